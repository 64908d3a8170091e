"""What is emulated: smooth numbers, in units of measurement error, of a response."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..interfaces import Floats, read
from .choose_modes import choose_modes
from .outputs_modes import read_modes
from .outputs_plain import Numbers, SignedShapes

Named = dict[str, Floats]


class Part(Protocol):
    """Some variables of a response as smooth numbers, and back."""

    @property
    def size(self) -> int:
        """How many numbers."""

    def encode(self, response: Any) -> Floats:
        """Return the numbers ``(n, size)`` of a response."""

    def decode(self, values: Floats) -> Named:
        """Return the variables, ``{variable: (n, *shape)}``."""

    def decode_slopes(
        self, values: Floats, directions: Floats, finite: bool = False
    ) -> tuple[Named, Named]:
        """Return them, and their slopes ``{variable: (n, *shape, k)}``.

        ``directions (n, size, k)`` are those along which the numbers move: as far as
        they are long if ``finite``, so that what has a root stays finite; otherwise
        slopes are derivatives.
        """


@dataclass(frozen=True, eq=False)
class Outputs:
    """The parts that together make a response; made by :func:`choose_outputs`."""

    parts: tuple[Part, ...]

    @property
    def size(self) -> int:
        """How many numbers are emulated."""
        return sum(part.size for part in self.parts)

    def encode(self, response: Any) -> Floats:
        """Return the numbers ``(n, size)``, in units of measurement error."""
        return np.hstack([part.encode(response) for part in self.parts])

    def decode(self, values: Floats) -> Named:
        """Return the response ``{variable: (n, *shape)}`` that has these numbers."""
        found: Named = {}
        for part, own in zip(self.parts, self._split(), strict=True):
            found |= part.decode(values[:, own])
        return found

    def decode_slopes(
        self, values: Floats, directions: Floats, finite: bool = False
    ) -> tuple[Named, Named]:
        """Return the response, and how it moves along directions ``(n, size, k)``.

        The slopes are ``{variable: (n, *shape, k)}``: derivatives, or if ``finite`` the
        moves as far as the directions are long.
        """
        response: Named = {}
        slopes: Named = {}
        for part, own in zip(self.parts, self._split(), strict=True):
            found, turned = part.decode_slopes(
                values[:, own], directions[:, own], finite
            )
            response |= found
            slopes |= turned
        return response, slopes

    def _split(self) -> list[slice]:
        ends = np.cumsum([0, *(part.size for part in self.parts)]).tolist()
        return [slice(*pair) for pair in zip(ends[:-1], ends[1:], strict=True)]


def choose_outputs(
    points: Floats,
    response: Any,
    units: Mapping[str, Floats],
    start: Floats | None = None,
) -> Outputs:
    """Return what to emulate of a response that was solved for at some points.

    Frequencies become eigenvalues, those of modes that cross one block of numbers that
    stay smooth (:func:`choose_modes`); all else stays as it is.

    Args:
        points: ``(N, d)`` coordinates of about unit spread.
        response: Its variables, each ``(N, *shape)``.
        units: Standard deviations of the measurement error, ``{variable: (*shape)}``,
            of every variable that is wanted; of frequencies in Hz. Shapes that are not
            wanted still tell which mode is which.
        start: Lengths to begin with.

    Raises:
        TypeError: If a variable is missing or is not made of real numbers.
        ValueError: If a variable is not finite, or its units have another shape.
    """
    parts: list[Part] = []
    scales = {}
    for name, unit in units.items():
        values = _check_values(name, read(response, name), len(points))
        scales[name] = _check_unit(name, unit, values.shape[1:])
    if "frequency" in scales and scales["frequency"].ndim == 1:
        modes = read_modes(response)
        units_of_modes = scales.pop("frequency"), scales.pop("shapes", None)
        parts.append(choose_modes(points, modes, units_of_modes, start))
    for name, unit in scales.items():
        if name == "shapes" and unit.ndim == 2:
            parts.append(SignedShapes.of(np.asarray(read(response, name)), unit))
        else:
            parts.append(Numbers(name, unit))
    return Outputs(tuple(parts))


def _check_values(name: str, values: Any, n: int) -> Floats:
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise TypeError(
            f"response: expected real numbers of {name!r} to emulate, got dtype "
            f"{array.dtype}; return the real and imaginary parts as two variables"
        )
    if array.ndim < 1 or len(array) != n:
        raise ValueError(
            f"response: expected {name!r} of {n} points, got shape {array.shape}"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"response: expected finite numbers of {name!r}")
    return array.astype(float)


def _check_unit(name: str, unit: Any, shape: tuple[int, ...]) -> Floats:
    try:
        scale = np.broadcast_to(np.asarray(unit, dtype=float), shape).copy()
    except ValueError:
        raise ValueError(
            f"units: expected those of {name!r} of shape {shape}, got {np.shape(unit)}"
        ) from None
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        raise ValueError(f"units: expected those of {name!r} above zero, got {unit!r}")
    return scale
