"""The border check of a matrix from an FE program: square, finite, symmetric."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csc_array, issparse

from ... import checks
from ...interfaces import Floats

ASYMMETRY = 1e-8  # share of the largest entry; FE programs print 9 to 16 digits


def symmetric(argument: str, value: ArrayLike, size: int | None = None) -> Floats:
    """Return a finite, symmetric ``(N, N)`` array; a tiny asymmetry is averaged out.

    Raises:
        TypeError: If the matrix is sparse.
        ValueError: If the matrix is not square, not of ``size`` where that is given, or
            differs from its transpose by more than 1e-8 of its largest entry.
    """
    if issparse(value):
        raise TypeError(
            f"{argument}: a sparse matrix beside a dense K0; give K0 as a scipy.sparse "
            f"matrix too (an empty one is csc_array((N, N))), or {argument}.toarray()"
        )
    matrix = checks.real_array(argument, value, 2)
    _check_square(argument, matrix.shape, size)
    _check_gap(argument, np.abs(matrix - matrix.T), np.abs(matrix))
    return 0.5 * (matrix + matrix.T)


def sparse_symmetric(argument: str, value: Any, size: int | None = None) -> csc_array:
    """Return the same as a float64 ``csc_array`` without stored zeros.

    A dense ``value`` is turned into a sparse one; a sparse one is never made dense.
    """
    if not issparse(value):
        return csc_array(symmetric(argument, value, size))
    if value.dtype.kind not in "fiu":
        raise TypeError(
            f"{argument}: expected real numbers, got a sparse matrix of {value.dtype}"
        )
    _check_square(argument, value.shape, size)
    matrix = csc_array(value, dtype=np.float64)  # sums duplicate entries
    if not np.isfinite(matrix.data).all():
        entries = matrix.tocoo()
        i = int(np.argmin(np.isfinite(entries.data)))
        raise ValueError(
            f"{argument}: expected finite numbers, got {entries.data[i]} at index "
            f"({entries.row[i]}, {entries.col[i]})"
        )
    transpose = matrix.T.tocsc()
    _check_gap(argument, abs(matrix - transpose).data, np.abs(matrix.data))
    result = csc_array(0.5 * (matrix + transpose))
    result.eliminate_zeros()
    result.sort_indices()
    return result


def _check_square(argument: str, shape: tuple[int, ...], size: int | None) -> None:
    if len(shape) != 2 or shape[0] != shape[1] or not shape[0]:
        raise ValueError(f"{argument}: expected a square matrix, got {shape}")
    if size not in (None, shape[0]):
        raise ValueError(
            f"{argument}: expected the shape of K0, {(size, size)}, got {shape}"
        )


def _check_gap(argument: str, gaps: Floats, sizes: Floats) -> None:
    gap, largest = (float(numbers.max(initial=0.0)) for numbers in (gaps, sizes))
    if gap > ASYMMETRY * largest:
        raise ValueError(
            f"{argument}: expected a symmetric matrix, but entries differ from the "
            f"transpose by up to {gap:.3g} (largest entry {largest:.3g})"
        )
