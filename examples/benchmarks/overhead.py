"""What a generation costs: our moves against emcee's, in paired runs.

The two samplers of a pair take turns in short blocks on one thread, and the median of
the block-by-block ratios is printed, so that a drift of the machine's speed cancels.
The target is a Gaussian that costs next to nothing.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/overhead.py
"""

import time
from typing import Any

import emcee
import numpy as np
from commands import command

import emcee_femu as ef


def gaussian(theta: np.ndarray) -> np.ndarray:
    """Return the log density of a batch ``(n, d)``."""
    return -0.5 * np.einsum("ij,ij->i", theta, theta)


def paired(ours: Any, theirs: Any, start: np.ndarray, blocks: int, n: int) -> str:
    """Run two samplers in turn; return microseconds a generation and the ratio."""

    def cost(sampler: Any) -> float:
        sampler.reset()
        begin = time.process_time()
        sampler.run_mcmc(start, n)
        return 1e6 * (time.process_time() - begin) / n

    cost(ours), cost(theirs)  # warm up
    pairs = np.array([(cost(ours), cost(theirs)) for _ in range(blocks)])
    ratio = np.median(pairs[:, 0] / pairs[:, 1])
    a, b = np.median(pairs, axis=0)
    return f"{a:8.0f} us   {b:8.0f} us   ratio {ratio:.2f}   ({1 / ratio:.1f} x faster)"


def main(blocks: int = 40, n: int = 300) -> None:
    """Print the comparison for three ensemble sizes."""
    independence = ef.IndependenceMove([1.0], np.zeros((1, 5)), [np.eye(5)])
    moves = {
        "DEMCMove()": ef.DEMCMove(),
        "IndependenceMove": independence,
        "auto's mixture": [(independence, 0.9), (ef.DEMCMove(mode_jump=0.1), 0.1)],
    }
    print("a generation, free target, d = 5:            ours    stock DEMove")
    for nwalkers in (10, 32, 128):
        start = np.random.default_rng(0).normal(size=(nwalkers, 5))
        for label, move in moves.items():
            pair = [
                emcee.EnsembleSampler(nwalkers, 5, gaussian, moves=own, vectorize=True)
                for own in (move, emcee.moves.DEMove())
            ]
            found = paired(*pair, start, blocks, n)
            print(f"  N = {nwalkers:3d}  {label:<17}", found)


if __name__ == "__main__":
    command(main)
