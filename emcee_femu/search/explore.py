"""Explore a posterior: scan it, and climb where no known maximum explains a point.

Climbs find maxima whose region holds much of the prior; a narrow maximum beside a wide
one is only found by points that hit it. Therefore a share of the solves scans: draws of
the prior, and draws about the maxima found, wider and wider.
"""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from ..contracts import Floats
from ..moves.mixture import Mixture
from ..posterior.log_posterior import LOG_POSTERIOR
from ..posterior.plausibility import doubt_reach
from ..posterior.priors import summarize_prior
from .campaign import Campaign
from .climbing import climb
from .proposal import WIDER, Proposal
from .shoulders import UNEXPLAINED, find_shoulders

# Least part of the search's solves for climbs, whatever is reserved for other stages.
CLIMBED_AT_LEAST = 1 / 3
# Places at which the way from a maximum to a point is probed, relative to its length.
WAY_POINTS = np.array([0.2, 0.4, 0.6, 0.8])
# A valley parts a point from a maximum if the lowest log-density on the way is below
# that of the point by this.
VALLEY = 0.5
# Points of each ensemble that are candidates in a round: half of them the highest, half
# those that are explained least.
TESTED = 8
# Most solves for probing ways each time, relative to the points of a search.
SHARE_TESTED = 0.1
# Number of climbs from the prior that share their batches.
CLIMBED_AT_ONCE = 24


