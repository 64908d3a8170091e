r"""Coordinates in which flexibilities, not stiffnesses, move along straight lines.

With ``c = about``, the coordinate of a parameter is ``q = c (2 - c / theta)``: the
reciprocal, scaled such that q and theta have the same value and slope at c. A metric
that fits theta about there fits q too. Where c is zero, and for ``about=None``, q is
theta. It maps all of the line but zero onto all of it but one point, so that no
trajectory leaves it; the density of q is that of theta times ``(theta / c)^2``.
"""

import numpy as np

from ..interfaces import Floats


def shift(theta: Floats, change: Floats, about: Floats | None) -> Floats:
    """Return theta ``(n, d)`` after a change of q."""
    if about is None:
        return theta + change
    own = about != 0
    square = np.where(own, about, 1.0) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):  # at infinity: it ends there
        result: Floats = np.where(
            own, theta / (1 - theta / square * change), theta + change
        )
    return result


def slope(theta: Floats, gradient: Floats, about: Floats | None) -> Floats:
    """Return the gradient of the log density of q, from that of theta ``(n, d)``."""
    if about is None:
        return gradient
    own = about != 0
    square = np.where(own, about, 1.0) ** 2
    result: Floats = np.where(own, theta / square * (theta * gradient + 2), gradient)
    return result


def log_volume(theta: Floats, about: Floats | None) -> Floats:
    """Return by what the log density of q exceeds that of theta, ``(n,)``."""
    if about is None:
        return np.zeros(len(theta))
    own = about != 0
    with np.errstate(divide="ignore"):
        result: Floats = 2 * np.log(np.abs(theta[:, own] / about[own])).sum(axis=1)
    return result
