"""Harwell-Boeing: real assembled matrices, against scipy.io, and what is refused."""

import numpy as np
import pytest
from scipy import sparse
from scipy.io import hb_read, hb_write

import emcee_femu as ef

# 3 by 3, lower half by columns: [[4, 0, -1.5], [0, 3, 0], [-1.5, 0, 2]].
LINES = [
    f"{'A title':72s}KEY",
    f"{3:14d}{1:14d}{1:14d}{1:14d}{0:14d}",
    f"{'RSA':14s}{3:14d}{3:14d}{4:14d}{0:14d}",
    f"{'(4I3)':16s}{'(4I3)':16s}{'(1P,4D12.4)':20s}",
    "  1  3  4  5",
    "  1  3  2  3",
    "  4.0000D+00 -1.5000D+00  3.0000D+00  2.0000D+00",
]
K = [[4.0, 0.0, -1.5], [0.0, 3.0, 0.0], [-1.5, 0.0, 2.0]]


def write(path, changed=()):
    lines = LINES.copy()
    for line, text in dict(changed).items():
        lines[line - 1] = text
    path.write_text("".join(line + "\n" for line in lines if line is not None))
    return {"K": path}


# SciPy 1.18 announces another default of an argument that older ones have not.
@pytest.mark.filterwarnings("ignore:The default value for `spmatrix`")
def test_all_entries_and_the_lower_half_are_read_as_scipy_reads_them(tmp_path):
    random = np.random.default_rng(3)
    half = np.tril(random.normal(size=(9, 9)) * (random.random((9, 9)) < 0.5))
    half += 20 * np.eye(9)
    paths = [tmp_path / f"{name}.hb" for name in ("half", "full")]
    for path, A in zip(paths, (half, half + np.tril(half, -1).T), strict=True):
        hb_write(path, sparse.csc_array(A))
    lower, full = (hb_read(path).toarray() for path in paths)
    np.testing.assert_array_equal(np.tril(full), lower)
    paths[0].write_text(paths[0].read_text().replace("RUA", "RSA"))
    for path in paths:
        read = ef.read_matrices({"K": path, "M": path})
        np.testing.assert_array_equal(read.K.toarray(), full)
        np.testing.assert_array_equal(read.M.toarray(), full)


F = {4: "(4I3)           (4I3)           (4F12.4)", 7: LINES[6].replace("D+00", "    ")}
BARE = {2: f"{4:14d}{2:14d}{1:14d}{1:14d}", 4: "(2I3)          (4I3)          (4E6.1)"}
BARE |= {5: "  1  3\n  4  5", 7: " 4.0+0-1.5+0 3.0+0 2.0+0"}
RHS = {2: LINES[1].replace(" 0", " 1"), 4: LINES[3] + "\nF  1  0", 7: LINES[6] + "\n 9"}


@pytest.mark.parametrize("changed", [{}, {3: LINES[2].lower()}, F, BARE, RHS])
def test_numbers_are_read_by_the_formats_that_the_file_says(tmp_path, changed):
    read = ef.read_matrices(write(tmp_path / "K.rsa", changed))
    assert read.K.toarray().tolist() == K


@pytest.mark.parametrize("kind", ["CSA", "PUA", "RSE", "RZA", "RRA"])
def test_other_types_are_refused_by_their_name(tmp_path, kind):
    files = write(tmp_path / "K.hb", {3: LINES[2].replace("RSA", kind)})
    with pytest.raises(ValueError, match=rf"K\.hb.*{kind}"):
        ef.read_matrices(files)


@pytest.mark.parametrize(
    ("line", "text"),
    [(3, LINES[2].replace("RSA", "RUA")),  # half of it alone
     (3, f"RSA {4:14d}{3:14d}{4:14d}"), (3, f"RSA {3:14d}{3:14d}{5:14d}"),
     (4, "(4I3)           (4I3)"), (5, None), (5, "  1  3  4  6"), (5, "  0  2  3  4"),
     (5, "  1  4  3  5"), (5, "nan  3  4  5"), (5, "inf  3  4  5"), (6, "  1  4  2  3"),
     (6, "  1  0  2  3"), (6, "1.5  3  2  3"), (6, "  1  1  2  3"), (6, ""),
     (7, LINES[6][:36]), (7, LINES[6].replace("2.0000D", "1.0D999")), (7, None)],
)  # fmt: skip
def test_a_damaged_file_is_refused_by_its_name(tmp_path, line, text):
    with pytest.raises(ValueError, match=r"K\.hb"):
        ef.read_matrices(write(tmp_path / "K.hb", {line: text}))
