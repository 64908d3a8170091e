"""A look at where the draws of an emulated posterior are not.

Weights at the draws cannot see what the emulator excludes. Three things can: bounds
narrower than the prior's, draws that press against such a bound, and climbs of the true
posterior from draws of the prior.
"""

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..interfaces import Floats, Prior
from ..posterior.climbing import Maximum, climb_each
from ..posterior.log_posterior import LogPosterior
from .solved_draws import EmulatedChain

PRIOR_DRAWS = 20_000  # which cost no solve
LEFT_OUT = 0.01  # of the prior's probability, of which nothing would be known
NEAR, PRESSED = 0.1, 0.005  # standard deviations from a bound; share of draws there
SHARE, MOST = 4, 30  # solves for the search: at most a quarter, and no more than these
FIRST = 8  # starts that are put in order
STEPS = 3  # of a climb, below which it says nothing
MISSED = 0.01  # share of the posterior that may be missing
FOUND = 0.25  # of a maximum's share, below which the draws lack it
GAPS = 1.5  # times the largest gap between draws: farther than any of them
SHOWN = 2_000  # draws of the chain that are compared


def compare_bounds(
    chain: EmulatedChain, prior: Prior, rng: np.random.Generator
) -> list[str]:
    """Return what is wrong with the emulated posterior's bounds, without a solve."""
    faults = []
    theta = prior.sample(rng, PRIOR_DRAWS)
    low, high = chain.bounds.T
    left_out = 1 - ((theta >= low) & (theta <= high)).all(axis=1).mean()
    if left_out > LEFT_OUT:
        faults.append(
            f"the emulated posterior's bounds leave out {100 * left_out:.2g} % of the "
            "prior, and of what is there nothing is known; emulate within the bounds "
            "of the prior, or certify against a posterior whose prior is cut at those "
            "of the emulator"
        )
    sd = chain.draws.std(axis=0)
    for i, name in enumerate(chain.names):
        for end, sign in ((0, 1.0), (1, -1.0)):
            bound, beyond = chain.bounds[i, end], prior.bounds[i, end]
            if bound == beyond or not sign * (bound - beyond) > NEAR * NEAR * sd[i]:
                continue
            share = (sign * (chain.draws[:, i] - bound) < NEAR * sd[i]).mean()
            if share > PRESSED:
                faults.append(
                    f"the draws press against {name} = {bound:.5g} ({100 * share:.2g} "
                    f"% of them within {NEAR:g} standard deviations), where the "
                    "emulator ends but the prior does not; emulate within wider bounds"
                )
    return faults


class Search:
    """Climbs of the true posterior that stop when their solves are spent.

    Attributes:
        solves: Solves spent.
        theta: Every point that was evaluated, ``(n, d)``.
        log_posterior: Its log-posterior, ``(n,)``.
        maxima: Where climbs ended, if they came to an end.
    """

    def __init__(self, evaluation: Any, most: int) -> None:
        self._evaluation, self._most = evaluation, most
        self._start = evaluation.solves
        posterior: LogPosterior = evaluation.posterior
        self._per_slope = 1 if posterior.differentiable else posterior.ndim + 1
        self.theta, self.log_posterior = np.empty((0, posterior.ndim)), np.empty(0)
        self.maxima: list[Maximum] = []
        self._spent: int | None = None  # once it has ended

    @property
    def solves(self) -> int:
        """Solves spent so far; climbs read it."""
        if self._spent is not None:
            return self._spent
        so_far: int = self._evaluation.solves - self._start
        return so_far

    @property
    def worth_while(self) -> bool:
        """Whether there are solves for a few steps."""
        return self._most >= STEPS * self._per_slope

    def climb(self, prior: Prior, starts: Floats) -> None:
        """Climb from each start in turn until the solves are spent."""
        for start in starts:
            try:
                self.maxima += climb_each(self, start[None], prior)
            except _Spent:
                break
        self._spent = self.solves

    def rows(self, theta: Floats) -> Floats:
        """Return rows of the posterior."""
        self._pay(len(theta))
        rows: Floats = self._evaluation.rows(theta)
        self._keep(theta, rows)
        return rows

    def linearize(self, theta: Floats) -> Any:
        """Return rows, gradients and information."""
        self._pay(len(theta) * self._per_slope)
        found = self._evaluation.linearize(theta)
        self._keep(theta, found.rows)
        return found

    def _pay(self, price: int) -> None:
        if self.solves + price > self._most:
            raise _Spent

    def _keep(self, theta: Floats, rows: Floats) -> None:
        self.theta = np.vstack([self.theta, theta])
        self.log_posterior = np.append(self.log_posterior, rows[:, 0])


