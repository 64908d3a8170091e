"""What the moves take from the walkers at rest: their spread, and distinct guides."""

from functools import lru_cache

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..interfaces import Floats

DEFAULT_NOISE = 1e-2  # of the standard deviation of the walkers at rest


def draw_guides(
    random: RandomState, moving: int, n: int, size: int
) -> NDArray[np.intp]:
    """Draw ``size`` distinct guides of ``n`` for each of ``moving`` walkers.

    All ordered choices are equally likely: the j-th guide is drawn among the n - j that
    are left, and its number is raised past those taken before.

    Returns:
        Numbers of guides, ``(size, moving)``.
    """
    left = n - np.arange(size)[:, None]
    uniform = random.random_sample((size, moving))
    chosen: NDArray[np.intp] = (uniform * left).astype(np.intp)
    for j in range(1, size):
        for taken in np.sort(chosen[:j], axis=0):
            chosen[j] += chosen[j] >= taken
    return chosen


def draw_noise(
    sigma: Floats | None, guides: Floats, moving: int, random: RandomState
) -> Floats:
    """Return the moves' Gaussian noise ``(moving, ndim)``, with the default of sigma.

    The default is symmetric, because the guides stand still meanwhile.
    """
    scale = DEFAULT_NOISE * measure_spread(guides) if sigma is None else sigma
    result: Floats = random.standard_normal((moving, guides.shape[1]))
    result *= scale
    return result


def convert_sigma(sigma: ArrayLike | None) -> Floats | None:
    """Return the argument ``sigma`` of a move as an array, or None for the default.

    Raises:
        ValueError: If it is neither a number nor one-dimensional, or is negative.
    """
    if sigma is None:
        return None
    array = checks.real_array("sigma", sigma)
    if array.ndim > 1 or not array.size or (array < 0).any():
        raise ValueError(
            f"sigma: expected a number or (ndim,) numbers not below zero, got {sigma}"
        )
    return array


def measure_spread(walkers: Floats) -> Floats:
    """Return those of the columns of ``walkers (n, ndim)``, to 1e-8 of the mean.

    The textbook difference of moments, in a third of the time of ``walkers.std``; its
    rounding matters only to a scale that is 1e-8 of the parameter's value.
    """
    weights = _weights(len(walkers))
    mean = weights.dot(walkers)
    variance = weights.dot(walkers * walkers)
    variance -= mean * mean
    result: Floats = np.sqrt(np.maximum(variance, 0.0, out=variance), out=variance)
    return result


@lru_cache(maxsize=8)
def _weights(n: int) -> Floats:
    return np.full(n, 1.0 / n)
