"""Measured frequency response functions."""

from __future__ import annotations

import warnings
from collections.abc import Hashable, Sequence
from copy import copy
from os import PathLike
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import checks
from ...contracts import Floats, Variable
from ...measurements.directions import along_axis
from ...measurements.universal import Nodes
from ...table import Column, Parts, Report, Table
from .uff import place_channels, read_uff58

# Power of i omega relative to receptance, and the SI unit.
FRF_KINDS = {
    "receptance": (0, "m/N"),
    "mobility": (1, "m/(N s)"),
    "accelerance": (2, "m/(N s2)"),
}


class Channel(NamedTuple):
    """What is measured and where the force acts: labels of DOFs."""

    response: Hashable
    excitation: Hashable

    @property
    def label(self) -> str:
        """Its name, such as ``roof/floor``."""
        return f"{self.response}/{self.excitation}"


def frf_variable(
    channels: Sequence[Channel],
    lines: Floats,
    kind: str,
    unit: str | None,
    stored: bool = False,
) -> Variable:
    """Return dimensions and unit of an FRF."""
    coords = {
        "channel": [channel.label for channel in channels],
        "line": lines.tolist(),
        "part": ["real", "imaginary"],
    }
    return Variable(coords, FRF_KINDS[kind][1] if unit is None else unit, stored)


def read_channels(
    channels: Sequence[tuple[Hashable, Hashable]],
) -> tuple[tuple[Channel, ...], Floats]:
    """Return pairs of DOFs along the axes, and the sign of each pair as given."""
    form = "pairs (response DOF, excitation DOF)"
    if not (given := checks.sequence("channels", channels, form)):
        raise TypeError(f"channels: expected at least one of {form}, got none")
    pairs = [checks.group("channels", pair, form, 2) for pair in given]
    turned = [[along_axis(dof) for dof in pair] for pair in pairs]
    result = tuple(Channel(*(dof for dof, _ in pair)) for pair in turned)
    if len(set(result)) < len(result):
        raise ValueError(f"channels: expected each pair once, got {given}")
    return result, np.array([first[1] * second[1] for first, second in turned])


def read_lines(lines: ArrayLike) -> Floats:
    """Return lines in Hz, ascending."""
    numbers = checks.positive_array("lines", lines, 1)
    if not len(numbers) or (np.diff(numbers) <= 0).any():
        raise ValueError("lines: expected frequencies in ascending order, at least one")
    return numbers


