"""Leapfrog trajectories of many walkers, which end where the density does."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from .reciprocals import log_volume, shift, slope

# Points (k, d) to the posterior's rows (k, columns) and gradients (k, d).
Evaluate: TypeAlias = Callable[[Floats], tuple[Floats, Floats]]


class Points(NamedTuple):
    """Where walkers are on their trajectories.

    Attributes:
        walkers: Which of the walkers, ``(k,)``; the trajectories of others have ended.
        coords: Positions, ``(k, d)``.
        momenta: Standardised momenta, ``(k, d)``: normal with unit covariance.
        rows: Rows of the posterior there, ``(k, columns)``.
        gradient: Gradients of the log-posterior there, ``(k, d)``.
    """

    walkers: NDArray[np.intp]
    coords: Floats
    momenta: Floats
    rows: Floats
    gradient: Floats

    def take(self, chosen: NDArray[np.bool_]) -> "Points":
        """Return some of them, all if all are chosen."""
        if chosen.all():
            return self
        parts = self.coords, self.momenta, self.rows, self.gradient
        return Points(self.walkers[chosen], *(part[chosen] for part in parts))

    def finite(self) -> "Points":
        """Return those whose position and gradient are finite."""
        known = np.isfinite(self.coords + self.gradient)
        return self.take(np.logical_and.reduce(known, axis=1))


def leap(
    evaluate: Evaluate,
    start: Points,
    sizes: Floats,
    factor: Floats,
    about: Floats | None = None,
) -> Points:
    r"""Take one leapfrog step of every trajectory.

    .. math:: u \mathrel{+}= \tfrac h2 L^T \nabla \ln p(\theta), \qquad
        \theta \mathrel{+}= h L u, \qquad
        u \mathrel{+}= \tfrac h2 L^T \nabla \ln p(\theta)

    A trajectory ends where the posterior is zero: out of bounds, where nothing is
    solved, or where a solve failed. Whether it ends is told by the points on it alone,
    in whichever direction they are passed; so to reject then is reversible.

    Args:
        evaluate: Rows and gradients of points; a row begins with the log-posterior.
        start: Where the trajectories are.
        sizes: Step sizes h of all walkers, also of those that ended, ``(n,)``.
        factor: L, a triangular matrix ``(d, d)`` or its diagonal ``(d,)``.
        about: Where reciprocals are the coordinates, not theta, see reciprocals.py.

    Returns:
        Where they are now, without those that ended.
    """
    h = sizes[start.walkers, None]
    with np.errstate(over="ignore", invalid="ignore"):  # such a trajectory ends
        force = _multiply(slope(start.coords, start.gradient, about), factor)
        momenta = start.momenta + 0.5 * h * force
        coords = shift(start.coords, h * _multiply(momenta, factor.T), about)
    moved = start._replace(coords=coords, momenta=momenta)
    moved = moved.finite()
    if not len(moved.walkers):
        return moved
    rows, gradient = evaluate(moved.coords)
    here = moved._replace(rows=rows, gradient=gradient).finite()
    force = _multiply(slope(here.coords, here.gradient, about), factor)
    kick = 0.5 * sizes[here.walkers, None] * force
    return here._replace(momenta=here.momenta + kick)


def _multiply(vectors: Floats, factor: Floats) -> Floats:
    result: Floats = vectors * factor if factor.ndim == 1 else vectors @ factor
    return result


def energies(log_prob: Floats, momenta: Floats) -> Floats:
    """Return minus the energy of each walker, ``(k,)``: log density with momenta."""
    kinetic: Floats = log_prob - 0.5 * np.einsum("nd,nd->n", momenta, momenta)
    return kinetic


def energies_of(points: Points, about: Floats | None) -> Floats:
    """Return minus the energy of points in their coordinates, ``(k,)``."""
    volume = log_volume(points.coords, about)
    return energies(points.rows[:, 0] + volume, points.momenta)
