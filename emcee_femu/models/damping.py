"""Damping ratios of modes, as numbers or parameters."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from .. import checks
from ..interfaces import Floats, Parameters

PROPORTIONAL = ("mass", "stiffness")


class Damping(NamedTuple):
    r"""Ratios of each mode, or proportional damping.

    .. math:: \zeta_m = \zeta_m^0, \qquad \text{or} \qquad
        \zeta_m = \frac{a}{2 \omega_m} + \frac{b \omega_m}{2}

    Attributes:
        given: One per mode, or a and b: numbers, or names of parameters.
        proportional: Whether they are a and b.
    """

    given: tuple[float | str, ...]
    proportional: bool

    @classmethod
    def of(cls, damping: Any, n_modes: int) -> Self:
        """Return what a user gave.

        Raises:
            TypeError: If it is neither numbers nor names, nor a mapping of both.
            ValueError: If a number is negative, or there is not one per mode.
        """
        if isinstance(damping, Mapping):
            unknown = [key for key in damping if key not in PROPORTIONAL]
            if unknown or not damping:
                raise ValueError(
                    f"damping: expected {list(PROPORTIONAL)}, got {list(damping)}"
                )
            given = tuple(_read(damping.get(key, 0.0)) for key in PROPORTIONAL)
            return cls(given, True)
        if isinstance(damping, str) or np.ndim(damping) == 0:
            return cls((_read(damping),) * n_modes, False)
        if not isinstance(damping, Sequence | np.ndarray) or len(damping) != n_modes:
            raise ValueError(
                f"damping: expected one number or name, or one for each of {n_modes} "
                f"modes, or {{'mass': a, 'stiffness': b}}, got {damping!r}"
            )
        return cls(tuple(_read(one) for one in damping), False)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters among them."""
        return tuple(dict.fromkeys(one for one in self.given if isinstance(one, str)))

    def __call__(self, parameters: Parameters, f: Floats) -> Floats:
        """Return the ratios ``(n, modes)`` of modes of frequencies f in Hz."""
        values = [
            parameters[one] if isinstance(one, str) else np.full(len(f), one)
            for one in self.given
        ]
        numbers = np.stack(values, axis=1)
        if not self.proportional:
            return numbers
        w = 2 * np.pi * f
        ratios: Floats = numbers[:, :1] / (2 * w) + numbers[:, 1:] * w / 2
        return ratios

    def slope(self, parameters: Parameters, name: str, f: Floats, df: Floats) -> Floats:
        """Return their derivatives by a parameter, which changes f by ``df``."""
        own = np.array([one == name for one in self.given], dtype=float)
        if not self.proportional:
            return np.tile(own, (len(f), 1))
        w, dw = 2 * np.pi * f, 2 * np.pi * df
        a, b = (
            parameters[one][:, None] if isinstance(one, str) else one
            for one in self.given
        )
        slopes: Floats = own[0] / (2 * w) + own[1] * w / 2
        slopes = slopes + (b / 2 - a / (2 * w * w)) * dw
        return slopes


def _read(value: Any) -> float | str:
    """Return a ratio or factor, or the name of a parameter."""
    if isinstance(value, str):
        return checks.parameter_names("damping", [value])[0]
    return checks.real_number("damping", value, 0.0)
