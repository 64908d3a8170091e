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
    path: Path, rows: NDArray[np.int64], columns: NDArray[np.int64], values: Floats
) -> csc_array:
    """Return the symmetric matrix of entries that are in one triangle, or in both.

    Args:
        path: The file, for messages.
        rows: Row numbers from 0, ``(n,)``.
        columns: Column numbers from 0, ``(n,)``.
        values: The entries, ``(n,)``.

    Raises:
        ValueError: If a number is below 0, a place is listed twice, or both triangles
            are there and differ.
    """
    if not len(rows) or min(rows.min(), columns.min()) < 0:
        raise ValueError(f"{path}: expected rows and columns from 1 on; {AGAIN}")
    size = int(max(rows.max(), columns.max())) + 1
    place = rows * size + columns
    _, first, count = np.unique(place, return_index=True, return_counts=True)
    if (count > 1).any():
        at = first[count > 1].min()
        raise ValueError(
            f"{path}: row {rows[at] + 1}, column {columns[at] + 1} is listed twice; "
            f"are these element matrices? Export the assembled ones"
        )
    off = rows != columns
    if not (off.any() and (rows > columns).any() and (rows < columns).any()):
        mirrored = columns[off], rows[off]
        rows, columns = (
            np.concatenate(pair) for pair in zip((rows, columns), mirrored, strict=True)
        )
        values = np.concatenate([values, values[off]])
    matrix = coo_array((values, (rows, columns)), shape=(size, size))
    return check(path, matrix)


def check(path: Path, matrix: coo_array | csc_array) -> csc_array:
    """Return a symmetric matrix as :class:`MatrixModel` takes it.

    Raises:
        ValueError: If it is not square, finite and symmetric, with the file's name.
    """
    return sparse_symmetric(str(path), csc_array(matrix))
