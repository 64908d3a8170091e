"""The DE-MC move in plain emcee: nothing else of this package is used.

Target: a Gaussian in 5 dimensions with correlation 0.9 and scales from 1e-8 to 1e8, as
areas stand beside stiffnesses. ``DEMCMove`` takes the place of ``emcee.moves.DEMove``
in an ``EnsembleSampler``, alone or in a weighted list with emcee's own moves. The
default noise follows the walkers, so that no scale has to be given.

Run it:  python examples/benchmarks/stock_moves.py
"""

import argparse

import emcee
import numpy as np

from emcee_femu.moves import DEMCMove

SCALES = np.array([1e-8, 1e-4, 1.0, 1e4, 1e8])
CORRELATION = 0.1 * np.eye(5) + 0.9
PRECISION = np.linalg.inv(CORRELATION)


def log_prob(theta: np.ndarray) -> float:
    """Return the log density at one point ``(5,)``."""
    x = theta / SCALES
    return float(-0.5 * x @ PRECISION @ x)


def main(generations: int = 4_000, seed: int = 3) -> dict[str, np.ndarray]:
    """Sample with three settings; return the standard deviations over the scales."""
    start = SCALES * np.random.default_rng(seed).normal(size=(20, 5))
    settings = {
        "DEMCMove()": DEMCMove(),
        "90 % DEMCMove(), 10 % DEMCMove(gamma0=1)": [
            (DEMCMove(), 0.9),
            (DEMCMove(gamma0=1.0), 0.1),
        ],
        "half DEMCMove(), half emcee's StretchMove()": [
            (DEMCMove(), 0.5),
            (emcee.moves.StretchMove(), 0.5),
        ],
    }
    result = {}
    for name, moves in settings.items():
        np.random.seed(seed)  # noqa: NPY002 - emcee copies this global stream
        sampler = emcee.EnsembleSampler(20, 5, log_prob, moves=moves)
        sampler.run_mcmc(start, generations)
        draws = sampler.get_chain(discard=generations // 5, flat=True)
        result[name] = draws.std(axis=0) / SCALES
        tau = sampler.get_autocorr_time(tol=0).max()
        accepted = sampler.acceptance_fraction.mean()
        print(f"{name}: acceptance {accepted:.2f}, tau {tau:.0f}")
        print("  sd / exact sd:", result[name].round(3))
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=4_000)
    parser.add_argument("--seed", type=int, default=3)
    main(**vars(parser.parse_args()))
