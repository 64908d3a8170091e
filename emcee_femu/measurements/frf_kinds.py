"""What an FRF is of: kinds, channels and lines."""

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats, Variable

# Times i omega, and the unit in SI.
KINDS = {
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
    unit: str | None = None,
    stored: bool = False,
) -> Variable:
    """Return what an FRF is: its dimensions and unit."""
    coords = {
        "channel": [channel.label for channel in channels],
        "line": lines.tolist(),
        "part": ["real", "imaginary"],
    }
    return Variable(coords, KINDS[kind][1] if unit is None else unit, stored)


def read_kind(kind: Any) -> str:
    """Return a kind of FRF."""
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"kind: expected one of {list(KINDS)}, got {kind!r}")
    return kind


def read_channels(channels: Any) -> tuple[Channel, ...]:
    """Return pairs of DOFs."""
    pairs = isinstance(channels, Sequence) and all(
        isinstance(pair, Sequence) and not isinstance(pair, str) and len(pair) == 2
        for pair in channels
    )
    if not pairs or isinstance(channels, str) or not len(channels):
        raise TypeError(
            f"channels: expected pairs (response DOF, excitation DOF), got {channels!r}"
        )
    found = tuple(Channel(*pair) for pair in channels)
    if len(set(found)) < len(found):
        raise ValueError(f"channels: expected each pair once, got {list(channels)}")
    return found


def read_lines(lines: ArrayLike) -> Floats:
    """Return lines in Hz, ascending."""
    numbers = checks.positive_array("lines", lines, 1)
    if not len(numbers) or (np.diff(numbers) <= 0).any():
        raise ValueError("lines: expected frequencies in ascending order, at least one")
    return numbers
