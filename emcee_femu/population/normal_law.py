"""A test's likelihood as a normal law, fitted to the densities of its draws."""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from ..interfaces import Floats
from ..sampling.importance import FAIR_SHARE, kish_share
from .draws import Drawn

PER_COEFFICIENT = 3  # draws, at least
OUTSIDE = 1e-3  # of its mass out of bounds, at most
FLATTEST = 1e-3  # curvature, in that of the posterior, of what the data leave open


class NormalLaw(NamedTuple):
    r"""``ln q = slope^T (theta - centre) - (theta - centre)^T curvature (...) / 2``.

    Attributes:
        centre: ``(d,)``.
        slope: ``(d,)``.
        curvature: ``(d, d)``, positive definite.
        log_ratio: ln q less the log-likelihood at each draw, ``(S,)``; where there are
            parameters that are not pooled, with q before these were integrated out.
        good: Whether the law resembles the draws.
    """

    centre: Floats
    slope: Floats
    curvature: Floats
    log_ratio: Floats
    good: bool


def fit_normal_law(draws: Drawn) -> NormalLaw:
    """Fit a quadratic to the log-likelihood at the draws of a test, by least squares.

    Where it is one, the fit is exact, however few draws there are, and however far the
    population pulls.
    """
    both = np.column_stack([draws.theta, draws.others])
    s, d = len(both), draws.theta.shape[1]
    size = both.shape[1]
    mean = both.mean(axis=0)
    factor = np.linalg.cholesky(_covariance(both))
    white = np.linalg.solve(factor, (both - mean).T).T
    upper = np.triu_indices(size)
    products = white[:, upper[0]] * white[:, upper[1]]
    design = np.column_stack([np.ones(s), white, products])
    fit = np.linalg.lstsq(design, draws.log_rest, rcond=None)[0]
    slope, curvature = fit[1 : 1 + size], np.zeros((size, size))
    curvature[upper] = -fit[1 + size :]
    curvature += curvature.T
    values, vectors = np.linalg.eigh(curvature)
    curvature = (vectors * np.maximum(values, FLATTEST)) @ vectors.T
    bent = np.einsum("si,ij,sj->s", white, curvature, white)
    log_ratio = white @ slope - bent / 2 - draws.log_rest
    log_ratio -= log_ratio.mean()
    back = np.linalg.inv(factor)
    slope, curvature = back.T @ slope, back.T @ curvature @ back
    if size > d:  # integrate the others out
        inner = np.linalg.solve(curvature[d:, d:], curvature[d:, :d])
        slope = slope[:d] - inner.T @ slope[d:]
        curvature = curvature[:d, :d] - curvature[:d, d:] @ inner
    good = (
        s >= PER_COEFFICIENT * design.shape[1]
        and kish_share(log_ratio) > FAIR_SHARE
        and _mass_outside(draws) < OUTSIDE
    )
    return NormalLaw(mean[:d], slope, curvature, log_ratio, good)


def _covariance(draws: Floats) -> Floats:
    covariance = np.atleast_2d(np.cov(draws, rowvar=False))
    sd = np.sqrt(np.diag(covariance))
    result: Floats = covariance + 1e-10 * np.diag(sd**2)
    return result


def _mass_outside(draws: Drawn) -> float:
    mean, sd = draws.theta.mean(axis=0), draws.theta.std(axis=0)
    low, high = (draws.bounds.T - mean) / sd
    return float((ndtr(low) + ndtr(-high)).sum())
