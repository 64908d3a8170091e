"""One matrix as it was read, before it is joined with the others of its model."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array

from ...interfaces import Floats
from ..eigen.symmetric import sparse_symmetric
from .labels import Dofs
from .numbers import AGAIN


class Part(NamedTuple):
    """A symmetric matrix.

    Attributes:
        name: What the file calls it; ``"K"`` and ``"M"`` where that is known, empty
            where the file does not say.
        path: The file.
        matrix: ``(N, N)``.
        dofs: Node and direction of each row, ``(N, 2)``, or None.
    """

    name: str
    path: Path
    matrix: csc_array
    dofs: Dofs | None = None


def build_matrix(
    path: Path,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    values: Floats,
    size: int | None = None,
) -> csc_array:
    """Return the symmetric matrix of entries on one side of the diagonal, or on both.

    Args:
        path: The file, for messages.
        rows: Row numbers from 0, ``(n,)``.
        columns: Column numbers from 0, ``(n,)``.
        values: The entries, ``(n,)``.
        size: The number of rows; None for as many as there are numbers.

    Raises:
        ValueError: If a number is below 0, a place is listed twice, or both sides are
            there and differ.
    """
    if not len(rows) or min(rows.min(), columns.min()) < 0:
        raise ValueError(f"{path}: expected rows and columns from 1 on; {AGAIN}")
    if size is None:
        size = int(max(rows.max(), columns.max())) + 1
    _, first, count = np.unique(
        rows * size + columns, return_index=True, return_counts=True
    )
    if (count > 1).any():
        at = first[count > 1].min()
        raise ValueError(
            f"{path}: row {rows[at] + 1}, column {columns[at] + 1} is listed twice; "
            "are these the matrices of elements? Export the assembled ones"
        )
    off = rows != columns
    pairs = np.minimum(rows, columns)[off] * size + np.maximum(rows, columns)[off]
    if len(np.unique(pairs)) == len(pairs):  # each pair is there once: mirror it
        values = np.concatenate([values, values[off]])
        rows, columns = (
            np.concatenate([rows, columns[off]]),
            np.concatenate([columns, rows[off]]),
        )
    return check(path, coo_array((values, (rows, columns)), shape=(size, size)))


def build_labelled(
    name: str, path: Path, rows: Dofs, columns: Dofs, values: Floats
) -> Part:
    """Return the matrix of entries at rows and columns ``(n, 2)`` of DOFs, sorted."""
    both = np.concatenate([rows, columns])
    dofs, at = np.unique(both, axis=0, return_inverse=True)
    i, j = at.reshape(2, -1)
    return Part(name, path, build_matrix(path, i, j, values, len(dofs)), dofs)


def name_parts(parts: list[Part]) -> list[Part]:
    """Return the parts with K and M for the only names that begin like that.

    Nastran calls them KAAX, KGG, .. (K4, with a number, is damping).
    """
    names = [part.name for part in parts]
    renamed = {}
    for letter in "KM":
        own = [x for x in names if x[:1].upper() == letter and not x[1:2].isdecimal()]
        if len(own) == 1:
            renamed[own[0]] = letter
    return [part._replace(name=renamed.get(part.name, part.name)) for part in parts]


def check(path: Path, matrix: coo_array | csc_array) -> csc_array:
    """Return a symmetric matrix as :class:`MatrixModel` takes it.

    Raises:
        ValueError: If it is not square, finite and symmetric, with the file's name.
    """
    return sparse_symmetric(str(path), csc_array(matrix))
