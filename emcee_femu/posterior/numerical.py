"""Gradient and Fisher information of black boxes, by finite differences."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..interfaces import Floats, Parameters
from ..likelihoods.normal import linearize_normal
from .differences import COARSE, ONE_SIDE, SIDES, STEP, place
from .experiments import Experiment
from .linearize import combine, prior_gradient


def extend(posterior: Any, theta: Floats) -> Floats:
    """Return rows, then deviations and their standard deviations of all terms."""
    parts: list[tuple[Floats, Floats]] = []

    def solve(
        experiment: Experiment,
        own: Parameters,
        parameters: Parameters,
        n: int,
        describe: Callable[[], Any],
    ) -> Any:
        response = experiment.respond(experiment.model, own, describe)
        compared = experiment.compare(response, parameters, n, describe)
        parts.extend(
            term.deviations(parameters, response)
            for term in experiment.terms
            if hasattr(term, "deviations")
        )
        return compared

    log_prior, supported = posterior.support(theta)
    if not supported.any():
        return np.tile(posterior.rejected(), (len(theta), 1))
    rows = posterior.solve(theta[supported], log_prior[supported], solve)
    columns = [rows, *(part for part, _ in parts), *(sd for _, sd in parts)]
    inside = np.hstack(columns)
    result = np.full((len(theta), inside.shape[1]), np.nan)
    result[:, : rows.shape[1]] = posterior.rejected()
    result[supported] = inside
    return result


def difference(
    posterior: Any,
    theta: Floats,
    evaluate: Callable[[Floats], Floats],
    information: bool,
    searching: bool = False,
) -> Floats:
    """Return what ``linearize`` does, from ``2 d + 1`` solves per point.

    All points are one batch, none of them outside the prior's support.

    Args:
        posterior: A posterior whose models need no ``jacobian``.
        theta: Parameter sets ``(n, d)``.
        evaluate: What :func:`extend` does, perhaps on a pool.
        information: Whether it is wanted.
        searching: Whether one side will do, ``d + 1`` solves, and wider steps, for
            solvers that round.
    """
    n, d = theta.shape
    width = len(posterior.rejected())
    _, supported = posterior.support(theta)
    rows = np.tile(posterior.rejected(), (n, 1))
    rest = np.full((n, d + (d * d if information else 0)), np.nan)
    if not supported.any():
        return np.hstack([rows, rest])
    inside = theta[supported]
    how = (COARSE, ONE_SIDE) if searching else (STEP, SIDES)
    stencil = place(posterior.prior, inside, posterior.scale, *how)
    extended = evaluate(stencil.points).reshape(len(inside), stencil.size, -1)
    rows[supported] = extended[:, 0, :width]
    derivatives = stencil.derive(extended)  # (n, columns, d)
    gradient = prior_gradient(posterior, inside)
    scores: list[Floats | None] = []
    for column, term in enumerate(posterior.terms, 2):
        if not hasattr(term, "deviations"):
            gradient = gradient + derivatives[:, column]
            scores.append(None)
    if extended.shape[2] > width:
        half = (extended.shape[2] - width) // 2
        parts = slice(width, width + half), slice(width + half, None)
        values = [extended[:, 0, part] for part in parts]
        slopes = [derivatives[:, part] for part in parts]
        with np.errstate(all="ignore"):  # of rows that are -inf
            own, score = linearize_normal(values[0], values[1], slopes[0], slopes[1])
        gradient = gradient + own
        scores.append(score)
    # A solve that failed beside a point leaves it without a gradient.
    known = np.isfinite(extended[:, :, 0]).all(axis=1) & ~np.isnan(stencil.steps).any(
        axis=(1, 2)
    )
    found = np.full((len(inside), rest.shape[1]), np.nan)
    chosen = [None if part is None else part[known] for part in scores]
    if known.any():
        found[known] = combine(
            posterior,
            inside[known],
            rows[supported][known],
            gradient[known],
            chosen,
            information,
        )
    rest[supported] = found
    return np.hstack([rows, rest])
