"""The plan of an emulation: its first points, and how many are solved at a time."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import qmc

from ... import checks
from ...contracts import Floats
from ...evaluation.resume import describe
from ...posterior.log_posterior import LogPosterior
from .problem import EmulationProblem

FEWEST_FITTED = 3  # points to which a process can be fitted
MORE = 4  # points of the first design beyond d: a linear trend needs d + 1
DESIGN_DRAWS = 20_000  # of the prior, for its quantiles
DESIGN_SPREAD = 0.8  # spread of the first points, in that of the prior
NEAR_SPREAD = 0.25  # the same around a given point


class Design(NamedTuple):
    """What is emulated, and by how many solves at a time.

    Attributes:
        problem: What is emulated.
        seed: Of all that is drawn.
        first: The first points, ``(n, d)``.
        few: Points of a batch at least; one of so many explores beyond the posterior.
        batch: Points of a batch.
    """

    problem: EmulationProblem
    seed: int
    first: Floats
    few: int
    batch: int

    def describe(self, moves: str) -> dict[str, Any]:
        """Return what a file must have been made for."""
        asked = {
            "moves": moves,
            "seed": self.seed,
            "starts": self.first,
            "derivatives": self.problem.derivatives,
            "solves at a time": self.batch,
        }
        return describe(self.problem.posterior, asked)


def plan(
    posterior: LogPosterior,
    width: int,
    seed: int,
    derivatives: bool,
    starts: ArrayLike | None,
) -> Design:
    """Return the design of an emulation, for so many solves at a time.

    Raises:
        ValueError: As for :func:`emulate`.
    """
    problem = EmulationProblem(posterior, checks.flag("derivatives", derivatives))
    seed = checks.whole_number("seed", seed)
    d, fewer = posterior.ndim, problem.derivatives
    number = max(d // 2 + 1, FEWEST_FITTED) if fewer else d + MORE
    first = first_points(problem, max(number, width), seed, starts)
    few = d // (4 if fewer else 2) + 1
    return Design(problem, seed, first, few, max(few, width))


def first_points(
    problem: EmulationProblem, number: int, seed: int, starts: ArrayLike | None
) -> Floats:
    """Return a first design ``(n, d)`` inside the prior's support.

    Sobol points, mapped through the quantiles of the prior and drawn together towards
    its mean, which is among them; or towards a given point ``(d,)``, nearer to it. Or
    the points ``(n, d)`` that were given.

    Raises:
        ValueError: If a start is out of bounds, or points are too few or alike.
    """
    coordinates, posterior = problem.coordinates, problem.posterior
    rng = np.random.default_rng(*np.random.SeedSequence(seed).spawn(1))
    draws = coordinates.sample(np.random.default_rng(0), DESIGN_DRAWS)
    centre, spread = (mean := draws.mean(axis=0)), DESIGN_SPREAD
    if starts is not None:
        given = checks.real_array("starts", starts)
        posterior.check_inside("starts", np.atleast_2d(given))
        if given.ndim == 2:
            among = given[:, problem.inputs]
            if len(among) < FEWEST_FITTED or not np.ptp(among, axis=0).all():
                raise ValueError(
                    f"starts: expected a point (d,), or at least {FEWEST_FITTED} "
                    "points (n, d) that differ in every parameter of the model, got "
                    f"{given.tolist()}"
                )
            return given
        centre, spread = coordinates.coordinates(given[None])[0], NEAR_SPREAD
    power = int(np.ceil(np.log2(number - 1)))
    places = qmc.Sobol(len(mean), seed=rng).random_base2(power)[: number - 1]
    columns = zip(draws.T, places.T, strict=True)
    far = np.column_stack([np.quantile(*pair) for pair in columns])
    points = coordinates.parameters(np.vstack([centre, centre + spread * (far - mean)]))
    theta = np.clip(points, *posterior.prior.bounds.T)
    # Of a prior that is not independent.
    outside = ~(posterior.prior.logpdf(theta) > -np.inf)
    theta[outside] = posterior.prior.sample(rng, int(outside.sum()))
    return theta
