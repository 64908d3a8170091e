"""Means and standard deviations as full solves at a few draws correct them."""

from typing import NamedTuple

import numpy as np

from ..interfaces import Floats
from .solved_draws import EmulatedChain


class Moments(NamedTuple):
    """Means and standard deviations, each ``(d,)``, with standard errors."""

    mean: Floats
    mean_error: Floats
    sd: Floats
    sd_error: Floats


def correct_moments(
    chain: EmulatedChain, theta: Floats, plain: Floats, weights: Floats
) -> Moments:
    r"""Return moments of the true posterior from weighted draws and the whole chain.

    .. math:: \hat f = \sum_i W_i f_i - \beta \left(\sum_i c_i f_i - \bar f\right)

    for f the parameter, or its squared distance from the chain's mean. The solved
    draws' own accidents are those of ``c_i``, their shares without weights, against the
    mean over the whole chain (a control variate): beta is the slope of the one error on
    the other, near 1 where the weights are nearly equal. So a good emulator's
    corrections are known much better than the mean of as many draws.

    Args:
        chain: Of the emulated posterior.
        theta: The draws that were solved in full, ``(n, d)``.
        plain: Their shares as draws of the emulated posterior, ``(n,)``.
        weights: Their shares of the true posterior, ``(n,)``.

    Source: Owen (2013), Monte Carlo theory, methods and examples, chapter 9.
    """
    more = spread_factor(chain.size, len(theta))
    centre = chain.draws.mean(axis=0)
    mean, of_mean, mean_rest = _regress(theta, chain.draws, plain, weights)
    squares, of_squares, squares_rest = _regress(
        (theta - centre) ** 2, (chain.draws - centre) ** 2, plain, weights
    )
    shift = mean - centre
    mean_error = np.hypot(
        np.sqrt(more * (of_mean**2).sum(axis=0)),
        mean_rest / np.sqrt(chain.mean_sizes[0]),
    )
    variance = squares - shift**2 + mean_error**2
    without = weights @ (theta - weights @ theta) ** 2 / (1 - (weights**2).sum())
    sd = np.sqrt(np.where(variance > 0, variance, without))
    of_sd = (of_squares - 2 * shift * of_mean) / (2 * sd)
    sd_error = np.hypot(
        np.sqrt(more * (of_sd**2).sum(axis=0)),
        squares_rest / np.sqrt(chain.mean_sizes[1]) / (2 * sd),
    )
    return Moments(mean, mean_error, sd, sd_error)


def spread_factor(size: float, n: int) -> float:
    """Return by how much a mean of n draws of a chain varies more than of independent.

    ``coth(size / n)`` is exact for draws at equal distances of an AR(1) chain that is
    worth ``size`` independent ones.
    """
    return float(1 / np.tanh(size / n))


def _regress(
    values: Floats, whole: Floats, plain: Floats, weights: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return means, the influence of each draw, and the spread left to the chain."""
    n = len(values)
    weighted, unweighted = weights @ values, plain @ values
    u = weights[:, None] * (values - weighted)
    v = plain[:, None] * (values - unweighted)
    power = (v**2).sum(axis=0)
    slope = (u * v).sum(axis=0) / np.where(power > 0, power, 1.0)
    slope = np.clip(slope, 0.0, 1.0)
    means = weighted - slope * (unweighted - whole.mean(axis=0))
    # Two numbers were fitted: a mean and a slope.
    influence = (u - slope * v) * np.sqrt(n / max(n - 2, 1))
    return means, influence, slope * whole.std(axis=0)
