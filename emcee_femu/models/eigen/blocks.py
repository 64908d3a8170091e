"""Matrices with few rows that are not zero, and their products with mode shapes."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...interfaces import Floats

ONE = 1.0  # the weight of a parameter that is a coefficient

Weight: TypeAlias = Floats | float  # (n,), or the same for all


class Block(NamedTuple):
    """Matrices of coefficients without their rows of zeros, those of one size together.

    The matrix of a spring, storey or member has few rows that are not zero.

    Attributes:
        numbers: Which matrices, ``g`` of them.
        rows: Their rows that are not zero, ``(g, s)``.
        entries: What is in these rows and columns, ``(g, s, s)``.
    """

    numbers: tuple[int, ...]
    rows: NDArray[np.intp]
    entries: Floats


Blocks: TypeAlias = tuple[Block, ...]


def collect(matrices: Floats) -> Blocks:
    """Return matrices ``(n, N, N)`` by the number of their rows that are not zero."""
    N = matrices.shape[1]
    rows = [np.flatnonzero(matrix.any(axis=1)) for matrix in matrices]
    by_size: dict[int, list[int]] = {}
    for number, own in enumerate(rows):
        size = min(N, max(4, 1 << (len(own) - 1).bit_length()))  # few sizes: 4, 8, 16
        rows[number] = np.append(
            own, np.setdiff1d(np.arange(N), own)[: size - len(own)]
        )
        by_size.setdefault(size, []).append(number)
    blocks = []
    for size, numbers in by_size.items():
        # A block gathers g s rows of all shapes: at most four times their number.
        most = 4 * N // size
        for start in range(0, len(numbers), most):
            part = numbers[start : start + most]
            entries = [matrices[j][np.ix_(rows[j], rows[j])] for j in part]
            places = np.array([rows[j] for j in part])
            blocks.append(Block(tuple(part), places, np.array(entries)))
    return tuple(blocks)


def combine(
    blocks: Blocks,
    slopes: Sequence[Mapping[int, Weight]],
    left: Floats | None,
    right: Floats,
) -> Floats:
    """Return ``left^T A' right`` for each parameter, where ``A' = sum w_j A_j``.

    Args:
        blocks: The A_j.
        slopes: The w_j of each parameter, ``d`` of them.
        left: ``(n, N, p)``; None for the diagonal of ``right^T A' right`` alone.
        right: ``(n, N, m)``.

    Returns:
        ``(n, d, p, m)``, or ``(n, d, m)`` for the diagonal.
    """
    users: dict[int, list[tuple[int, Weight]]] = {}
    for place, weights in enumerate(slopes):
        for number, weight in weights.items():
            users.setdefault(number, []).append((place, weight))
    used = [b for b in blocks if not users.keys().isdisjoint(b.numbers)]
    n, _, m = right.shape
    total: Floats | None = None
    for block in used:
        gathered = right[:, block.rows]  # (n, g, s, m)
        forces = block.entries @ gathered
        forms: Floats = (
            (gathered * forces).sum(axis=2)
            if left is None
            else left[:, block.rows].swapaxes(2, 3) @ forces
        )
        own = [users.get(number, []) for number in block.numbers]
        places = [place for pairs in own for place, _ in pairs]
        plain = all(len(pairs) == 1 and pairs[0][1] is ONE for pairs in own)
        if plain and len(used) == 1 and places == list(range(len(slopes))):
            return forms  # as it is, which saves half of the time
        if total is None:
            total = np.zeros((n, len(slopes), *forms.shape[2:]))
        if plain and len(set(places)) == len(places):
            total[:, places] += forms
            continue
        for i, pairs in enumerate(own):
            for place, weight in pairs:
                total[:, place] += (forms[:, i].T * weight).T
    if total is None:
        total = np.zeros((n, len(slopes), *(() if left is None else left.shape[2:]), m))
    return total


def absolute(blocks: Blocks) -> Blocks:
    """Return the same with the absolute values of all entries."""
    return tuple(block._replace(entries=np.abs(block.entries)) for block in blocks)
