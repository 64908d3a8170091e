"""Which sampler? Both structures of the paper under seven moves.

In model updating the FE solve is what costs, and one is spent on every proposal inside
the bounds, accepted or not. What it buys are effective samples: n correlated draws fix
a mean as well as ESS = n / tau independent ones, tau being the autocorrelation time.
The currency is thus the ESS per 1000 evaluations, for the parameter that fares worst.

A random walk pays for the shape of the posterior. Five masses, ten springs: stiffnesses
trade against one another, so that the posterior is a thin tilted ellipsoid; a step that
is short enough across it needs many to go along it. DE-MC takes its steps from the
differences of other walkers, which lie along the ellipsoid by themselves; so does
Metropolis-Hastings, once it is tuned to the covariance of an earlier run. The H at
beta = 10 is nearly the prior, cut by its bounds: wide, without correlation, and most
proposals end outside, where they cost no solve. An independence proposal ("auto")
escapes the ceiling of random walks: it is fitted to a search and jumps to anywhere.

All moves start from the same draws of the prior, in independent ensembles, and their
ESS is judged by its spread over these ensembles. A chain of fewer than 50
autocorrelation times does not know its own tau, and cannot win.

What to look for: "auto" is far ahead on both, also when its search is counted ("end to
end"). On the springs its ensembles may differ, with other seeds: in some, a walker
stays long in the lobe at k4 < 1980 N/m, where the fitted proposal is thin. The DE-MC
variants (the paper's sweep, two halves in turn, emcee's DEMove) and tuned M-H are of
one kind.

Run it:  python examples/compare_moves.py
"""

import argparse
from pathlib import Path
from typing import Any

import emcee
import matplotlib

matplotlib.use("Agg")  # figures go to files

import numpy as np

import emcee_femu as ef

PROBLEMS = {  # with the paper's numbers of walkers, and a share of the generations
    "mass_spring": (ef.paper.mass_spring, 10, 1),
    "h_structure": (ef.paper.h_structure, 14, 2),  # half as many: its solve is dearer
}


def tuned(
    posterior: ef.LogPosterior, nwalkers: int, generations: int, seed: int
) -> ef.MetropolisMove:
    """Return M-H with the covariance of a short DE-MC run, and say what that cost."""
    (first,) = ef.run(posterior, None, nwalkers, generations, seed=seed)
    draws = first.get_chain(discard=generations // 2, flat=True)
    print(
        f"M-H was tuned to a DE-MC run of {generations * nwalkers} evaluations, which "
        "the table does not count"
    )
    return ef.MetropolisMove.tuned(draws)


def main(
    generations: int = 5_000,
    ensembles: int = 4,
    seed: int = 2026,
    output: str = "figures/compare_moves",
) -> dict[str, ef.comparison.compare.Comparison]:
    """Compare the moves on both structures, print tables, write tables and figures."""
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    results = {}
    for name, (problem, nwalkers, divisor) in PROBLEMS.items():
        nsteps = generations // divisor
        posterior = problem().posterior
        print(f"\n===== {name} =====\n")
        moves: dict[str, Any] = {
            "DE-MC (paper)": ef.DEMCMove(nsplits=nwalkers),
            "DE-MC (red-blue)": ef.DEMCMove(),
            "M-H untuned": ef.MetropolisMove(
                sd=np.ptp(posterior.prior.bounds, axis=1) / 20
            ),
            "M-H tuned": tuned(posterior, nwalkers, nsteps // 2, seed + 1),
            "emcee StretchMove": emcee.moves.StretchMove(),
            "emcee DEMove": emcee.moves.DEMove(),
            "auto": "auto",
        }
        results[name] = compared = ef.compare_moves(
            posterior,
            moves,
            nwalkers,
            nsteps,
            ensembles=ensembles,
            seed=seed,
            progress=True,
        )
        print(f"\n{compared}\n")
        compared.table.to_csv(folder / f"{name}.csv")
        ef.plot_comparison(compared).savefig(folder / f"{name}.png", dpi=100)
    print(f"Tables (CSV) and figures (PNG) are in {folder.resolve()}")
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=5_000)
    parser.add_argument("--ensembles", type=int, default=4)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--output", default="figures/compare_moves")
    main(**vars(parser.parse_args()))
