"""Nastran: every layout of OUTPUT4 as text and of DMIG, and files of many matrices."""

import warnings

import numpy as np
import pytest
from support.exports import cantilever, op4, write_dmig

import emcee_femu as ef

A = np.diag([2.0, 3e5, 4.0, 5.0, 6.0, 7.0, 8.0])
A[0, 3:] = A[3:, 0] = -1.5, -1.25e-102, 1 / 3, -1.0  # two strings in a column
A[1, 2] = A[2, 1] = -0.5
LOAD, SKEW, SMALL = A[:, :2], A + np.triu(A, 1), A[:3, :3]


@pytest.mark.parametrize("layout", ["dense", "sparse", "bigmat", "bigmat 64"])
@pytest.mark.parametrize(
    ("told", "kind"),
    [("1P,3D23.16", 2), ("1P3E23.16", 2), ("3D23.16", 2), ("1p,3e23.16", 1),
     ("1P,5E16.9", 1), ("5E16.9", 2), ("", 1), ("", 2)],
)  # fmt: skip
def test_OP4_is_read_in_every_layout_and_number_format(tmp_path, layout, told, kind):
    path = tmp_path / "km.op4"
    name = "KLONGNAM" if kind == 2 else "KAA"  # the format follows without a blank
    path.write_text(op4(name, A, layout, told, kind) + op4("MAA", 2 * A))
    read = ef.read_matrices(path)
    np.testing.assert_allclose(read.K.toarray(), A, rtol=1e-9)
    np.testing.assert_allclose(read.M.toarray(), 2 * A, rtol=1e-15)


def test_good_matrices_of_an_OP4_file_are_read_beside_others(tmp_path):
    path = tmp_path / "many.op4"
    others = op4("PG", LOAD), op4("UNS", SKEW), op4("CAA", A, kind=4), op4("X", SMALL)
    path.write_text(others[0] + op4("KAA", A) + "".join(others[1:]) + op4("MAA", 3 * A))
    for given in (path, {"K": path, "M": path}):
        read = ef.read_matrices(given)
        assert [*read.matrices] == ["K", "M"]
        np.testing.assert_array_equal(read.K.toarray(), A)
        np.testing.assert_array_equal(read.M.toarray(), 3 * A)
    for name, why in (("PG", ""), ("UNS", "symmetric"), ("CAA", "complex")):
        with pytest.raises(ValueError, match=rf"many\.op4.*{name}.*{why}"):
            ef.read_matrices({name: path})
    for text, why in ((op4("KAA", SKEW), "KAA.*symmetric"), (others[0], "square")):
        path.write_text(text)
        with pytest.raises(ValueError, match=rf"many\.op4.*{why}"):
            ef.read_matrices(path)
    sets = ("KGG", A), ("KAA", SMALL), ("MGG", 2 * A), ("MAA", 2 * SMALL)
    path.write_text("".join(op4(*each) for each in sets))
    read = ef.read_matrices(dict.fromkeys(("KAA", "MAA"), path)).matrices
    np.testing.assert_array_equal(read["KAA"].toarray(), SMALL)
    np.testing.assert_array_equal(read["MAA"].toarray(), 2 * SMALL)


@pytest.mark.parametrize(
    ("layout", "line", "new"),
    [("sparse", 2, f"{8 + 65536 * 3}"),  # a row beyond the last
     ("sparse", 2, f"{1 + 65536 * 5}"),  # two values, and one is there
     ("sparse", 1, "1 0 3"), ("bigmat", 2, "3 8"), ("bigmat", 1, "1 0 4"),
     ("dense", 1, "1 2 14"), ("dense", 2, ""), ("dense", -1, "")],
)  # fmt: skip
def test_a_damaged_OP4_matrix_is_refused_by_file_and_line(tmp_path, layout, line, new):
    lines = op4("KAA", A, layout).splitlines()
    lines[line] = new
    path = tmp_path / "km.op4"
    path.write_text("".join(text + "\n" for text in lines))
    with pytest.raises(ValueError, match=r"km\.op4.*line \d+"):
        ef.read_matrices(path)


def free(name, form, *columns, kind=2):
    lines = f"DMIG,{name},0,{form},{kind},0", *columns
    return "".join(line.format(name) + "\n" for line in lines)


HALF = "DMIG,{0},1,3,,1,3,2.0,,", ",2,5,-1.25-10,,7,,0.5", "DMIG,{0},2,5,,2,5,3.5D+3"
WHOLE = *HALF, "+,1,3,-1.25-10", "DMIG,{0},7,,,1,3,0.5"
DMIG = {
    "free, symmetric": free("KAAX", 6, *HALF),
    "free, square": free("KAAX", 1, *WHOLE).lower(),
    "free, large": "DMIG*,KAAX,0,6,2\nDMIG*,KAAX,1,3\n*,1,3,2.0\n*,2,5,-1.25-10\n"
    "*,7,,0.5\nDMIG*,KAAX,2,5\n*,2,5,3.5D+3 $ tip\n",
    "small": """$ a comment
DMIG    KAAX           0       6       2       0                       3
DMIG    KAAX           1       3               1       3     2.0        +K1
+K1            2       5-1.25-10               7             0.5
DMIG    KAAX           2       5               2       5  3.5D+3
""",
    "large": """GRID           1               0.      0.      0.
DMIG*   KAAX                           0               6               2
*                      0                                               3
DMIG*   KAAX                           1               3
*                      1               3 2.000000000D+00
*                      2               5-1.25000000D-10 $ touches the component
*                      7                           0.50
DMIG*   KAAX                           2               5
*                      2               5          3.5+3
""",
}


