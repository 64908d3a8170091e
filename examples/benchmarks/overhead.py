"""What a generation costs: our moves against emcee's, in paired runs.

The two samplers of a pair take turns in short blocks on one thread, and the median of
the block-by-block ratios is printed, so that a drift of the machine's speed cancels.
The first table is the bare overhead, on a Gaussian that costs next to nothing. The
second compares the mass-spring posterior under ``DEMCMove``, vectorised over walkers,
with the same posterior written as most scripts are: one walker at a time,
``scipy.linalg.eigh(K, M)``, under emcee's ``DEMove``.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/overhead.py
"""

import time
from collections.abc import Callable
from typing import Any

import emcee
import numpy as np
from commands import command
from scipy.linalg import eigh

import emcee_femu as ef


def gaussian(theta: np.ndarray) -> np.ndarray:
    """Return the log density of a batch ``(n, d)``."""
    return -0.5 * np.einsum("ij,ij->i", theta, theta)


def looped_mass_spring() -> Callable[[np.ndarray], float]:
    """Return the mass-spring log-posterior of one walker, written by hand."""
    problem = ef.paper.mass_spring()
    mass = np.diag(problem.model.masses)
    ends = [(0, 4), (0, 1), (1, 4), (1, 3), (3, 4), (0, 3), (0, 2), (2, 3), (0, 3)]
    ends = {f"k{i}": pair for i, pair in enumerate([*ends, (3, 5)], 1)}
    fixed = {"k3": 3200.0, "k5": 1840.0, "k9": 2800.0, "k10": 2000.0}
    names = problem.posterior.names
    low, high = problem.posterior.prior.bounds.T
    mean = np.array([*problem.initial.values()])

    def log_prob(theta: np.ndarray) -> float:
        if (theta < low).any() or (theta > high).any():
            return -np.inf
        k = dict(zip(names, theta, strict=True)) | fixed
        k["k7"] = k["k2"]
        K = np.zeros((6, 6))
        for name, (i, j) in ends.items():
            K[[i, j], [i, j]] += k[name]
            K[[i, j], [j, i]] -= k[name]
        f = np.sqrt(eigh(K[1:, 1:], mass, eigvals_only=True)) / (2 * np.pi)
        misfit = 6.8e5 * (((problem.measured - f) / problem.measured) ** 2).sum()
        return float(-0.5 * misfit - 0.5 * (((theta - mean) / 1e3) ** 2).sum())

    return log_prob


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
    """Print both comparisons for three ensemble sizes."""
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

    print("a generation of the mass-spring posterior: vectorised    looped, scipy eigh")
    problem, looped = ef.paper.mass_spring(), looped_mass_spring()
    for nwalkers in (10, 32, 128):
        (burn_in,) = ef.run(
            problem.posterior, ef.DEMCMove(), nwalkers, ensembles=1, seed=1
        )
        start = burn_in.get_chain()[-1]
        ours = emcee.EnsembleSampler(
            nwalkers, 5, problem.posterior, moves=ef.DEMCMove(), vectorize=True
        )
        theirs = emcee.EnsembleSampler(nwalkers, 5, looped, moves=emcee.moves.DEMove())
        print(
            f"  N = {nwalkers:3d}   ",
            paired(ours, theirs, start, max(blocks // 4, 2), max(n // 10, 2)),
        )


if __name__ == "__main__":
    command(main)
