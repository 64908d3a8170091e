"""Measured spectra: FFTs of ambient vibration near one mode or a close pair."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats
from ..table import Parts, Report, Table
from .frf import read_kind, read_lines
from .modes import labels

KINDS = {"acceleration": 0, "velocity": 1, "displacement": 2}  # over i omega, powers


class Spectra(Report):
    r"""Spectral matrices of a record in a band, raw or averaged over segments.

    .. math:: D_k = \frac1{n_d} \sum_s F_{sk} F_{sk}^H, \qquad F_{sk} =
        \sqrt{\frac{2 \Delta t}{N}} \sum_{j=0}^{N-1} x_{sj} e^{-2 \pi i j k / N}

    of the :math:`n_d` segments of N samples each: the expectation of D is the one-sided
    power spectral density, in the square of the record's unit per Hz. One segment, the
    whole record, tells most: a segment resolves 1 / (N dt) Hz, which must be a small
    part of the mode's width, :math:`2 \zeta f`.

    Args:
        lines: Frequencies in Hz, ascending, ``(n_lines,)``, without 0 Hz and the
            Nyquist frequency.
        matrices: D, Hermitian, ``(n_lines, n_channels, n_channels)``.
        averages: The number of independent segments :math:`n_d`.
        sensors: Labels of the channels; None for s1, s2, ...
        kind: What was recorded: "acceleration", "velocity" or "displacement".

    Attributes:
        psd: The spectral densities of the channels, ``(n_lines, n_channels)``.

    Raises:
        TypeError: If an argument does not hold numbers or labels.
        ValueError: If sizes disagree, a number is not finite, a matrix is not Hermitian
            with a diagonal above zero, lines do not ascend, or kind is none.

    Source: Au, Operational Modal Analysis (2017), doi:10.1007/978-981-10-4118-1.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu.spectra import Spectra
        >>> record = np.random.default_rng(1).standard_normal((1000, 2))
        >>> spectra = Spectra.from_record(record, 20.0, (3.0, 5.0), averages=4)
        >>> spectra.matrices.shape, bool(abs(spectra.psd.mean() - 0.1) < 0.02)
        ((25, 2, 2), True)
    """

    def __init__(
        self,
        lines: ArrayLike,
        matrices: ArrayLike,
        *,
        averages: int,
        sensors: Sequence[str] | None = None,
        kind: str = "acceleration",
    ) -> None:
        numbers = read_lines(lines)
        D = np.asarray(checks.complex_array("matrices", matrices), dtype=np.complex128)
        square = D.ndim == 3 and D.shape[1] == D.shape[2] > 0
        if not square or len(D) != len(numbers) or not np.isfinite(D).all():
            raise ValueError(
                f"matrices: expected ({len(numbers)}, n_channels, n_channels), one "
                f"matrix of finite numbers for each line, got {D.shape}"
            )
        self.psd: Floats = np.diagonal(D, axis1=1, axis2=2).real
        asymmetry = np.abs(D - D.conj().swapaxes(1, 2)).max()
        if not (self.psd > 0).all() or asymmetry > 1e-8 * self.psd.max():
            raise ValueError(
                "matrices: expected Hermitian ones with a diagonal above zero, the "
                "mean of F F^H over segments"
            )
        self.lines, self.matrices = numbers, D
        self.averages = checks.whole_number("averages", averages, 1)
        self.sensors = labels(sensors, D.shape[1])
        self.kind = read_kind(kind, KINDS)

    @classmethod
    def from_record(
        cls,
        record: ArrayLike,
        rate: float,
        band: tuple[float, float],
        *,
        averages: int = 1,
        sensors: Sequence[str] | None = None,
        kind: str = "acceleration",
    ) -> Self:
        """Transform a record, without a window, and keep the lines of a band.

        Args:
            record: ``(samples, channels)``.
            rate: Samples per second.
            band: Lowest and highest line in Hz. Some six half widths of the mode to
                either side, ``f (1 - 6 zeta)`` to ``f (1 + 6 zeta)``, use most of what
                the record tells; other modes must be far from it.
            averages: Into how many segments the record is cut; a rest is left out.
            sensors: Labels of the channels.
            kind: What was recorded.

        Returns:
            The spectral matrices of the band.

        Raises:
            TypeError: If an argument is no number, or record no array of them.
            ValueError: If the record has fewer samples than channels, a channel does
                not move, or there are fewer than four lines between 0 Hz and half the
                rate in the band.

        Examples:
            >>> import numpy as np
            >>> from emcee_femu.spectra import Spectra
            >>> record = np.random.default_rng(1).standard_normal((1000, 2))
            >>> spectra = Spectra.from_record(record, rate=20.0, band=(3.0, 5.0))
            >>> spectra.lines[[0, 1, -1]].round(6).tolist()
            [3.0, 3.02, 5.0]
        """
        x = checks.real_array("record", record, 2)
        number = checks.positive_array("rate", rate, 0).item()
        averages = checks.whole_number("averages", averages, 1)
        if len(x) <= x.shape[1] or not x.shape[1]:
            raise ValueError(
                f"record: expected (samples, channels), got {x.shape}; transpose it"
            )
        still = np.flatnonzero(np.ptp(x, axis=0) == 0)
        if len(still):
            raise ValueError(f"record: channel {still[0] + 1} does not move")
        limits = checks.real_array("band", band, 1)
        if limits.shape != (2,):
            raise ValueError(f"band: expected (low, high) in Hz, got {band!r}")
        N = len(x) // averages
        segments = x[: N * averages].reshape(averages, N, -1)
        lines = np.arange(N // 2 + 1) * number / N
        kept = (lines >= limits[0]) & (lines <= limits[1])
        kept &= (lines > 0) & (2 * np.arange(len(lines)) < N)
        if kept.sum() < 4:
            raise ValueError(
                f"band: expected at least 4 lines between {limits[0]:g} and "
                f"{limits[1]:g} Hz, got {kept.sum()}; segments of {N} samples resolve "
                f"{number / max(N, 1):.3g} Hz up to {number / 2:g} Hz"
            )
        F = np.fft.rfft(segments, axis=1)[:, kept] * np.sqrt(2 / (number * N))
        D = np.einsum("ski,skj->kij", F, F.conj()) / averages
        return cls(lines[kept], D, averages=averages, sensors=sensors, kind=kind)

    def _parts(self) -> Parts:
        yield Table.from_columns(
            f"Spectra of {self.kind}: {len(self.lines)} lines, {self.lines[0]:.4g} to "
            f"{self.lines[-1]:.4g} Hz, averages: {self.averages}",
            [
                ("sensor", "", list(self.sensors)),
                ("largest psd", ".3g", self.psd.max(axis=0)),
                ("at Hz", ".4g", self.lines[self.psd.argmax(axis=0)]),
            ],
        )
