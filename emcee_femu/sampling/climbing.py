"""Climb to the maxima of a posterior, in few solves.

Damped Newton steps inside the bounds, of all climbs at once. The curvature is Fisher's
information where all terms tell it, for which gradients are enough; else a quadratic is
fitted to the rows of points around.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Evaluator, Floats
from .quadratic import (
    find_damping,
    fit_covariance,
    log_integral,
    make_positive,
    step_within,
)

GAIN = 1e-3  # of log-posterior still to be had: 0.045 standard deviations from the top
NOISE = 0.1  # the same where no step gains: noise of a solver, a kink, a sharp bend
MOST_STEPS = 100
ACCEPTED, POOR, GOOD = 0.01, 0.25, 0.75  # actual gain by predicted gain
EXACT = 1e-2  # relative error of a prediction by a curvature that holds everywhere
USABLE = 0.5  # the same of one that is kept
SHORTER, LONGER = 0.25, 3.0
SADDLE = -0.1  # least curvature of a maximum, in prior sds; rounding gives some
TOUCHING = 1e-9  # prior sds from a bound at which a point is on it
NARROWEST = 1e-10  # of the prior's scale: no posterior of data is as narrow
SAME = 2.0  # standard deviations; two equal Gaussians so near have one top
FIRST_OFFSET = 1e-3  # of differences, in prior sds, where no scale is known
OFFSET = 0.05  # of differences, in conditional sds of the posterior
MOST_OFFSET = 0.1  # in prior sds


@dataclass(frozen=True, eq=False)
class Maximum:
    """A local maximum of the posterior, and the Gaussian that fits it there.

    Attributes:
        theta: Where it is, ``(d,)``; the start, if nothing could be evaluated there.
        row: The row of the posterior there, as ``posterior(theta)`` gives it.
        covariance: Of the Laplace approximation, ``(d, d)``: the inverse of the
            Fisher information with the prior's curvature, or of minus the Hessian. A
            parameter at a bound has the spread of the exponential that falls from it.
            NaN without a maximum.
        log_evidence: Laplace's, over what lies inside the bounds; -inf without a
            maximum.
        at_bound: Which parameters are at a bound, ``(d,)``.
        converged: Whether less than 1e-3 of log-posterior is left to gain, 0.045
            standard deviations; 0.1 where no step gains, as at a kink.
        solves: Solves spent on this climb.
        message: What ended the climb.
    """

    theta: Floats
    row: Floats
    covariance: Floats
    log_evidence: float
    at_bound: NDArray[np.bool_]
    converged: bool
    solves: int
    message: str

    @property
    def log_posterior(self) -> float:
        """Its height."""
        return float(self.row[0])


class Local(NamedTuple):
    """The quadratic about a point, in standard deviations of the prior.

    Attributes:
        point: Where, ``(d,)``.
        row: The posterior's row there.
        gradient: Of the log-posterior, ``(d,)``.
        curvature: Minus the Hessian, ``(d, d)``.
        fresh: Whether the curvature is that of this point.
    """

    point: Floats
    row: Floats
    gradient: Floats
    curvature: Floats
    fresh: bool = True

    @property
    def value(self) -> float:
        """The log-posterior."""
        return float(self.row[0])

    @property
    def usable(self) -> bool:
        """Whether nothing failed, here and beside."""
        return bool(np.isfinite([self.value, *self.gradient]).all())


@dataclass(eq=False)
class Climb:
    """One climb: where it is, what it tries next, and why it ended.

    Attributes:
        local: Where it is.
        radius: How far the quadratic is trusted.
        target: The point that is to be looked at; None where the curvature is.
        predicted: What the quadratic says that it gains.
        solves: Spent so far.
        ended: Why, in words; empty while it goes on.
        converged: Whether at a maximum.
        damped: Whether the radius shortens the step.
    """

    local: Local
    radius: float = np.inf
    target: Floats | None = None
    predicted: float = 0.0
    solves: float = 0.0
    ended: str = ""
    converged: bool = False
    damped: bool = False

    def choose(self, box: Floats) -> None:
        """Choose the next point, or end."""
        local = self.local
        curvature = make_positive(local.curvature)
        room = box.T - local.point
        step, gain = step_within(local.gradient, curvature, *room)
        self.target = None
        if gain < GAIN and not local.fresh:
            return  # to the curvature of this point
        uphill = local.gradient if gain >= GAIN else _leave_saddle(local, box)
        if uphill is None:
            self.ended, self.converged = "converged", True
            return
        damping = find_damping(uphill, curvature, self.radius)
        damped = curvature + damping * np.eye(len(step))
        step, _ = step_within(uphill, damped, *room)
        self.predicted = float(uphill @ step - 0.5 * step @ curvature @ step)
        self.target = _put(local.point, step, box)
        self.damped = damping > 0

    def take(self, trial: Local) -> None:
        """Go to the target, or trust the quadratic less."""
        local = self.local
        length = float(np.linalg.norm(trial.point - local.point))
        gained = (trial.value - local.value) / self.predicted
        if gained > ACCEPTED and trial.usable:
            self.local = trial
            if gained < POOR:
                self.radius = SHORTER * length
            elif gained > GOOD:
                self.radius = max(self.radius, LONGER * length)
        elif local.fresh:
            self.radius = SHORTER * length
        else:
            self.target = None  # the curvature misled
            self.local = local._replace(fresh=False)
        if self.predicted < GAIN and gained < GOOD and self.damped and local.fresh:
            self.ended, self.converged = "no step gains", self.predicted < NOISE


def climb(
    evaluator: Evaluator,
    starts: Floats,
    guess: Floats | None = None,
    most: float = np.inf,
) -> list[Maximum]:
    r"""Climb from every start ``(n, d)`` to a maximum inside the prior's bounds.

    .. math:: (H + \mu I) \, \Delta\theta = \nabla \ln p(\theta | D)

    with H the Fisher information and the prior's curvature, and :math:`\mu` such that
    the step stays where the quadratic was good so far.

    Args:
        evaluator: What evaluates the posterior; all climbs share its batches.
        starts: Where to begin.
        guess: A covariance ``(d, d)`` of the posterior near the starts, which spares
            solves where no information comes with gradients.
        most: Solves that may be spent; the climbs end where they are then.

    Raises:
        ValueError: If the density grows without bound.
    """
    space = _Space(evaluator, guess)
    before = evaluator.solves
    climbs = [Climb(local) for local in space.look(starts / space.scale, [])]
    _charge(climbs, evaluator.solves - before)
    for ascent in climbs:
        if not ascent.local.usable:
            finite = np.isfinite(ascent.local.value)
            ascent.ended = (
                "a solve beside the start failed"
                if finite
                else "the posterior is zero at the start, or its solve failed"
            )
    for _ in range(MOST_STEPS):
        for ascent in (active := [ascent for ascent in climbs if not ascent.ended]):
            ascent.choose(space.box)
        active = [ascent for ascent in active if not ascent.ended]
        if not active:
            break
        spent = evaluator.solves
        if spent - before + len(active) * space.price > most:
            for ascent in active:
                ascent.ended = "its solves were spent"
            break
        trying = [ascent for ascent in active if ascent.target is not None]
        targets = [ascent.target for ascent in trying if ascent.target is not None]
        if trying:
            trials = space.look(np.array(targets), [ascent.local for ascent in trying])
            for ascent, trial in zip(trying, trials, strict=True):
                ascent.take(trial)
        for ascent in active:
            if ascent.target is None and not ascent.ended:
                ascent.local = space.fit(ascent.local)
        _charge(active, evaluator.solves - spent)
    return [space.maximum(ascent) for ascent in climbs]


def distinct(maxima: Sequence[Maximum]) -> list[list[int]]:
    """Return the numbers of maxima that are the same, highest group and member first.

    Two are the same where each is in the Gaussian about the other, no lower than that
    allows; so are those that a third one links.
    """
    heights = [m.log_posterior for m in maxima]
    groups: list[list[int]] = []
    for i in np.argsort(heights, kind="stable")[::-1].tolist():
        near = [g for g in groups if any(_same(maxima[i], maxima[j]) for j in g)]
        merged = sorted([j for g in near for j in g], key=lambda j: -heights[j])
        groups = [g for g in groups if g not in near] + [[*merged, i]]
    return sorted(groups, key=lambda group: -heights[group[0]])


def _same(first: Maximum, second: Maximum) -> bool:
    step = first.theta - second.theta
    squares = [step @ np.linalg.solve(m.covariance, step) for m in (first, second)]
    difference = abs(first.log_posterior - second.log_posterior)
    near = max(squares) < SAME**2 and difference < max(squares) / 2 + NOISE
    return bool(near)


def _charge(climbs: Sequence[Climb], solves: int) -> None:
    """Share the solves of a batch among its climbs."""
    for ascent in climbs:
        ascent.solves += solves / len(climbs)


class _Space:
    """Coordinates in standard deviations of the prior, and quadratics in them."""

    def __init__(self, evaluator: Evaluator, guess: Floats | None) -> None:
        self.evaluator, self.posterior = evaluator, evaluator.posterior
        self.scale = self.posterior.scale
        self.bounds = self.posterior.prior.bounds
        self.box = self.bounds / self.scale[:, None]
        d = len(self.scale)
        self.guess: Floats | None = None
        if guess is not None:
            curvature = guess / np.outer(self.scale, self.scale)
            self.guess = np.asarray(np.linalg.inv(curvature), np.float64)
        if self.posterior.informative:  # solves for a look
            self.price = 1 if self.posterior.differentiable else d + 1
        else:
            self.price = 2 * d + 1

    def theta(self, points: Floats) -> Floats:
        """Return points as parameters; rounding alone can pass a bound, by an ulp."""
        inside: Floats = np.clip(points * self.scale, *self.bounds.T)
        return inside

    def look(self, points: Floats, before: Sequence[Local]) -> list[Local]:
        """Return the quadratics about points, which climbs reached from others."""
        if not self.posterior.informative:
            last: list[Local | None] = [*before] or [None] * len(points)
            pairs = zip(points, last, strict=True)
            return [self._look_around(point, local) for point, local in pairs]
        rows, gradient, information = self.evaluator.linearize(self.theta(points))
        if information is None:  # nothing but failures
            information = np.full((*gradient.shape, len(self.scale)), np.nan)
        gradient = gradient * self.scale
        information = information * np.outer(self.scale, self.scale)
        parts = zip(points, rows, gradient, information, strict=True)
        return [Local(*part) for part in parts]

    def fit(self, local: Local) -> Local:
        """Return the quadratic that fits the rows of points around."""
        return self._look_around(local.point, local, mixed=True)

    def _look_around(
        self, point: Floats, before: Local | None, mixed: bool = False
    ) -> Local:
        """Return gradient and curvature from the rows of points around.

        Two on each axis give the gradient and the diagonal; one more for each pair of
        axes gives the rest, which is spared where an old curvature still holds.
        """
        curvature = self.guess if before is None else before.curvature
        first, second = self._offsets(point, curvature)
        steps = [np.zeros((1, len(point))), np.diag(first), np.diag(second)]
        rows = self.evaluator.rows(self.theta(point + np.concatenate(steps)))
        row, d = rows[0], len(point)
        if not np.isfinite(row[0]):
            return Local(point, row, np.full(d, np.nan), np.full((d, d), np.nan))
        ahead, behind = (rows[1 : d + 1, 0] - row[0]), (rows[d + 1 :, 0] - row[0])
        a, b = ahead / first, behind / second
        # Where a solve on one side failed, the slope of the other one is taken.
        a, b = np.where(np.isfinite(a), a, b), np.where(np.isfinite(b), b, a)
        gradient = (a * second - b * first) / (second - first)
        diagonal = -2 * (b - a) / (second - first)
        local = Local(point, row, gradient, np.diag(diagonal))
        if not local.usable or d == 1:
            return local
        if curvature is not None and not mixed:
            kept = local._replace(curvature=curvature, fresh=False)
            if before is None:
                return kept
            if self._error(before, local) < USABLE:
                if self._exact(before, local):
                    return kept._replace(fresh=True)
                return kept._replace(curvature=_bend(before, local))
        i, j = np.triu_indices(d, 1)
        pairs = np.diag(first)[i] + np.diag(first)[j]
        beside = self.evaluator.rows(self.theta(point + pairs))[:, 0]
        with np.errstate(invalid="ignore"):  # of solves that failed
            both = beside - row[0] - ahead[i] - ahead[j]
        both[~np.isfinite(both)] = 0.0
        local.curvature[i, j] = local.curvature[j, i] = -both / (first[i] * first[j])
        self.guess = local.curvature  # where others start
        return local

    def _exact(self, before: Local, here: Local) -> bool:
        """Return whether a curvature is that of the next point too, as a Gaussian's."""
        if self._error(before, here) > EXACT:
            return False
        old, new = np.diag(before.curvature), np.diag(here.curvature)
        return bool((np.abs(new - old) < EXACT * np.abs(old)).all())

    def _error(self, before: Local, here: Local) -> float:
        step, change = here.point - before.point, here.value - before.value
        predicted = before.gradient @ step - 0.5 * step @ before.curvature @ step
        return float(abs((change - predicted) / change)) if change else 0.0

    def _offsets(
        self, point: Floats, curvature: Floats | None
    ) -> tuple[Floats, Floats]:
        """Return two steps on each axis, ``(d,)`` each, that stay inside the bounds."""
        size = np.full(len(point), FIRST_OFFSET)
        if curvature is not None:
            scale = np.abs(np.diag(curvature))
            size = np.minimum(OFFSET / np.sqrt(np.maximum(scale, 1e-300)), MOST_OFFSET)
        below, above = point - self.box[:, 0], self.box[:, 1] - point
        size = np.minimum(size, np.maximum(below, above) / 2)
        up, down = above >= size, below >= size
        first = np.where(up, size, -size)
        return first, np.where(up & down, -size, 2 * first)

    def maximum(self, ascent: Climb) -> Maximum:
        """Return the maximum where a climb ended, with its Laplace approximation.

        Raises:
            ValueError: If the density grows without bound.
        """
        local = ascent.local
        at_bound = (local.point[:, None] == self.box).any(axis=1)
        covariance, log_evidence = np.full((len(self.scale),) * 2, np.nan), -np.inf
        if local.usable:
            self._check_width(local)
            curvature = make_positive(local.curvature)
            covariance = fit_covariance(local.gradient, curvature, at_bound)
            covariance *= np.outer(self.scale, self.scale)
            room = self.box.T - local.point
            log_evidence = log_integral(local.gradient, curvature, *room)
            log_evidence += local.value + np.log(self.scale).sum()
        return Maximum(
            theta=self.theta(local.point),
            row=local.row,
            covariance=covariance,
            log_evidence=log_evidence,
            at_bound=at_bound,
            converged=ascent.converged,
            solves=round(ascent.solves),
            message=ascent.ended or f"not converged after {MOST_STEPS} steps",
        )

    def _check_width(self, local: Local) -> None:
        if not np.diagonal(local.curvature).max() > NARROWEST**-2:
            return
        values = zip(
            self.posterior.names, self.theta(local.point).tolist(), strict=True
        )
        raise ValueError(
            "posterior: its density seems to grow without bound towards "
            f"{ {name: float(f'{value:.5g}') for name, value in values} }: does an "
            "inferred error go to zero where the parameters fit the data exactly? Give "
            "its prior a lower bound above zero, or the term the errors that are known"
        )


