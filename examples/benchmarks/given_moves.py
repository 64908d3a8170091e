"""Runs by given moves, which start from the prior and end by their verdict.

Is what they leave out as burn-in enough, and are they right when they are called
converged? "auto", which has no burn-in, stands beside them. The bar: no converged run
has a standard deviation off by more than 12 % and two claimed errors, or a mean by .15
sd and three. docs/explanation/calibration.md has the tables.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/given_moves.py  (half an hour)
"""

import functools
from collections.abc import Callable
from typing import Any

import emcee
import numpy as np
from benchmark import fe5
from commands import command, tabulate
from default_runs import of_page
from hard_posteriors import Target, box, correlated, posterior_of
from hard_targets import COLUMNS, Run, Truth, compare, summarize

import emcee_femu as ef
from emcee_femu.table import Table

DRAWS = 400_000  # of a fitted mixture, whose weights are even
BETAS = np.linspace(1, 0, 8) ** 4


def weighed(posterior: ef.LogPosterior) -> tuple[ef.LogPosterior, Truth]:
    """Return a posterior, and its moments by weighted draws of a search's proposal."""
    law = ef.run(posterior, seed=4_711, steps=1).search.mixture
    x = law.draw(np.random.default_rng(1), DRAWS)
    low, high = posterior.prior.bounds.T
    x = x[((x > low) & (x < high)).all(axis=1)]
    pieces = np.array_split(x, 100)
    log_weights = np.concatenate(
        [posterior(p)[:, 0] - law.log_density(p) for p in pieces]
    )
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    mean = weights @ x
    sd = np.sqrt(weights @ (x - mean) ** 2)
    return posterior, Truth(mean, sd, np.ones(1), int(1 / (weights**2).sum()))


def gaussian(d: int, correlation: float, half: float) -> tuple[ef.LogPosterior, Truth]:
    """Return a correlated Gaussian of sd 1 in a box of so many sds to either side."""
    target: Target = correlated(correlation, np.ones((d, 1)), box(d, -half, half), 0.0)
    truth = Truth(np.zeros(d), np.ones(d), np.ones(1), 10**9)
    return posterior_of(target), truth


PROBLEMS: dict[str, Callable[[], tuple[ef.LogPosterior, Truth]]] = {
    "two springs": lambda: weighed(of_page("start/first_posterior.py")),
    "mass-spring": lambda: weighed(ef.paper.mass_spring().posterior),
    "five springs": lambda: weighed(fe5().posterior),
    "Gaussian, d=8": lambda: gaussian(8, 0.8, 20.0),
    "Gaussian, d=2": lambda: gaussian(2, 0.5, 100.0),
}


def tuned(posterior: ef.LogPosterior) -> Any:
    """Return a Metropolis move with the covariance of the posterior."""
    found = ef.run(posterior, seed=4_711)
    draws = np.concatenate([sampler.get_chain(flat=True) for sampler in found])
    return ef.MetropolisMove(cov=2.38**2 / posterior.ndim * np.cov(draws.T))


MOVES: dict[str, Callable[[ef.LogPosterior], Any]] = {
    "auto": lambda posterior: "auto",
    "DE-MC": lambda posterior: ef.DEMCMove(),
    "DE-MC, in turn": lambda posterior: ef.DEMCMove(nsplits=max(8, 2 * posterior.ndim)),
    "M-H, tuned": tuned,
    "stretch": lambda posterior: emcee.moves.StretchMove(),
    "tempered": lambda posterior: ef.moves.TemperedMove(ef.DEMCMove(), BETAS),
}


@functools.cache
def problem(name: str) -> tuple[ef.LogPosterior, Truth]:
    """Return a posterior and what is true of it."""
    return PROBLEMS[name]()


def main(
    seeds: int = 2,
    first: int = 100,
    problems: tuple[str, ...] = tuple(PROBLEMS),
    moves: tuple[str, ...] = tuple(MOVES),
) -> Table:
    """Print and return the table."""

    def row(name: str, move: str) -> tuple[object, ...]:
        posterior, truth = problem(name)
        given = MOVES[move](posterior)
        runs: list[Run] = [
            compare(posterior, truth, None, moves=given, seed=seed)
            for seed in range(first, first + seeds)
        ]
        return f"{name}: {move}", *summarize(name, runs)[1:]

    rows = (row(name, move) for name in problems for move in moves)
    return tabulate("Runs by given moves that end by their verdict", COLUMNS, rows)


if __name__ == "__main__":
    command(main)
