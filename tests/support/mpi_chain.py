"""Run by ``mpiexec`` from test_pools.py: chains of all routes into a file."""

import pickle
import sys

from emcee_femu.sampling.pools.evaluation_pool import EvaluationPool
from support.pool_problems import POSTERIOR, chain, failing, posterior_of

if __name__ == "__main__":
    from schwimmbad import MPIPool  # here, since pytest looks for doctests in this file

    with MPIPool() as pool:
        found = [
            chain(pool),
            chain(EvaluationPool(pool)),
            chain(EvaluationPool(pool, 1)),
        ]
        points = POSTERIOR.start(8, 1)
        points[:, 2] = 2_100.0
        points[5, 2] = 2_500.0
        try:
            EvaluationPool(pool).map(posterior_of(failing), points)
        except ArithmeticError as error:
            found.append(error.__notes__[-1])
    with open(sys.argv[1], "wb") as file:
        pickle.dump(found, file)
