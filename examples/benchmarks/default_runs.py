"""What a run takes that ends by itself: ``ef.run(posterior, seed=...)``.

Two springs are the example of the README; mass-spring and the H structure are those of
the paper; the frame is the one of the page "A modal test", with inferred errors; the
aircraft is GARTEUR SM-AG19, six parameters, its modes paired by shape.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/default_runs.py  (ten minutes)
"""

import os
import runpy
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

import matplotlib
import numpy as np
from commands import command, tabulate

import emcee_femu as ef
from emcee_femu.table import Table

matplotlib.use("Agg")  # of the pages
EXAMPLES = Path(__file__).parents[1]
sys.path.append(str(EXAMPLES))
FACTORS = ("density", "fin small", "fin torsion",
           "wing small", "wing large", "wing torsion")  # fmt: skip


def of_page(page: str) -> ef.LogPosterior:
    """Return the posterior that a page builds."""
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        return runpy.run_path(str(EXAMPLES / page))["posterior"]


def aircraft() -> ef.LogPosterior:
    """Return that of the page "A real aircraft", by shape."""
    from garteur import MEASURED, garteur

    sd, limits = [0.05] + 5 * [0.2], [(0.8, 1.25)] + 5 * [(0.5, 2.0)]
    bounds = dict(zip(FACTORS, limits, strict=True))
    small = ef.reduce_model(garteur(FACTORS, n_modes=12, shapes=True), bounds)
    drawn = dict.fromkeys(FACTORS, 1.0)
    paired = ef.PairedModel(small, MEASURED, reference=drawn, candidates=12)
    prior = ef.GaussianPrior(FACTORS, np.ones(6), sd, limits)
    return ef.LogPosterior(paired, ef.FrequencyTerm(MEASURED, relative_sd=0.01), prior)


PROBLEMS: dict[str, Callable[[], ef.LogPosterior]] = {
    "two springs": lambda: of_page("start/first_posterior.py"),
    "mass-spring": lambda: ef.paper.mass_spring().posterior,
    "H structure, beta 10": lambda: ef.paper.h_structure(beta=10.0).posterior,
    "frame": lambda: of_page("tutorials/modal_test.py"),
    "aircraft": aircraft,
}
COLUMNS = {
    "problem": "", "runs": "", "converged": "", "solves": ",.0f", "most": ",",
    "search": ",.0f", "ESS": ",.0f", "1,000 more": ",.0f",
}  # fmt: skip


def main(
    seeds: int = 10, first: int = 0, problems: tuple[str, ...] = tuple(PROBLEMS)
) -> Table:
    """Print and return the table."""

    def row(name: str) -> tuple[object, ...]:
        posterior, converged, found = PROBLEMS[name](), 0, []
        for seed in range(first, first + seeds):
            run = ef.run(posterior, seed=seed)
            diagnosis = ef.diagnose(run)
            converged += diagnosis.converged
            found.append((run.solves, run.search.solves, diagnosis.ess_bulk.min()))
        solves, search, sizes = np.array(found).T
        more = 1e3 * (solves - search) / sizes  # the search is not repeated
        medians = [*map(np.median, (solves, search, sizes, more))]
        return name, seeds, converged, medians[0], int(solves.max()), *medians[1:]

    return tabulate("Default runs; medians of the seeds", COLUMNS, map(row, problems))


if __name__ == "__main__":
    command(main)
