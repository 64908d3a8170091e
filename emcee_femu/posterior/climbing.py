"""Climb to the maxima of a posterior, in few solves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats, Prior
from .ascent import NOISE, Climb, Summit, ascend, refuse
from .differences import prior_scale
from .laplace import fit_covariance, log_integral
from .local_shape import Local, Reply, Request, find_scheme, read
from .quadratic import make_positive

NARROWEST = 1e-10  # of the prior's scale: no posterior of data is as narrow

SAME = 2.0  # standard deviations; two equal Gaussians so near have one top


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


def climb(evaluation: Any, start: Floats, prior: Prior) -> Maximum:
    """Climb from a start ``(d,)``; see :func:`climb_each`."""
    return climb_each(evaluation, np.asarray(start)[None], prior)[0]


def climb_each(evaluation: Any, starts: Floats, prior: Prior) -> list[Maximum]:
    r"""Climb from every start ``(n, d)`` to a maximum inside the prior's bounds.

    Each step maximises a quadratic inside the bounds,

    .. math:: g^T p - \tfrac12 p^T (H + \mu \, \mathrm{diag} H) p

    with a damping mu that is raised where the posterior gains less than predicted
    (Levenberg-Marquardt). H is the Fisher information with the prior's curvature where
    ``evaluation.linearize`` gives it; otherwise minus the Hessian by differences, of
    gradients or of the rows of a black box, corrected by secant updates while it
    predicts well, and taken anew at the maximum. The other climbs of a black box begin
    with the curvature of the first one's maximum. They advance together, in batches.

    Args:
        evaluation: Has ``rows(theta)``, ``linearize(theta)`` and ``solves``.
        starts: Inside the bounds.
        prior: Owner of the bounds; its standard deviations are the units.

    Returns:
        One for each start. Where nothing could be evaluated it has
        ``log_evidence = -inf`` and a message that says why.

    Source: Moré (1978), doi:10.1007/BFb0067700; SR1 updates: Conn, Gould and Toint
    (1991), doi:10.1007/BF01594934.
    """
    space = _Space(prior)
    points = np.asarray(starts, dtype=float) / space.sd
    ends: list[tuple[Summit, int]] = []
    for point in points:  # the first that can be evaluated tells what a gradient costs
        reply = space.evaluate(evaluation, "linearize", point[None])
        first = read(point, reply)
        if first.usable:
            ends += _climb_all(evaluation, space, first, reply, points[len(ends) + 1 :])
            break
        ends.append((refuse(first), round(reply.cost)))
    return [space.maximum(summit, solves) for summit, solves in ends]


def _climb_all(
    evaluation: Any, space: "_Space", first: Local, reply: Reply, others: Floats
) -> list[tuple[Summit, int]]:
    """Climb from a start that was evaluated, and from others, or then from others."""
    scheme = find_scheme(reply)
    begun = [ascend(scheme, space.box, first.point, old=first)]
    if scheme.curvature_is_free:
        begun += [ascend(scheme, space.box, point) for point in others]
    ends = _advance(evaluation, begun, space)
    summit, solves = ends[0]
    ends[0] = summit, solves + round(reply.cost)
    if not scheme.curvature_is_free:
        rest = [ascend(scheme, space.box, p, known=summit) for p in others]
        ends += _advance(evaluation, rest, space)
    return ends


def distinct(maxima: Sequence[Maximum]) -> list[list[int]]:
    """Return the numbers of maxima that are the same, highest group and member first.

    Two are one if each lies within two standard deviations of the other, by both
    covariances, and they differ in height by no more than a Gaussian would there. So
    are those that others link: a ridge on which climbs ended everywhere is one.
    """
    heights = [m.log_posterior for m in maxima]
    groups: list[list[int]] = []
    for i in np.argsort(heights, kind="stable")[::-1].tolist():
        near = [g for g in groups if any(_same(maxima[i], maxima[j]) for j in g)]
        merged = sorted([j for g in near for j in g], key=lambda j: -heights[j])
        groups = [g for g in groups if g not in near] + [[*merged, i]]
    return sorted(groups, key=lambda group: -heights[group[0]])


def _same(one: Maximum, other: Maximum) -> bool:
    step = one.theta - other.theta
    squares = [step @ np.linalg.solve(m.covariance, step) for m in (one, other)]
    difference = abs(one.log_posterior - other.log_posterior)
    near = max(squares) < SAME**2 and difference < max(squares) / 2 + NOISE
    return bool(near)


def _advance(
    evaluation: Any, climbs: Sequence[Climb], space: "_Space"
) -> list[tuple[Summit, int]]:
    """Run climbs to their ends, their requests of one kind in one batch."""
    asked: dict[int, Request] = {}
    ends: dict[int, Summit] = {}
    solves = np.zeros(len(climbs))

    def send(number: int, reply: Reply | None) -> None:
        try:
            asked[number] = climbs[number].send(reply)  # type: ignore[arg-type]
        except StopIteration as stop:
            ends[number] = stop.value
            asked.pop(number, None)

    for number in range(len(climbs)):
        send(number, None)
    while asked:
        for kind in ("linearize", "rows"):
            some = {i: own.points for i, own in asked.items() if own.kind == kind}
            if not some:
                continue
            answer = space.evaluate(evaluation, kind, np.concatenate([*some.values()]))
            stop = 0
            for number, points in some.items():
                part, stop = slice(stop, stop + len(points)), stop + len(points)
                solves[number] += answer.cost * len(points)
                send(number, answer.part(part))
    return [(ends[i], round(solves[i])) for i in range(len(climbs))]


class _Space:
    """Coordinates in standard deviations of the prior."""

    def __init__(self, prior: Prior) -> None:
        self.bounds, self.names = prior.bounds, prior.names
        self.sd = prior_scale(prior)
        self.box = prior.bounds / self.sd[:, None]

    def theta(self, points: Floats) -> Floats:
        """Return points as parameters; rounding alone can pass a bound, by an ulp."""
        inside: Floats = np.clip(points * self.sd, *self.bounds.T)
        return inside

    def evaluate(self, evaluation: Any, kind: str, points: Floats) -> Reply:
        """Return what an evaluation says of points, in these coordinates."""
        before = evaluation.solves
        found = getattr(evaluation, kind)(self.theta(points))
        cost = (evaluation.solves - before) / max(1, len(points))  # none in d = 1
        if kind == "rows":
            return Reply(found, cost=cost)
        information = found.information
        if information is not None:
            information = information * np.outer(self.sd, self.sd)
        return Reply(found.rows, found.gradient * self.sd, information, cost)

    def maximum(self, summit: Summit, solves: int) -> Maximum:
        """Return the maximum at a summit, with its Laplace approximation.

        Raises:
            ValueError: If the density grows without bound.
        """
        local = summit.local
        at_bound = (local.point[:, None] == self.box).any(axis=1)
        covariance, log_evidence = np.full((len(self.sd),) * 2, np.nan), -np.inf
        if local.usable:
            self._check_width(local)
            curvature = make_positive(local.curvature)
            gradient = local.gradient
            covariance = fit_covariance(gradient, curvature, at_bound)
            covariance *= np.outer(self.sd, self.sd)
            room = self.box.T - local.point
            log_evidence = log_integral(gradient, curvature, *room)
            log_evidence += local.value + np.log(self.sd).sum()
        return Maximum(
            theta=self.theta(local.point),
            row=local.row,
            covariance=covariance,
            log_evidence=log_evidence,
            at_bound=at_bound,
            converged=summit.converged,
            solves=solves,
            message=summit.message,
        )

    def _check_width(self, local: Local) -> None:
        if not np.diagonal(local.curvature).max() > NARROWEST**-2:
            return
        where = zip(self.names, self.theta(local.point).tolist(), strict=True)
        raise ValueError(
            "posterior: its density seems to grow without bound towards "
            f"{ {name: float(f'{value:.5g}') for name, value in where} }: does an "
            "inferred error go to zero where the parameters fit the data exactly? Give "
            "its prior a lower bound above zero, or the term the errors that are known"
        )
