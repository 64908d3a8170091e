"""The likelihood of measured frequency response functions."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats, Parameters, Variable, read
from ..measurements.frf import FRFMeasurements
from ..measurements.frf_kinds import frf_variable
from .normal import LEAST_SD, linearize_normal


@dataclass(frozen=True, eq=False, init=False)
class FRFTerm:
    r"""Gaussian errors of frequency response functions, line by line.

    .. math:: \ln p = \sum_{cl} \ln N(\mathrm{Re}\,\Delta_{cl}; 0, v_{cl})
        + \ln N(\mathrm{Im}\,\Delta_{cl}; 0, v_{cl}), \qquad
        v_{cl} = s_{cl}^2 + (\sigma_d |H_{cl}^m|)^2

    with :math:`\Delta = H - H^m` of channel c at line l. With ``amplitude=True`` the
    logarithm of the amplitude is compared instead,

    .. math:: \ln p = \sum_{cl} \ln N\Big( \ln \frac{|H_{cl}|}{|H_{cl}^m|}; 0,
        \frac{s_{cl}^2}{|H_{cl}^m|^2} + \sigma_d^2 \Big)

    for phases that are not trusted; by it antiresonances weigh as much as resonances.
    The lines must be independent: those of averaged FFTs without zero padding are.

    Args:
        measured: :class:`FRFMeasurements`.
        sd: s, of the real and of the imaginary part: one number, one per channel
            ``(n_channels, 1)``, or ``(n_channels, n_lines)``; None for that of the
            coherence.
        amplitude: Whether only amplitudes are compared.
        discrepancy: Name of the parameter :math:`\sigma_d`, what the model cannot
            represent relative to the amplitude; None for no such part.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If measured is not FRFMeasurements.
        ValueError: If the error is not known, sd not above zero or of another shape, or
            only magnitudes are known, of which ``amplitude`` is to be taken.

    Source: Bendat and Piersol, Random Data, 4th ed. (2010), section 9.2.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import FRFMeasurements, FRFTerm
        >>> measured = FRFMeasurements([9.0], [[2j]], [("a", "b")], kind="receptance")
        >>> term = FRFTerm(measured, sd=0.1)
        >>> term({}, {"receptance": np.array([[[[0.0, 2.1]]]])}).round(4).tolist()
        [2.2673]
    """

    measured: FRFMeasurements
    sd: Floats  # (n_channels, n_lines); zero if exact
    amplitude: bool
    discrepancy: str | None
    name: str
    reads: Mapping[str, Variable] = field(repr=False)

    def __init__(
        self,
        measured: FRFMeasurements,
        *,
        sd: ArrayLike | None = None,
        amplitude: bool = False,
        discrepancy: str | None = None,
        name: str = "frf",
    ) -> None:
        if not isinstance(measured, FRFMeasurements):
            raise TypeError(
                f"measured: expected FRFMeasurements, got {type(measured).__name__}"
            )
        for label, text in (("name", name), ("discrepancy", discrepancy)):
            left_out = label == "discrepancy" and text is None
            if not left_out and (not isinstance(text, str) or not text):
                raise TypeError(f"{label}: expected a non-empty string, got {text!r}")
        if not (checks.flag("amplitude", amplitude) or measured.values.imag.any()):
            raise ValueError(
                "measured: expected complex values with their phases, got real ones "
                "alone; of magnitudes take FRFTerm(..., amplitude=True)"
            )
        shape = measured.values.shape
        spread = measured.sd
        if sd is not None:
            spread = checks.positive_array("sd", sd)
            if spread.shape not in ((), (shape[0], 1), shape):
                raise ValueError(
                    f"sd: expected one number, {(shape[0], 1)} or {shape}, got shape "
                    f"{spread.shape}"
                )
        elif spread is None and discrepancy is None:
            raise ValueError(
                "sd: the measurements have no coherence; give sd, or a discrepancy"
            )
        kind, unit = measured.kind, measured.unit
        reads = frf_variable(measured.channels, measured.lines, kind, unit)
        spread = np.zeros(shape) if spread is None else np.broadcast_to(spread, shape)
        checks.set_fields(
            self,
            measured=measured,
            sd=spread,
            amplitude=checks.flag("amplitude", amplitude),
            discrepancy=discrepancy,
            name=name,
            reads={kind: reads},
        )

    @property
    def names(self) -> tuple[str, ...]:
        """The discrepancy, where there is one, the only parameter that is read."""
        return () if self.discrepancy is None else (self.discrepancy,)

    @property
    def positive(self) -> tuple[str, ...]:
        """All parameters of the term, which must stay above zero."""
        return self.names

    def __call__(self, parameters: Parameters, response: Any) -> Floats:
        """Return the log-likelihood of every parameter set, ``(n,)``."""
        r, sd = self.deviations(parameters, response)
        with np.errstate(over="ignore"):  # so far off the likelihood is zero
            values = (r / sd) ** 2
        values += np.log(2 * np.pi * sd**2)
        log_likelihood: Floats = -0.5 * values.sum(axis=1)
        return log_likelihood

    def deviations(
        self, parameters: Parameters, response: Any
    ) -> tuple[Floats, Floats]:
        """Return deviations and their standard deviations, ``(n, m)`` each."""
        H = self._cut(read(response, self.measured.kind))
        size = np.abs(self.measured.values)
        scale = np.ones_like(size) if self.amplitude else size
        if self.amplitude:
            with np.errstate(divide="ignore"):  # an FRF of 0 is impossible, not wrong
                r = 0.5 * np.log((H**2).sum(axis=-1)) - np.log(size)
            r, variances = r[..., None], (self.sd / size) ** 2
        else:
            values = self.measured.values
            r = H - np.stack([values.real, values.imag], axis=-1)
            variances = self.sd**2
        if self.discrepancy is not None:
            sigma = parameters[self.discrepancy][:, None, None]
            variances = np.maximum(variances + (sigma * scale) ** 2, LEAST_SD**2)
        sd = np.broadcast_to(np.sqrt(variances)[..., None], r.shape)
        return r.reshape(len(r), -1), sd.reshape(len(r), -1)

    def linearize(
        self, parameters: Parameters, response: Any, tangents: Mapping[str, Floats]
    ) -> tuple[Floats, Floats]:
        """Return the gradient of the log-likelihood, and its scores."""
        r, sd = self.deviations(parameters, response)
        slopes = self._cut(tangents[self.measured.kind])
        if self.amplitude:
            H = self._cut(read(response, self.measured.kind))
            slopes = (H[..., None] * slopes).sum(axis=3)
            slopes = slopes / (H**2).sum(axis=-1)[..., None]
        slopes = slopes.reshape(*r.shape, -1)
        if self.discrepancy is None:
            return linearize_normal(r, sd, slopes)
        scale = np.ones(r.shape[1])
        if not self.amplitude:
            scale = np.repeat(np.abs(self.measured.values).ravel(), 2)
        by_sigma = parameters[self.discrepancy][:, None] * scale**2 / sd
        d_sd = by_sigma[:, :, None] * tangents[self.discrepancy][:, None]
        return linearize_normal(r, sd, slopes, d_sd)

    def _cut(self, values: Any) -> Floats:
        """Return the channels and lines that were measured, the first of the model."""
        channels, lines = self.measured.values.shape
        cut: Floats = values[:, :channels, :lines]
        return cut
