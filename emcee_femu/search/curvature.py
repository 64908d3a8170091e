"""Quadratics about points of a posterior: its gradient and curvature there.

The curvature is the Fisher information if all terms have one, for which gradients are
enough. Otherwise a quadratic is fitted to the rows of points around.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..contracts import Floats
from ..evaluation.evaluator import Evaluation
from ..posterior.derivatives import is_printed
from ..posterior.log_posterior import LOG_POSTERIOR
from .coordinates import Coordinates

# If a prediction has a smaller relative error, the curvature holds everywhere.
EXACT = 1e-2
# If a prediction has a larger relative error, the curvature is computed anew.
USABLE = 0.5
# Step of differences, in prior standard deviations, where no scale is known.
FIRST_OFFSET = 1e-3
# Step of differences, in conditional standard deviations of the posterior.
OFFSET = 0.05
# Largest step of differences, in prior standard deviations.
MOST_OFFSET = 0.1
# OFFSET and MOST_OFFSET for a solver that prints few digits.
GRAINED_OFFSET = 1.0
MOST_GRAINED = 0.5


class Local(NamedTuple):
    """The quadratic about a point, in standard deviations of the prior.

    Attributes:
        point: The point, ``(d,)``.
        row: The posterior's row there.
        gradient: Gradient of the log-posterior, ``(d,)``; NaN where a solve failed.
        curvature: Minus the Hessian, ``(d, d)``.
        fresh: Whether the curvature is that of this point.
        offsets: Steps of the differences to a neighbour on each axis, ``(d,)``.
        ahead: Change of the log-posterior over these steps, ``(d,)``.
        diagonal: Diagonal of the curvature at this point, ``(d,)``; NaN if not known.
    """

    point: Floats
    row: Floats
    gradient: Floats
    curvature: Floats
    fresh: bool = True
    offsets: Floats = np.empty(0)
    ahead: Floats = np.empty(0)
    diagonal: Floats = np.empty(0)

    @property
    def value(self) -> float:
        """The log-posterior."""
        return float(self.row[LOG_POSTERIOR])

    @property
    def usable(self) -> bool:
        """Whether no solve failed, neither at the point nor beside it."""
        return bool(np.isfinite([self.value, *self.gradient]).all())


class Space:
    """Coordinates in standard deviations of the prior, and quadratics in them."""

    def __init__(
        self,
        evaluator: Evaluation,
        guess: Floats | None,
        coordinates: Coordinates,
        box: Floats | None,
    ) -> None:
        self.evaluator, self.posterior = evaluator, evaluator.posterior
        self.coordinates, self.scale = coordinates, coordinates.scale
        bounds = coordinates.bounds if box is None else box
        self.box = bounds / self.scale[:, None]
        self.guess: Floats | None = None
        if guess is not None:
            curvature = guess / np.outer(self.scale, self.scale)
            self.guess = np.asarray(np.linalg.inv(curvature), np.float64)
        self.printed = False  # as far as is known
        # Solves that a look at a point takes.
        rows = len(self.scale) * (1 if self.posterior.normal else 2)
        self.price = 1 if self.posterior.differentiable else rows + 1

    def rows(self, points: Floats) -> Floats:
        """Return rows with the density of the coordinates."""
        x, coordinates = points * self.scale, self.coordinates
        rows = self.evaluator.rows(coordinates.inside(x))
        self.printed |= len(rows) > 1 and is_printed(self.posterior, rows)
        return coordinates.lift(rows, x)

    def linearize(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Return rows, gradients and information, NaN where it is not known."""
        found = self.coordinates.linearize(self.evaluator, points * self.scale)
        rows, gradient, information = found
        return rows, gradient * self.scale, information * np.outer(*[self.scale] * 2)

    def look(self, points: Floats, before: Sequence[Local] = ()) -> list[Local]:
        """Return the quadratics about points, which climbs reached from others."""
        unknown = np.full_like(points, np.nan)
        if self.posterior.normal or self.posterior.differentiable:
            rows, gradient, information = self.linearize(points)
        else:
            rows, gradient = self.rows(points), unknown
            information = unknown[:, :, None] * unknown[:, None]
        parts = zip(points, rows, gradient, information, strict=True)
        if self.posterior.normal:
            return [Local(*part) for part in parts]
        last: list[Local | None] = [*before] or [None] * len(points)
        return [
            self._look_around(Local(*part, diagonal=unknown[0]), local)
            for part, local in zip(parts, last, strict=True)
        ]

    def _look_around(self, local: Local, before: Local | None) -> Local:
        """Return the quadratic about a point, with an old curvature if it still holds.

        An unknown gradient takes two rows on each axis, which give the diagonal of the
        curvature too. A point lower than the one before is not worth them.
        """
        curvature = self.guess if before is None else before.curvature
        first, second = self._offsets(local.point, curvature)
        local = local._replace(offsets=first)
        if not self.posterior.differentiable:
            if not local.value > (-np.inf if before is None else before.value):
                return local
            known = self.printed
            local = self._difference(local, second)
            if self.printed and not known:  # the steps were too small
                first, second = self._offsets(local.point, curvature)
                local = self._difference(local._replace(offsets=first), second)
        if curvature is None or not local.usable or local.curvature.size == 1:
            return self.fit(local) if local.usable else local
        local = local._replace(curvature=curvature, fresh=False)
        if before is None:
            return local
        step, change = local.point - before.point, local.value - before.value
        predicted = before.gradient @ step - 0.5 * step @ curvature @ step
        error = abs(change - predicted)
        if error > USABLE * abs(change):
            return self.fit(local)
        changed = np.abs(local.diagonal - np.diag(curvature))
        exact = (changed < EXACT * np.abs(np.diag(curvature))).all()
        if error < EXACT * abs(change) and exact:
            return local._replace(fresh=True)  # as for a Gaussian
        return local._replace(curvature=_bend(before, local))

    def _difference(self, local: Local, second: Floats) -> Local:
        """Return gradient and diagonal of the curvature from rows beside a point."""
        first = local.offsets
        steps = np.concatenate([np.diag(first), np.diag(second)])
        rows = self.rows(local.point + steps)
        ahead, behind = np.split(rows[:, LOG_POSTERIOR] - local.value, 2)
        a, b = ahead / first, behind / second
        # Where a solve on one side failed, the slope on the other side is taken.
        a, b = np.where(np.isfinite(a), a, b), np.where(np.isfinite(b), b, a)
        with np.errstate(invalid="ignore"):  # where all solves failed
            gradient = (a * second - b * first) / (second - first)
            diagonal = -2 * (b - a) / (second - first)
        return local._replace(gradient=gradient, ahead=ahead, diagonal=diagonal)

    def fit(self, local: Local) -> Local:
        """Return the quadratic with the curvature of its point.

        It takes differences of gradients, or one more row for each pair of axes.
        """
        steps = np.diag(local.offsets)
        if self.posterior.differentiable:
            around = self.linearize(local.point + steps)[1]
            changes = (local.gradient - around) / local.offsets[:, None]
            changes[~np.isfinite(changes)] = 0.0  # of solves that failed
            curvature = (changes + changes.T) / 2
        else:
            curvature = np.diag(local.diagonal)
            i, j = np.triu_indices(len(steps), 1)
            rows = self.rows(local.point + steps[i] + steps[j])
            with np.errstate(invalid="ignore"):  # of solves that failed
                both = rows[:, LOG_POSTERIOR] - local.value
                both = both - local.ahead[i] - local.ahead[j]
            both[~np.isfinite(both)] = 0.0
            curvature[i, j] = -both / (local.offsets[i] * local.offsets[j])
            curvature[j, i] = curvature[i, j]
        self.guess = curvature  # from which other climbs start
        return local._replace(curvature=curvature, fresh=True)

    def _offsets(
        self, point: Floats, curvature: Floats | None
    ) -> tuple[Floats, Floats]:
        """Return two steps on each axis, ``(d,)`` each, that stay inside the bounds."""
        usual = FIRST_OFFSET, OFFSET, MOST_OFFSET
        grained = MOST_OFFSET, GRAINED_OFFSET, MOST_GRAINED
        begin, share, most = grained if self.printed else usual
        size = np.full(len(point), begin)
        if curvature is not None:
            scale = np.abs(np.diag(curvature))
            size = np.minimum(share / np.sqrt(np.maximum(scale, 1e-300)), most)
        below, above = point - self.box[:, 0], self.box[:, 1] - point
        size = np.minimum(size, np.maximum(below, above) / 2)
        up, down = above >= size, below >= size
        first = np.where(up, size, -size)
        return first, np.where(up & down, -size, 2 * first)


def _bend(before: Local, here: Local) -> Floats:
    """Return the curvature that explains how the gradient changed (SR1)."""
    step = here.point - before.point
    rest = before.gradient - here.gradient - before.curvature @ step
    product = rest @ step
    rounding = np.sqrt(np.finfo(float).eps)
    if abs(product) <= rounding * np.linalg.norm(rest) * np.linalg.norm(step):
        return before.curvature
    return np.asarray(before.curvature + np.outer(rest, rest) / product)
