"""Abaqus: held DOFs, inner nodes, one matrix alone."""

import numpy as np
import pytest
from support.exports import FREQUENCIES, cantilever, write_abaqus

import emcee_femu as ef

K, M, DOFS = cantilever()


def test_abaqus_holds_DOFs_by_1e36(tmp_path):
    K, M, dofs = cantilever(clamped=False)
    for row in (0, 1):
        K[row, :] = K[:, row] = 0.0
        K[row, row] = 1e36
    read = ef.read_matrices(write_abaqus(tmp_path, K, M, dofs))
    np.testing.assert_array_equal(read.nodes, dofs[2:])
    model = ef.MatrixModel(read.K, read.M, {}, n_modes=3)
    np.testing.assert_allclose(model({}).frequencies[0], FREQUENCIES, rtol=3e-3)
    path = write_abaqus(tmp_path, K, M, dofs, "coordinate")
    with pytest.raises(ValueError, match=r"STIF1.mtx: 2 rows are held .*MATRIX INPUT"):
        ef.read_matrices(path)


def test_abaqus_numbers_inner_nodes_below_zero_and_in_any_order(tmp_path):
    dofs = DOFS.copy()
    dofs[4:6, 0] = -3
    shuffled = np.random.default_rng(1).permutation(len(K))  # each pair stays once
    both = [A[np.ix_(shuffled, shuffled)] for A in (K, M)]
    read = ef.read_matrices(write_abaqus(tmp_path, *both, dofs[shuffled]))
    rows = read.dofs(["13:uz", "-3:uz", "27:ry"])
    assert rows.tolist() == [2, 0, 15]
    model = ef.MatrixModel(read.K, read.M, {}, n_modes=3)
    np.testing.assert_allclose(model({}).frequencies[0], FREQUENCIES, rtol=3e-3)
