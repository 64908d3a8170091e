"""Look for the modes of a posterior: scan, climb where no known mode explains a point.

Local climbs find modes whose region holds much of the prior; a narrow mode beside a
wide one is only found by points that hit it. Therefore a share of the evaluations
scans: draws of the prior, and draws about the modes found, wider and wider.
"""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..contracts import Floats, read_declared
from ..evaluation.evaluator import Evaluation
from ..models.paired import PairedModel
from ..moves.mixture import GAUSSIAN, Mixture
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import prior_centre, summarize_prior
from .climbing import Maximum, climb, distinct
from .first_solve import doubt_reach
from .proposals import Draws

UNEXPLAINED = 2.0  # log-density beyond what Gaussians at the modes say
WAY_POINTS = np.array([0.2, 0.4, 0.6, 0.8])  # of the way from a mode to a point
VALLEY = 0.5  # log-density below that of the point
TESTED = 8  # points per ensemble in a round, by weight and by what is unexplained
SHARE_TESTED = 0.1  # of the points of a search are spent on the ways, each time
UNTESTED = 2  # climbs to known modes after which valleys are asked for
FRUITLESS = 4  # climbs in a row to known modes that end the search
MOST_CLIMBS = 60  # from such points
# Of the points of a search, spent on climbs from the prior with derivatives, when one
# takes a few solves; so many at once.
CLIMBED_SHARE, CLIMBED_AT_ONCE = 0.5, 24
NEGLIGIBLE = 12.0  # log evidence below the largest without a component
SCAN_WIDENS = 2.0  # ratio of the widths of scans about the modes
MOST_SCANS = 6
FIRST_DF = 8.0
FOLLOWED_MAC = 0.8  # MAC of a mode that is followed: two turned ones share less


