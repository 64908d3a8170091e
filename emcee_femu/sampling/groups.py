"""Separated groups of a posterior: which components, and how much of the posterior."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..interfaces import Floats
from ..moves.mixture_em import Mixture, log_parts
from .refine import COVERS

APART = 10.0  # squared distance of the centres, by the sum of the matrices
COVER = -1  # the number of components that belong to no group

Labels = NDArray[np.intp]


def separate(law: Mixture) -> Labels:
    """Return the group of each component ``(k,)``; those that overlap share one.

    The last components cover the others and belong to none.
    """
    k = len(law.weights) - len(COVERS)
    apart = law.means[:k, None] - law.means[:k]
    sums = law.matrices[:k, None] + law.matrices[:k]
    solved = np.linalg.solve(sums, apart[..., None])[..., 0]
    distances = np.einsum("ijd,ijd->ij", apart, solved)
    groups = connected_components(distances < APART, directed=False)[1].astype(np.intp)
    result: Labels = np.append(groups, [COVER] * len(COVERS))
    return result


def label(theta: Floats, law: Mixture, group_of: Labels) -> Labels:
    """Return the group of each point ``(n,)``: that of its likeliest component."""
    own = np.flatnonzero(group_of != COVER)
    kept = Mixture(law.weights[own], law.means[own], law.matrices[own], law.df)
    result: Labels = group_of[own][np.argmax(log_parts(theta, kept)[0], axis=1)]
    return result


def weigh(
    labels: Labels, log_weights: Floats, count: int
) -> tuple[list[float | None], list[float | None]]:
    """Return the weight of each group by importance sampling, and standard errors.

    None of them is known where all weights are zero.
    """
    if not np.isfinite(log_weights).any():
        return [None] * count, [None] * count
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    inside = labels[:, None] == np.arange(count)
    shares = weights @ inside
    errors = np.sqrt(weights**2 @ (inside - shares) ** 2)
    return shares.tolist(), errors.tolist()


def count_shares(labels: Labels, count: int) -> list[float]:
    """Return the share of the points in each group."""
    shares: list[float] = (np.bincount(labels, minlength=count) / len(labels)).tolist()
    return shares
