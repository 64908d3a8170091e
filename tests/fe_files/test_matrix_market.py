"""Matrix Market: arrays, and what is refused."""

import numpy as np
import pytest
from scipy.io import mmwrite
from support.exports import cantilever

import emcee_femu as ef

K, M, DOFS = cantilever()


@pytest.mark.parametrize("symmetry", ["symmetric", "general"])
def test_matrix_market_may_hold_an_array(tmp_path, symmetry):
    path = tmp_path / "K.mtx"
    mmwrite(path, K, symmetry=symmetry, comment="of a beam")
    read = ef.read_matrices({"K": path})
    np.testing.assert_allclose(read.K.toarray(), K, rtol=1e-12)


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ("matrix coordinate complex hermitian", r"line 1: expected a matrix of real"),
        ("vector coordinate real general", r"line 1: expected a matrix of real"),
        ("matrix coordinate real general\n3 3", r"line 2: .*columns and entries"),
        ("matrix coordinate real general\n2 2 1\n3 1 1.0", r"as line 2 says.*row 3"),
        ("matrix array real general\n2 2\n1\n0\n0\nx", r"line 6: expected 'value'"),
    ],
)
def test_other_matrix_market_files_are_refused(tmp_path, head, message):
    path = tmp_path / "K.mtx"
    path.write_text(f"%%MatrixMarket {head}\n")
    with pytest.raises(ValueError, match=rf"K\.mtx.*{message}"):
        ef.read_matrices({"K": path})
