"""The likelihood of measured displacements."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats, Parameters, Variable, read
from .normal import LEAST_SD, linearize_normal


@dataclass(frozen=True, eq=False, init=False)
class DisplacementTerm:
    r"""Gaussian errors of the displacements of a static test.

    .. math:: \ln p = \sum_{c,i} \ln N(u_{ci} - u_{ci}^m; 0, v_{ci}), \qquad
        v_{ci} = \sigma_{ci}^2 + (\sigma_d u_{ci}^m)^2

    over load cases c and points i. :math:`\sigma_d` is the relative standard deviation
    of what the model cannot represent; give the name of a parameter as ``discrepancy``
    and a proper prior to infer it, as for a :class:`FrequencyTerm`.

    Args:
        measured: Measured displacements ``(cases, points)``, in the unit of the model.
        sd: Their standard deviations in that unit: one number, one per point, or
            ``(cases, points)``.
        relative_sd: Instead: standard deviations over the measured displacements.
        discrepancy: Name of the parameter :math:`\sigma_d`, or None for no such part.
        cases: Names of the load cases, which the model's are then held against; None
            where they correspond in order.
        points: Labels of the points, likewise.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If not exactly one of sd and relative_sd is given (none at all is
            possible with discrepancy).
        ValueError: If a number is not finite, a standard deviation not above zero, a
            relative one belongs to a displacement of zero, or shapes disagree.

    Source: Simoen, De Roeck and Lombaert (2015), doi:10.1016/j.ymssp.2014.11.001, for
    errors of measurement and model side by side.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import DisplacementTerm
        >>> term = DisplacementTerm([[0.5, 2.5]], sd=0.1)
        >>> term({}, {"displacement": np.array([[[0.5, 2.6]]])}).round(4).tolist()
        [2.2673]
    """

    measured: Floats
    sd: Floats  # of the measurement, (cases, points); zero if exact
    discrepancy: str | None
    name: str
    reads: Mapping[str, Variable] = field(repr=False)

    def __init__(
        self,
        measured: ArrayLike,
        *,
        sd: ArrayLike | None = None,
        relative_sd: ArrayLike | None = None,
        discrepancy: str | None = None,
        cases: Sequence[str] | None = None,
        points: Sequence[Hashable] | None = None,
        name: str = "displacement",
    ) -> None:
        u = checks.real_array("measured", measured, 2)
        if not u.size:
            raise ValueError("measured: expected at least one displacement, got none")
        for label, text in (("name", name), ("discrepancy", discrepancy)):
            left_out = label == "discrepancy" and text is None
            if not left_out and (not isinstance(text, str) or not text):
                raise TypeError(f"{label}: expected a non-empty string, got {text!r}")
        possible = {"sd": sd, "relative_sd": relative_sd}
        given = {label: v for label, v in possible.items() if v is not None}
        if len(given) > 1 or not (given or discrepancy):
            raise TypeError(
                "sd, relative_sd: expected exactly one of them, or a discrepancy "
                f"alone, got {list(given) or 'none'}"
            )
        spread = np.zeros(u.shape)
        for label, value in given.items():
            numbers = checks.positive_array(label, value)
            if numbers.shape not in ((), u.shape[1:], u.shape):
                raise ValueError(
                    f"{label}: expected one number, one per point {u.shape[1:]} or "
                    f"{u.shape}, got shape {numbers.shape}"
                )
            spread = spread + numbers * (np.abs(u) if label == "relative_sd" else 1.0)
        if not (spread > 0).all() and (given or not u.all()):
            raise ValueError(
                "measured: a displacement of zero has no relative error; give sd"
            )
        shape = zip(("cases", "points"), (cases, points), u.shape, strict=True)
        labels = [_read_labels(*one) for one in shape]
        coords = dict(zip(("load_case", "point"), labels, strict=True))
        checks.set_fields(
            self,
            measured=u,
            sd=spread,
            discrepancy=discrepancy,
            name=name,
            reads={"displacement": Variable(coords)},
        )

    @property
    def observed(self) -> Mapping[str, Floats]:
        """What was measured, by the name of the variable."""
        return {"displacement": self.measured}

    @property
    def error_sd(self) -> Mapping[str, Floats]:
        """Standard deviations of what was measured; 0 if exact."""
        return {"displacement": self.sd}

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
        log_likelihood: Floats = _log_normal(r, sd).sum(axis=1)
        return log_likelihood

    def deviations(
        self, parameters: Parameters, response: Any
    ) -> tuple[Floats, Floats]:
        """Return deviations and their standard deviations, ``(n, m)`` each."""
        cases, points = self.measured.shape
        u = read(response, "displacement")[:, :cases, :points]
        r = np.ascontiguousarray(u - self.measured).reshape(len(u), -1)
        variances = self.sd.ravel() ** 2
        if self.discrepancy is not None:
            sigma = parameters[self.discrepancy][:, None]
            variances = variances + (sigma * self.measured.ravel()) ** 2
            variances = np.maximum(variances, LEAST_SD**2)
        return r, np.broadcast_to(np.sqrt(variances), r.shape)

    def linearize(
        self, parameters: Parameters, response: Any, tangents: Mapping[str, Floats]
    ) -> tuple[Floats, Floats]:
        """Return the gradient of the log-likelihood, and its scores."""
        r, sd = self.deviations(parameters, response)
        cases, points = self.measured.shape
        slopes = tangents["displacement"][:, :cases, :points]
        slopes = slopes.reshape(*r.shape, -1)
        if self.discrepancy is None:
            return linearize_normal(r, sd, slopes)
        sigma = parameters[self.discrepancy][:, None]
        by_sigma = (sigma * self.measured.ravel() ** 2 / sd)[:, :, None]
        d_sd = by_sigma * tangents[self.discrepancy][:, None]
        return linearize_normal(r, sd, slopes, d_sd)

    def pointwise(
        self, parameters: Parameters, stored: Mapping[str, Floats]
    ) -> dict[str, Floats]:
        """Return each displacement's log-likelihood ``(n, cases, points)``."""
        values = _log_normal(*self.deviations(parameters, stored))
        return {"displacement": values.reshape(-1, *self.measured.shape)}

    def replicate(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        stored: Mapping[str, Floats],
    ) -> dict[str, Floats]:
        """Return a new measurement for each sample, with all its errors."""
        r, sd = self.deviations(parameters, stored)
        r = r + sd * rng.standard_normal(r.shape)
        return {"displacement": self.measured + r.reshape(-1, *self.measured.shape)}


def _log_normal(r: Floats, sd: Floats) -> Floats:
    with np.errstate(over="ignore"):  # so far off the likelihood is zero
        values: Floats = -0.5 * ((r / sd) ** 2 + np.log(2 * np.pi * sd**2))
    return values


def _read_labels(argument: str, labels: Any, size: int) -> list[Any]:
    """Return one label for each, None where they are known by their places."""
    if labels is None:
        return [None] * size
    if isinstance(labels, Mapping | set) or np.ndim(labels) != 1:
        raise TypeError(f"{argument}: expected a sequence of labels, got {labels!r}")
    result = np.asarray(labels, dtype=object).tolist()
    if len(result) != size or len(set(result)) != size:
        raise ValueError(
            f"{argument}: expected {size} labels, each another, got {result}"
        )
    return list(result)
