"""Follow the tails of a posterior outwards, to arms that its draws do not see.

A thin arm begins where a posterior seems to end. It may hold little of the mass and
much of the variance, and a chain that never met it looks converged.
"""

import numpy as np
from scipy.special import expit

from ..contracts import Floats
from ..evaluation.evaluator import Evaluation
from ..moves.mixture import PER_PARAMETER
from .archive import Archive
from .campaign import Campaign
from .climbing import Maximum, climb
from .proposal import TAIL, WIDER, Component
from .settings import SETTINGS

# Share of the draws beyond the value at which a tail begins.
TAIL_SHARE = 0.003
# Width of a slab, in standard deviations of the parameter.
TAIL_WIDTH = 0.8
# Share of the variance below which what lies in a slab does not matter.
TAIL_MATTERS = 1e-3
# The draws in a slab tell its share if that is this many standard errors: 20 draws.
WELL_SEEN = 4.5
# If Laplace's approximation finds at most this many times the share that the draws have
# there, WELL_SEEN divided by the same number is enough: 5 draws.
AGREE = 2.0
# Weight of the components relative to Laplace's share of the variance. (Of mass-spring,
# whose tail is .14 of a variance and .26 to .29 by Laplace, with 1 the draws are less
# effective.)
TAIL_WEIGHT = 0.5
# Solves after which no climb in a tail begins.
TAIL_SOLVES = 6_000


def follow_tails(campaign: Campaign) -> None:
    """Follow the tails of each parameter, and add components for slabs that matter.

    From a value that few draws exceed, one slab after another is climbed outwards,
    until one no longer matters to the variance. The mass of a slab is its evidence by
    Laplace's approximation. The draws from the new components come before the next
    parameter, whose tail they may cover.
    """
    c, dimensions = campaign, campaign.posterior.ndim
    most = min(c.ledger.end("judge"), c.evaluator.solves + TAIL_SOLVES)
    for j in range(dimensions):
        if c.archive.effective < 2 * dimensions:  # their covariance may be singular
            return
        sides = [_follow(c.evaluator, c.archive, j, side, most) for side in (0, 1)]
        if slabs := sum(sides, []):
            new = [slab._replace(weight=c.heavy * slab.weight) for slab in slabs]
            # These draws come from the new components alone.
            fewest = PER_PARAMETER * dimensions * len(new)
            c.extend(new, TAIL, max(c.sizes.batch // 2, fewest))


def _follow(
    evaluator: Evaluation, archive: Archive, j: int, side: int, most: float
) -> list[Component]:
    """Return components for the lower or the upper tail of a parameter."""
    bounds, sign = evaluator.posterior.prior.bounds, 2 * side - 1
    x, shares, found = archive.x, archive.shares, []
    mean, guess = shares @ x, np.atleast_2d(np.cov(x.T, aweights=shares, ddof=0))
    # No component is wider than the defensive one.
    sd, widest = np.sqrt(guess[j, j]), WIDER * np.sqrt(np.diag(guess))
    order = np.argsort(x[:, j])[::-sign]
    place = x[order[int(np.searchsorted(shares[order].cumsum(), TAIL_SHARE))]]
    value, way = place[j], 0.0 * place
    while True:
        further = np.clip(value + sign * TAIL_WIDTH * sd, *bounds[j])
        if further == value or evaluator.solves > most:
            break
        box = bounds.copy()
        box[j] = sorted([value, further])
        inside = np.flatnonzero((x[:, j] > box[j, 0]) & (x[:, j] < box[j, 1]))
        seen, error = shares[inside].sum(), np.sqrt((shares[inside] ** 2).sum())
        square, before = ((value - mean[j]) / sd) ** 2, way
        if seen > WELL_SEEN * error and seen * square > TAIL_MATTERS:
            end, part = x[inside[np.argmax(archive.log_p[inside])]], seen * square
            way = end - place
        else:
            start = np.clip(place + way, *box.T)
            (top,) = climb(evaluator, start[None], guess, box=box, masses=True)
            # Its share of all mass that is then known, which may be nearly one.
            mass = float(expit(top.log_evidence - archive.log_evidence))
            part = mass * square
            end, way = top.theta, top.theta - place
            if np.isfinite(top.covariance).all():  # else there is no maximum
                guess = top.covariance
            if way @ before < 0:  # from one arm to another
                way = 0.0 * way
            agree = AGREE * seen > WELL_SEEN * error and mass < AGREE * seen
            if part > TAIL_MATTERS and not agree:
                found.append((part, *_within(top, j, box, way, widest)))
        if not max(part, seen * square) > TAIL_MATTERS:
            break
        value, place = further, end
    total = sum(part for part, *_ in found)
    # A share of a variance is half of that share of an sd, and the tail may take half
    # of the sd's error: Laplace's approximation sees one of two arms of a slab.
    if total < SETTINGS.sd_at_end:
        return []
    # They get equal weights, since the mass of a slab with few draws is hardly known.
    weight = TAIL_WEIGHT * total / len(found)
    return [Component(weight, mean, matrix) for _, mean, matrix in found]


def _within(
    top: Maximum, j: int, box: Floats, way: Floats, widest: Floats
) -> tuple[Floats, Floats]:
    """Return mean and scale matrix of the component for a slab of parameter j.

    It is stretched along the way through the slab. At a bound of another parameter the
    density is an exponential, whose mean is one spread inside. A kink, or a density
    that hardly bends, has a curvature that says nothing.
    """
    low, high = box.T
    pressed = top.at_bound & (np.arange(len(low)) != j)
    known = np.sqrt(np.diag(top.covariance))
    sds = np.minimum(known, np.minimum(widest, (high - low) / 2))
    matrix = top.covariance * np.outer(sds / known, sds / known)
    inwards = np.where(top.theta == low, sds, -sds)
    mean = top.theta + np.where(pressed, inwards, -way / 2)
    # Twice the variance of points along the way.
    return mean, matrix + np.outer(way, way) / 6
