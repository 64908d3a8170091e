"""A cluster: the evaluations of one sampler on any number of machines.

The solver here stands for an external FE program: it solves the paper's mass-spring
structure, slowly. The posterior is sent to each worker once, then only coordinates
are. The chain is that of a serial run with this seed.

With dask, two workers are started on this machine if no address is given. With MPI,
rank 0 samples, and the other ranks evaluate. The page "Use many processors, or a
cluster" (docs/how_to/clusters.md) has the job scripts.

Run it:  python examples/cluster.py
         mpiexec -n 3 python examples/cluster.py --mpi
"""

import argparse
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

import emcee_femu as ef

STRUCTURE = ef.paper.mass_spring()


def solver(parameters: Mapping[str, float], seconds: float) -> np.ndarray:
    """Return five frequencies in Hz: put the call of your own program here."""
    time.sleep(seconds)
    one = {name: np.array([value]) for name, value in parameters.items()}
    return STRUCTURE.model(one).frequencies[0]


@contextmanager
def dask_pool(scheduler: str | None, workers: int) -> Iterator[tuple[Any, int]]:
    """Yield a client of a dask cluster, and how many workers it has."""
    from distributed import Client, LocalCluster  # an optional extra

    options = {"threads_per_worker": 1, "dashboard_address": ":0"}  # any free port
    cluster = scheduler or LocalCluster(n_workers=workers, **options)
    with Client(cluster) as client:
        client.wait_for_workers(workers)  # else one worker gets all at first
        yield client, workers
    if scheduler is None:
        cluster.close()


@contextmanager
def mpi_pool() -> Iterator[tuple[Any, int]]:
    """Yield the ranks of an MPI job but the first, and how many they are."""
    from schwimmbad import MPIPool  # an optional extra

    with MPIPool() as ranks:  # the workers stay in this line until the end
        yield ranks, ranks.size


def main(
    scheduler: str | None = None,
    workers: int = 2,
    mpi: bool = False,
    steps: int = 100,
    seconds: float = 0.05,
    seed: int = 1,
) -> np.ndarray:
    """Sample on the cluster; return the chain ``(steps, walkers, 5)``."""
    model = ef.FunctionModel(partial(solver, seconds=seconds), n_modes=5)
    given = STRUCTURE.posterior
    posterior = ef.LogPosterior(model, given.terms, given.prior)
    with mpi_pool() if mpi else dask_pool(scheduler, workers) as (pool, count):
        begin = time.perf_counter()
        options = {"ensembles": 1, "seed": seed, "pool": pool}
        run = ef.run(posterior, ef.DEMCMove(), max(16, 4 * count), steps, **options)
        elapsed = time.perf_counter() - begin
    print(f"{count} workers: {run[0].nwalkers} walkers, {elapsed:.1f} s")
    idata = ef.to_inference_data(run, discard=steps // 2)
    print(ef.parameter_table(idata, STRUCTURE.target))
    return run[0].get_chain()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scheduler", help="address, such as tcp://node1:8786")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--mpi", action="store_true", help="under mpiexec or srun")
    main(**vars(parser.parse_args()))
