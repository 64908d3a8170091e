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
        ("matrix coordinate complex general\n1 1 1\n1 1 1 0", r"real.*complex"),
        ("matrix coordinate pattern symmetric\n1 1 1\n1 1", r"real.*pattern"),
        ("matrix coordinate real general\n3 3", r"it again"),
        (
            "matrix coordinate real general\n2 2 1\n3 1 1.0",
            r"Line 3: Row index out of bounds",
        ),
        ("matrix array real general\n2 2\n1\n0\n0\nx", r"Line 6: Invalid"),
    ],
)
def test_other_matrix_market_files_are_refused(tmp_path, head, message):
    path = tmp_path / "K.mtx"
    path.write_text(f"%%MatrixMarket {head}\n")
    with pytest.raises(ValueError, match=rf"K\.mtx.*{message}"):
        ef.read_matrices({"K": path})
