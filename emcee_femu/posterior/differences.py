"""Derivatives by finite differences, at points inside the prior's support."""

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..interfaces import (
    Floats,
    ModalSolution,
    PairedSolution,
    Pairing,
    Parameters,
    Prior,
    SolveError,
    read,
)
from ..likelihoods.normal import linearize_normal

Sides: TypeAlias = tuple[tuple[float, ...], ...]

# Of the prior's scale: eigenvalues that are good to 1e-10 then give derivatives that
# are good to 1e-5, those of dense solvers to 1e-9, and curvature costs about as much.
STEP = 3e-5
COARSE = 3e-3  # for a search: frequencies that are good to six digits will do
WIDE = 1e-3  # of second derivatives of the prior, from first ones
ALONG = 6e-6  # relative change of a response, where no solve adds noise
DRAWS = 256
# Central where both points are inside, else one-sided with the same order.
SIDES: Sides = ((1.0, -1.0), (1.0, 2.0), (-1.0, -2.0))
ONE_SIDE: Sides = ((1.0,), (-1.0,))  # half as many solves, enough to search by


class Stencil(NamedTuple):
    """Points about each parameter set at which its derivatives are taken.

    Attributes:
        points: ``(n * (k d + 1), d)``, the centre first.
        steps: k steps along each parameter, 1 or 2, ``(n, k, d)``; NaN where none is
            inside.
    """

    points: Floats
    steps: Floats

    @property
    def size(self) -> int:
        """How many points there are about each parameter set, and it."""
        return 1 + int(np.prod(self.steps.shape[1:]))

    def derive(self, values: Floats) -> Floats:
        """Return derivatives ``(n, m, d)`` of values ``(n, k d + 1, m)``."""
        d = self.steps.shape[2]
        with np.errstate(invalid="ignore"):  # of solves that failed
            changes = values[:, 1:] - values[:, :1]
        first, second = changes[:, :d].swapaxes(1, 2), changes[:, d:].swapaxes(1, 2)
        a, b = self.steps[:, None, 0], self.steps[:, None, -1]
        derivatives: Floats = first / a
        if self.steps.shape[1] == 2:
            with np.errstate(invalid="ignore"):
                derivatives = (first * (b / a) - second * (a / b)) / (b - a)
        return derivatives


def prior_scale(prior: Prior) -> Floats:
    """Return the scale of each parameter ``(d,)``: from quartile to quartile."""
    draws = prior.sample(np.random.default_rng(0), DRAWS)
    low, high = np.quantile(draws, [0.25, 0.75], axis=0)
    scale: Floats = (high - low) / 1.35
    return scale


def small_steps(prior: Prior, theta: Floats, scale: Floats) -> Floats:
    """Return steps ``(n, d)`` that are small beside the way to the next bound."""
    low, high = prior.bounds.T
    room = np.minimum(theta - low, high - theta)
    steps: Floats = np.clip(1e-3 * room, 1e-6 * STEP * scale, STEP * scale)
    return steps


def place(
    prior: Prior,
    theta: Floats,
    scale: Floats,
    step: float = STEP,
    sides: Sides = SIDES,
) -> Stencil:
    """Return the points about ``theta (n, d)``, none outside the prior's support."""
    (n, d), k = theta.shape, len(sides[0])
    points = np.repeat(theta[:, None], k * d + 1, axis=1)
    steps = np.full((n, k, d), np.nan)
    diagonal = np.arange(d)
    left = np.ones((n, d), dtype=bool)
    for signs in sides:
        trial = np.repeat(theta[:, None], k * d, axis=1).reshape(n, k, d, d)
        for side, sign in enumerate(signs):
            trial[:, side, diagonal, diagonal] += sign * step * scale
        density = prior.logpdf(trial.reshape(-1, d)).reshape(n, k, d)
        row, column = np.nonzero(left & np.isfinite(density).all(axis=1))
        for side in range(k):
            moved = trial[row, side, column]
            points[row, 1 + side * d + column] = moved
            steps[row, side, column] = (
                moved[np.arange(len(row)), column] - (theta[row, column])
            )
        left[row, column] = False
        if not left.any():
            break
    return Stencil(points.reshape(-1, d), steps)


def difference_density(prior: Prior, theta: Floats, scale: Floats) -> Floats:
    """Return the gradient of a log-prior ``(n, d)`` from its ``logpdf``."""
    stencil = place(prior, theta, scale)
    values = prior.logpdf(stencil.points).reshape(len(theta), -1, 1)
    gradient: Floats = stencil.derive(values)[:, 0]
    return gradient


def difference_hessian(prior: Any, theta: Floats, scale: Floats) -> Floats:
    """Return the second derivatives of a log-prior ``(n, d, d)``."""
    n, d = theta.shape
    stencil = place(prior, theta, scale, WIDE)
    if hasattr(prior, "gradient"):
        slopes = prior.gradient(stencil.points)
    else:
        slopes = difference_density(prior, stencil.points, scale)
    hessian = stencil.derive(slopes.reshape(n, 2 * d + 1, d))
    result: Floats = (hessian + hessian.swapaxes(1, 2)) / 2
    return result


