"""ANSYS: what its reader gives, and what a user without it is told."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy import sparse
from support.exports import cantilever

import emcee_femu as ef

K, M, DOFS = cantilever()


def full_file(folder):
    path = folder / "file.full"
    path.write_bytes(np.array([100, -(2**31), 4, 0], "<i4").tobytes() + bytes(400))
    return path


def test_ansys_without_its_reader_is_told_how(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ansys.mapdl.reader", None)
    with pytest.raises(ImportError, match=r"file\.full.*emcee_femu\[ansys\].*\*EXPORT"):
        ef.read_matrices(full_file(tmp_path))


def test_ansys_files_have_upper_triangles_and_empty_rows_of_held_DOFs(
    tmp_path, monkeypatch
):
    K0, M0, dofs = cantilever(clamped=False)
    K0[:2], K0[:, :2], M0[:2], M0[:, :2] = 0.0, 0.0, 0.0, 0.0
    numbered = dofs - [0, 1]
    triangles = [sparse.csc_matrix(np.triu(A)) for A in (K0, M0)]
    found = SimpleNamespace(
        load_km=lambda sort: (numbered, *triangles), const=numbered[:2]
    )
    reader = ModuleType("ansys.mapdl.reader")
    reader.read_binary = lambda path: found
    monkeypatch.setitem(sys.modules, "ansys.mapdl.reader", reader)
    for name in ("ansys", "ansys.mapdl"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    read = ef.read_matrices(full_file(tmp_path))
    np.testing.assert_array_equal(read.nodes, DOFS)
    np.testing.assert_allclose(read.K.toarray(), K)
    np.testing.assert_allclose(read.M.toarray(), M)
    found.load_km = lambda sort: 1 / 0
    with pytest.raises(ValueError, match=r"file\.full: ZeroDivisionError"):
        ef.read_matrices(full_file(tmp_path))


def test_the_beam_that_comes_with_the_reader_of_ansys():
    pytest.importorskip("ansys.mapdl.reader")
    from ansys.mapdl.reader import examples

    read = ef.read_matrices(examples.fullfile)
    assert (read.size, read.dofs("node 22 x")) == (900, 0)
    clamped = ef.MatrixModel(read.K, read.M, {}, n_modes=6)({}).frequencies[0]
    free = 11504.895, 20137.193  # of its file.rst: torsion and axial, free at both ends
    np.testing.assert_allclose(clamped[[2, 5]], np.divide(free, 2), rtol=0.015)
