"""One climb: damped Newton steps inside the bounds, as a generator of requests."""

from collections.abc import Generator
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..interfaces import Floats
from .local_shape import Asking, Differences, Local, Reply, Request, Scheme
from .quadratic import find_damping, make_positive, step_within, update_secant

GAIN = 1e-3  # of log-posterior still to be had: 0.045 standard deviations from the top
NOISE = 0.1  # the same where no step gains: noise of a solver, a kink, a sharp bend
MOST_STEPS = 100
ACCEPTED, POOR, GOOD = 0.01, 0.25, 0.75  # actual gain by predicted gain
USABLE = 0.5  # relative error of a prediction by a curvature that is kept
EXACT = 1e-2  # the same of one that holds everywhere
SHORTER, LONGER = 0.25, 3.0
SADDLE = -0.1  # least curvature of a maximum, in prior sds; rounding gives some
TOUCHING = 1e-9  # prior sds from a bound at which a point is on it
TWIN = 0.1  # standard deviations from a maximum that is known


class Summit(NamedTuple):
    """Where a climb ended, in standard deviations of the prior, and why."""

    local: Local
    message: str
    converged: bool = False


Climb: TypeAlias = Generator[Request, Reply, Summit]


def ascend(
    scheme: Scheme,
    box: Floats,
    point: Floats,
    old: Local | None = None,
    known: Summit | None = None,
) -> Climb:
    """Climb from a point inside a box; ask for evaluations, return the summit.

    Args:
        scheme: How gradients and curvatures are had.
        box: Bounds ``(d, 2)``.
        point: ``(d,)``.
        old: The point, if it was evaluated.
        known: Where an earlier climb ended: its curvature is the first guess of one
            that costs many solves.
    """
    local = old
    if local is None or isinstance(scheme, Differences):
        guess = old if known is None else known.local
        local = yield from scheme.look(point, box, guess)
    if not local.usable:
        return refuse(local)
    if local.curvature is None and known is not None:
        local = local._replace(curvature=known.local.curvature)
    if local.curvature is None:
        local = yield from scheme.bend(local, box)
    radius = float("inf")
    for _ in range(MOST_STEPS):
        curvature = make_positive(local.curvature)
        room = box.T - local.point
        step, gain = step_within(local.gradient, curvature, *room)
        if gain < GAIN and not local.fresh:
            if known is not None and _are_twins(local, known):
                return known._replace(message="converged to a maximum known before")
            local = yield from scheme.bend(local, box)
            continue
        uphill = local.gradient if gain >= GAIN else _leave_saddle(local, box)
        if uphill is None:
            return Summit(local, "converged", converged=True)
        damping = find_damping(uphill, curvature, radius)
        damped = curvature + damping * np.eye(len(point))
        step, _ = step_within(uphill, damped, *room)
        predicted = uphill @ step - 0.5 * step @ curvature @ step
        target = _put(local.point, step, box)
        length = float(np.linalg.norm(step))
        trial = yield from _try(scheme, local, target, box, damping > 0)
        ratio = float((trial.value - local.value) / predicted)
        if ratio > ACCEPTED and np.isfinite(trial.gradient).all():
            local = yield from _move(scheme, local, trial, box)
            radius = _change_radius(radius, length, ratio)
        elif not local.fresh:
            local = yield from scheme.bend(local, box)
        else:
            radius = SHORTER * length
        if predicted < GAIN and ratio < GOOD and damping and local.fresh:
            return Summit(local, "no step gains", gain < NOISE)
    return Summit(local, f"not converged after {MOST_STEPS} steps")


def refuse(local: Local) -> Summit:
    """Return the end of a climb that did not begin."""
    if np.isfinite(local.value):
        return Summit(local, "a solve beside the start failed")
    return Summit(local, "the posterior is zero at the start, or its solve failed")


def _try(
    scheme: Scheme, local: Local, target: Floats, box: Floats, damped: bool
) -> Asking:
    """Look at a point; if that costs many solves, only if it is higher."""
    old = local._replace(point=target, fresh=False)
    if scheme.costly and (damped or isinstance(scheme, Differences)):
        reply = yield Request("rows", target[None])
        old = old._replace(row=reply.rows[0])
        if not old.value > local.value:
            return old
    return (yield from scheme.look(target, box, old))


def _move(scheme: Scheme, old: Local, new: Local, box: Floats) -> Asking:
    """Return the new point with a curvature: its own, the old one, or a secant's."""
    if new.fresh or old.curvature is None:
        return new
    step, change = new.point - old.point, old.gradient - new.gradient
    bent = old.curvature @ step
    predicted = old.gradient @ step - 0.5 * step @ bent
    error = abs(new.value - old.value - predicted) / abs(new.value - old.value)
    if error > USABLE:
        return (yield from scheme.bend(new, box))
    rest = change - bent
    if error < EXACT and _still_holds(old.curvature, new.diagonal, rest, change):
        return new._replace(curvature=old.curvature, fresh=old.fresh)
    return new._replace(curvature=update_secant(old.curvature, step, rest))


def _still_holds(
    curvature: Floats, diagonal: Any, rest: Floats, change: Floats
) -> bool:
    """Return whether an old curvature is that of the new point, as of a Gaussian."""
    if diagonal is None:
        return False
    bound = EXACT * np.abs(np.diag(curvature))
    small = np.linalg.norm(rest) < EXACT * np.linalg.norm(change)
    return bool(small and (np.abs(diagonal - np.diag(curvature)) < bound).all())


def _put(point: Floats, step: Floats, box: Floats) -> Floats:
    """Return the end of a step, exactly on the bounds that it reaches."""
    low, high = box.T
    end = point + step
    put: Floats = np.where(end > high - TOUCHING, high, end)
    put = np.where(end < low + TOUCHING, low, put)
    return put


def _change_radius(radius: float, length: float, ratio: float) -> float:
    """Return the radius of trust after a step that was accepted."""
    if ratio < POOR:
        return SHORTER * length
    return max(radius, LONGER * length) if ratio > GOOD else radius


def _are_twins(local: Local, known: Summit) -> bool:
    """Return whether a climb is about to end where another one ended."""
    if not known.converged or known.local.curvature is None:
        return False
    step = local.point - known.local.point
    distance = step @ make_positive(known.local.curvature) @ step
    return bool(distance < TWIN**2 and abs(local.value - known.local.value) < GAIN)


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