class _Spent(Exception):
    """The solves of a search are spent."""


def look_elsewhere(
    chain: EmulatedChain, evaluation: Any, most: int, rng: np.random.Generator
) -> Search:
    """Return a search from draws of the prior away from the draws of the chain."""
    search, prior = Search(evaluation, most), evaluation.posterior.prior
    starts = prior.sample(rng, 20 * most)
    away = distance(chain, starts)
    starts, away = starts[away > 1], away[away > 1]
    # The first climb begins where the draws are farthest of a few starts, since near
    # ones lead to the maximum that is known.
    order = np.argsort(-away[:FIRST])
    far = np.concatenate([starts[:FIRST][order], starts[FIRST:]])
    search.climb(prior, far[:most] if search.worth_while else far[:0])
    return search


def distance(chain: EmulatedChain, theta: Floats) -> Floats:
    """Return how far points ``(n, d)`` are from the draws, in their largest gaps."""
    some = chain.draws[:: -(-len(chain.draws) // SHOWN)]
    some = np.unique(some, axis=0)
    scale = np.atleast_2d(np.cov(chain.draws, rowvar=False))
    root = np.linalg.cholesky(scale + 1e-12 * np.diag(np.diag(scale)))
    tree = cKDTree(np.linalg.solve(root, some.T).T)
    gaps = tree.query(tree.data, k=2)[0][:, 1]
    found: Floats = tree.query(np.linalg.solve(root, theta.T).T)[0]
    found /= GAPS * gaps.max()
    return found


def find_missed(
    chain: EmulatedChain, search: Search, log_posterior: Floats, weights: Floats
) -> list[str]:
    """Return what a search found that the draws lack.

    Args:
        chain: Of the emulated posterior.
        search: Of the true one.
        log_posterior: The true log-posterior at the solved draws, ``(n,)``.
        weights: Their shares of the true posterior, ``(n,)``.
    """
    d = chain.draws.shape[1]
    scale = np.atleast_2d(np.cov(chain.draws, rowvar=False))
    log_volume = 0.5 * (d + d * np.log(2 * np.pi) + np.linalg.slogdet(scale)[1])
    heights = np.where(weights > 0, log_posterior, 0.0)
    known = float(weights @ heights) + log_volume  # the log evidence of a Gaussian
    faults = []
    for top in search.maxima:
        share = 1 / (1 + np.exp(np.clip(known - top.log_evidence, -500, 500)))
        if share < MISSED:
            continue
        offset = chain.draws - top.theta
        squares = np.einsum(
            "ni,ij,nj->n", offset, np.linalg.inv(top.covariance), offset
        )
        if (squares < d + 4 * np.sqrt(d)).mean() < FOUND * share:
            faults.append(
                f"a maximum of the true posterior is at {_name(chain, top.theta)}, "
                f"about {100 * share:.0f} % of it by Laplace's approximation, where "
                "the emulated one has hardly a draw; emulate with a start there"
            )
    if not faults and len(search.theta):
        middle = np.median(log_posterior)
        high = np.flatnonzero(search.log_posterior > middle)
        far = [i for i in high if distance(chain, search.theta[i : i + 1])[0] > 1]
        if far:
            best = max(far, key=lambda i: search.log_posterior[i])
            faults.append(
                "far from all draws of the emulated posterior the true one is as high "
                f"as at half of them, at {_name(chain, search.theta[best])}; emulate "
                "with a start there"
            )
    return faults[:1]


def _name(chain: EmulatedChain, theta: Floats) -> str:
    pairs = zip(chain.names, theta.tolist(), strict=True)
    return ", ".join(f"{name} = {value:.5g}" for name, value in pairs)
