"""Look for the modes of a posterior: scan, climb where no known mode explains a point.

Local climbs find modes whose region holds much of the prior; a narrow mode beside a
wide one is only found by points that hit it. Therefore a share of the evaluations
scans: draws of the prior, and draws about the modes found, wider and wider.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..interfaces import Floats, Prior
from ..moves.mixture_em import Mixture, draw, log_density, log_parts
from ..posterior.climbing import Maximum, climb_each, distinct
from ..posterior.priors import summarize_prior
from .refine import Draws

UNEXPLAINED = 2.0  # log-density beyond what Gaussians at the modes say
GAUSSIAN = 1e6  # degrees of freedom
ALONG = np.array([0.2, 0.4, 0.6, 0.8])  # of the way from a mode to a point
VALLEY = 0.5  # log-density below that of the point
TESTED = 8  # points per ensemble in a round, by weight and by what is unexplained
SHARE_TESTED = 0.2  # of the points of a search are spent on the ways
UNTESTED = 2  # climbs to known modes after which valleys are asked for
FRUITLESS = 4  # climbs in a row to known modes that end the search
MOST_CLIMBS = 60
NEGLIGIBLE = 12.0  # log evidence below the largest without a component
WIDER = 2.0  # ratio of the widths of scans about the modes
MOST_SCANS = 6
FIRST_DF = 8.0


@dataclass(eq=False)
class Search:
    """What has been evaluated, and what was found.

    Attributes:
        evaluation: With ``rows`` and ``linearize``.
        prior: The prior.
        streams: A random stream per ensemble.
        draws: All points, weighted.
        own: Points and rows of each ensemble.
        maxima: Of all climbs, distinct.
        found_by: The climbs of each ensemble that ended there, by maximum.
        climbs: How many there were.
    """

    evaluation: Any
    prior: Prior
    streams: list[np.random.Generator]
    draws: Draws = field(init=False)
    own: list[tuple[Floats, Floats]] = field(init=False, default_factory=list)
    maxima: list[Maximum] = field(init=False, default_factory=list)
    found_by: list[list[int]] = field(init=False, default_factory=list)
    climbs: int = field(init=False, default=0)

    def run(self, size: int, given: Floats | None) -> None:
        """Climb, and scan the prior and the surroundings of the modes for others.

        Args:
            size: How many points.
            given: Points of each ensemble ``(ensembles, n, d)`` that are searched too.

        Raises:
            ValueError: If the posterior is zero at all of them.
        """
        each = -(-size // (2 * len(self.streams)))
        points = [self.prior.sample(rng, each) for rng in self.streams]
        theta = np.concatenate(points)
        rows = self.evaluation.rows(theta)
        self.draws = Draws.of_prior(theta, rows)
        self._keep(points, rows)
        if given is not None:
            self._keep(list(given), self.evaluation.rows(np.concatenate(list(given))))
        if not any(np.isfinite(rows[:, 0]).any() for _, rows in self.own):
            raise ValueError(
                f"posterior: it is zero at all of {len(theta)} draws of the prior; "
                "widen the errors, or narrow the prior to where it can be solved (for "
                "solves that fail, on_failure='raise' tells why)"
            )
        self._climb([self._best(number) for number in range(len(self.own))])
        if not self.maxima:
            raise ValueError(
                "moves: 'auto' could not climb to any maximum: solves fail, or their "
                "derivatives do, wherever it began; mend them, or use DEMCMove()"
            )
        self._follow(size)
        scans = self._wider_laws()
        for law in scans:
            number = -(-each // len(scans))
            points = [draw(rng, law, number) for rng in self.streams]
            theta = np.concatenate(points)
            rows = self.evaluation.rows(theta)
            self.draws.add(theta, rows, law)
            self._keep(points, rows)
        self._follow(size)

    def law(self) -> Mixture:
        """Return a Student-t component for each maximum, weighted by its evidence."""
        evidences = np.array([m.log_evidence for m in self.maxima])
        kept = np.flatnonzero(evidences > evidences.max() - NEGLIGIBLE)
        return Mixture(
            np.exp(evidences[kept] - logsumexp(evidences[kept])),
            np.array([self.maxima[i].theta for i in kept]),
            np.array([self.maxima[i].covariance for i in kept]),
            FIRST_DF,
        )

    def _keep(self, points: list[Floats], rows: Floats) -> None:
        ends = np.cumsum([len(part) for part in points])[:-1]
        parts = list(zip(points, np.split(rows, ends), strict=True))
        if not self.own:
            self.own = parts
            return
        self.own = [
            (np.vstack([old, new]), np.vstack([old_rows, new_rows]))
            for (old, old_rows), (new, new_rows) in zip(self.own, parts, strict=True)
        ]

    def _best(self, number: int) -> tuple[int, Floats]:
        """Return an ensemble, and its point of the largest log-posterior."""
        theta, rows = self.own[number]
        return number, theta[np.argmax(rows[:, 0])]

    def _climb(self, starts: list[tuple[int, Floats]]) -> bool:
        """Climb from points of ensembles; return whether there is a new mode."""
        points = np.array([point for _, point in starts])
        reached = climb_each(self.evaluation, points, self.prior)
        self.climbs += len(points)
        pairs = zip(starts, reached, strict=True)
        return any([self._add(maximum, number) for (number, _), maximum in pairs])

    def _follow(self, size: int) -> None:
        """Climb from points that the modes do not explain.

        If Gaussians describe the modes, any such point leads to another one. Otherwise
        many do not, and only those are followed that a valley parts from the modes.

        Args:
            size: Of which a share may be spent on the ways to the modes.
        """
        left = round(SHARE_TESTED * size / len(ALONG))
        fruitless = 0
        tested = [np.zeros(len(theta), dtype=bool) for theta, _ in self.own]
        waiting: list[tuple[int, Floats, float]] = []
        while fruitless < FRUITLESS and self.climbs < MOST_CLIMBS:
            waiting = [
                (number, theta, height)
                for number, theta, height in waiting
                if self._excess(theta[None], np.array([height]))[0] > UNEXPLAINED
            ]
            if waiting:
                number, theta, _ = waiting.pop()
                fruitless = 0 if self._climb([(number, theta)]) else fruitless + 1
                continue
            chosen = [self._choose(i, done) for i, done in enumerate(tested)]
            waiting = [point for points in chosen for point in points]
            if not waiting:
                return
            if fruitless < UNTESTED:
                waiting = waiting[: UNTESTED - fruitless]
            elif len(waiting) > left:
                return
            else:
                left -= len(waiting)
                waiting = self._find_valleys(waiting)
            waiting.sort(key=lambda point: point[2])

    def _excess(self, theta: Floats, log_p: Floats) -> Floats:
        """Return the log-density beyond that of Gaussians at the modes."""
        total = logsumexp([maximum.log_evidence for maximum in self.maxima])
        density: Floats = (
            log_p - total - log_density(theta, self.law()._replace(df=GAUSSIAN))
        )
        return density

    def _choose(
        self, number: int, tested: NDArray[np.bool_]
    ) -> list[tuple[int, Floats, float]]:
        """Return untested points of an ensemble that the modes explain least."""
        theta, rows = self.own[number]
        heights = rows[:, 0]
        excess = self._excess(theta, heights)
        possible = np.isfinite(heights) & (excess > UNEXPLAINED) & ~tested
        # Out of bounds both densities are zero.
        gains = np.where(possible, heights - np.nan_to_num(rows[:, 1]), -np.inf)
        ranks = [
            values.argsort()[: -TESTED // 2 - 1 : -1]
            for values in (np.where(possible, excess, -np.inf), gains)
        ]
        both = np.column_stack(ranks).ravel()  # in turn
        chosen = [i for i in dict.fromkeys(both.tolist()) if possible[i]]
        tested[chosen] = True
        return [(number, theta[i], float(heights[i])) for i in chosen]

    def _find_valleys(
        self, points: list[tuple[int, Floats, float]]
    ) -> list[tuple[int, Floats, float]]:
        """Return those points that a valley parts from the nearest mode.

        Source: Ursem (1999), doi:10.1109/CEC.1999.785493.
        """
        law = self.law()
        theta = np.array([point for _, point, _ in points])
        heights = np.array([height for _, _, height in points])
        modes = law.means[np.argmin(log_parts(theta, law)[1], axis=1)]
        ways = modes[:, None] + ALONG[:, None] * (theta - modes)[:, None]
        rows = self.evaluation.rows(ways.reshape(-1, theta.shape[1]))
        lowest = rows[:, 0].reshape(len(points), -1).min(axis=1)
        return [points[i] for i in np.flatnonzero(lowest < heights - VALLEY)]

    def _add(self, maximum: Maximum, number: int) -> bool:
        """Take in the end of a climb; return whether it is a new mode."""
        if not np.isfinite(maximum.log_evidence):
            return False
        together = distinct([*self.maxima, maximum])
        last = len(self.maxima)
        same = next(group for group in together if last in group)
        if len(same) > 1:
            self.found_by[min(same)][number] += 1
            return False
        self.maxima.append(maximum)
        self.found_by.append([int(i == number) for i in range(len(self.streams))])
        return True

    def _wider_laws(self) -> list[Mixture]:
        """Return the law of the modes at widths up to that of the prior."""
        law = self.law()
        spread = summarize_prior(self.prior)[1]
        widths = np.sqrt(np.diagonal(law.matrices, axis1=1, axis2=2))
        ratio = float((spread / widths).max())
        laws: list[Mixture] = []
        factor = WIDER
        while factor < ratio and len(laws) < MOST_SCANS:
            laws.append(law._replace(matrices=law.matrices * factor**2))
            factor *= WIDER
        return laws
