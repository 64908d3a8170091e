"""A cluster through dask: the evaluations of one sampler on any number of machines.

The solver here stands for an external FE program: it solves the paper's mass-spring
structure and takes its time. The posterior goes to each worker once, then only
coordinates travel, and the chain is the one that a serial run with this seed gives.

Without an address two workers are started on this machine. On a cluster, start a
scheduler and the workers, and give the scheduler's address. In a Slurm job:

    #SBATCH --ntasks=64 --cpus-per-task=1
    export OMP_NUM_THREADS=1
    dask scheduler --port 8786 &
    srun dask worker tcp://$(hostname):8786 --nthreads 1 &
    python examples/cluster_dask.py --scheduler tcp://$(hostname):8786 --workers 64

In a PBS job (``#PBS -l select=2:ncpus=32:mpiprocs=32``) ``mpiexec`` takes the place of
``srun``. The workers need the same Python packages as this script, emcee_femu among
them; what stands in the script itself is sent along. No more than half the walkers are
evaluated at once, hence 4 walkers per worker here: 2 evaluations each, one after the
other. ``examples/benchmarks/cluster_scaling.py`` shows what other numbers give.

A worker that dies is no loss: dask gives its work to another. If a run must survive
the end of the whole job, give it a file, ``ef.run(..., backend="run.chain")``.

Run it:  python examples/cluster_dask.py
"""

import argparse
import time
from collections.abc import Mapping
from functools import partial

import numpy as np

import emcee_femu as ef

STRUCTURE = ef.paper.mass_spring()


def solver(parameters: Mapping[str, float], seconds: float) -> np.ndarray:
    """Return five frequencies in Hz: put the call of your own program here."""
    time.sleep(seconds)
    one = {name: np.array([value]) for name, value in parameters.items()}
    return STRUCTURE.model(one).frequencies[0]


def main(
    scheduler: str | None = None,
    workers: int = 2,
    generations: int = 100,
    seconds: float = 0.05,
    seed: int = 1,
) -> np.ndarray:
    """Sample on the cluster; return the chain ``(generations, walkers, 5)``."""
    from distributed import Client, LocalCluster  # an optional extra

    nwalkers = max(16, 4 * workers)
    model = ef.FunctionModel(partial(solver, seconds=seconds), n_modes=5)
    posterior = ef.LogPosterior(
        model, STRUCTURE.posterior.terms, STRUCTURE.posterior.prior
    )
    cluster = None
    if scheduler is None:
        cluster = LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=None
        )
    client = Client(scheduler if cluster is None else cluster)
    try:
        client.wait_for_workers(workers)  # else one worker gets all at first
        print(
            f"{sum(client.nthreads().values())} workers at {client.scheduler.address}"
        )
        begin = time.perf_counter()
        samplers = ef.run(
            posterior,
            nwalkers=nwalkers,
            nsteps=generations,
            seed=seed,
            pool=ef.EvaluationPool(client),
        )
        elapsed = time.perf_counter() - begin
    finally:
        client.close()
        if cluster is not None:
            cluster.close()
    chain = samplers[0].get_chain()
    tried = nwalkers * (generations + 1)
    print(
        f"{tried} points by {nwalkers} walkers in {elapsed:.1f} s; a solve takes "
        f"{seconds:g} s, those outside the bounds none: one after the other they would "
        f"take up to {tried * seconds:.1f} s"
    )
    idata = ef.to_inference_data(samplers, posterior, discard=generations // 2)
    print(ef.parameter_table(idata, STRUCTURE.target))
    return chain


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scheduler", help="address, such as tcp://node1:8786")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--generations", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=0.05, help="of one solve")
    parser.add_argument("--seed", type=int, default=1)
    main(**vars(parser.parse_args()))
