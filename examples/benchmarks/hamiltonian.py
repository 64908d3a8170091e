"""Hamiltonian moves beside DE-MC on shear buildings of 20, 30 and 50 storeys.

The storey stiffnesses are unknown. Twelve natural frequencies and the mode shapes at
every second floor were measured on a building drawn from the prior. The Gaussian at the
maximum of the posterior (``find_map``) gives the metric, ``tuned`` chooses the steps,
then both are frozen. All moves start from draws of that Gaussian and drop a fifth as
burn-in. A gradient counts as one solve. Pareto k is that of the Gaussian's weights.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/hamiltonian.py
"""

import itertools
from typing import Any

import numpy as np
from buildings import draw, measure, shear_building, terms_of
from commands import command, tabulate

import emcee_femu as ef
from emcee_femu.table import Table

MODES, MASS = 12, 1e5  # kg
SAMPLES = 24  # on which the steps are tried out
WALKERS = 16  # of the Hamiltonian move


def simulate(storeys: int, seed: int) -> ef.LogPosterior:
    """Return the posterior of the storey stiffnesses of a simulated test."""
    names, rng = [f"k{i}" for i in range(1, storeys + 1)], np.random.default_rng(seed)
    model, prior = shear_building(names, MASS, MODES, range(1, storeys, 2))
    measured = measure(model, draw(prior, rng), MODES, rng)
    return ef.LogPosterior(model, terms_of(measured), prior)


def efficiency(
    posterior: ef.LogPosterior, move: Any, starts: np.ndarray, solves: int, seed: int
) -> float:
    """Return ESS per 1000 solves, of about that many after the burn-in."""
    gradients = isinstance(move, ef.moves.HamiltonianMove)
    cost = (move.steps if gradients else 1) * len(starts)
    kept = max(20, solves // cost)
    options = {"ensembles": 1, "seed": seed, "starts": starts}
    run = ef.run(posterior, move, len(starts), kept // 4 + kept, **options)
    return 1000 * ef.diagnose(run, discard=kept // 4).ess_bulk.min() / (kept * cost)


def compare(d: int, building: int, solves: int) -> tuple[object, ...]:
    """Return a row of the table."""
    posterior = simulate(d, building)
    start = posterior.prior.mean[None]
    laplace = ef.find_map(posterior, start, seed=building, check=2_000)
    draws = laplace.draw(3 * d + SAMPLES, seed=building)
    metric = laplace.maxima[0].covariance
    hmc = ef.moves.HamiltonianMove.tuned(posterior, draws[:SAMPLES], metric, seed=1)
    moves = [(hmc, draws[-WALKERS:], solves)]
    moves += [(ef.DEMCMove(), draws[-3 * d :], 4 * solves)]  # more, to be stable
    ess = [efficiency(posterior, *each, seed=building) for each in moves]
    return d, building, laplace.pareto_k, f"{hmc.steps} x {hmc.step_size:.2f}", *ess


COLUMNS = {"storeys": "d", "building": "d", "Pareto k": ".2f", "steps": ""}
COLUMNS |= {"HMC": ".1f", "DE-MC": ".1f"}


def main(
    storeys: tuple[int, ...] = (20, 30, 50), solves: int = 20_000, buildings: int = 3
) -> Table:
    """Print and return a table with a row per building."""
    cases = itertools.product(storeys, range(1, buildings + 1))
    rows = (compare(*case, solves) for case in cases)
    return tabulate("ESS per 1000 solves", COLUMNS, rows)


if __name__ == "__main__":
    command(main)
