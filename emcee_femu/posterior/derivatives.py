r"""Gradient and Fisher information of a posterior.

Where every model has ``jacobian`` they take one solve per point
(:func:`along_tangents`), else a stencil of solves (:func:`difference`). Terms and
priors are differenced without any.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..contracts import (
    LOG_POSTERIOR,
    LOG_PRIOR,
    Floats,
    Linearization,
    Parameters,
    Prior,
    SolveError,
)
from ..likelihoods.term import Term, linearize_normal
from .experiments import Solved

Sides: TypeAlias = tuple[tuple[float, ...], ...]
Linearized: TypeAlias = tuple[Floats, Floats | None]  # gradient and scores of a part
Law: TypeAlias = tuple[Prior, Floats]  # and the scale of each of its parameters

# Of the prior's scale: eigenvalues that are good to 1e-10 then give derivatives that
# are good to 1e-5, those of dense solvers to 1e-9, and curvature costs about as much.
SMALL_STEP = 3e-5
COARSE = 3e-3  # for a search: frequencies that are good to six digits will do
GRAINED = 0.1  # the same of fewer digits: a frequency of four errs by 3 % of the change
DIGITS = 5  # up to which numbers are taken for printed ones; six do no harm
WIDE = 1e-3  # of second derivatives of the prior, from first ones
# Central where both points are inside, else one-sided with the same order.
SIDES: Sides = ((1.0, -1.0), (1.0, 2.0), (-1.0, -2.0))
ONE_SIDE: Sides = ((1.0,), (-1.0,))  # half as many solves, enough to search by


class _Differentiated(Protocol):
    """What derivatives ask of a posterior."""

    names: tuple[str, ...]
    ndim: int
    prior: Prior
    terms: tuple[Term, ...]
    columns: dict[str, slice]
    row_size: int

    @property
    def scale(self) -> Floats: ...
    def parameters(self, theta: Floats) -> Parameters: ...
    def split(self, stacked: Floats) -> tuple[slice, slice, slice]: ...


class Stencil(NamedTuple):
    """Points about each parameter set at which its derivatives are taken.

    Attributes:
        points: ``(n * (k d + 1), d)``, the centre first.
        steps: k steps along each parameter, 1 or 2, ``(n, k, d)``; NaN where none is
            inside.
    """

    points: Floats
    steps: Floats

    def derive(self, values: Floats) -> Floats:
        """Return derivatives ``(n, m, d)`` of values ``(n * (k d + 1), m)``."""
        n, k, d = self.steps.shape
        values = values.reshape(n, 1 + k * d, -1)
        with np.errstate(invalid="ignore"):  # of solves that failed
            changes = (values[:, 1:] - values[:, :1]).reshape(n, k, d, -1)
            first, a = changes[:, 0].swapaxes(1, 2), self.steps[:, None, 0]
            derivatives: Floats = first / a
            if k == 2:
                second, b = changes[:, 1].swapaxes(1, 2), self.steps[:, None, 1]
                derivatives = (first * (b / a) - second * (a / b)) / (b - a)
        return derivatives


def place(
    law: Law, theta: Floats, step: float = SMALL_STEP, sides: Sides = SIDES
) -> Stencil:
    """Return the points about ``theta (n, d)``, none outside the prior's support."""
    (prior, scale), (n, d), k = law, theta.shape, len(sides[0])
    around = np.tile(theta[:, None, None], (1, k, d, 1))
    steps = np.full((n, k, d), np.nan)
    for signs in sides:
        moves = np.array(signs)[:, None, None] * step * np.diag(scale)
        trial = theta[:, None, None] + moves  # (n, k, d, d)
        density = prior.logpdf(trial.reshape(-1, d)).reshape(n, k, d)
        chosen = np.isnan(steps) & np.isfinite(density).all(axis=1, keepdims=True)
        around = np.where(chosen[..., None], trial, around)
        moved = np.diagonal(trial - theta[:, None, None], axis1=2, axis2=3)
        steps = np.where(chosen, moved, steps)
        if not np.isnan(steps).any():
            break
    points = np.concatenate([theta[:, None], around.reshape(n, k * d, d)], axis=1)
    return Stencil(points.reshape(-1, d), steps)


def is_printed(posterior: _Differentiated, rows: Floats) -> bool:
    """Return whether a solver prints few digits, by its rows at several points.

    Small steps do not change what it prints, or by one digit. Where the response is
    the same and the likelihood is not, a term has the density, and no solver.
    """
    solved = rows[np.isfinite(rows[:, LOG_POSTERIOR])]
    response = solved[:, posterior.columns["densities"].stop :]
    likelihood = solved[:, LOG_POSTERIOR] - solved[:, LOG_PRIOR]
    numbers = np.abs(response[response != 0])
    if not numbers.size or (not np.ptp(response, 0).any() and np.ptp(likelihood)):
        return False
    digits = numbers / 10.0 ** (np.floor(np.log10(numbers)) - DIGITS + 1)
    return bool((np.abs(digits - np.round(digits)) < 1e-6).all())


def prior_gradient(law: Law, theta: Floats) -> Floats:
    """Return the gradient of the log-prior ``(n, d)``."""
    stencil = place(law, theta)
    return stencil.derive(law[0].logpdf(stencil.points))[:, 0]


def prior_hessian(law: Law, theta: Floats) -> Floats:
    """Return the second derivatives of the log-prior ``(n, d, d)``."""
    stencil = place(law, theta, WIDE)
    hessian = stencil.derive(prior_gradient(law, stencil.points))
    return (hessian + hessian.swapaxes(1, 2)) / 2


