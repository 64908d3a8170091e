"""A sum of sparse matrices with varying coefficients, on one fixed pattern."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from ... import checks
from ...interfaces import Floats


@dataclass(frozen=True, eq=False, init=False)
class SparseSum:
    r"""``A(a) = A_0 + sum a_i A_i``, where only the stored numbers change.

    .. math:: d(a) = d_0 + D a

    where d are the stored numbers of A on the union of the patterns of all terms, which
    is found once. D is sparse as well: an entry of A depends on few parameters.

    Args:
        terms: A_0, then the A_i, each ``(N, N)`` without duplicate entries.
        also: Matrices whose pattern the sum must hold too.

    Examples:
        >>> total = SparseSum([csc_array(np.eye(2)), csc_array([[0., 1.], [1., 0.]])])
        >>> total(np.array([5.0])).toarray().tolist()
        [[1.0, 5.0], [5.0, 1.0]]
    """

    size: int
    _indices: NDArray[np.int32] = field(repr=False)
    _indptr: NDArray[np.int32] = field(repr=False)
    _constant: Floats = field(repr=False)
    _units: csc_array = field(repr=False)

    def __init__(
        self, terms: Sequence[csc_array], also: Sequence[csc_array] = ()
    ) -> None:
        constant, *units = terms
        size = constant.shape[0]
        places = [_places(matrix) for matrix in (*terms, *also)]
        pattern = np.unique(np.concatenate(places))
        where = [np.searchsorted(pattern, own) for own in places]
        data = np.zeros(len(pattern))
        data[where[0]] = constant.data
        ends = np.searchsorted(pattern, size * np.arange(size + 1, dtype=np.int64))
        # D, whose column i holds the numbers of unit i at their places.
        numbers = np.concatenate([np.empty(0), *(unit.data for unit in units)])
        rows = np.concatenate([np.empty(0, int), *where[1 : len(terms)]])
        counts = np.cumsum([0, *(unit.nnz for unit in units)])
        checks.set_fields(
            self,
            size=size,
            _indices=(pattern % size).astype(np.int32),
            _indptr=ends.astype(np.int32),
            _constant=data,
            _units=csc_array((numbers, rows, counts), (len(pattern), len(units))),
        )

    def __call__(self, coefficients: Floats) -> csc_array:
        """Return the matrix for ``coefficients (n_units,)``."""
        data = self._constant + self._units @ coefficients
        matrix = csc_array(
            (data, self._indices, self._indptr), shape=(self.size, self.size)
        )
        matrix.has_canonical_format = True  # known here; saves a search at each use
        return matrix


def _places(matrix: csc_array) -> NDArray[np.int64]:
    """Return the place of each stored number when columns are laid end to end."""
    size = matrix.shape[0]
    columns = np.repeat(np.arange(size, dtype=np.int64), np.diff(matrix.indptr))
    places: NDArray[np.int64] = columns * size + matrix.indices
    return places
