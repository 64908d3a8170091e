"""Hamiltonian moves beside DE-MC on shear buildings of 20, 30 and 50 storeys.

The storey stiffnesses are unknown, with a Gaussian prior of 20 % about their nominal
values. Twelve natural frequencies (errors of 0.5 %) and the mode shapes at every second
floor (errors of 2 % of a shape's length) were measured on a building drawn from that
prior; there are several buildings. The Laplace approximation at the maximum of the
posterior gives the metric, ``tuned`` chose the steps, then all is frozen. HMC moves in
the stiffnesses, "HMC 1/k" in their reciprocals about the maximum. All moves start from
draws of the Laplace approximation and drop a fifth as burn-in.

The effective sample size is ArviZ's bulk ESS of the worst parameter, walkers as chains;
"tail" is that of its 5 and 95 % quantiles. A gradient counts as one solve, and every
solve after the burn-in counts, out of bounds or not; "before" are the solves of
maximum, tuning and burn-in. Pareto k is that of the Laplace approximation.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/hamiltonian.py
"""

import argparse
import time
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np

import emcee_femu as ef
from emcee_femu.results.arviz_objects import effective_sizes
from emcee_femu.sampling.importance import pareto_k

Floats = np.ndarray
MODES, SPREAD, RELATIVE_SD, DELTA = 12, 0.2, 0.005, 0.02
MASS, STIFFNESS = 1e5, 2e8  # kg, N/m
SAMPLES = 24  # on which the steps are tried out


class Counted(ef.MatrixModel):
    """Counts what ``tuned`` solves."""

    solved = 0

    def jacobian(self, parameters: Any) -> Any:
        """Return responses and derivatives."""
        Counted.solved += len(next(iter(parameters.values())))
        return super().jacobian(parameters)


def shear_building(storeys: int, seed: int) -> ef.LogPosterior:
    """Return the posterior of the storey stiffnesses of a simulated test."""
    names = [f"k{i}" for i in range(1, storeys + 1)]
    drift = np.eye(storeys) - np.eye(storeys, k=-1)
    floors = list(range(1, storeys, 2))
    model = Counted(
        np.zeros((storeys, storeys)),
        MASS * np.eye(storeys),
        K={name: np.outer(b, b) for name, b in zip(names, drift, strict=True)},
        n_modes=MODES,
        shapes=floors,
    )
    rng = np.random.default_rng(seed)
    nominal = np.full(storeys, STIFFNESS)
    prior = ef.GaussianPrior(
        names, nominal, SPREAD * nominal, np.outer(nominal, [0.1, 3.0])
    )
    truth = dict(zip(names, prior.sample(rng, 1).T, strict=True))
    modes = model(truth)
    frequencies = modes.frequencies[0]
    frequencies = frequencies * (1 + RELATIVE_SD * rng.standard_normal(MODES))
    shapes = modes.shapes[0] / np.linalg.norm(modes.shapes[0], axis=0)
    shapes += DELTA * rng.standard_normal(shapes.shape)
    terms = [
        ef.FrequencyTerm(frequencies, relative_sd=RELATIVE_SD),
        ef.ShapeTerm(shapes, delta=DELTA),
    ]
    return ef.LogPosterior(model, terms, prior)


def laplace(posterior: ef.LogPosterior) -> tuple[Floats, Floats, int]:
    """Return the maximum, the Laplace covariance, and the solves that they took."""
    point, solves = posterior.prior.mean, 1
    here = posterior.linearize(point)
    while True:  # Gauss-Newton, halved until it climbs
        step = np.linalg.solve(here.information[0], here.gradient[0])
        if here.gradient[0] @ step < 1e-4:
            return point, np.linalg.inv(here.information[0]), solves
        ahead = posterior.linearize(point + step)
        solves += 1
        while ahead.rows[0, 0] <= here.rows[0, 0]:
            step /= 2
            ahead = posterior.linearize(point + step)
            solves += 1
        point, here = point + step, ahead


def laplace_draws(
    posterior: ef.LogPosterior, point: Floats, covariance: Floats, seed: int
) -> tuple[Floats, float]:
    """Return draws of the Laplace approximation, and Pareto k of their weights."""
    rng, d = np.random.default_rng(seed), len(point)
    normal = rng.standard_normal((2_000, d))
    draws = point + normal @ np.linalg.cholesky(covariance).T
    log_posterior = posterior(draws)[:, 0]
    k = pareto_k(log_posterior + 0.5 * (normal**2).sum(axis=1))
    # Without those in the far tails, where the approximation is not good.
    return draws[log_posterior > posterior(point)[0] - d], k


