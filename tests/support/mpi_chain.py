"""Run by ``mpiexec`` from test_clusters.py: chains of all routes into a file."""

import pickle
import sys

from emcee_femu import EvaluationPool
from support.pool_problems import ordinary, run, sample

if __name__ == "__main__":
    if sys.argv[1] == "futures":  # here, since pytest looks for doctests in this file
        from mpi4py.futures import MPIPoolExecutor as MPIPool
    else:
        from schwimmbad import MPIPool

    with MPIPool() as pool:
        if "fail" in sys.argv:
            run(ordinary, pool=pool)
        pools = pool, EvaluationPool(pool), EvaluationPool(pool, 1)
        found = [sample(own)[0].get_chain() for own in pools]
        try:
            run(ordinary, pool=pool)
        except ArithmeticError as error:
            found.append("\n".join(error.__notes__))
    with open(sys.argv[2], "wb") as file:
        pickle.dump(found, file)
