"""How large an ensemble a cluster needs: two workers measured, a thousand simulated.

One sampler can have ``nwalkers / nsplits`` evaluations under way at once: half the
ensemble, for the usual two splits. The half must be back before the other half moves,
so that a generation lasts as long as its unluckiest worker. A cluster is used well if

* every worker gets several evaluations of each half (then their times even out), or
* all evaluations take the same time and the half is a multiple of the workers.

The first table is measured here, with processes: an ``EvaluationPool`` of an executor,
as in ``run(..., workers=2)``, and emcee with a ``multiprocessing.Pool``. The efficiency
is the time of the serial run, over workers times the time of the first. The routes
take turns in short blocks, and the best block of each counts, since other programs
only slow a run down. One model burns a fixed amount of processor time; another waits
as long, like a solver on another machine, so that it shows what the pool alone costs
where the processors are not to be had.

The other tables are simulated: solver times are log-normal, and the master hands
evaluation after evaluation to the next free worker (``EvaluationPool(...,
chunksize=1)``), which takes it some time each. A larger ensemble is used better but
has its price: every walker has a burn-in of its own. So where all solves take the same
time, 2 to 4 walkers per worker are enough; where their times vary, 8 to 16. Beyond some
hundred workers rather run several ensembles, each a job of its own with its own
``seed``.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/cluster_scaling.py
"""

import argparse
import heapq
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import emcee
import numpy as np

import emcee_femu as ef
from emcee_femu.table import Table

JOBS = 40_000  # simulated, for every number of the tables
WALKERS_PER_WORKER = (2, 4, 8, 16)


@dataclass(frozen=True)
class CostlyModel:
    """A log-density that computes, waits, and has ballast to be sent along."""

    turns: int = 0
    wait: float = 0.0  # s
    ballast: np.ndarray | None = None

    def __call__(self, theta: np.ndarray) -> float:
        """Return the log density of one point."""
        spin(self.turns)
        if self.wait:
            time.sleep(self.wait)
        return -0.5 * float(theta @ theta)


def spin(turns: int) -> float:
    """Do a fixed amount of arithmetic."""
    total = 0.0
    for turn in range(turns):
        total += turn * 0.5
    return total


def turns_for(seconds: float) -> int:
    """Return how much arithmetic takes so long on this machine."""
    turns = 200_000
    best = min(_seconds(spin, turns) for _ in range(20))
    return round(turns * seconds / best)


def measured(
    rounds: int, workers: int = 2, seconds: float = 0.05, walkers: int = 32
) -> Table:
    """Time ``EvaluationPool`` and the bare pool against a serial run."""
    megabyte = np.random.default_rng(0).random(125_000)
    cost = f"{1e3 * seconds:g} ms"
    cases = {
        f"{cost} busy": (CostlyModel(turns=turns_for(seconds)), 1),
        f"{cost} waiting": (CostlyModel(wait=seconds), 1),
        "free": (CostlyModel(), 10),
        "free, 1 MB": (CostlyModel(ballast=megabyte), 10),
    }
    rows = []
    with (
        ProcessPoolExecutor(workers) as executor,
        multiprocessing.Pool(workers) as bare,
    ):
        adapter = ef.EvaluationPool(executor)
        for name, (model, steps) in cases.items():
            milliseconds = {"serial": [], "EvaluationPool": [], "bare pool": []}
            pools = (None, adapter, bare)
            for _ in range(rounds):
                for route, pool in zip(milliseconds, pools, strict=True):
                    sampler = emcee.EnsembleSampler(
                        walkers, 3, model, moves=ef.DEMCMove(), pool=pool
                    )
                    start = np.random.default_rng(1).normal(size=(walkers, 3))
                    state = sampler.run_mcmc(start, 1)  # the model is sent here
                    elapsed = _seconds(sampler.run_mcmc, state, steps)
                    milliseconds[route].append(1e3 * elapsed / steps)
            best = [min(times) for times in milliseconds.values()]
            rows.append((name, *best, best[0] / (workers * best[1])))
    return Table(
        f"Measured: ms per generation of {walkers} walkers, {workers} workers",
        ("model", "serial", "EvaluationPool", "bare pool", "efficiency"),
        ("", ".2f", ".2f", ".2f", ".2f"),
        tuple(rows),
    )