@dataclass(frozen=True)
class Result:
    """ESS of the worst parameter and of its tails per 1000 solves, and what it took."""

    bulk: float
    tail: float
    acceptance: float
    burn_in: int
    solves: int
    seconds: float


def sample(
    posterior: ef.LogPosterior, move: Any, start: Floats, solves: int, seed: int
) -> Result:
    """Spend about that many solves after the burn-in."""
    cost = getattr(move, "cost", 1) * len(start)
    kept = max(20, solves // cost)
    sampler = emcee.EnsembleSampler(*start.shape, posterior, moves=move, vectorize=True)
    stream = np.random.RandomState(seed).get_state()
    begin = time.process_time()
    state = emcee.State(start, random_state=stream)
    sampler.run_mcmc(state, kept // 4 + kept, skip_initial_state_check=True)
    seconds = time.process_time() - begin
    bulk, tail = effective_sizes(
        sampler.get_chain(discard=kept // 4).transpose(1, 0, 2)
    )
    return Result(
        1000 * bulk.min() / (kept * cost),
        1000 * tail.min() / (kept * cost),
        float(sampler.acceptance_fraction.mean()),
        kept // 4 * cost,
        kept * cost,
        seconds,
    )


def compare(
    storeys: int, building: int, solves: int, walkers: int
) -> dict[str, Result]:
    """Print a line a move on one building, and return what they gave."""
    posterior = shear_building(storeys, building)
    point, covariance, used = laplace(posterior)
    draws, k = laplace_draws(posterior, point, covariance, building)
    runs: dict[str, tuple[Any, int, int, int]] = {}
    for name, about in {"HMC 1/k": point, "HMC": None}.items():
        Counted.solved = 0
        move = ef.HamiltonianMove.tuned(
            posterior, draws[:SAMPLES], covariance, seed=1, reciprocal_about=about
        )
        runs[name] = move, walkers, solves, used + Counted.solved
    # It needs more for a stable figure.
    runs["DE-MC"] = ef.DEMCMove(), 3 * storeys, 4 * solves, used
    result = {}
    for name, (move, n, own, before) in runs.items():
        found = result[name] = sample(posterior, move, draws[-n:], own, building)
        steps = f"{move.steps} x {move.step_size:.2f}" if n == walkers else ""
        print(
            f"{storeys:7d} {building:9d} {k:5.2f}  {name:<8}{steps:>8} "
            f"{found.acceptance:9.2f} {found.bulk:9.1f} {found.tail:6.1f} "
            f"{before + found.burn_in:7d} {found.solves:7d} "
            f"{1000 * found.seconds / (found.solves + found.burn_in):11.2f}",
            flush=True,
        )
    return result


def main(
    storeys: tuple[int, ...] = (20, 30, 50),
    solves: int = 20_000,
    buildings: int = 3,
    walkers: int = 16,
    quick: bool = False,
) -> dict[tuple[int, str], float]:
    """Print a line a building and move, then medians of the ESS; return those."""
    if quick:
        storeys, solves, buildings = (20,), 6_000, 1
    print("                 Pareto           steps            ESS per 1000 solves")
    print("storeys  building     k  move    x size  accepted      bulk   tail", end="")
    print("  before  solves  ms / solve")
    result = {}
    for d in storeys:
        found = [compare(d, 1 + i, solves, walkers) for i in range(buildings)]
        for name in found[0]:
            result[d, name] = float(np.median([one[name].bulk for one in found]))
        print(
            f"{d:7d}  median:",
            *(f"{name} {result[d, name]:.1f}" for name in found[0]),
            sep="  ",
            flush=True,
        )
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--storeys", type=int, nargs="+", default=(20, 30, 50))
    parser.add_argument("--solves", type=int, default=20_000)
    parser.add_argument("--buildings", type=int, default=3)
    parser.add_argument("--walkers", type=int, default=16)
    parser.add_argument("--quick", action="store_true", help="only a look, a minute")
    main(**vars(parser.parse_args()))
