"""Where an emulated model is solved first."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import qmc

from ... import checks
from ...contracts import Floats
from ...sampling.coordinates import Coordinates
from .problem import EmulationProblem

DESIGN_DRAWS = 20_000  # of the prior, for its quantiles
DESIGN_SPREAD = 0.8  # share of the prior's spread that the first points have
NEAR_SPREAD = 0.25  # the same of first points about a given one
FEWEST_FITTED = 3  # points to which a process can be fitted


def first_points(
    coordinates: Coordinates, number: int, seed: int, starts: Floats | None
) -> Floats:
    """Return a first design ``(n, d)`` inside the prior's support.

    Sobol points, mapped through the quantiles of the prior and drawn together towards
    its mean, which is among them; or towards a given point, nearer to it.
    """
    if starts is not None and starts.ndim == 2:
        return starts
    prior = coordinates.prior
    rng = np.random.default_rng(*np.random.SeedSequence(seed).spawn(1))
    draws = coordinates.sample(np.random.default_rng(0), DESIGN_DRAWS)
    mean = draws.mean(axis=0)
    power = int(np.ceil(np.log2(number - 1)))
    places = qmc.Sobol(len(mean), seed=rng).random_base2(power)[: number - 1]
    columns = zip(draws.T, places.T, strict=True)
    far = np.column_stack([np.quantile(*pair) for pair in columns])
    if starts is None:
        theta = coordinates.parameters(
            np.vstack([mean, mean + DESIGN_SPREAD * (far - mean)])
        )
    else:
        near = coordinates.coordinates(starts[None]) + NEAR_SPREAD * (far - mean)
        theta = np.clip(coordinates.parameters(near), *prior.bounds.T)
        theta = np.vstack([starts, theta])
    outside = ~(prior.logpdf(theta) > -np.inf)  # of a prior that is not independent
    theta[outside] = prior.sample(rng, int(outside.sum()))
    return theta


def check_starts(starts: ArrayLike | None, problem: EmulationProblem) -> Floats | None:
    """Return a point ``(d,)`` or points ``(n, d)`` inside the bounds, or None."""
    if starts is None:
        return None
    points, posterior = checks.real_array("starts", starts), problem.posterior
    posterior.check_inside("starts", np.atleast_2d(points))
    alike = (
        len(points) < FEWEST_FITTED or not np.ptp(points[..., problem.inputs], 0).all()
    )
    if points.ndim == 2 and alike:
        raise ValueError(
            f"starts: expected a point (d,), or at least {FEWEST_FITTED} points (n, d) "
            f"that differ in every parameter of the model, got {points.tolist()}"
        )
    return points