def explore(campaign: Campaign) -> None:
    """Climb, and scan the prior and the surroundings of the maxima for others.

    Raises:
        ValueError: If the posterior is zero at all draws, one of them is infinite, or
            no climb arrives.
    """
    search, c, size = _Exploration(campaign), campaign, campaign.sizes.points
    prior = c.posterior.prior
    each = -(-size // (2 * len(c.streams)))
    drawn = [prior.sample(rng, each) for rng in c.streams]
    if not np.isfinite(drawn).all():
        raise ValueError(
            "prior: some draws are infinite; scipy.stats.lognorm takes (s, scale=)"
        )
    theta, rows = search.evaluate(drawn)
    for doubt in doubt_reach(c.posterior, rows):
        warnings.warn(doubt, stacklevel=5)
    c.archive.add(theta, rows)
    if c.starts is not None:
        search.evaluate(c.starts)
    if not np.isfinite(search.heights).any():
        raise ValueError(
            f"posterior: it is zero at all of {len(theta)} draws of the prior; "
            "widen the errors, or narrow the prior to where it can be solved (for "
            "solves that fail, on_failure='raise' tells why)"
        )
    search.climb_from_highest()
    if not c.maxima.found:
        raise ValueError(
            "moves: 'auto' could not climb to any maximum: solves or "
            "their derivatives fail at every start; fix them, or use DEMCMove()"
        )
    if c.posterior.differentiable:
        search.climb_from_prior(len(theta), size / 2)
    search.follow(size)
    most = c.evaluator.solves + SHARE_TESTED * size
    find_shoulders(
        c.evaluator,
        c.maxima,
        search.theta,
        search.heights,
        c.settings.fruitless,
        min(search.most, most),
    )
    scans = search.wider_mixtures()
    for mixture in scans:
        number = -(-each // len(scans))
        drawn = [mixture.draw(rng, number) for rng in c.streams]
        c.archive.add(*search.evaluate(drawn), mixture)
    search.follow(size)
    c.points = len(search.theta)
    begins = [c.maxima.mixture().seen_in(logs) for logs in c.coordinates]
    c.proposal = Proposal.fitted(max(begins, key=c.archive.effective_share))


class _Exploration:
    """The points of an exploration, whatever law they came from.

    Attributes:
        theta: All points ``(n, d)``.
        heights: Their log-posteriors, ``(n,)``.
        owner: The ensemble of each point, ``(n,)``.
        most: Solves at which climbs end where they are.
    """

    def __init__(self, campaign: Campaign) -> None:
        self.evaluator, self.maxima = campaign.evaluator, campaign.maxima
        self.settings, self.ensembles = campaign.settings, len(campaign.streams)
        ledger = campaign.ledger
        self.most = max(ledger.end(), CLIMBED_AT_LEAST * ledger.total)
        self.theta = np.empty((0, campaign.posterior.ndim))
        self.heights, self.owner = np.empty(0), np.empty(0, dtype=np.intp)

    def evaluate(self, points: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Evaluate points of each ensemble, and keep them."""
        theta = np.concatenate(points)
        rows = self.evaluator.rows(theta)
        owner = np.repeat(np.arange(len(points)), [len(part) for part in points])
        self.theta = np.vstack([self.theta, theta])
        self.heights = np.append(self.heights, rows[:, LOG_POSTERIOR])
        self.owner = np.append(self.owner, owner)
        return theta, rows

    def climb(self, numbers: Sequence[int]) -> bool:
        """Climb from some of the points; return whether there is a new maximum."""
        starts, guess = self.theta[numbers], None
        if self.maxima.found:
            guess = self.maxima.nearest(starts[0])
        left = self.most - self.evaluator.solves
        reached = climb(self.evaluator, starts, guess, left, masses=True)
        self.maxima.climbs += len(starts)
        pairs = zip(reached, self.owner[numbers].tolist(), strict=True)
        return any([self.maxima.add(maximum, by) for maximum, by in pairs])

    def climb_from_highest(self) -> None:
        """Climb from the highest point of each ensemble."""
        members = [np.flatnonzero(self.owner == i) for i in range(self.ensembles)]
        self.climb([int(some[np.argmax(self.heights[some])]) for some in members])

    def climb_from_prior(self, draws: int, budget: float) -> None:
        """Climb from draws of the prior while they are cheap: many, at once."""
        spent = self.evaluator.solves
        for first in range(0, draws, CLIMBED_AT_ONCE):
            if self.evaluator.solves > min(self.most, spent + budget):
                return
            numbers = range(first, min(first + CLIMBED_AT_ONCE, draws))
            finite = [i for i in numbers if np.isfinite(self.heights[i])]
            if finite:
                self.climb(finite)
                self.maxima.from_prior += len(finite)

    def follow(self, size: int) -> None:
        """Climb from points that the maxima do not explain.

        At first the climbs begin at the points that are explained least. Where that
        leads to known maxima again, they begin only at points that a valley parts from
        the maximum that they would belong to.
        """
        left = round(SHARE_TESTED * size / len(WAY_POINTS))
        fruitless, few = 0, self.settings.untested
        tested = np.zeros(len(self.theta), dtype=bool)
        waiting: list[int] = []
        while fruitless < self.settings.fruitless:
            if self.evaluator.solves > self.most:
                return
            excess = self.maxima.excess(self.theta, self.heights)
            waiting = [i for i in waiting if excess[i] > UNEXPLAINED]
            if waiting:
                fruitless = 0 if self.climb([waiting.pop()]) else fruitless + 1
                continue
            waiting = self._choose(excess, tested)
            if not waiting:
                return
            if fruitless < few:
                waiting = waiting[: few - fruitless]
                tested[waiting] = True
            elif len(waiting) > left:
                return
            else:
                left -= len(waiting)
                tested[waiting] = True
                waiting = self._find_valleys(waiting)
            waiting.sort(key=lambda i: self.heights[i])

    def wider_mixtures(self) -> list[Mixture]:
        """Return the mixture of the maxima at widths up to that of the prior."""
        mixture = self.maxima.mixture()
        spread = summarize_prior(self.evaluator.posterior.prior)[1]
        widths = np.sqrt(np.diagonal(mixture.matrices, axis1=1, axis2=2))
        ratio = float((spread / widths).max())
        count = max(int(np.ceil(np.log(ratio) / np.log(WIDER))), 1)
        return [
            replace(mixture, matrices=mixture.matrices * WIDER ** (2 * step))
            for step in range(1, count)
        ]

    def _choose(self, excess: Floats, tested: NDArray[np.bool_]) -> list[int]:
        """Return untested points that are explained least, by ensembles in turn.

        Each round begins with another ensemble, since only the first may be taken.
        """
        possible = np.isfinite(self.heights) & (excess > UNEXPLAINED) & ~tested
        queues: list[list[int]] = []
        for ensemble in range(self.ensembles):
            eligible = possible & (self.owner == ensemble)
            ranks = [
                np.where(eligible, values, -np.inf).argsort()[: -TESTED // 2 - 1 : -1]
                for values in (excess, self.heights)
            ]
            both = np.column_stack(ranks).ravel()  # in turn
            queues.append([i for i in dict.fromkeys(both.tolist()) if eligible[i]])
        first = self.maxima.climbs % len(queues)
        turns = zip_longest(*queues[first:], *queues[:first])
        return [i for turn in turns for i in turn if i is not None]

    def _find_valleys(self, numbers: Sequence[int]) -> list[int]:
        """Return those points that a valley parts from the nearest maximum.

        On the straight way to it, the density falls clearly below that of the point.
        """
        mixture, theta = self.maxima.mixture(), self.theta[numbers]
        tops = mixture.means[np.argmin(mixture.squared_distances(theta), axis=1)]
        ways = tops[:, None] + WAY_POINTS[:, None] * (theta - tops)[:, None]
        rows = self.evaluator.rows(ways.reshape(-1, theta.shape[1]))
        heights = rows[:, LOG_POSTERIOR].reshape(len(numbers), -1)
        pairs = zip(numbers, heights.min(axis=1), strict=True)
        return [i for i, low in pairs if low < self.heights[i] - VALLEY]
