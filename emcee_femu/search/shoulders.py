"""Shoulders: mass beside a maximum that its own curvature does not show.

Where two parts of a posterior cross, the curvature at a maximum is that of the thinner
one along each axis, and the Gaussian there is narrower than both. A few of its standard
deviations away one part is alone, and its curvature is found there.
"""

from typing import NamedTuple

import numpy as np

from ..contracts import Floats
from ..evaluation.evaluator import Evaluation
from ..posterior.log_posterior import LOG_POSTERIOR
from .coordinates import Coordinates
from .curvature import Space
from .maxima import NEGLIGIBLE, WORTH_SOLVES, Gaussian, Maxima
from .quadratic import log_integral, make_positive

# Standard deviations from a maximum at which its Gaussian is compared with the density.
PROBED_AT = 3.0
# A point is unexplained if its log-density exceeds that of all Gaussians by more.
UNEXPLAINED = 2.0


class Shoulder(NamedTuple):
    """A Gaussian that has the density's value, gradient and curvature at a point.

    Attributes:
        theta: Its mean, ``(d,)``, inside the bounds.
        covariance: Its covariance, ``(d, d)``.
        log_evidence: Its log evidence inside the bounds, lowered if the density at its
            mean is lower than the quadratic predicts.
    """

    theta: Floats
    covariance: Floats
    log_evidence: float


def find_shoulders(
    evaluator: Evaluation,
    maxima: Maxima,
    points: Floats,
    heights: Floats,
    fruitless: int,
    most: float,
) -> None:
    """Add shoulders to the maxima, where points beside these are not explained.

    Of those points and all explored ones, the highest unexplained one comes next, until
    ``fruitless`` shoulders in a row hold little of the evidence.

    Args:
        evaluator: Evaluates the posterior.
        maxima: The maxima, which get the shoulders.
        points: Points that were explored, ``(n, d)``.
        heights: Their log-posteriors, ``(n,)``.
        fruitless: Number of shoulders in a row after which the search ends.
        most: Solves after which no further shoulder is fitted.
    """
    probed, failed = 0, 0
    while evaluator.solves < most and failed < fruitless:
        for part in maxima.parts[probed:]:
            new = _beside(evaluator, part)
            points = np.vstack([points, new])
            rows = evaluator.rows(new)
            heights = np.append(heights, rows[:, LOG_POSTERIOR])
        probed = len(maxima.parts)
        unexplained = maxima.excess(points, heights) > UNEXPLAINED
        if not unexplained.any():
            return
        highest = int(np.argmax(np.where(unexplained, heights, -np.inf)))
        shoulder = _fit(evaluator, points[highest], maxima.nearest(points[highest]))
        points, heights = (np.delete(x, highest, axis=0) for x in (points, heights))
        share = shoulder.log_evidence - maxima.log_evidence if shoulder else -np.inf
        failed = 0 if share > np.log(WORTH_SOLVES) else failed + 1
        if shoulder and share > -NEGLIGIBLE:  # there may be others beside it
            maxima.shoulders.append(shoulder)


def _beside(evaluator: Evaluation, part: Gaussian) -> Floats:
    """Return points on both sides of a Gaussian along its principal axes, ``(2 d, d)``.

    The axes are those in units of prior standard deviations; the points are clipped to
    the bounds.
    """
    scale = Coordinates.plain(evaluator.posterior.prior).scale
    values, vectors = np.linalg.eigh(part.covariance / np.outer(scale, scale))
    steps = PROBED_AT * np.sqrt(np.maximum(values, 0.0)) * vectors * scale[:, None]
    both = part.theta + np.concatenate([steps.T, -steps.T])
    return np.asarray(np.clip(both, *evaluator.posterior.prior.bounds.T))


def _fit(evaluator: Evaluation, point: Floats, guess: Floats) -> Shoulder | None:
    """Return the shoulder at a point; None if a solve fails there."""
    plain = Coordinates.plain(evaluator.posterior.prior)
    space = Space(evaluator, guess, plain, None)
    (local,) = space.look(point[None] / space.scale)
    if local.usable and not local.fresh:
        local = space.fit(local)
    if not local.usable:
        return None
    curvature = make_positive(local.curvature)
    step = np.linalg.solve(curvature, local.gradient)
    low, high = space.box.T
    end = np.clip(local.point + step, low, high)
    step = end - local.point
    promised = local.value + local.gradient @ step - 0.5 * step @ curvature @ step
    height = float(space.rows(end[None])[0, LOG_POSTERIOR])
    log_evidence = local.value + np.log(space.scale).sum()
    log_evidence += log_integral(
        local.gradient, curvature, low - local.point, high - local.point
    )
    return Shoulder(
        theta=end * space.scale,
        covariance=np.linalg.inv(curvature) * np.outer(space.scale, space.scale),
        log_evidence=float(log_evidence + min(height - promised, 0.0)),
    )
