"""Means and standard deviations as full solves at a few draws correct them."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from .solved_draws import EmulatedChain

PER_TERM = 5  # draws for each term of a quadratic with products
FOLDS = 5  # of the draws: weights are predicted by a fit to the others
BEYOND = 1.0  # the largest ln w so far, up to which a fit is believed
ALONE = 1e-9  # weight beside that of one draw, below which it has no spread
MOST = 50_000  # draws of the chain that are averaged over


class Moments(NamedTuple):
    """Means and standard deviations, each ``(d,)``, with standard errors.

    A standard deviation is NaN where one draw has all the weight.
    """

    mean: Floats
    mean_error: Floats
    sd: Floats
    sd_error: Floats


def correct_moments(
    chain: EmulatedChain, theta: Floats, plain: Floats, weights: Floats
) -> Moments:
    r"""Return moments of the true posterior from weighted draws and the whole chain.

    .. math:: \hat f = \frac{\overline{g f} + \sum_i c_i (w_i - g_i) f_i}
        {\overline{g} + \sum_i c_i (w_i - g_i)}

    with means over the whole chain, shares c of the solved draws, and g, what a fit to
    ln w at other draws predicts of the weight (a control variate). Whatever g is, the
    ratio is right; a good one leaves little to the few draws. Where all weights are
    equal it is the mean over the chain.

    Args:
        chain: Of the emulated posterior.
        theta: The draws that were solved in full, ``(n, d)``.
        plain: Their shares as draws of the emulated posterior, ``(n,)``.
        weights: Their shares of the true posterior, ``(n,)``.

    Source: Owen (2013), Monte Carlo theory, methods and examples, chapters 8 and 9.
    """
    whole = chain.draws[:: -(-len(chain.draws) // MOST)]
    sizes = chain.mean_sizes * min(1.0, len(whole) / chain.mean_sizes.max())
    g_whole, g = _predict_weights(chain, whole, theta, weights / plain)
    more = np.sqrt(spread_factor(chain.size, len(theta)))
    rest = weights - plain * g

    def average(values: Floats, of_whole: Floats, size: Floats) -> tuple[Floats, ...]:
        """Return means, the influence of each draw and of what the chain leaves."""
        total = g_whole.mean() + rest.sum()
        mean = ((g_whole @ of_whole) / len(whole) + rest @ values) / total
        influence = rest[:, None] * (values - mean) / total
        by_chain = g_whole[:, None] * (of_whole - mean) / total / np.sqrt(size)
        return mean, influence, by_chain

    centre = chain.draws.mean(axis=0)
    mean, *of_mean = average(theta, whole, sizes[0])
    squares, *of_squares = average(
        (theta - centre) ** 2, (whole - centre) ** 2, sizes[1]
    )
    shift = mean - centre

    def error(by_draws: Floats, by_chain: Floats) -> Floats:
        n = len(by_draws)
        own = more * np.sqrt((by_draws**2).sum(axis=0) * n / (n - 1))
        total: Floats = np.hypot(own, by_chain.std(axis=0))
        return total

    mean_error = error(*of_mean)
    variance = squares - shift**2 + mean_error**2
    without = weights @ (theta - weights @ theta) ** 2
    left = 1 - (weights**2).sum()
    if left > ALONE:
        variance = np.where(variance > 0, variance, without / left)
    sd = np.sqrt(np.where(variance > 0, variance, np.nan))
    of_sd = [
        (a - 2 * shift * b) / (2 * sd) for a, b in zip(of_squares, of_mean, strict=True)
    ]
    return Moments(mean, mean_error, sd, error(*of_sd))


def _predict_weights(
    chain: EmulatedChain, whole: Floats, theta: Floats, ratios: Floats
) -> tuple[Floats, Floats]:
    """Return predictions of the weights at the whole chain and at the solved draws.

    A fit of ln w by a quadratic; each draw's prediction is by the others.
    """
    n = len(theta)
    features = _features(chain, n)
    known, far = features(theta), features(whole)
    above = ratios > 0
    logs = np.log(np.where(above, ratios, 1.0))
    g, g_whole = np.ones(n), np.zeros(len(whole))
    for fold in range(FOLDS):
        own = np.arange(n) % FOLDS == fold
        used = above & ~own
        if used.sum() < 2 * known.shape[1]:
            return np.ones(len(whole)), np.ones(n)
        fit = np.linalg.lstsq(known[used], logs[used])[0]
        limits = logs[used].min(), logs[used].max() + BEYOND
        level = ratios[~own].mean() / np.exp(known[used] @ fit).sum() * (~own).sum()
        g[own] = level * np.exp(np.clip(known[own] @ fit, *limits))
        g_whole += level * np.exp(np.clip(far @ fit, *limits)) / FOLDS
    return g_whole, g


def spread_factor(size: float, n: int) -> float:
    """Return by how much a mean of n draws of a chain varies more than of independent.

    ``coth(size / n)`` is exact for draws at equal distances of an AR(1) chain that is
    worth ``size`` independent ones.
    """
    return float(1 / np.tanh(size / n))


def curvature_k(chain: EmulatedChain, theta: Floats, log_weights: Floats) -> float:
    """Return the Pareto k that the curvature of ln w implies: its largest eigenvalue.

    Where the chain is standard normal, weights ``exp(k z^2 / 2)`` have the tail of a
    Pareto law of shape k. All weights tell of it, not the largest ones alone; -inf
    where there are too few.
    """
    above = np.isfinite(log_weights)
    known = _features(chain, len(theta))(theta[above])
    if len(known) < 2 * known.shape[1]:
        return -np.inf
    d = theta.shape[1]
    fit = np.linalg.lstsq(known, log_weights[above])[0][1 + d :]
    i, j = _products(d, len(theta))
    hessian = np.zeros((d, d))
    hessian[i, j] += fit
    hessian[j, i] += fit
    return float(np.linalg.eigvalsh(hessian)[-1])


def _features(chain: EmulatedChain, n: int) -> Callable[[Floats], Floats]:
    """Return a function of points to the terms of a quadratic, ``(m, terms)``.

    In coordinates in which the chain is white.
    """
    scale = np.atleast_2d(np.cov(chain.draws, rowvar=False))
    root = np.linalg.cholesky(scale + 1e-12 * np.diag(np.diag(scale)))
    centre = chain.draws.mean(axis=0)
    i, j = _products(len(centre), n)

    def features(points: Floats) -> Floats:
        z = np.linalg.solve(root, (points - centre).T).T
        return np.column_stack([np.ones(len(z)), z, z[:, i] * z[:, j]])

    return features


def _products(d: int, n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which products of coordinates n draws can tell; else squares alone."""
    i, j = np.triu_indices(d)
    if n < PER_TERM * (1 + d + len(i)):
        return np.arange(d), np.arange(d)
    return i, j
