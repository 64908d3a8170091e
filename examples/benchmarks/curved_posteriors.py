"""A curved posterior, and how "auto" does on it.

Ten storey stiffnesses of a building from eight frequencies to 0.5 %, without shapes.

Data are simulated with parameters drawn from the prior, anew with each seed. The
effective sample size is the bulk ESS of the worst parameter, over all solves,
including those of the search.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/curved_posteriors.py
"""

import functools
import time

import numpy as np
from buildings import draw, measure, shear_building, terms_of
from commands import command, tabulate

import emcee_femu as ef
from emcee_femu.table import Table


def building(seed: int) -> tuple[ef.LogPosterior, dict[str, float]]:
    """Return the posterior of a shear building, and the true parameters."""
    names, rng = [f"k{i}" for i in range(1, 11)], np.random.default_rng(seed)
    model, prior = shear_building(names, 2e5, 8, [])
    truth = draw(prior, rng)
    terms = terms_of(measure(model, truth, 8, rng))
    posterior = ef.LogPosterior(model, terms, prior)
    return posterior, {name: value.item() for name, value in truth.items()}


def run(steps: int, seed: int) -> tuple[object, ...]:
    """Return a row of the table."""
    posterior, truth = building(seed)
    begun = time.process_time()
    found = ef.run(posterior, "auto", nwalkers=40, steps=steps, seed=seed)
    seconds = time.process_time() - begun
    diagnosis = ef.diagnose(found)
    samples = np.concatenate([sampler.get_chain(flat=True) for sampler in found])
    low, high = np.quantile(samples, [0.025, 0.975], axis=0)
    true = np.array([truth[name] for name in posterior.names])
    inside = f"{np.sum((low < true) & (true < high))}/{len(truth)}"
    ess = diagnosis.ess_bulk.min()
    efficiency, said = 1e3 * ess / found.solves, diagnosis.chains.short
    return seed, found.solves, ess, efficiency, said, inside, seconds


COLUMNS = {
    "seed": "", "solves": ",d", "ESS": ",.0f", "ESS/1000": ".1f", "chains": "",
    "truths inside": "", "s": ".0f",
}  # fmt: skip


def main(seeds: int = 10, steps: int = 250) -> Table:
    """Print and return the table."""
    rows = map(functools.partial(run, steps), range(seeds))
    return tabulate("A building without shapes", COLUMNS, rows)


if __name__ == "__main__":
    command(main)