class FRFMeasurements(Report):
    r"""Measured frequency response functions (FRFs) of channels on the same lines.

    .. math:: s_{cl} = |H_{cl}| \sqrt{\frac{1 - \gamma_{cl}^2}{2 n_d \gamma_{cl}^2}}

    is the standard deviation of the real and of the imaginary part of an H1 estimate
    with ordinary coherence :math:`\gamma^2` from :math:`n_d` independent averages;
    :math:`s / |H|` is that of the logarithm of the amplitude and of the phase in
    radians. Pass the measurements to an :class:`FRFTerm`. Overlapping averages are not
    independent: with a Hann window and 50 % overlap, use 0.95 times the number of
    segments.

    Args:
        lines: Frequencies in Hz, ascending, ``(n_lines,)``. A line at 0 Hz, with which
            analysers usually begin, is left out.
        values: Complex FRFs ``(n_channels, n_lines)``.
        channels: Pairs ``(response DOF, excitation DOF)``, with the labels of the
            model. For a direction against the axis, ``"2:-ux"``, the sign of the values
            is reversed, and the channel is renamed ``"2:ux"``.
        kind: "receptance", "mobility" or "accelerance".
        coherence: Ordinary coherence, above 0 and below 1, in the shape of values; None
            if unknown.
        averages: Number of independent averages; required with coherence.
        unit: Unit of the values, if it is not SI.

    Attributes:
        sd: Standard deviation of real and imaginary part, ``(n_channels, n_lines)``;
            None without a coherence.

    Raises:
        TypeError: If values are not numbers, or channels are not pairs.
        ValueError: If sizes do not match, a number is not finite, lines are not
            ascending, kind is unknown, a coherence is out of range, or only one of
            coherence and averages is given.

    Warns:
        UserWarning: If a line at 0 Hz is left out.

    Source: Bendat and Piersol, Random Data, 4th ed. (2010), section 9.2.

    Examples:
        >>> from emcee_femu.extensions.frf import FRFMeasurements
        >>> H, quality = [[1 - 1j, -2j]], {"coherence": [[0.8, 0.5]], "averages": 50}
        >>> channels = [("1:z", "1:z")]
        >>> frf = FRFMeasurements([9, 10], H, channels, kind="receptance", **quality)
        >>> frf.sd.round(3).tolist()
        [[0.071, 0.2]]
        >>> frf.between(9.5, 12.0).lines.tolist()
        [10.0]
    """

    def __init__(
        self,
        lines: ArrayLike,
        values: ArrayLike,
        channels: Sequence[tuple[Hashable, Hashable]],
        *,
        kind: str,
        coherence: ArrayLike | None = None,
        averages: int | None = None,
        unit: str | None = None,
    ) -> None:
        pairs, signs = read_channels(channels)
        hertz = checks.real_array("lines", lines, 1)
        H = np.asarray(checks.complex_array("values", values), dtype=np.complex128)
        if len(hertz) and hertz[0] == 0:
            warnings.warn(
                "lines: 0 Hz is left out, where an analyser has an offset and no FRF",
                stacklevel=2,
            )
            hertz, H = hertz[1:], np.atleast_1d(H)[..., 1:]
            if coherence is not None:
                coherence = np.atleast_1d(coherence)[..., 1:]
        numbers = read_lines(hertz)
        shape = (len(pairs), len(numbers))
        checks.shaped("values", H.shape, shape, remedy="one for each channel and line")
        if (wrong := ~np.isfinite(H)).any():
            i, j = np.argwhere(wrong)[0].tolist()
            raise ValueError(
                f"values: expected finite numbers, got {H[i, j]:g} of channel "
                f"{pairs[i].label} at {numbers[j]:g} Hz; leave such lines out"
            )
        self.sd: Floats | None = None
        if (coherence is None) != (averages is None):
            raise ValueError("coherence, averages: expected both or none of them")
        if coherence is not None:
            coherence = checks.positive_array("coherence", coherence, 2)
            if coherence.shape != shape or (coherence >= 1).any():
                raise ValueError(
                    f"coherence: expected numbers below 1 of shape {shape}, got shape "
                    f"{coherence.shape}, up to {coherence.max(initial=0):g}; where it "
                    "is rounded to 1, leave it and averages out: FRFTerm(..., sd=...)"
                )
            averages = checks.whole_number("averages", averages, 2)
            relative = np.sqrt((1 / coherence - 1) / (2 * averages))
            self.sd = np.abs(H) * relative
        if unit is not None:
            checks.text("unit", unit)
        self.lines, self.channels = numbers, pairs
        self.values = H * signs[:, None]
        self.kind = checks.one_of("kind", kind, FRF_KINDS)
        self.coherence, self.averages, self.unit = coherence, averages, unit

    @classmethod
    def from_uff(
        cls,
        path: str | PathLike[str],
        *,
        averages: int | None = None,
        between: tuple[float, float] | None = None,
        kind: str | None = None,
        nodes: Nodes | None = None,
        axes: str | None = None,
    ) -> Self:
        """Read FRFs and coherences from the data sets 58 of a universal file.

        DOFs are labelled as in :meth:`Measurements.from_uff`, ``"12:z"``, or ``"12"``
        if the file gives no direction. With ``nodes`` they are
        DOFs of the model, ``"3:uz"``, or combinations of them, ``"0.8*3:ux +
        0.6*3:uz"``: give the model ``shapes=measured.dofs``. A direction against the
        axis reverses the sign. The kind follows from the ordinate: displacement,
        velocity or acceleration over force. Values are converted to SI from the units
        of the file (data set 164). Text and binary data sets (58b) are read. Requires
        the extra ``uff``.

        Args:
            path: The universal file.
            averages: Number of independent averages, which a file does not hold.
                Without it, coherences are not read.
            between: Lowest and highest line in Hz, both included; None for all. Other
                lines are not checked.
            kind: "receptance", "mobility" or "accelerance", if the file does not give
                it: some analysers write the type of the ordinate as unknown.
            nodes: ``{node of the file: node of the model}``, as in
                :meth:`Measurements.from_uff`; channels at other nodes are left out.
            axes: "own" or "global", where nodes have axes of their own, as there.

        Returns:
            The FRFs of all channels, with their coherences.

        Raises:
            ImportError: If pyuff is not installed.
            ValueError: If there are no FRFs, or they differ in lines or kind; or nodes
                are given where a channel has no direction, or its axes are not known,
                or may be those of its node or global ones.

        Warns:
            UserWarning: If a line at 0 Hz is left out, values are converted to SI, or,
                without nodes and axes, nodes have axes of their own.

        Examples:
            >>> from emcee_femu.extensions.frf import FRFMeasurements
            >>> frf = FRFMeasurements.from_uff("a.uff", averages=50)  # doctest: +SKIP
            >>> band = (20.0, 80.0)
            >>> laser = FRFMeasurements.from_uff(
            ...     "b.uff", between=band, kind="mobility"
            ... )  # doctest: +SKIP
        """
        checks.one_of("kind", kind, [None, *FRF_KINDS])
        fields = read_uff58(path, averages, kind)
        place_channels(path, fields, nodes, axes)
        if between is not None:
            low, high = checks.group("between", between, "(low, high) in Hz", 2)
            kept = _find_lines(fields["lines"], low, high)
            for name in fields.keys() & {"lines", "values", "coherence"}:
                fields[name] = fields[name][..., kept]
        return cls(**fields)

    def _parts(self) -> Parts:
        size = np.abs(self.values)
        columns: list[Column] = [
            ("response", "", [str(channel.response) for channel in self.channels]),
            ("excitation", "", [str(channel.excitation) for channel in self.channels]),
            ("largest", ".3g", size.max(axis=1)),
            ("at Hz", ".4g", self.lines[size.argmax(axis=1)]),
        ]
        if self.coherence is not None:
            columns.append(("coherence", ".3f", np.median(self.coherence, axis=1)))
        yield Table.from_columns(
            f"{self.kind.capitalize()} at {len(self.lines)} lines, "
            f"{self.lines[0]:.4g} to {self.lines[-1]:.4g} Hz"
            + ("" if self.averages is None else f", {self.averages} averages"),
            columns,
        )

    @property
    def dofs(self) -> tuple[Hashable, ...]:
        """The DOFs of all channels, each once, as a model needs for ``shapes=``."""
        return tuple(dict.fromkeys(dof for channel in self.channels for dof in channel))

    def between(self, low: float, high: float) -> FRFMeasurements:
        """Return the lines from ``low`` to ``high`` Hz, both included."""
        kept = _find_lines(self.lines, low, high)
        part = copy(self)
        part.lines, part.values = self.lines[kept], self.values[:, kept]
        if self.coherence is not None and self.sd is not None:
            part.coherence, part.sd = self.coherence[:, kept], self.sd[:, kept]
        return part


def _find_lines(lines: Floats, low: float, high: float) -> NDArray[np.bool_]:
    """Return which lines are within limits, at least one."""
    low, high = checks.real_number("low", low), checks.real_number("high", high)
    kept = (lines >= low) & (lines <= high)
    if not kept.any():
        raise ValueError(
            f"low, high: no line between {low:g} and {high:g} Hz; they are "
            f"{lines[0]:g} to {lines[-1]:g}"
        )
    return np.asarray(kept)
