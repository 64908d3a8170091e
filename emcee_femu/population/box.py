"""How much of a normal law lies inside bounds."""

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri
from scipy.stats import qmc

from ..interfaces import Floats

POINTS = 256
NEGLIGIBLE = 1e-4  # mass outside below which one more digit of it does not matter
TINY = 1e-300


def log_mass(location: Floats, factor: Floats, bounds: Floats) -> Floats:
    """Return ln of the mass inside the bounds, ``(n, m)``.

    Independent parameters exactly; correlated ones by 256 fixed quasi-random points,
    each an exact integral along the last axis, where more than 1e-4 lies outside.

    Args:
        location: Means, ``(n, m, d)``.
        factor: Cholesky factors of the covariance, ``(n, d, d)``.
        bounds: ``(d, 2)``, or infinite.

    Source: Genz (1992), "Numerical computation of multivariate normal probabilities",
    doi:10.1080/10618600.1992.10477010.
    """
    if np.isinf(bounds).all():
        return np.zeros(location.shape[:2])
    sd = np.sqrt(np.einsum("nij,nij->ni", factor, factor))[:, None]
    low, high = (bounds.T[:, None, None] - location) / sd
    each = log_between(low, high)
    total: Floats = each.sum(axis=2)
    dependent = np.any(np.abs(np.tril(factor, -1)) > 0, axis=(1, 2))[:, None]
    which = np.argwhere(dependent & (total < -NEGLIGIBLE))
    if len(which):
        n, m = which.T
        unit = factor[n] / sd[n, 0][:, :, None]
        total[n, m] = _log_orthant(low[n, m], high[n, m], unit)
    return total


def log_between(low: Floats, high: Floats) -> Floats:
    """Return ln(ndtr(high) - ndtr(low)), exact to 38 standard deviations."""
    upper = log_ndtr(high)
    with np.errstate(divide="ignore", invalid="ignore"):  # beyond all numbers
        inside: Floats = upper + np.log(-np.expm1(log_ndtr(low) - upper))
    return np.fmax(inside, -1e10)


def _log_orthant(low: Floats, high: Floats, factor: Floats) -> Floats:
    """Return ln of the mass of ``N(0, factor factor^T)`` between, each ``(n, d)``."""
    n, d = low.shape
    uniform = qmc.Halton(d, scramble=True, rng=np.random.default_rng(0)).random(POINTS)
    drawn, mass = np.empty((n, POINTS, d)), np.ones((n, POINTS))
    for i in range(d):
        before = np.einsum("npk,nk->np", drawn[:, :, :i], factor[:, i, :i])
        own = factor[:, i, i][:, None]
        below, above = (
            ndtr((end[:, i][:, None] - before) / own) for end in (low, high)
        )
        mass *= above - below
        inside = below + uniform[:, i] * (above - below)
        drawn[:, :, i] = ndtri(np.clip(inside, 1e-16, 1 - 1e-16))
    total: Floats = np.log(np.maximum(mass.mean(axis=1), TINY))
    return total
