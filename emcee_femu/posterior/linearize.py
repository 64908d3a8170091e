r"""Gradient and Fisher information of a posterior, from one solve per point.

Every function here returns its results side by side, one row per point: the row of the
posterior, the gradient (d), and where it was asked for the information (d * d), so that
a pool can carry them.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..interfaces import Floats, Linearization, Parameters, SolveError
from .differences import (
    difference_density,
    difference_hessian,
    difference_term,
    gather_tangents,
    small_steps,
)
from .experiments import Experiment


def linearize(posterior: Any, theta: Floats, information: bool) -> Floats:
    """Return rows, gradients and information ``(n, width + d (+ d * d))``.

    Rows that are -inf have NaN for the rest, without a solve where the prior is zero.
    """
    n, d = theta.shape
    log_prior, supported = posterior.support(theta)
    rows = np.tile(posterior.rejected(), (n, 1))
    rest = np.full((n, d + (d * d if information else 0)), np.nan)
    if supported.any():
        inside = theta[supported]
        rows[supported], rest[supported] = _linearize_supported(
            posterior, inside, log_prior[supported], information
        )
    return np.hstack([rows, rest])


def _linearize_supported(
    posterior: Any, theta: Floats, log_prior: Floats, information: bool
) -> tuple[Floats, Floats]:
    found: list[tuple[Floats, Floats | None]] = []
    steps = small_steps(posterior.prior, theta, posterior.scale)
    along = {
        name: np.broadcast_to(unit, theta.shape)
        for name, unit in zip(posterior.names, np.eye(posterior.ndim), strict=True)
    }

    def solve(
        experiment: Experiment,
        own: Parameters,
        parameters: Parameters,
        n: int,
        describe: Callable[[], Any],
    ) -> Any:
        jacobian = experiment.model.jacobian  # type: ignore[attr-defined]
        response, derivatives = experiment.respond(jacobian, own, describe)
        compared = experiment.compare(response, parameters, n, describe)
        label = f"{experiment.full_name('model')}: jacobian"
        tangents = gather_tangents(label, response, derivatives, posterior.names)
        _check_read(experiment, tangents)
        tangents |= along
        with np.errstate(all="ignore"):  # of rows that are -inf
            found.extend(
                term.linearize(parameters, response, tangents)
                if hasattr(term, "linearize")
                else difference_term(term, parameters, response, tangents, steps)
                for term in experiment.terms
            )
        return compared

    rows = posterior.solve(theta, log_prior, solve)
    gradient = sum(part for part, _ in found) + prior_gradient(posterior, theta)
    scores = [part for _, part in found]
    return rows, combine(posterior, theta, rows, gradient, scores, information)


def combine(
    posterior: Any,
    theta: Floats,
    rows: Floats,
    gradient: Floats,
    scores: list[Floats | None],
    information: bool,
) -> Floats:
    """Return gradient and information side by side; NaN where a row is -inf.

    Raises:
        SolveError: If the gradient is not finite where the posterior is.
    """
    n, d = theta.shape
    rest = [gradient]
    if information:
        matrix = -difference_hessian(posterior.prior, theta, posterior.scale)
        for part in scores:
            matrix += np.nan if part is None else part.swapaxes(1, 2) @ part
        rest.append(matrix.reshape(n, d * d))
    result = np.hstack(rest)
    rejected = rows[:, 0] == -np.inf
    result[rejected] = np.nan
    wrong = ~rejected & ~np.isfinite(gradient).all(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        values = dict(zip(posterior.names, theta[row].tolist(), strict=True))
        raise SolveError(
            "not finite",
            f"the gradient of the log-posterior is {gradient[row].tolist()} at "
            f"{values}; a model's jacobian, a term's linearize and a prior's gradient "
            "must return finite numbers",
        )
    return result


def _check_read(experiment: Experiment, tangents: Mapping[str, Floats]) -> None:
    """Refuse a jacobian that says nothing of a variable which a term reads."""
    for term, name in zip(experiment.terms, experiment.term_names, strict=True):
        missing = [key for key in getattr(term, "reads", ()) if key not in tangents]
        if missing:
            raise ValueError(
                f"{experiment.full_name('model')}: jacobian returned no derivatives of "
                f"{missing}, which the term {name!r} reads; return "
                "{variable: {parameter: array}}, {} for one that does not change"
            )


def prior_gradient(posterior: Any, theta: Floats) -> Floats:
    """Return the gradient of the log-prior ``(n, d)``, by differences if need be."""
    prior = posterior.prior
    if hasattr(prior, "gradient"):
        gradient: Floats = prior.gradient(theta)
        return gradient
    return difference_density(prior, theta, posterior.scale)


def split(posterior: Any, stacked: Floats) -> tuple[Floats, Floats]:
    """Return rows and gradients of what ``stack_gradient`` returned, one or many."""
    width, d = len(posterior.rejected()), posterior.ndim
    rows, gradient = stacked[..., :width], stacked[..., width : width + d]
    if not gradient.shape[-1]:  # nothing but failures
        gradient = np.full((*rows.shape[:-1], d), np.nan)
    return rows, gradient


def unstack(posterior: Any, stacked: Floats) -> Linearization:
    """Return rows, gradient and information, None where a term's is not known."""
    rows, gradient = split(posterior, stacked)
    n, d = gradient.shape
    information = stacked[:, rows.shape[1] + d :]
    if not information.shape[1]:
        return Linearization(rows, gradient, np.full((n, d, d), np.nan))
    information = information.reshape(n, d, d)
    solved = np.isfinite(gradient).all(axis=1)
    unknown = bool(np.isnan(information[solved]).any())
    return Linearization(rows, gradient, None if unknown else information)
