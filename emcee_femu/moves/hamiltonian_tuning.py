"""Step size and number of steps of Hamiltonian moves, from a few trajectories."""

from collections.abc import Iterator

import numpy as np
from scipy.special import ndtri

from ..interfaces import Floats
from .leapfrog import Evaluate, Points, energies_of, leap

FEWEST = 8  # samples
ACCEPTED = 0.8  # share of proposals at which the step size is best, or nearly so
ROUNDS = 5  # of trajectories that adjust the step size
RECORDED = 4  # of those that choose the number of steps
FIRST = 0.4  # step size of the first round
LONGEST = 3.3  # sum of the steps: half a period of the slowest oscillation, if it fits
MOST = 64  # steps, should the metric fit badly


def tune_steps(
    evaluate: Evaluate,
    theta: Floats,
    factor: Floats,
    jitter: float,
    rng: np.random.Generator,
    about: Floats | None = None,
) -> tuple[int, float]:
    r"""Return the number of steps and the step size, by some 70 gradients per walker.

    The step size h is adjusted until 80 % of the proposals would be accepted. In theory
    the accepted share is ``2 Phi(-c h^2)``, so that each round tells the next h. With
    it longer trajectories are recorded. A proposal may end at any of their points; the
    number of steps is the one with most effective samples per gradient,

    .. math:: \frac{1 - \rho}{(1 + \rho) \, steps}, \qquad
        \rho_j = 1 - \frac{E[\alpha \, (\theta^*_j - \theta_j)^2]}{2 \sigma_j^2}

    with the probability alpha of acceptance, in the worst quarter of the parameters.

    Args:
        evaluate: Rows and gradients of points ``(n, d)``.
        theta: Points of the posterior ``(n, d)``, such as the walkers of a burn-in.
        factor: L, with ``L L^T`` the metric.
        jitter: Share by which step sizes differ from the mean.
        rng: The random stream.
        about: Where reciprocals are the coordinates, see reciprocals.py.

    Source: Beskos et al. (2013), doi:10.3150/12-BEJ414, for the accepted share.
    """
    rows, gradient = evaluate(theta)
    here = Points(np.arange(len(theta)), theta, 0 * theta, rows, gradient).finite()
    n, size, sizes = len(here.walkers), FIRST, []
    if n < FEWEST:
        raise ValueError(
            f"samples: expected at least {FEWEST} where the posterior is above zero, "
            f"got {n}"
        )
    here = here._replace(walkers=np.arange(n))
    for _ in range(ROUNDS):
        own = size * rng.uniform(1 - jitter, 1 + jitter, n)
        here = here._replace(momenta=rng.standard_normal(here.coords.shape))
        steps = _steps(LONGEST / 2, size)
        *_, (end, chance) = _travel(evaluate, here, steps, own, factor, about)
        # Those that left the bounds say nothing of h, unless most of them did.
        left = len(end.walkers) < n / 2
        accepted = chance.sum() / (n if left else max(1, len(end.walkers)))
        ratio = ndtri(ACCEPTED / 2) / ndtri(np.clip(accepted, 0.02, 0.98) / 2)
        size *= float(np.clip(np.sqrt(ratio), 0.3, 1.6))
        sizes.append(size)
        here = _accept(here, end, chance, rng)
    size = float(np.exp(np.mean(np.log(sizes[-3:]))))  # each is as uncertain as another

    starts, squares = [], []
    for _ in range(RECORDED):
        own = size * rng.uniform(1 - jitter, 1 + jitter, n)
        here = here._replace(momenta=rng.standard_normal(here.coords.shape))
        steps = _steps(LONGEST, size)
        path = list(_travel(evaluate, here, steps, own, factor, about))
        starts.append(here.coords)
        squares.append([_mean_square(here, *point) for point in path])
        end, chance = path[len(path) // 2]
        here = _accept(here, end, chance, rng)
    places = np.concatenate(starts)
    wide = factor**2 if factor.ndim == 1 else (factor**2).sum(axis=1)
    # The metric's, where all walkers are at one place, which nothing was accepted from.
    variance = np.where(np.ptp(places, axis=0) > 0, places.var(axis=0), wide)
    rho = 1 - np.mean(squares, axis=0) / (2 * variance)  # (steps, d)
    return _choose(rho), size


def _steps(length: float, size: float) -> int:
    return int(np.clip(np.ceil(length / size), 1, MOST))


def _travel(
    evaluate: Evaluate,
    start: Points,
    steps: int,
    sizes: Floats,
    factor: Floats,
    about: Floats | None,
) -> Iterator[tuple[Points, Floats]]:
    """Yield the points of trajectories, and how likely each would be accepted."""
    before = energies_of(start, about)
    here = start
    for _ in range(steps):
        here = leap(evaluate, here, sizes, factor, about)
        gain = energies_of(here, about) - before[here.walkers]
        yield here, np.exp(np.minimum(gain, 0))


def _accept(
    here: Points, end: Points, chance: Floats, rng: np.random.Generator
) -> Points:
    """Return where the walkers are after a Metropolis step."""
    moved = end.take(rng.random(len(here.walkers))[end.walkers] < chance)
    parts = [part.copy() for part in here[1:]]
    for part, new in zip(parts, moved[1:], strict=True):
        part[moved.walkers] = new
    return Points(here.walkers, *parts)


def _mean_square(here: Points, end: Points, chance: Floats) -> Floats:
    """Return how far the walkers would have moved, on average, squared ``(d,)``."""
    jumps = end.coords - here.coords[end.walkers]
    result: Floats = chance @ jumps**2 / len(here.walkers)
    return result


def _choose(rho: Floats) -> int:
    """Return the number of steps for the autocorrelations ``(steps, d)``.

    Where rho is below zero the squares mix worse than the parameters: rho^2 tells it.
    """
    rho = np.where(rho < 0, rho**2, rho)
    efficiency = (1 - rho) / (1 + rho)
    worst = np.sort(efficiency, axis=1)[:, : -(-rho.shape[1] // 4)].mean(axis=1)
    return int(np.argmax(worst / np.arange(1, len(rho) + 1))) + 1
