"""How large an ensemble a cluster needs: 1,000 workers simulated, 32 measured.

One ensemble can have half of its walkers under way at once, and the ensembles of a run
are under way together. The half must be back before the other half moves, so a
generation lasts as long as its slowest worker. Solver times are log-normal, and the
master takes some time to hand out each. A larger ensemble uses the workers better, but
every walker has its own burn-in. If all solves take the same time, 2 to 4 walkers per
worker are enough; if their times vary, 8 to 16. Beyond some hundred workers, make each
ensemble a job of its own, with its own ``seed``.

The last table is measured, with threads that sleep for a solve: four ensembles of 16
walkers, together as ``run`` has them on a pool, and one after another.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/cluster_scaling.py
"""

import heapq
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from commands import command

import emcee_femu as ef
from emcee_femu.table import Table

JOBS = 40_000  # simulated, for every number of the tables
WALKERS_PER_WORKER = (2, 4, 8, 16)


def makespan(times: np.ndarray, workers: int, dispatch: float = 0.0) -> float:
    """Return when the last job ends, each given to the next free worker in turn."""
    free = [0.0] * workers  # when each worker is free: a heap
    for number, duration in enumerate(times, 1):
        start = max(free[0], number * dispatch)
        heapq.heapreplace(free, start + duration)
    return max(free)


def efficiency(workers: int, jobs: int, cov: float, dispatch: float = 0.0) -> float:
    """Return the share of the workers' time that is spent in the solver.

    Args:
        workers: How many work at once.
        jobs: Evaluations at once: walkers over splits.
        cov: Coefficient of variation of the solver's log-normal time.
        dispatch: Time to hand out one job, as a share of the mean solver time.
    """
    rng = np.random.default_rng(0)
    sigma = np.sqrt(np.log1p(cov**2))
    times = rng.lognormal(-0.5 * sigma**2, sigma, (-(-JOBS // jobs), jobs))  # mean 1
    ends = [makespan(row, workers, dispatch) for row in times]
    return float(times.sum() / (workers * np.sum(ends)))


def simulated(mean: float, cov: float, dispatch: float, most: int) -> Table:
    """Tabulate the efficiency in percent for clusters of up to ``most`` workers."""
    sizes = [size for size in (1, 2, 8, 32, 128, 512, 1_000) if size <= most]
    rows = []
    for size in sizes:
        jobs = [k * size // 2 for k in WALKERS_PER_WORKER]
        busy = [100 * efficiency(size, n, cov, dispatch / mean) for n in jobs]
        rows.append((size, *busy))
    return Table(
        f"Simulated: efficiency in %; a solve of {mean:g} s, c.o.v. {cov:g}, "
        f"{1e3 * dispatch:g} ms to hand it out",
        ("workers", *(f"{k} walkers per worker" for k in WALKERS_PER_WORKER)),
        ("d", *(".0f",) * len(WALKERS_PER_WORKER)),
        tuple(rows),
    )


def measured(solve: float = 0.05, steps: int = 20, most: int = 32) -> Table:
    """Tabulate seconds of four ensembles of 16 walkers on threads that sleep."""

    def model(p: dict[str, float]) -> list[float]:
        time.sleep(solve)
        return [p["f1"], p["f2"]]

    names = ["f1", "f2"]
    prior = ef.GaussianPrior(names, [1.0, 2.0], 0.2)
    term = ef.FrequencyTerm([1.0, 2.0], relative_sd=0.1)
    posterior = ef.LogPosterior(ef.FunctionModel(model), term, prior)
    rows = []
    for workers in (size for size in (2, 16, 32, 64) if size <= most):
        with ThreadPoolExecutor(workers) as pool:
            options = dict(nwalkers=16, steps=steps, pool=pool)
            begun = time.perf_counter()
            run = ef.run(posterior, ef.DEMCMove(), ensembles=4, seed=1, **options)
            together = time.perf_counter() - begun
            begun = time.perf_counter()
            for seed in range(4):
                ef.run(posterior, ef.DEMCMove(), ensembles=1, seed=seed, **options)
            alone = time.perf_counter() - begun
        busy = 100 * run.solves * solve / (workers * together)
        rows.append((workers, alone, together, alone / together, busy))
    return Table(
        f"Measured: 4 x 16 walkers, {steps} steps, solves of {1e3 * solve:g} ms",
        ("workers", "one after another s", "together s", "ratio", "efficiency %"),
        ("d", ".2f", ".2f", ".2f", ".0f"),
        tuple(rows),
    )


def main(
    mean: float = 60.0,
    cov: float = 0.3,
    dispatch: float = 1e-3,
    most: int = 1_000,
    solve: float = 0.05,
) -> list[Table]:
    """Print and return the tables: equal times, the given scatter, a large one.

    Args:
        mean: Seconds of a solve.
        cov: Coefficient of variation of these seconds.
        dispatch: Seconds to hand out one job.
        most: Workers, at most.
        solve: Seconds of a solve where it is slept.
    """
    tables = [simulated(mean, scatter, dispatch, most) for scatter in (0.0, cov, 1.0)]
    tables.append(measured(solve, most=min(most, 32)))
    print(*tables, sep="\n\n")
    return tables


if __name__ == "__main__":
    command(main)