@pytest.mark.parametrize("fields", DMIG)
def test_DMIG_is_read_in_every_kind_of_fields_and_form(tmp_path, fields):
    path = tmp_path / "k.pch"
    path.write_text(DMIG[fields] + free("MAAX", 6, "DMIG,MAAX,1,3,,1,3,1.0"))
    with pytest.warns(UserWarning, match=r"k\.pch.*7"):  # the last point has no mass
        read = ef.read_matrices(path)  # 7 is a constraint by a multiplier
    K = [[2.0, -1.25e-10, 0.5], [-1.25e-10, 3500.0, 0.0], [0.5, 0.0, 0.0]]
    assert read.K.toarray().tolist() == K and read.M.toarray()[0, 0] == 1.0
    assert read.nodes.tolist() == [[1, 3], [2, 5], [7, 0]]
    path.write_text(DMIG[fields])
    with pytest.raises(ValueError, match=r"k\.pch.*row 3 of K.*Lagrange.*M"):
        ef.read_matrices(path)


@pytest.mark.parametrize(
    ("form", "kind", "columns", "why"),
    [(6, 3, HALF, "KAAX.*complex"), (6, 4, HALF, "KAAX.*complex"),
     (1, 2, HALF, "KAAX.*symmetric"), (6, 2, (*HALF, HALF[2]), "KAAX.*twice"),
     (6, 2, (HALF[0], ",x,5,1.0"), "line 3.*KAAX"), (6, 2, ["+,1,3,2.0"], "square"),
     (6, 2, (HALF[0], ",2,5,nan"), "line 3.*KAAX"), (6, 2, ["DMIG,{0},1,3"], "KAAX"),
     (9, 2, ["DMIG,{0},-1,0,,1,3,2.0"], "square"), (2, 2, HALF, "square")],
)  # fmt: skip
def test_a_DMIG_matrix_is_refused_by_name_and_others_are_read(
    tmp_path, form, kind, columns, why
):
    path = tmp_path / "k.pch"
    path.write_text(free("KAAX", form, *columns, kind=kind))
    with pytest.raises(ValueError, match=rf"k\.pch.*{why}"):
        ef.read_matrices(path)
    path.write_text(path.read_text() + free("MAAX", 6, "DMIG,{0},1,3,,1,3,1.5"))
    assert ef.read_matrices({"M": path}).M.toarray().tolist() == [[1.5]]


@pytest.mark.parametrize(
    "text",
    [op4("KAA", A) + op4("MAA", A) + op4("KAA", 2 * A),
     op4("MAA", A) + op4("KAA", A, kind=4) + op4("KAA", A),
     "".join(free("KAA", 6, f"DMIG,KAA,{i},3,,{i},3,1.0") for i in (1, 2))],
    ids=["OP4", "OP4, one complex", "DMIG"],
)  # fmt: skip
def test_a_name_that_stands_twice_is_refused_with_the_remedy(tmp_path, text):
    path = tmp_path / "twice.txt"
    path.write_text(text)
    for given in (path, {"K": path}):
        with pytest.raises(ValueError, match=r"twice\.txt.*KAA.*export"):
            ef.read_matrices(given)
    loads = op4("PG", LOAD)
    path.write_text(loads + op4("KAA", A) + loads)  # of several subcases
    assert [*ef.read_matrices(path).matrices] == ["K"]


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("word", [4, 8])
def test_binary_OP4_is_refused_with_the_export_that_is_read(tmp_path, order, word):
    """The first record: columns, rows, form, type and a name of two words."""
    record = b"".join(n.to_bytes(word, order) for n in (4, 4, 6, 2))
    record += b"KAA ".ljust(2 * word)
    mark = len(record).to_bytes(4, order)
    path = tmp_path / "beam.op4"
    path.write_bytes(mark + record + mark + bytes(400))
    with pytest.raises(ValueError, match=r"beam\.op4: .*FORMATTED"):
        ef.read_matrices(path)


def test_a_mass_without_rotations_gets_rows_of_zeros(tmp_path):
    # Lumped at z alone: Nastran writes no column for DOFs without mass.
    K, _, dofs = cantilever()
    lumped = np.diag(np.where(dofs[:, 1] == 3, 2.0, 0.0))
    read = ef.read_matrices(write_dmig(tmp_path / "beam.pch", K, lumped, dofs))
    np.testing.assert_array_equal(read.M.toarray(), lumped)
    np.testing.assert_array_equal(read.nodes, dofs)


def test_a_punch_file_that_was_cut_at_the_end_of_a_line_is_noticed(tmp_path):
    """It has no end mark; what is left is a matrix, but hardly that of a structure."""
    path = write_dmig(tmp_path / "beam.pch", *cantilever())
    lines, silent = path.read_text().splitlines(keepends=True), 0
    mass = next(i for i, line in enumerate(lines) if "MAAX" in line)
    for end in range(1, len(lines) - 1, 4):
        path.write_text("".join(lines[:end]))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")  # the last node has no mass
            try:
                read = ef.read_matrices(path)
            except ValueError as error:
                assert "beam.pch" in str(error)
                continue
        assert end > 2 and (end <= mass + 1) == ("M" not in read.matrices)
        silent += end > mass + 1 and not caught
    assert silent <= 2
