"""The paper's first structure by long runs, too long for its page.

Five masses and ten springs (``ef.paper.mass_spring``), by DE-MC with the paper's 10
walkers and 10,000 generations; and the share of a thin lobe of the posterior at low k4,
by the default move with 40 walkers.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/paper_runs.py  (five minutes)
"""

import numpy as np
from commands import command, draws_of, tabulate

import emcee_femu as ef
from emcee_femu.table import Table

LOBE = 1980.0  # N/m; the lobe has k4 below it
COLUMNS = {
    "parameter": "", "mean": ".1f", "published": ".1f", "apart, sd": ".2f",
    "c.o.v. %": ".2f", "published c.o.v. %": ".2f",
}  # fmt: skip


def main(steps: int = 10_000, lobe_steps: int = 4_000) -> tuple[Table, Table]:
    """Print and return both tables; the first fifth of the DE-MC steps is left out."""
    problem = ef.paper.mass_spring()
    posterior, published = problem.posterior, problem.published
    run = ef.run(posterior, ef.DEMCMove(), nwalkers=10, steps=steps, seed=2026)
    idata = ef.to_inference_data(run, discard=steps // 5)
    found = ef.parameter_table(idata)
    names = found.column("parameter")
    mean, cv = (np.array(found.column(title)) for title in ("mean", "c.o.v. %"))
    theirs, their_cv = ([*by.values()] for by in published.parameters.values())
    apart = np.abs(mean - theirs) / (cv / 100 * mean)
    rows = zip(names, mean, theirs, apart, cv, their_cv, strict=True)
    title = f"DE-MC, 4 x 10 walkers, {steps:,} generations; stiffnesses in N/m"
    compared = tabulate(title, COLUMNS, rows)
    print()

    run = ef.run(posterior, nwalkers=40, steps=lobe_steps, seed=1)
    in_lobe = draws_of(run)[:, names.index("k4")] < LOBE
    # TAE: the mean error of the frequencies, here at the mean parameters
    tae = ef.frequency_table(idata, posterior).column("error %  ")[-1]
    rows = [
        (
            "TAE at the mean parameters, %",
            tae,
            published.frequencies["paper error %"][-1],
        ),
        (f"samples with k4 < {LOBE:.0f} N/m, %", 100 * in_lobe.mean(), np.nan),
    ]
    formats = {"": "", "ours": "#.2g", "published": "#.2g"}
    return compared, tabulate("TAE, and the lobe (by auto)", formats, rows)


if __name__ == "__main__":
    command(main)
