"""Curved posteriors, and how "auto" does on them.

building    ten storey stiffnesses from eight frequencies to 0.5 %, without shapes
springs     the paper's five springs from the prior, with few evaluations

Data are simulated with parameters drawn from the prior, anew with each seed. The
effective sample size is the bulk ESS of the worst parameter, over all solves,
including those of the search and of gradients.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/curved_posteriors.py
"""

import functools
import time

import numpy as np
from buildings import draw, measure, shear_building, terms_of
from commands import command, tabulate

import emcee_femu as ef

Problem = tuple[ef.LogPosterior, dict[str, float]]  # and the true parameters


def building(seed: int) -> Problem:
    """Return a shear building."""
    names, rng = [f"k{i}" for i in range(1, 11)], np.random.default_rng(seed)
    model, prior = shear_building(names, 2e5, 8, [])
    truth = draw(prior, rng)
    terms = terms_of(measure(model, truth, 8, rng))
    posterior = ef.LogPosterior(model, terms, prior)
    return posterior, {name: value.item() for name, value in truth.items()}


def springs(seed: int) -> Problem:
    """Return the paper's mass-spring example, whose data are always the same."""
    problem = ef.paper.mass_spring()
    return problem.posterior, problem.target


PROBLEMS = {  # and steps, walkers of each ensemble
    "building": (building, 1_000, 40),
    "springs": (springs, 10, 50),
}


def run(name: str, steps: int | None, seed: int) -> tuple[object, ...]:
    """Return a row of the table."""
    problem, usual, nwalkers = PROBLEMS[name]
    posterior, truth = problem(seed)
    begun = time.process_time()
    found = ef.run(posterior, "auto", nwalkers, steps or usual, seed=seed)
    seconds = time.process_time() - begun
    diagnosis = ef.diagnose(found)
    samples = np.concatenate([sampler.get_chain(flat=True) for sampler in found])
    low, high = np.quantile(samples, [0.025, 0.975], axis=0)
    true = np.array([truth.get(name, np.nan) for name in posterior.names])
    inside = f"{np.sum((low < true) & (true < high))}/{len(truth)}"
    ess = diagnosis.ess_bulk.min()
    efficiency, said = 1e3 * ess / found.solves, diagnosis.chains.short
    return seed, found.solves, ess, efficiency, said, inside, seconds


COLUMNS = {
    "seed": "", "solves": ",d", "ESS": ",.0f", "ESS/1000": ".1f", "chains": "",
    "truths inside": "", "s": ".0f",
}  # fmt: skip


def main(
    problem: tuple[str, ...] = tuple(PROBLEMS),
    seeds: int = 10,
    steps: int | None = None,
) -> None:
    """Print a table for each problem."""
    for name in problem:
        tabulate(name, COLUMNS, map(functools.partial(run, name, steps), range(seeds)))


if __name__ == "__main__":
    command(main)
