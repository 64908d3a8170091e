"""Hamiltonian moves beside DE-MC on shear buildings of 20, 30 and 50 storeys.

The storey stiffnesses are unknown, with a Gaussian prior of 25 % about their nominal
values. Twelve natural frequencies (errors of 1 %) and the mode shapes at every second
floor (errors of 3 % of a shape's length) were measured on a building drawn from that
prior. The Hamiltonian move has the covariance of a Laplace approximation at the maximum
of the posterior for its metric; ``tuned`` chose its steps, then all is frozen. Both
moves start from the same draws of the Laplace approximation and drop a fifth.

The effective sample size is ArviZ's bulk ESS of the worst parameter, walkers as chains;
"tail" is that of its 5 and 95 % quantiles. A gradient counts as one solve, and every
solve after the burn-in counts, out of bounds or not.

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

Floats = np.ndarray
MODES, SPREAD, RELATIVE_SD, DELTA = 12, 0.25, 0.01, 0.03
MASS, STIFFNESS = 1e5, 2e8  # kg, N/m
SAMPLES = 24  # on which the steps are tried out


def shear_building(storeys: int, seed: int = 1) -> ef.LogPosterior:
    """Return the posterior of the storey stiffnesses of a simulated test."""
    names = [f"k{i}" for i in range(1, storeys + 1)]
    drift = np.eye(storeys) - np.eye(storeys, k=-1)
    floors = list(range(1, storeys, 2))
    model = ef.MatrixModel(
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


@dataclass(frozen=True)
class Result:
    """ESS of the worst parameter and of its tails per 1000 solves, and what it took."""

    bulk: float
    tail: float
    acceptance: float
    solves: int
    seconds: float


def sample(
    posterior: ef.LogPosterior, move: Any, start: Floats, solves: int, seed: int
) -> Result:
    """Spend about that many solves after the burn-in."""
    cost = getattr(move, "cost", 1)
    kept = max(20, solves // (cost * len(start)))
    sampler = emcee.EnsembleSampler(*start.shape, posterior, moves=move, vectorize=True)
    stream = np.random.RandomState(seed).get_state()
    begin = time.process_time()
    state = emcee.State(start, random_state=stream)
    sampler.run_mcmc(state, kept // 4 + kept, skip_initial_state_check=True)
    seconds = time.process_time() - begin
    bulk, tail = effective_sizes(
        sampler.get_chain(discard=kept // 4).transpose(1, 0, 2)
    )
    spent = kept * len(start) * cost
    return Result(
        1000 * bulk.min() / spent,
        1000 * tail.min() / spent,
        float(sampler.acceptance_fraction.mean()),
        spent,
        seconds,
    )


def main(
    storeys: tuple[int, ...] = (20, 30, 50),
    solves: int = 60_000,
    repeats: int = 3,
    walkers: int = 16,
    quick: bool = False,
) -> dict[tuple[int, str], Result]:
    """Print a line a move and building, medians over the repeats; return the last."""
    if quick:
        storeys, solves, repeats = (20,), 6_000, 1
    result = {}
    print("storeys  move     ESS per 1000 solves   tail  accepted  solves  ms / solve")
    for d in storeys:
        posterior = shear_building(d)
        point, covariance, used = laplace(posterior)
        rows: dict[str, list[Result]] = {"HMC": [], "DE-MC": []}
        for seed in range(repeats):
            rng = np.random.default_rng(seed)
            draws = rng.multivariate_normal(point, covariance, 20 * d)
            # Without those in the far tails, where the approximation is not good.
            draws = draws[posterior(draws)[:, 0] > posterior(point)[0] - d]
            move = ef.HamiltonianMove.tuned(
                posterior, draws[:SAMPLES], covariance, seed=seed
            )
            runs = [("HMC", move, walkers, 1), ("DE-MC", ef.DEMCMove(), 3 * d, 4)]
            for name, own, n, more in runs:  # DE-MC needs more for a stable figure
                found = sample(posterior, own, draws[-n:], more * solves, seed)
                rows[name].append(found)
            print(
                f"  {d} storeys, repeat {seed}: maximum in {used} solves; steps="
                f"{move.steps}, step_size={move.step_size:.3f}"
            )
        for name, runs_of in rows.items():
            bulk = [one.bulk for one in runs_of]
            middle = runs_of[int(np.argsort(bulk)[len(bulk) // 2])]
            result[d, name] = middle
            print(
                f"{d:7d}  {name:<7}{middle.bulk:21.1f} {middle.tail:6.1f} "
                f"{middle.acceptance:9.2f} {middle.solves:7d} "
                f"{1000 * middle.seconds / middle.solves / 1.25:11.2f}",
                flush=True,
            )
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--storeys", type=int, nargs="+", default=(20, 30, 50))
    parser.add_argument("--solves", type=int, default=60_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--walkers", type=int, default=16)
    parser.add_argument("--quick", action="store_true", help="only a look, a minute")
    main(**vars(parser.parse_args()))