def _bend(before: Local, here: Local) -> Floats:
    """Return the curvature that explains how the gradient changed (SR1)."""
    step = here.point - before.point
    rest = before.gradient - here.gradient - before.curvature @ step
    product = rest @ step
    if abs(product) <= 1e-8 * np.linalg.norm(rest) * np.linalg.norm(step):
        return before.curvature
    bent: Floats = before.curvature + np.outer(rest, rest) / product
    return bent


def _put(point: Floats, step: Floats, box: Floats) -> Floats:
    """Return the end of a step, exactly on the bounds that it reaches."""
    low, high = box.T
    end = point + step
    put: Floats = np.where(end > high - TOUCHING, high, end)
    return np.where(end < low + TOUCHING, low, put)


def _leave_saddle(local: Local, box: Floats) -> Floats | None:
    """Return a gradient that leads downhill in curvature, None at a maximum."""
    free = (local.point[:, None] != box).all(axis=1)
    values, vectors = np.linalg.eigh(local.curvature[np.ix_(free, free)])
    if not free.any() or values[0] > SADDLE:
        return None
    gradient = local.gradient.copy()
    side = np.sign(gradient[free] @ vectors[:, 0]) or 1.0
    gradient[free] += side * np.sqrt(-values[0]) * vectors[:, 0]
    return gradient
