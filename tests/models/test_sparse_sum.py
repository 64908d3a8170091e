"""A sum of sparse matrices on one pattern."""

import numpy as np
from scipy import sparse

from emcee_femu.models.eigen.sparse_sum import SparseSum


def test_the_pattern_is_the_union_and_a_sum_of_numbers():
    rng = np.random.default_rng(0)
    terms = [sparse.random_array((9, 9), density=0.2, rng=rng).tocsc() for _ in "abcd"]
    also = sparse.csc_array(np.eye(9))
    total = SparseSum(terms, [also])
    a = rng.normal(size=3)
    matrix = total(a)
    expected = terms[0] + sum(x * term for x, term in zip(a, terms[1:], strict=True))
    np.testing.assert_allclose(matrix.toarray(), expected.toarray(), atol=1e-15)
    union = sum(abs(term) for term in (*terms, also)).tocsc()
    union.sort_indices()
    assert np.array_equal(matrix.indices, union.indices)
    assert np.array_equal(matrix.indptr, union.indptr)
    assert total(a).indices.base is matrix.indices.base  # nothing is built anew
    assert matrix.has_sorted_indices
