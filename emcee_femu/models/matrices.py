"""Stiffness and mass matrices as users give them: which are refused or doubted."""

import warnings
from collections.abc import Hashable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csc_array, issparse, tril, triu

from .. import checks
from ..contracts import Floats

Matrix: TypeAlias = Floats | csc_array
Weights: TypeAlias = Sequence[Floats]  # of K and of M, (n, n_k) and (n, n_m)

# Share of the largest entry. FE programs print 7 (single precision) to 16 digits, and
# what they reduce to superelements is off by 1e-7.
ASYMMETRY = 1e-6


def read_matrix(
    argument: str, value: ArrayLike | Matrix, size: int | None = None, *, sparse: bool
) -> Matrix:
    """Return a finite, symmetric ``(N, N)`` matrix; a tiny asymmetry is averaged out.

    Args:
        argument: Its name, for messages.
        value: Dense, or of scipy.sparse, which is never made dense.
        size: N, where it is known.
        sparse: Whether to return a float64 ``csc_array`` without stored zeros.

    Raises:
        TypeError: If it is no matrix, or sparse where a dense one is expected.
        ValueError: If the matrix is not square, not of ``size`` where that is given, or
            differs from its transpose by more than 1e-6 of its largest entry.
    """
    if value is None or isinstance(value, str):
        raise TypeError(
            f"{argument}: expected a matrix, got {value!r}; read_matrices reads files, "
            "and 0 * M0 is one of zeros, where nothing is fixed"
        )
    if issparse(value) and not sparse:
        raise TypeError(
            f"{argument}: a sparse matrix beside a dense K0; give K0 as a scipy.sparse "
            f"matrix too (an empty one is csc_array((N, N))), or {argument}.toarray()"
        )
    if issparse(value):
        matrix = csc_array(value)
        matrix.data = checks.real_array(f"{argument} (as stored)", matrix.data)
    else:
        matrix = checks.real_array(argument, value, 2)
    N = matrix.shape[0]
    if matrix.shape != (N, N) or not N:
        raise ValueError(f"{argument}: expected a square matrix, got {matrix.shape}")
    if size not in (None, N):
        raise ValueError(f"{argument}: expected K0's shape {(size,) * 2}, got {(N, N)}")
    gap, largest = abs(matrix - matrix.T).max(), abs(matrix).max()
    if gap > ASYMMETRY * largest:
        cure = "if this is rounding, give 0.5 * (A + A.T)"
        entries = coo_array(matrix)
        if not (tril(entries, -1).count_nonzero() and triu(entries, 1).count_nonzero()):
            cure = "is it one triangle? Add the other: A + A.T, with the diagonal once"
        raise ValueError(
            f"{argument}: expected a symmetric matrix, but entries differ from the "
            f"transpose by up to {gap:.3g} (largest entry {largest:.3g}); {cure}"
        )
    mean = 0.5 * (matrix + matrix.T)
    if not sparse:
        return mean
    result = csc_array(mean)
    result.eliminate_zeros()
    result.sort_indices()
    return result


def refuse_empty(
    K: Sequence[Matrix], M: Sequence[Matrix], labels: Sequence[Hashable]
) -> None:
    """Refuse rows that have neither stiffness nor mass in any matrix."""
    every = [csc_array(matrix) for matrix in (*K, *M)]
    entries = np.sum([np.diff(matrix.indptr) for matrix in every], axis=0)
    if rows := np.flatnonzero(entries == 0).tolist():
        names = checks.listed(labels[row] for row in rows)
        raise ValueError(
            f"K0, M0: the DOFs {names} have neither "
            "stiffness nor mass; leave their rows and columns out of all matrices, "
            "A[np.ix_(kept, kept)]"
        )


def warn_of_uncoupled(
    K: Sequence[Matrix], M: Sequence[Matrix], labels: Sequence[str] = ()
) -> None:
    """Warn of rows with mass that are coupled to no other, such as held DOFs.

    Each is a mode of its own. One that a parameter scales by itself, as in modal
    coordinates, is meant so.

    Args:
        K: The constant stiffness, and what parameters multiply.
        M: The same of the mass.
        labels: The names of all rows, where they have any.
    """
    every = [csc_array(matrix) for matrix in (*K, *M)]
    there = np.array([matrix.diagonal() != 0 for matrix in every])
    entries = np.array([np.diff(matrix.indptr) for matrix in every])
    coupled = (entries > there).any(axis=0)
    scaled = ~np.isin(np.arange(len(every)), [0, len(K)])  # by a parameter
    by_itself = scaled & ~(there & coupled).any(axis=1)
    alone = there[len(K) :].any(axis=0) & ~coupled & ~there[by_itself].any(axis=0)
    if alone.any():
        rows = np.flatnonzero(alone).tolist()
        k, m = (
            sum(A.diagonal() for A in part)
            for part in (every[: len(K)], every[len(K) :])
        )
        hertz = np.sqrt(np.maximum(k[rows] / m[rows], 0.0)) / (2 * np.pi)
        names = [str(labels[row]) if labels else str(row) for row in rows]
        each = [f"{name} ({f:.4g} Hz)" for name, f in zip(names, hertz, strict=True)]
        warnings.warn(
            "K0, K: each of these rows is coupled to no other, and is a mode by itself "
            f"(with parameters of 1): {checks.listed(each)}. If they are "
            "held DOFs of an export, leave their rows and columns out of all matrices; "
            "if they are fixed-base modes, as of a Craig-Bampton reduction, keep them",
            stacklevel=3,
        )