def difference_term(
    term: Any,
    parameters: Parameters,
    response: Any,
    tangents: Mapping[str, Floats],
    step: Floats,
) -> tuple[Floats, Floats | None]:
    """Return gradient and scores of a term along the tangents, without a solve.

    Args:
        term: A likelihood term.
        parameters: ``{name: (n,)}``.
        response: The model's, at these.
        tangents: Derivatives of parameters and variables.
        step: The largest steps of the parameters, ``(n, d)``.
    """
    variables = {name: tangents[name] for name in tangents if name not in parameters}
    n, d = step.shape
    values = {name: np.asarray(read(response, name)) for name in variables}
    for name, tangent in variables.items():
        largest = np.abs(values[name]).reshape(n, -1).max(axis=1)[:, None]
        slope = np.abs(tangent).reshape(n, -1, d).max(axis=1)
        far = np.full((n, d), np.inf)
        relative = np.divide(largest, slope, out=far, where=slope > 0)
        step = np.minimum(step, ALONG * relative)
    there, moved = move_along(parameters, response, tangents, step)

    def slopes(numbers: Any) -> Floats:
        sided = np.asarray(numbers).reshape(n, 2, d, -1)
        difference = (sided[:, 0] - sided[:, 1]) / (2 * step[:, :, None])
        slope: Floats = difference.swapaxes(1, 2)  # (n, m, d)
        return slope

    if hasattr(term, "deviations"):
        here = term.deviations(parameters, response)
        d_deviations, d_sd = map(slopes, term.deviations(there, moved))
        return linearize_normal(here[0], here[1], d_deviations, d_sd)
    return slopes(term(there, moved))[:, 0], None


def move_along(
    parameters: Parameters,
    response: Any,
    tangents: Mapping[str, Floats],
    step: Floats,
) -> tuple[dict[str, Floats], Any]:
    """Return parameters and response, ``n * 2 d`` of each, moved along the tangents.

    Each of the n by ``step (n, d)``, ahead along all tangents and then behind.
    """
    n, d = step.shape
    sides = np.concatenate([step, -step], axis=1)  # (n, 2 d)

    def shift(value: Any, tangent: Any) -> Floats:
        wide = np.concatenate([tangent, tangent], axis=-1)
        wide = np.moveaxis(wide, -1, 1)  # (n, 2 d, *shape)
        moved = wide * sides.reshape(*sides.shape, *[1] * (wide.ndim - 2))
        moved += np.asarray(value)[:, None]
        shifted: Floats = moved.reshape(-1, *wide.shape[2:])
        return shifted

    variables = {
        name: shift(read(response, name), tangent)
        for name, tangent in tangents.items()
        if name not in parameters
    }
    there = {name: shift(parameters[name], tangents[name]) for name in parameters}
    return there, _replace(response, variables, n, 2 * d)


def _replace(response: Any, shifted: Mapping[str, Floats], n: int, times: int) -> Any:
    """Return a response with other variables, and the rest of it repeated."""

    def repeat(value: Any) -> Any:
        own = isinstance(value, np.ndarray) and value.ndim and len(value) == n
        return np.repeat(value, times, axis=0) if own else value

    if isinstance(response, Mapping):
        return {**{k: repeat(v) for k, v in response.items()}, **shifted}
    if isinstance(response, ModalSolution | PairedSolution):
        frequency = shifted.get("frequency", repeat(response.frequencies))
        shapes = shifted.get("shapes", repeat(response.shapes))
        if isinstance(response, ModalSolution):
            return ModalSolution(frequency, shapes)
        mac, modes, unpaired = map(repeat, response.pairing)
        pairing = Pairing(shifted.get("mac", mac), modes, unpaired)
        return PairedSolution(frequency, shapes, pairing)
    other = copy(response)
    try:
        for name, value in vars(response).items():
            object.__setattr__(other, name, shifted.get(name, repeat(value)))
    except (AttributeError, TypeError):
        raise TypeError(
            f"terms: one without linearize cannot be differenced on a response of "
            f"{type(response).__name__}; let the model return {{variable: array}}, or "
            "give the term linearize"
        ) from None
    return other


def gather_tangents(
    label: str, response: Any, derivatives: Any, names: Sequence[str]
) -> dict[str, Floats]:
    """Return the derivatives of each variable, ``(n, *shape, d)``.

    Args:
        label: What returned them.
        response: The model's.
        derivatives: ``{variable: {name: (n, *shape)}}``; zero where one is left out.
        names: The d names that there are.

    Raises:
        TypeError: If derivatives is no mapping.
        ValueError: If it has another name.
        SolveError: If a derivative is not as large as its variable.
    """
    if not isinstance(derivatives, Mapping):
        raise TypeError(
            f"{label}: expected {{variable: {{parameter: array}}}}, got "
            f"{type(derivatives).__name__}"
        )
    tangents = {}
    for variable, by_name in derivatives.items():
        shape = np.shape(read(response, variable))
        tangents[variable] = tangent = np.zeros((*shape, len(names)))
        unknown = [name for name in by_name if name not in names]
        if unknown:
            raise ValueError(
                f"{label}: no parameter {unknown}; there are {list(names)}"
            )
        for name, value in by_name.items():
            if np.shape(value) != shape:
                raise SolveError(
                    "wrong shape",
                    f"{label}: expected the derivative of {variable!r} by {name!r} of "
                    f"shape {shape}, got {np.shape(value)}",
                )
            tangent[..., names.index(name)] = value
    return tangents
