r"""The likelihood under a model that knows its own error, such as an emulator.

The response moves by one standard deviation along each of q independent directions,
whose coordinates z are standard normal. To second order in z

.. math:: \ln \int N(z; 0, I) \, p(D | z) \, dz \approx \ln p(D | 0)
    + \tfrac12 g^T (I + F)^{-1} g - \tfrac12 \ln \det(I + F)

with gradient g and Fisher information F of the log-likelihood along the directions:
exact where the data are Gaussian and their mean is linear in z. The variance of the
model then adds to that of the measurement.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..interfaces import Floats, Parameters
from .differences import difference_term, move_along


def marginalize(
    terms: tuple[Any, ...],
    parameters: Parameters,
    response: Any,
    tangents: Mapping[str, Floats],
    values: list[Floats],
) -> list[Floats]:
    """Return log-likelihoods, each given the data of the terms before it.

    Their sum is that of all data; a term that shares the model's error with one before
    it knows the error better.

    Args:
        terms: Likelihood terms.
        parameters: ``{name: (n,)}``.
        response: The model's.
        tangents: One standard deviation of each variable along each direction,
            ``(n, *shape, q)``; zeros ``(n, q)`` for each parameter.
        values: The terms' log-likelihoods ``(n,)`` at this response.
    """
    n, q = tangents[next(iter(parameters))].shape
    gradient, information = np.zeros((n, q)), np.tile(np.eye(q), (n, 1, 1))
    before, marginal = np.zeros(n), []
    for term, value in zip(terms, values, strict=True):
        found = value > -np.inf
        with np.errstate(all="ignore"):  # of rows that are -inf
            slope, curvature = expand(term, parameters, response, tangents, value)
        gradient += np.where(found[:, None], slope, 0.0)
        information += np.where(found[:, None, None], curvature, 0.0)
        factor = np.linalg.cholesky(information)
        scaled = np.linalg.solve(factor, gradient[:, :, None])[:, :, 0]
        widths = np.diagonal(factor, axis1=1, axis2=2)
        gain = 0.5 * (scaled**2).sum(axis=1) - np.log(widths).sum(axis=1)
        marginal.append(value + gain - before)
        before = gain
    return marginal


def expand(
    term: Any,
    parameters: Parameters,
    response: Any,
    tangents: Mapping[str, Floats],
    value: Floats,
) -> tuple[Floats, Floats]:
    """Return gradient ``(n, q)`` and information ``(n, q, q)`` along the directions."""
    n, q = tangents[next(iter(parameters))].shape
    if hasattr(term, "linearize"):
        gradient, scores = term.linearize(parameters, response, tangents)
    elif hasattr(term, "deviations"):
        gradient, scores = difference_term(
            term, parameters, response, tangents, np.ones((n, q))
        )
    else:
        scores = None
    if scores is not None:
        return gradient, scores.swapaxes(1, 2) @ scores
    # One standard deviation to both sides of each direction.
    moved = move_along(parameters, response, tangents, np.ones((n, q)))
    ahead, behind = term(*moved).reshape(n, 2, q).swapaxes(0, 1)
    slope = (ahead - behind) / 2
    bent = 2 * value[:, None] - ahead - behind
    # What bends the other way has no maximum: it gains what was seen, no more.
    seen = np.maximum(np.maximum(ahead, behind) - value[:, None], 0.5)
    least = np.maximum(slope**2 / (2 * seen) - 1.0, 0.0)
    bent = np.where(bent > 0, bent, least)
    return slope, bent[:, :, None] * np.eye(q)
