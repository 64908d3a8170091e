"""Climb to the maxima of a posterior, in few solves.

Damped Newton steps inside the bounds, of all climbs at once, by the quadratics of
:mod:`.curvature`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..contracts import Floats
from ..evaluation.evaluator import Evaluation
from ..likelihoods.term import ERROR_PRIOR
from ..posterior.log_posterior import LOG_POSTERIOR
from .coordinates import Coordinates
from .curvature import Local, Space
from .importance import EVIDENCE_APART
from .quadratic import (
    LEAST_CURVATURE,
    clip_curvature,
    find_damping,
    log_integral,
    make_positive,
    step_within,
)

# Log-posterior that a step has to gain: it ends 0.045 standard deviations from the top.
WORTH_A_STEP = 1e-3
# Log-posterior that may remain where no step gains: by the noise of a solver, at a kink
# or a sharp bend.
NOISE_OF_TOP = 0.1
# Most steps of a climb.
MOST_STEPS = 100
# If a step gains less than this share of what the quadratic predicts, the radius
# shrinks to this share of the step. If it misses the prediction by less than this
# share, a radius that shortened the step doubles.
# (Nocedal and Wright, 2006, algorithm 4.1, where all three numbers are a quarter.)
MISTRUST = 0.25
# Least width of a posterior relative to that of the prior: the curvature of a narrower
# one would have no digits, no data make it as narrow, and rounded frequencies would
# stop a climb at a tenth of it. A point closer to a bound than this is put on it.
NARROWEST = np.sqrt(np.finfo(float).eps)
# Distance of two maxima in standard deviations, below which they are one: the sum of
# two equal Gaussians so near has one top.
SAME = 2.0
# Share of a slope's square g^2 that stays as curvature, since without it the curvature
# might be rounding alone. One spread 1/|g| from the bound, where the exponential has
# fallen by a factor of e, it changes the log density by KEPT_SQUARE/2.
KEPT_SQUARE = 1e-4
# Why a climb ended.
ARRIVED = "converged"
UNBOUNDED = "the density grows without bound"


@dataclass(frozen=True, eq=False)
class Maximum:
    """A local maximum of the posterior, and the Gaussian that fits it there.

    Attributes:
        theta: The maximum, ``(d,)``; the start if nothing could be evaluated there.
        row: The row of the posterior there, as ``posterior(theta)`` returns it.
        covariance: Covariance of the Laplace approximation, ``(d, d)``: the inverse of
            the Fisher information plus the prior's curvature, or of minus the Hessian.
            For a parameter at a bound, the spread of the exponential that falls off
            from it. NaN without a maximum.
        log_evidence: Laplace's log evidence inside the bounds; -inf without a maximum.
        slopes: Slope of the log-posterior at a bound from which it falls, else zero,
            ``(d,)``.
        at_bound: Which parameters are at a bound, ``(d,)``.
        converged: Whether less than 1e-3 of log-posterior remains to be gained, or
            0.045 standard deviations; 0.1 if no step gains, as at a kink.
        message: Why the climb ended.
    """

    theta: Floats
    row: Floats
    covariance: Floats
    slopes: Floats
    log_evidence: float
    at_bound: NDArray[np.bool_]
    converged: bool
    message: str

    @property
    def log_posterior(self) -> float:
        """The log-posterior at the maximum."""
        return float(self.row[LOG_POSTERIOR])

    @property
    def gaussian(self) -> tuple[Floats, Floats]:
        """Mean and covariance of the Gaussian that fits the density inside the bounds.

        Its mean is out of bounds if the density falls from one.
        """
        if not self.slopes.any():
            return self.theta, self.covariance
        squares = (1 - KEPT_SQUARE) * self.slopes**2
        curvature = np.linalg.inv(self.covariance) - np.diag(squares)
        covariance = np.linalg.inv(curvature)
        return self.theta + covariance @ self.slopes, covariance


@dataclass(eq=False)
class Climb:
    """One climb: where it is, what it tries next, and why it ended.

    Attributes:
        local: Where it is.
        radius: How far the quadratic is trusted.
        target: The point to look at next; None to compute the curvature where it is.
        predicted: The gain that the quadratic predicts there.
        ended: Why, in words; empty while it goes on.
        converged: Whether it is at a maximum.
        damped: Whether the radius shortens the step.
        way: The points that it passed.
    """

    local: Local
    radius: float = np.inf
    target: Floats | None = None
    predicted: float = 0.0
    ended: str = ""
    converged: bool = False
    damped: bool = False
    way: list[Local] = field(default_factory=list)

    def choose(self, box: Floats) -> None:
        """Choose the next point, or end."""
        local = self.local
        if local.fresh and not np.diagonal(local.curvature).max() < NARROWEST**-2:
            self.ended = UNBOUNDED
            return
        self.way.append(local)
        curvature = make_positive(local.curvature)
        # From far below an inferred error, Newton's step has no limit. No parameter
        # changes by more than the largest width that a direction is taken for.
        longest = LEAST_CURVATURE**-0.5
        room = np.clip(box.T - local.point, -longest, longest)
        step, gain = step_within(local.gradient, curvature, *room)
        self.target = None
        if gain < WORTH_A_STEP and not local.fresh:
            return  # to the curvature of this point
        if gain < WORTH_A_STEP and curvature is not local.curvature:
            # With the least curvature, a long gentle slope would promise no gain.
            curvature = clip_curvature(local.curvature)
            step, gain = step_within(local.gradient, curvature, *room)
        uphill = local.gradient if gain >= WORTH_A_STEP else _leave_saddle(local, box)
        if uphill is None:
            self.ended, self.converged = ARRIVED, True
            return
        damping = find_damping(uphill, curvature, self.radius, *room)
        damped = curvature + damping * np.eye(len(step))
        step, _ = step_within(uphill, damped, *room)
        self.predicted = float(uphill @ step - 0.5 * step @ curvature @ step)
        low, high = box.T  # a step that reaches a bound ends exactly on it
        end = local.point + step
        end = np.where(end > high - NARROWEST, high, end)
        self.target = np.where(end < low + NARROWEST, low, end)
        self.damped = damping > 0

    def take(self, trial: Local) -> None:
        """Go to the target, or trust the quadratic less."""
        local = self.local
        length = float(np.linalg.norm(trial.point - local.point))
        gained = (trial.value - local.value) / self.predicted
        if gained > 0 and trial.usable:
            self.local = trial
            if gained < MISTRUST:
                self.radius = MISTRUST * length
            elif gained > 1 - MISTRUST and self.damped:
                self.radius *= 2  # without a limit, each step would shrink it anew
        elif local.fresh:
            self.radius = MISTRUST * length
        else:
            self.target = None  # the curvature misled
        if (
            self.predicted < WORTH_A_STEP
            and gained < 1 - MISTRUST
            and self.damped
            and local.fresh
        ):
            self.ended, self.converged = "no step gains", self.predicted < NOISE_OF_TOP


def climb(
    evaluator: Evaluation,
    starts: Floats,
    guess: Floats | None = None,
    most: float = np.inf,
    coordinates: Coordinates | None = None,
    masses: bool = False,
    box: Floats | None = None,
) -> list[Maximum]:
    r"""Climb from every start ``(n, d)`` to a maximum inside the prior's bounds.

    .. math:: (H + \mu I) \, \Delta\theta = \nabla \ln p(\theta | D)

    with H the Fisher information and the prior's curvature, and :math:`\mu` such that
    the step stays where the quadratic was good so far.

    Args:
        evaluator: Evaluates the posterior; all climbs share its batches.
        starts: Where to begin, in the coordinates.
        guess: A covariance ``(d, d)`` of the posterior near the starts, which spares
            solves where no information comes with gradients.
        most: Solves that may be spent; the climbs end where they are then.
        coordinates: Whose density is climbed, parameters or their logarithms; starts
            and maxima are in them. None for the parameters.
        masses: Whether a climb to a density without bound that has a finite integral
            gives the point on its way around which most of that lies.
        box: Narrower bounds ``(d, 2)`` of the coordinates, inside which they climb.

    Raises:
        ValueError: If the density grows without bound, and ``masses`` is False or the
            integral is not finite either.
    """
    coordinates = coordinates or Coordinates.plain(evaluator.posterior.prior)
    space = Space(evaluator, guess, coordinates, box)
    before = evaluator.solves
    climbs = [Climb(local) for local in space.look(starts / space.scale)]
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
        if evaluator.solves - before + len(active) * space.price > most:
            for ascent in active:
                ascent.ended = "its solves were spent"
            break
        trying = [(a.target, a) for a in active if a.target is not None]
        if trying:
            targets = np.array([target for target, _ in trying])
            trials = space.look(targets, [ascent.local for _, ascent in trying])
            for (_, ascent), trial in zip(trying, trials, strict=True):
                ascent.take(trial)
        for ascent in active:
            if ascent.target is None and not ascent.ended:
                ascent.local = space.fit(ascent.local)
    return [_end(space, ascent, masses) for ascent in climbs]


def distinct(maxima: Sequence[Maximum]) -> list[list[int]]:
    """Return the numbers of maxima that are the same, highest group and member first.

    Two are the same where each is in the Gaussian about the other, no lower than that
    allows; so are those that a third one links.
    """
    theta = np.array([m.theta for m in maxima])
    heights = np.array([m.log_posterior for m in maxima])
    steps, lower = theta[:, None] - theta, np.abs(heights[:, None] - heights)
    inverses = np.linalg.inv([m.covariance for m in maxima])
    squares = np.einsum("ijd,ide,ije->ij", steps, inverses, steps)
    squares = np.maximum(squares, squares.T)
    same = (squares < SAME**2) & (lower < squares / 2 + NOISE_OF_TOP)
    labels = connected_components(same, directed=False)[1].tolist()
    groups: dict[int, list[int]] = {}
    for i in np.argsort(heights, kind="stable")[::-1].tolist():
        groups.setdefault(labels[i], []).append(i)
    return [*groups.values()]


def _end(space: Space, ascent: Climb, masses: bool) -> Maximum:
    """Return the maximum where a climb ended, with its Laplace approximation.

    Raises:
        ValueError: If the density grows without bound, and masses do not help.
    """
    local = ascent.local
    if ascent.ended == UNBOUNDED:
        local = _find_mass(space, ascent, masses)
    at_bound = (local.point[:, None] == space.box).any(axis=1)
    covariance, log_evidence = np.full((len(space.scale),) * 2, np.nan), -np.inf
    slopes = np.zeros(len(space.scale))
    if local.usable:
        covariance, slopes, log_evidence = _laplace(space, local, ascent)
    return Maximum(
        theta=np.clip(local.point * space.scale, *space.coordinates.bounds.T),
        row=local.row,
        covariance=covariance,
        slopes=slopes,
        log_evidence=log_evidence,
        at_bound=at_bound,
        converged=ascent.converged,
        message=ascent.ended or f"not converged after {MOST_STEPS} steps",
    )


def _find_mass(space: Space, ascent: Climb, masses: bool) -> Local:
    """Return the point of the largest evidence on the way to a spike."""
    evidences = np.array([_laplace(space, one, ascent)[2] for one in ascent.way])
    # Where the integral is finite the drop is 10 and more, elsewhere there is none.
    if masses and evidences.size and evidences[-1] < evidences.max() - EVIDENCE_APART:
        return ascent.way[int(evidences.argmax())]
    theta = space.coordinates.inside(ascent.local.point[None] * space.scale)
    values = [f"{value:.5g}" for value in theta[0]]
    raise ValueError(
        "posterior: its density seems to grow without bound towards "
        f"{dict(zip(space.posterior.names, values, strict=True))}: does an inferred "
        "error go to zero where the parameters fit the data exactly? Give its "
        f"prior a lower bound above zero, such as {ERROR_PRIOR}, or give the term "
        "its known errors"
    )


def _laplace(space: Space, local: Local, ascent: Climb) -> tuple[Floats, Floats, float]:
    """Return covariance, slopes at bounds and log evidence about a point."""
    curvature = make_positive(local.curvature)
    # A density that falls from a bound with slope g is an exponential of sd
    # 1 / |g|: g^2 counts as curvature there.
    at_low, at_high = (local.point == end for end in space.box.T)
    slopes = np.minimum(local.gradient, 0.0) * at_low
    slopes += np.maximum(local.gradient, 0.0) * at_high
    covariance = np.linalg.inv(curvature + np.diag(slopes**2))
    covariance = (covariance + covariance.T) / 2
    covariance *= np.outer(space.scale, space.scale)
    room = space.box.T - local.point
    # A climb that ended below a step of the density, or too early, may have a
    # steep gradient there; what the quadratic promises beyond was not seen.
    seen = local.gradient if ascent.ended == ARRIVED else slopes
    log_evidence = log_integral(seen, curvature, *room)
    log_evidence += local.value + np.log(space.scale).sum()
    return covariance, slopes / space.scale, log_evidence


def _leave_saddle(local: Local, box: Floats) -> Floats | None:
    """Return a gradient that leads downhill in curvature, None at a maximum."""
    free = (local.point[:, None] != box).all(axis=1)
    values, vectors = np.linalg.eigh(local.curvature[np.ix_(free, free)])
    # Rounding makes that of a maximum negative too.
    if not free.any() or values[0] > -LEAST_CURVATURE:
        return None
    gradient = local.gradient.copy()
    side = np.sign(gradient[free] @ vectors[:, 0]) or 1.0
    gradient[free] += side * np.sqrt(-values[0]) * vectors[:, 0]
    return gradient
