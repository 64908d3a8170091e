"""Delayed acceptance by subchains, guided by an emulator: ESS per 1000 full solves.

A model is emulated from few solves, then walkers start from draws of the emulated
posterior and walk so many cheap steps between two full solves. Full solves are those of
the chain, as the black box counts them; the ESS is ArviZ's bulk ESS of the worst
parameter, walkers as chains. "efficiency" is that of importance weights of independent
draws of the emulated posterior.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/subchains.py mass_spring
"""

import argparse
from collections.abc import Sequence

import numpy as np
from few_solves_problems import PROBLEMS

import emcee_femu as ef
from emcee_femu.results.arviz_objects import effective_sizes
from emcee_femu.sampling.importance import kish_share


def main(
    name: str, solves: int, lengths: Sequence[int], chain: int, seed: int = 1
) -> dict[int, float]:
    """Print and return ESS per 1000 full solves by subchain length.

    Args:
        name: Of the problem.
        solves: Which the emulator may take.
        lengths: Cheap steps between full solves.
        chain: Proposals to solve in full, about, for each length.
        seed: A whole number.
    """
    problem = PROBLEMS[name]()
    full, box = problem.posterior, problem.box
    small = ef.emulate(full, solves, seed=seed)
    cheap, nwalkers = small.posterior, 4 * full.ndim
    (run,) = ef.run(cheap, "auto", nwalkers, 300, seed=seed)
    draws, rng = run.get_chain(flat=True), np.random.default_rng(seed)
    some = rng.choice(draws, 200, replace=False)
    share = kish_share(full(some)[:, 0] - cheap(some)[:, 0])
    print(f"{name}: {small.solves} solves to train, efficiency {share:.3f}")
    found = {}
    for length in lengths:
        move = ef.DelayedAcceptanceMove(ef.DEMCMove(), cheap, length)
        start, before = rng.choice(draws, nwalkers, replace=False), box.solves
        (sampler,) = ef.run(
            full, move, nwalkers, chain // nwalkers, seed=seed, initial=start
        )
        ess = effective_sizes(sampler.get_chain().transpose(1, 0, 2))[0].min()
        found[length] = 1000 * ess / (box.solves - before)
        print(f"steps={length}: {found[length]:.0f} ESS per 1000 solves; {move}")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problem", choices=[*PROBLEMS])
    parser.add_argument("--solves", type=int, default=60)
    parser.add_argument("--lengths", type=int, nargs="+", default=[1, 50, 100, 200])
    parser.add_argument("--chain", type=int, default=3_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    main(given.problem, given.solves, given.lengths, given.chain, given.seed)
