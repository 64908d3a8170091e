"""How large an ensemble a cluster needs: 1,000 workers simulated, 32 measured.

Half of the walkers of an ensemble must be back before the other half moves, so that a
generation lasts as long as its slowest worker. Solver times are log-normal, and the
master takes some time to hand out each. A larger ensemble uses the workers better, but
every walker has its own burn-in. If all solves take the same time, 2 to 4 walkers per
worker are enough; if their times vary, 8 to 16.

The last table is measured, with threads that sleep for a solve: four ensembles of 16
walkers, together as ``run`` has them on a pool, and one after another.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/cluster_scaling.py
"""

import heapq
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from commands import command, tabulate

import emcee_femu as ef
from emcee_femu.table import Table

MEAN, COV = 60.0, 0.3  # of the seconds of a solve
DISPATCH = 1e-3  # s to hand out a job
JOBS = 40_000  # simulated, for every number of the tables
SIZES = 1, 2, 8, 32, 128, 512, 1_000  # workers
PER_WORKER = 2, 4, 8, 16  # walkers
SIMULATED = {"workers": "d"} | {f"{k} walkers per worker": ".0f" for k in PER_WORKER}
MEASURED = {"workers": "d", "one after another s": ".2f", "together s": ".2f"}
MEASURED |= {"ratio": ".2f", "efficiency %": ".0f"}


def makespan(times: np.ndarray, workers: int, dispatch: float = 0.0) -> float:
    """Return when the last job ends, each given to the next free worker in turn."""
    free = [0.0] * workers  # when each worker is free: a heap
    for number, duration in enumerate(times, 1):
        start = max(free[0], number * dispatch)
        heapq.heapreplace(free, start + duration)
    return max(free)


def efficiency(workers: int, jobs: int, cov: float, dispatch: float = 0.0) -> float:
    """Return the share of the workers' time that is spent in the solver.

    Jobs are the evaluations at once, walkers over splits; cov is that of the solver's
    time, and dispatch the time to hand out one job, as a share of its mean.
    """
    rng = np.random.default_rng(0)
    sigma = np.sqrt(np.log1p(cov**2))
    times = rng.lognormal(-0.5 * sigma**2, sigma, (-(-JOBS // jobs), jobs))  # mean 1
    ends = [makespan(row, workers, dispatch) for row in times]
    return float(times.sum() / (workers * np.sum(ends)))


def time_runs(workers: int, solve: float, steps: int = 20) -> tuple[float, ...]:
    """Return the seconds of four ensembles, in turn and together, and their ratio."""

    def model(p: dict[str, float]) -> list[float]:
        time.sleep(solve)
        return [p["f1"], p["f2"]]

    prior = ef.GaussianPrior(["f1", "f2"], [1.0, 2.0], 0.2)
    term = ef.FrequencyTerm([1.0, 2.0], relative_sd=0.1)
    posterior = ef.LogPosterior(ef.FunctionModel(model), term, prior)
    options = dict(nwalkers=16, steps=steps)
    with ThreadPoolExecutor(workers) as options["pool"]:
        begun = time.perf_counter()
        run = ef.run(posterior, ef.DEMCMove(), ensembles=4, seed=1, **options)
        together = time.perf_counter() - begun
        begun = time.perf_counter()
        for seed in range(4):
            ef.run(posterior, ef.DEMCMove(), ensembles=1, seed=seed, **options)
        alone = time.perf_counter() - begun
    busy = 100 * run.solves * solve / (workers * together)
    return workers, alone, together, alone / together, busy


def main(most: int = 1_000, solve: float = 0.05) -> list[Table]:
    """Print and return the tables for ``most`` workers; a measured solve is a sleep."""
    tables = []
    for scatter in (0.0, COV, 1.0):
        title = f"Simulated: efficiency in %; solves of {MEAN:g} s, c.o.v. {scatter:g}"
        rows = []
        for size in (size for size in SIZES if size <= most):
            jobs = [k * size // 2 for k in PER_WORKER]
            shares = [efficiency(size, n, scatter, DISPATCH / MEAN) for n in jobs]
            rows.append((size, *(100 * share for share in shares)))
        tables.append(tabulate(title, SIMULATED, rows))
    title = f"Measured: 4 x 16 walkers, 20 steps, solves of {1e3 * solve:g} ms"
    sizes = [size for size in (2, 16, 32) if size <= most]
    tables.append(tabulate(title, MEASURED, (time_runs(n, solve) for n in sizes)))
    return tables


if __name__ == "__main__":
    command(main)
