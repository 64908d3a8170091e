r"""The likelihood under a model that knows its own error, such as an emulator.

The response moves by one standard deviation along each of q independent directions,
whose coordinates z are standard normal. To second order in z

.. math:: \ln \int N(z; 0, I) \, p(D | z) \, dz \approx \ln p(D | 0)
    + \tfrac12 g^T (I + F)^{-1} g - \tfrac12 \ln \det(I + F)

with gradient g and Fisher information F of the log-likelihood along the directions:
exact where the data are Gaussian and their mean is linear in z. The variance of the
model then adds to that of the measurement.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from ..interfaces import Floats, Parameters, Response, gather_tangents
from ..likelihoods.term import Term, move_along

Directions = Mapping[str, Mapping[str, Floats]]  # {variable: {direction: (n, *shape)}}


def average(
    label: str,
    terms: Sequence[Term],
    parameters: Parameters,
    response: Response,
    directions: Directions,
    log_likelihoods: list[Floats],
) -> list[Floats]:
    """Return averaged log-likelihoods, each given the data of the terms before it.

    Their sum is that of all data; a term that shares the model's error with one before
    it knows the error better.

    Args:
        label: What to call the directions in messages.
        terms: Likelihood terms.
        parameters: ``{name: (n,)}``.
        response: The model's.
        directions: By how much each variable moves along each direction.
        log_likelihoods: Those of the terms ``(n,)`` at this response.
    """
    tangents = tangents_of(label, parameters, response, directions)
    n, q = tangents[next(iter(parameters))].shape
    gradient, information = np.zeros((n, q)), np.tile(np.eye(q), (n, 1, 1))
    before, averaged = np.zeros(n), []
    for term, value in zip(terms, log_likelihoods, strict=True):
        possible = value > -np.inf
        with np.errstate(all="ignore"):  # of rows that are -inf
            slope, curvature = expand(term, parameters, response, tangents, value)
        gradient += np.where(possible[:, None], slope, 0.0)
        information += np.where(possible[:, None, None], curvature, 0.0)
        factor = np.linalg.cholesky(information)
        scaled = np.linalg.solve(factor, gradient[:, :, None])[:, :, 0]
        widths = np.diagonal(factor, axis1=1, axis2=2)
        gain = 0.5 * (scaled**2).sum(axis=1) - np.log(widths).sum(axis=1)
        averaged.append(value + gain - before)
        before = gain
    return averaged


def tangents_of(
    label: str, parameters: Parameters, response: Response, directions: Directions
) -> dict[str, Floats]:
    """Return moves of variables ``(n, *shape, q)``, and of parameters, which rest."""
    names = [*dict.fromkeys(name for moves in directions.values() for name in moves)]
    n = len(next(iter(parameters.values())))
    still = dict.fromkeys(parameters, np.zeros((n, len(names))))
    return gather_tangents(label, response, directions, names) | still


def expand(
    term: Term,
    parameters: Parameters,
    response: Response,
    tangents: Mapping[str, Floats],
    log_likelihood: Floats,
) -> tuple[Floats, Floats]:
    """Return gradient ``(n, q)`` and information ``(n, q, q)`` along the directions."""
    steps = np.ones_like(tangents[next(iter(parameters))])
    gradient, scores = term.linearize(parameters, response, tangents, steps)
    if scores is not None:
        return gradient, scores.swapaxes(1, 2) @ scores
    # One standard deviation to both sides of each direction.
    q, value = steps.shape[-1], log_likelihood[:, None]
    moved = move_along(parameters, response, tangents, steps)
    ahead, behind = term(*moved).reshape(-1, 2, q).swapaxes(0, 1)
    slope = (ahead - behind) / 2
    bend = 2 * value - ahead - behind
    # What bends the other way has no maximum: it gains what was seen, no more.
    seen = np.maximum(np.maximum(ahead, behind) - value, 0.5)
    least = np.maximum(slope**2 / (2 * seen) - 1.0, 0.0)
    bend = np.where(bend > 0, bend, least)
    return slope, bend[:, :, None] * np.eye(q)
