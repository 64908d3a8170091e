"""The quadratic that fits a posterior around a point, from as few solves as it takes.

Generators ask for evaluations and are sent the answers, so that several climbs share
one batch. Coordinates are in standard deviations of the prior.
"""

from collections.abc import Generator
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from ..interfaces import Floats

FIRST_OFFSET = 1e-3  # of differences, in prior sds, where no scale is known
OFFSET = 0.05  # of differences, in conditional sds of the posterior
MOST_OFFSET = 0.1  # in prior sds


class Request(NamedTuple):
    """Points ``(n, d)`` to evaluate, by "rows" or "linearize" of an evaluation."""

    kind: str
    points: Floats


class Reply(NamedTuple):
    """Rows of the points, what linearize adds, and solves per point."""

    rows: Floats
    gradient: Any = None
    information: Any = None
    cost: float = 0.0

    def part(self, which: slice) -> "Reply":
        """Return the reply to some of the points."""
        gradient, information = (
            None if array is None else array[which]
            for array in (self.gradient, self.information)
        )
        return Reply(self.rows[which], gradient, information, self.cost)


class Local(NamedTuple):
    """A point ``(d,)``, its row, gradient and curvature (minus the Hessian).

    Attributes:
        fresh: Whether the curvature is of this point, and not of an earlier one.
        offsets: Steps to neighbours along each axis, ``(d,)``, of differences of rows.
        beside: The log-posterior there, ``(d,)``.
        diagonal: Of the curvature, ``(d,)``.
    """

    point: Floats
    row: Floats
    gradient: Floats
    curvature: Any
    fresh: bool = False
    offsets: Any = None
    beside: Any = None
    diagonal: Any = None

    @property
    def value(self) -> float:
        """The log-posterior."""
        return float(self.row[0])

    @property
    def usable(self) -> bool:
        """Whether nothing failed, here and beside."""
        return bool(np.isfinite([self.value, *self.gradient]).all())


Asking: TypeAlias = Generator[Request, Reply, Local]


class Scheme(Protocol):
    """How gradients and curvatures are had."""

    costly: bool  # whether a gradient costs more than a row
    curvature_is_free: bool  # beside a gradient

    def look(self, point: Floats, box: Floats, old: Local | None) -> Asking:
        """Return row and gradient; old has the row already, or a curvature."""

    def bend(self, local: Local, box: Floats) -> Asking:
        """Return the same with a fresh curvature."""


def find_scheme(reply: Reply) -> Scheme:
    """Return what is cheapest where a gradient cost so much."""
    if reply.information is not None:
        return Information(costly=reply.cost > 1)
    return Gradients() if reply.cost <= 1 else Differences()


class Information:
    """The Fisher information comes with the gradient."""

    curvature_is_free = True

    def __init__(self, costly: bool) -> None:
        self.costly = costly

    def look(self, point: Floats, box: Floats, old: Local | None) -> Asking:
        """Return gradient and information."""
        reply: Reply = yield Request("linearize", point[None])
        return read(point, reply)

    def bend(self, local: Local, box: Floats) -> Asking:
        """Return the same: it is fresh."""
        return local
        yield  # a generator


class Gradients:
    """A gradient costs one solve, a curvature one for each parameter."""

    costly = False
    curvature_is_free = False

    def look(self, point: Floats, box: Floats, old: Local | None) -> Asking:
        """Return the gradient."""
        reply: Reply = yield Request("linearize", point[None])
        return read(point, reply)

    def bend(self, local: Local, box: Floats) -> Asking:
        """Return the curvature by differences of gradients."""
        offsets = choose_offsets(local.point, local.curvature, box)[0]
        reply = yield Request("linearize", local.point + np.diag(offsets))
        changes = (local.gradient - reply.gradient) / offsets[:, None]
        changes[~np.isfinite(changes)] = 0.0  # a solve that failed
        return local._replace(curvature=(changes + changes.T) / 2, fresh=True)


class Differences:
    """Rows alone: 2 d of them for a gradient, d (d - 1) / 2 more for a curvature.

    Exact for a quadratic, whatever the steps.
    """

    costly = True
    curvature_is_free = False

    def look(self, point: Floats, box: Floats, old: Local | None) -> Asking:
        """Return gradient and diagonal of the curvature, by two points on each axis."""
        known = old is not None and np.array_equal(old.point, point)
        curvature = None if old is None else old.curvature
        one, two = choose_offsets(point, curvature, box)
        steps = [np.diag(one), np.diag(two)]
        if not known:
            steps.append(np.zeros((1, len(one))))
        reply = yield Request("rows", point + np.concatenate(steps))
        row = old.row if old is not None and known else reply.rows[-1]
        d = len(point)
        a, b = (
            (reply.rows[:d, 0] - row[0]) / one,
            (reply.rows[d : 2 * d, 0] - row[0]) / two,
        )
        return Local(
            point,
            row,
            gradient=(a * two - b * one) / (two - one),
            curvature=curvature,
            offsets=one,
            beside=reply.rows[:d, 0],
            diagonal=-2 * (b - a) / (two - one),
        )

    def bend(self, local: Local, box: Floats) -> Asking:
        """Return the curvature, by one point for each pair of axes."""
        if len(local.point) == 1:
            return local._replace(curvature=np.diag(local.diagonal), fresh=True)
        i, j = np.triu_indices(len(local.point), 1)
        steps = np.diag(local.offsets)
        reply = yield Request("rows", local.point + steps[i] + steps[j])
        curvature = np.diag(local.diagonal)
        mixed = reply.rows[:, 0] - local.beside[i] - local.beside[j] + local.value
        mixed[~np.isfinite(mixed)] = 0.0  # a solve that failed
        curvature[i, j] = curvature[j, i] = -mixed / (
            local.offsets[i] * local.offsets[j]
        )
        return local._replace(curvature=curvature, fresh=True)


def read(point: Floats, reply: Reply) -> Local:
    """Return what one linearized point says."""
    if reply.information is None:
        return Local(point, reply.rows[0], reply.gradient[0], None)
    return Local(point, reply.rows[0], reply.gradient[0], reply.information[0], True)


def choose_offsets(point: Floats, curvature: Floats | None, box: Floats) -> Any:
    """Return two steps on each axis, ``(d,)`` each, that stay inside the bounds."""
    size = np.full(len(point), FIRST_OFFSET)
    if curvature is not None:
        scale = np.abs(np.diag(curvature))
        size = np.minimum(OFFSET / np.sqrt(np.maximum(scale, 1e-300)), MOST_OFFSET)
    below, above = point - box[:, 0], box[:, 1] - point
    size = np.minimum(size, np.maximum(below, above) / 2)
    up, down = above >= size, below >= size
    one = np.where(up, size, -size)
    two = np.where(up & down, -size, 2 * one)
    return one, two