def makespan(times: np.ndarray, workers: int, dispatch: float = 0.0) -> float:
    """Return when the last job ends, each given to the next free worker in turn.

    Args:
        times: Duration of every job.
        workers: How many work at once.
        dispatch: What it takes the master to hand out one job.
    """
    free = [0.0] * workers  # when each worker is free: a heap
    for number, duration in enumerate(times, 1):
        start = max(free[0], number * dispatch)
        heapq.heapreplace(free, start + duration)
    return max(free)


def efficiency(
    workers: int,
    jobs: int,
    cov: float,
    dispatch: float = 0.0,
    repeats: int | None = None,
    seed: int = 0,
) -> float:
    """Return the share of the workers' time that is spent in the solver.

    Args:
        workers: How many work at once.
        jobs: Evaluations at once: walkers over splits.
        cov: Coefficient of variation of the solver's log-normal time.
        dispatch: Time to hand out one job, as a share of the mean solver time.
        repeats: Simulated half-generations; None for as many as hold JOBS jobs.
        seed: A whole number.
    """
    rng = np.random.default_rng(seed)
    sigma = np.sqrt(np.log1p(cov**2))
    repeats = -(-JOBS // jobs) if repeats is None else repeats
    times = rng.lognormal(-0.5 * sigma**2, sigma, (repeats, jobs))  # of mean 1
    ends = [makespan(row, workers, dispatch) for row in times]
    return float(times.sum() / (workers * np.sum(ends)))


def simulated(
    mean: float = 60.0,
    cov: float = 0.3,
    dispatch: float = 1e-3,
    most: int = 1_000,
) -> Table:
    """Tabulate the efficiency in percent for clusters of up to ``most`` workers."""
    sizes = [size for size in (1, 2, 8, 32, 128, 512, 1_000) if size <= most]
    rows = [
        (
            size,
            *(
                100 * efficiency(size, k * size // 2, cov, dispatch / mean)
                for k in WALKERS_PER_WORKER
            ),
        )
        for size in sizes
    ]
    return Table(
        f"Simulated: efficiency in %; a solve of {mean:g} s, c.o.v. {cov:g}, "
        f"{1e3 * dispatch:g} ms to hand it out",
        ("workers", *(f"{k} walkers per worker" for k in WALKERS_PER_WORKER)),
        ("d", *(".0f",) * len(WALKERS_PER_WORKER)),
        tuple(rows),
    )


def _seconds(function, *arguments) -> float:
    begin = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - begin


def main(
    rounds: int = 10,
    mean: float = 60.0,
    cov: float = 0.3,
    dispatch: float = 1e-3,
    most: int = 1_000,
    seconds: float = 0.05,
) -> list[Table]:
    """Print and return the tables."""
    tables = [
        measured(rounds, seconds=seconds),
        simulated(mean, 0.0, dispatch, most),
        simulated(mean, cov, dispatch, most),
        simulated(mean, 1.0, dispatch, most),
        simulated(seconds, cov, dispatch, most),
    ]
    for table in tables:
        print(table, end="\n\n")
    return tables


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=10, help="of timing")
    parser.add_argument("--mean", type=float, default=60.0, help="seconds of a solve")
    parser.add_argument("--cov", type=float, default=0.3, help="of the solver's time")
    parser.add_argument("--dispatch", type=float, default=1e-3, help="seconds per task")
    parser.add_argument("--most", type=int, default=1_000, help="workers")
    main(**vars(parser.parse_args()))
