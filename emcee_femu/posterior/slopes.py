"""Derivatives of the log-densities of scipy.stats' marginals."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..interfaces import Floats


def _over(number: float, z: Floats) -> Floats:
    """Return their ratio, which a power of zero leaves at zero on the bound too."""
    ratio: Floats = number / z if number else 0.0 * z
    return ratio


# d ln p / dz at loc = 0 and scale = 1, by the shape parameters; scipy has none.
STANDARD: dict[str, Callable[..., Any]] = {
    "norm": lambda z: -z,
    "halfnorm": lambda z: -z,
    "truncnorm": lambda z, a, b: -z,
    "uniform": lambda z: 0.0 * z,
    "expon": lambda z: 0.0 * z - 1.0,
    "lognorm": lambda z, s: -(1.0 + np.log(z) / s**2) / z,
    "t": lambda z, df: -(df + 1.0) * z / (df + z**2),
    "gamma": lambda z, a: _over(a - 1.0, z) - 1.0,
    "invgamma": lambda z, a: (1.0 / z - a - 1.0) / z,
    "beta": lambda z, a, b: _over(a - 1.0, z) - _over(b - 1.0, 1.0 - z),
}


def slope(marginal: Any, x: Floats) -> Floats | None:
    """Return d ln p / dx ``(n,)`` of a frozen marginal; None if it is not known."""
    name = getattr(getattr(marginal, "dist", None), "name", None)
    if name not in STANDARD:
        return None
    shapes, loc, scale = marginal.dist._parse_args(*marginal.args, **marginal.kwds)
    derivative: Floats = STANDARD[name]((x - loc) / scale, *shapes) / scale
    return derivative