class Search:
    """What has been evaluated, and what was found.

    Args:
        evaluator: What evaluates.
        streams: A random stream per ensemble.

    Attributes:
        draws: All points, weighted.
        theta: All points ``(n, d)``.
        heights: Their log-posteriors, ``(n,)``.
        owner: The ensemble of each point, ``(n,)``.
        maxima: Of all climbs, distinct.
        found_by: The climbs of each ensemble that ended there, by maximum.
        climbs: How many there were.
        from_prior: How many of them began at a draw of the prior, whatever its height.
        most: Solves at which they end.
    """

    def __init__(
        self, evaluator: Evaluation, streams: Sequence[np.random.Generator]
    ) -> None:
        self.evaluator, self.streams = evaluator, streams
        self.theta = np.empty((0, evaluator.posterior.ndim))
        self.heights, self.owner = np.empty(0), np.empty(0, dtype=np.intp)
        self.maxima: list[Maximum] = []
        self.found_by: list[list[int]] = []
        self.climbs = self.from_prior = 0

    def run(self, size: int, starts: Sequence[Floats] | None, most: float) -> None:
        """Climb, and scan the prior and the surroundings of the modes for others.

        Args:
            size: How many points.
            starts: Points ``(n, d)`` of each ensemble that are searched too.
            most: Solves at which climbs end where they are.

        Raises:
            ValueError: If the posterior is zero at all of them, or one is infinite.
        """
        prior, self.most = self.evaluator.posterior.prior, most
        each = -(-size // (2 * len(self.streams)))
        drawn = [prior.sample(rng, each) for rng in self.streams]
        if not np.isfinite(drawn).all():
            raise ValueError(
                "prior: some draws are infinite; scipy.stats.lognorm takes (s, scale=)"
            )
        theta, rows = self._evaluate(drawn)
        for doubt in doubt_reach(self.evaluator.posterior, rows):
            warnings.warn(doubt, stacklevel=5)
        self.draws = Draws(theta, rows)
        if starts is not None:
            self._evaluate(starts)
        if not np.isfinite(self.heights).any():
            raise ValueError(
                f"posterior: it is zero at all of {len(theta)} draws of the prior; "
                "widen the errors, or narrow the prior to where it can be solved (for "
                "solves that fail, on_failure='raise' tells why)"
            )
        members = [np.flatnonzero(self.owner == i) for i in range(len(self.streams))]
        self._climb([int(some[np.argmax(self.heights[some])]) for some in members])
        if not self.maxima:
            raise ValueError(
                "moves: 'auto' could not climb to any maximum: solves or "
                "their derivatives fail at every start; fix them, or use DEMCMove()"
            )
        if self.evaluator.posterior.differentiable:
            self._climb_from_prior(len(theta), CLIMBED_SHARE * size)
        self._follow(size)
        scans = self._wider_mixtures()
        for mixture in scans:
            number = -(-each // len(scans))
            drawn = [mixture.draw(rng, number) for rng in self.streams]
            self.draws.add(*self._evaluate(drawn), mixture)
        self._follow(size)

    def mixture(self) -> Mixture:
        """Return a Student-t component for each maximum, weighted by its evidence."""
        evidences = np.array([m.log_evidence for m in self.maxima])
        kept = np.flatnonzero(evidences > evidences.max() - NEGLIGIBLE)
        return Mixture(
            np.exp(evidences[kept] - logsumexp(evidences[kept])),
            np.array([self.maxima[i].theta for i in kept]),
            np.array([self.maxima[i].covariance for i in kept]),
            FIRST_DF,
        )

    def _evaluate(self, points: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Evaluate points of each ensemble, and keep them."""
        theta = np.concatenate(points)
        rows = self.evaluator.rows(theta)
        owner = np.repeat(np.arange(len(points)), [len(part) for part in points])
        self.theta = np.vstack([self.theta, theta])
        self.heights = np.append(self.heights, rows[:, 0])
        self.owner = np.append(self.owner, owner)
        return theta, rows

    def _climb(self, numbers: Sequence[int]) -> bool:
        """Climb from some of the points; return whether there is a new mode."""
        starts, guess = self.theta[numbers], None
        if self.maxima:
            nearest = self.mixture().squared_distances(starts[:1])[0].argmin()
            guess = self.mixture().matrices[nearest]
        left = self.most - self.evaluator.solves
        reached = climb(self.evaluator, starts, guess, left, masses=True)
        self.climbs += len(starts)
        pairs = zip(reached, self.owner[numbers].tolist(), strict=True)
        return any([self._add(maximum, ensemble) for maximum, ensemble in pairs])

    def _follow(self, size: int) -> None:
        """Climb from points that the modes do not explain.

        At first from the ones explained least. Where that leads to known modes again,
        only from points that a valley parts from the mode they would belong to.
        """
        left = round(SHARE_TESTED * size / len(WAY_POINTS))
        fruitless = 0
        tested = np.zeros(len(self.theta), dtype=bool)
        waiting: list[int] = []
        while fruitless < FRUITLESS and self.climbs - self.from_prior < MOST_CLIMBS:
            if self.evaluator.solves > self.most:
                return
            excess = self._find_excess()
            waiting = [i for i in waiting if excess[i] > UNEXPLAINED]
            if waiting:
                fruitless = 0 if self._climb([waiting.pop()]) else fruitless + 1
                continue
            waiting = self._choose(excess, tested)
            if not waiting:
                return
            if fruitless < UNTESTED:
                waiting = waiting[: UNTESTED - fruitless]
                tested[waiting] = True
            elif len(waiting) > left:
                return
            else:
                left -= len(waiting)
                tested[waiting] = True
                waiting = self._find_valleys(waiting)
            waiting.sort(key=lambda i: self.heights[i])

    def _climb_from_prior(self, draws: int, budget: float) -> None:
        """Climb from draws of the prior while they are cheap: many, at once."""
        spent = self.evaluator.solves
        for first in range(0, draws, CLIMBED_AT_ONCE):
            if self.evaluator.solves > min(self.most, spent + budget):
                return
            numbers = range(first, min(first + CLIMBED_AT_ONCE, draws))
            finite = [i for i in numbers if np.isfinite(self.heights[i])]
            if finite:
                self._climb(finite)
                self.from_prior += len(finite)

    def _find_excess(self) -> Floats:
        """Return the log-densities beyond those of Gaussians at the modes."""
        total = logsumexp([maximum.log_evidence for maximum in self.maxima])
        gaussians = replace(self.mixture(), df=GAUSSIAN)
        explained = gaussians.log_density(self.theta)
        return np.asarray(self.heights - total - explained)

    def _choose(self, excess: Floats, tested: NDArray[np.bool_]) -> list[int]:
        """Return untested points that the modes explain least, by ensembles in turn.

        Each round begins at another ensemble, for only the first points may be taken.
        """
        possible = np.isfinite(self.heights) & (excess > UNEXPLAINED) & ~tested
        queues: list[list[int]] = []
        for ensemble in range(len(self.streams)):
            eligible = possible & (self.owner == ensemble)
            ranks = [
                np.where(eligible, values, -np.inf).argsort()[: -TESTED // 2 - 1 : -1]
                for values in (excess, self.heights)
            ]
            both = np.column_stack(ranks).ravel()  # in turn
            queues.append([i for i in dict.fromkeys(both.tolist()) if eligible[i]])
        first = self.climbs % len(queues)
        turns = zip_longest(*queues[first:], *queues[:first])
        return [i for turn in turns for i in turn if i is not None]

    def _find_valleys(self, numbers: Sequence[int]) -> list[int]:
        """Return those points that a valley parts from the nearest mode.

        On the straight way to it the density falls below that of the point.
        """
        mixture, theta = self.mixture(), self.theta[numbers]
        modes = mixture.means[np.argmin(mixture.squared_distances(theta), axis=1)]
        ways = modes[:, None] + WAY_POINTS[:, None] * (theta - modes)[:, None]
        rows = self.evaluator.rows(ways.reshape(-1, theta.shape[1]))
        lowest = rows[:, 0].reshape(len(numbers), -1).min(axis=1)
        pairs = zip(numbers, lowest, strict=True)
        return [i for i, low in pairs if low < self.heights[i] - VALLEY]

    def _add(self, maximum: Maximum, ensemble: int) -> bool:
        """Take in the end of a climb; return whether it is a new mode."""
        if not np.isfinite(maximum.log_evidence):
            return False
        last = len(self.maxima)
        together = distinct([*self.maxima, maximum])
        same = next(group for group in together if last in group)
        if len(same) > 1:
            self.found_by[min(same)][ensemble] += 1
            return False
        self.maxima.append(maximum)
        self.found_by.append([int(i == ensemble) for i in range(len(self.streams))])
        return True

    def _wider_mixtures(self) -> list[Mixture]:
        """Return the mixture of the modes at widths up to that of the prior."""
        mixture = self.mixture()
        spread = summarize_prior(self.evaluator.posterior.prior)[1]
        widths = np.sqrt(np.diagonal(mixture.matrices, axis1=1, axis2=2))
        ratio = float((spread / widths).max())
        factors = SCAN_WIDENS ** np.arange(1, MOST_SCANS + 1)
        return [
            replace(mixture, matrices=mixture.matrices * factor**2)
            for factor in factors[factors < ratio]
        ]


def follow_modes(posterior: LogPosterior, theta: Floats) -> dict[str, Floats]:
    """Return which modes the model has at points, in their order at the prior mean.

    Modes are followed by the model's own shapes, where it has shapes and its modes are
    compared in ascending order. If two of them change places, so do the frequencies
    that they are compared with. It takes a solve at each point, and two at the prior
    mean.

    Args:
        posterior: What was searched.
        theta: Points ``(g, d)``.

    Returns:
        The numbers of the modes ``(g, p)``, 1 = the lowest, by experiment; 0 for a mode
        that no longer has its shape, or is so close to another at the prior mean that
        they have no order. Empty where nothing is known.
    """
    centre = prior_centre(posterior.prior)
    reference = dict(zip(posterior.names, centre.tolist(), strict=True))
    followed = {}
    for experiment in posterior.experiments:
        offered = read_declared(experiment.model, "variables") or {}
        read = [variables for term in experiment.terms if (variables := term.reads)]
        sizes = [v["frequency"].size for v in read if "frequency" in v]
        if "shapes" not in offered or "model_mode" in offered or not sizes:
            continue
        try:
            at_mean = PairedModel(
                experiment.model,
                1.0 + np.arange(max(sizes)),  # any: modes are paired by shapes alone
                reference=reference,
                candidates=offered["frequency"].size,
                min_mac=FOLLOWED_MAC,
            )
            found = at_mean(posterior.parameters(np.vstack([centre, theta])))
        except Exception:  # of any kind: it is the user's model that raised
            continue
        frequencies = found.frequencies[0]
        close = np.diff(frequencies) < at_mean.min_gap * frequencies[1:]
        unclear = np.append(close, False) | np.append(False, close)
        numbers = np.where(found.unpaired | unclear, 0, found.model_mode)
        followed[experiment.name] = numbers[1:]
    return followed
