"""Where a full model is solved next: first points, and batches that teach most."""

from collections.abc import Callable

import numpy as np
from scipy.stats import qmc

from ..interfaces import Floats
from .log_scale import LogScale

DRAWS = 20_000  # of the prior, for its quantiles
SPREAD = 0.8  # of the prior's, of the first points
NEAR = 0.25  # of the prior's spread, of the first points about a given one


def first_size(ndim: int) -> int:
    """Return how many points a first design has: some more than a linear trend."""
    return ndim + 4


def batch_size(ndim: int) -> int:
    """Return how many points are solved between two fits."""
    return ndim // 2 + 1


def first_points(
    scale: LogScale, seed: np.random.SeedSequence, around: Floats | None
) -> Floats:
    """Return a first design ``(n, d)`` inside the prior's support.

    Sobol points, mapped through the quantiles of the prior and drawn together towards
    its mean, which is among them; or towards a given point, nearer to it.

    Args:
        scale: The prior, with the coordinates in which points are spread.
        seed: Scrambles the points.
        around: A point ``(d,)``, or points ``(n, d)`` that are the design themselves;
            None for the prior's mean.
    """
    if around is not None and around.ndim == 2:
        return around
    prior, number = scale.prior, first_size(len(scale.names)) - 1
    rng = np.random.default_rng(seed)
    draws = scale.sample(np.random.default_rng(0), DRAWS)
    mean = draws.mean(axis=0)
    power = int(np.ceil(np.log2(number)))
    places = qmc.Sobol(len(mean), seed=rng).random_base2(power)[:number]
    columns = zip(draws.T, places.T, strict=True)
    far = np.column_stack([np.quantile(*pair) for pair in columns])
    if around is None:
        theta = scale.parameters(np.vstack([mean, mean + SPREAD * (far - mean)]))
    else:
        centre = scale.coordinates(around[None])
        near = scale.parameters(centre + NEAR * (far - mean))
        theta = np.vstack([around, np.clip(near, *prior.bounds.T)])
    outside = ~(prior.logpdf(theta) > -np.inf)  # of a prior that is not independent
    theta[outside] = prior.sample(rng, int(outside.sum()))
    return theta


def choose_batch(
    candidates: list[Floats],
    errors: list[Floats],
    known: Floats,
    number: int,
    remaining: Callable[[Floats, Floats], Floats],
) -> Floats:
    """Return points ``(number, d)``, each where most error is left after those before.

    Args:
        candidates: For each point of the batch the draws to choose from, ``(n, d)``;
            the last ones serve all points after that, too.
        errors: Their mean square errors now, ``(n,)``.
        known: Points that are not to be asked again, ``(m, d)``: their solves failed.
        number: How many points.
        remaining: ``remaining(points, extra)``, the share of the mean square error that
            is left once ``extra (k, d)`` are solved, ``(n,)``.
    """
    extra = known
    for place in range(number):
        which = min(place, len(candidates) - 1)
        points, error = candidates[which], errors[which]
        left = error * remaining(points, extra)
        left[(points[:, None] == extra).all(axis=2).any(axis=1)] = -1.0
        extra = np.vstack([extra, points[np.argmax(left)]])
    return extra[len(known) :]