def along_tangents(
    posterior: _Differentiated,
    theta: Floats,
    rows: Floats,
    solved: Sequence[Solved],
    information: bool,
) -> Floats:
    """Return gradients, and information where asked for, side by side, by one solve.

    Args:
        posterior: The posterior.
        theta: Parameter sets ``(n, d)`` inside the prior's support.
        rows: Their rows.
        solved: What the experiments gave for them, with tangents.
        information: Whether it is wanted.
    """
    low, high = posterior.prior.bounds.T
    room = np.minimum(theta - low, high - theta)  # a step is small beside it
    size = SMALL_STEP * posterior.scale
    steps = np.clip(1e-3 * room, 1e-6 * size, size)
    parameters = posterior.parameters(theta)
    units = zip(posterior.names, np.eye(posterior.ndim), strict=True)
    along = {name: np.broadcast_to(unit, theta.shape) for name, unit in units}
    parts = []
    for part in solved:
        about = parameters, part.response, part.tangents | along, steps
        with np.errstate(all="ignore"):  # of rows that are -inf
            parts += [term.linearize(*about) for term in part.terms]
    law, possible = (posterior.prior, posterior.scale), rows[:, LOG_POSTERIOR] > -np.inf
    return _side_by_side(posterior.names, law, theta, possible, parts, information)


def difference(
    posterior: _Differentiated,
    theta: Floats,
    evaluate: Callable[[Floats], Floats],
    information: bool,
    searching: bool = False,
    law: Law | None = None,
) -> Floats:
    """Return rows, gradients and information of points, by a stencil of solves.

    Args:
        posterior: The posterior.
        theta: Parameter sets ``(n, d)`` inside the prior's support.
        evaluate: Returns ``posterior.stack(points, "deviations")``, on workers perhaps.
        information: Whether it is wanted.
        searching: Whether d + 1 solves per point will do, in place of 2 d + 1.
        law: Prior and scale of the coordinates that the points are in, and that
            evaluate takes; None for parameters.
    """
    law = law or (posterior.prior, posterior.scale)
    how = (COARSE, ONE_SIDE) if searching else (SMALL_STEP, SIDES)
    stencil = place(law, theta, *how)
    evaluated = evaluate(stencil.points)
    rows, r, sd = posterior.split(evaluated)
    if searching and is_printed(posterior, evaluated[:, rows]):
        stencil = place(law, theta, GRAINED, ONE_SIDE)
        evaluated = evaluate(stencil.points)
    slopes = stencil.derive(evaluated)  # (n, columns, d)
    values = evaluated.reshape(len(theta), -1, evaluated.shape[1])
    others = [column for column, t in enumerate(posterior.terms, 2) if not t.gaussian]
    parts: list[Linearized] = [(slopes[:, column], None) for column in others]
    if len(others) < len(posterior.terms) and values.shape[2] > posterior.row_size:
        normal = values[:, 0, r], values[:, 0, sd], slopes[:, r], slopes[:, sd]
        with np.errstate(all="ignore"):  # of rows that are -inf
            parts.append(linearize_normal(*normal))
    # A solve that failed beside a point leaves it without a gradient.
    possible = np.asarray(np.isfinite(values[:, :, 0]).all(axis=1))
    possible &= ~np.isnan(stencil.steps).any(axis=(1, 2))
    names = posterior.names
    rest = _side_by_side(names, law, theta, possible, parts, information)
    return np.hstack([values[:, 0, rows], rest])


def _side_by_side(
    names: Sequence[str],
    law: Law,
    theta: Floats,
    possible: NDArray[np.bool_],
    parts: Sequence[Linearized],
    information: bool,
) -> Floats:
    """Return gradient and information side by side; NaN where there can be none.

    Those of the log-prior, and of each part of the likelihood.

    Raises:
        SolveError: If a gradient is not finite elsewhere.
    """
    gradient = sum((slope for slope, _ in parts), start=prior_gradient(law, theta))
    result = gradient
    if information:
        matrix = -prior_hessian(law, theta)
        with np.errstate(all="ignore"):  # of rows that are -inf
            for _, score in parts:
                matrix += np.nan if score is None else score.swapaxes(1, 2) @ score
        result = np.hstack([gradient, matrix.reshape(len(theta), -1)])
    result[~possible] = np.nan
    wrong = possible & ~np.isfinite(gradient).all(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        values = dict(zip(names, theta[row].tolist(), strict=True))
        raise SolveError(
            "not finite",
            f"the gradient of the log-posterior is {gradient[row].tolist()} at "
            f"{values}; a model's jacobian and a term's deviations must be finite",
        )
    return result


def unstack(posterior: _Differentiated, stacked: Floats) -> Linearization:
    """Return rows, gradient and information; None where a term's is not known."""
    width, d, n = posterior.row_size, posterior.ndim, len(stacked)
    rows, gradient = stacked[:, :width], stacked[:, width : width + d]
    information = stacked[:, width + d :]
    if not gradient.shape[1]:  # nothing but failures
        gradient = np.full((n, d), np.nan)
    if not information.shape[1]:
        return Linearization(rows, gradient, np.full((n, d, d), np.nan))
    information = information.reshape(n, d, d)
    solved = np.isfinite(gradient).all(axis=1)
    unknown = bool(np.isnan(information[solved]).any())
    return Linearization(rows, gradient, None if unknown else information)
