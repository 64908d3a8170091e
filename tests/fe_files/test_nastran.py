"""Nastran: punch files of DMIG entries, and OUTPUT4 in ASCII."""

import warnings

import numpy as np
import pytest
from support.exports import cantilever, write_dmig, write_op4

import emcee_femu as ef

K, M, DOFS = cantilever()


def test_a_mass_without_rotations_gets_rows_of_zeros(tmp_path):
    # Lumped at z alone: Nastran writes no column for DOFs without mass.
    lumped = np.diag(np.where(DOFS[:, 1] == 3, 2.0, 0.0))
    read = ef.read_matrices(write_dmig(tmp_path / "beam.pch", K, lumped, DOFS))
    np.testing.assert_array_equal(read.M.toarray(), lumped)
    np.testing.assert_array_equal(read.nodes, DOFS)


def test_small_fields_and_commas_of_DMIG(tmp_path):
    path = tmp_path / "beam.pch"
    lines = ["$ two points", f"DMIG    K2GG    {0:8d}{6:8d}{1:8d}{0:8d}"]
    lines += ["DMIG    K2GG           1       3               1       3   1.5+3"]
    lines += ["+              2       3  -0.5D3", "DMIG,K2GG,2,3,,2,3,4.0E2,,"]
    path.write_text("".join(line + "\n" for line in lines))
    read = ef.read_matrices({"K": path})
    assert read.K.toarray().tolist() == [[1500.0, -500.0], [-500.0, 400.0]]
    assert read.labels == ("1:uz", "2:uz")
    assert [*ef.read_matrices(path).matrices] == ["K2GG"]


@pytest.mark.parametrize(
    ("line", "new", "message"),
    [
        (3, "DMIG    KAAX           0       6       4\n", r"KAAX is complex"),
        (3, "DMIG    KAAX           0       9       2\n", r"no square .*EXTOUT"),
        (3, "\n", r"no DMIG entry with the form of 'KAAX'"),
        (6, "*                    1.5               3 1.0D+00\n", r"line 6"),
        (4, "DMIG*   KAAX                           x               3\n", r"line 4"),
    ],
)
def test_damaged_DMIG_entries_are_named(tmp_path, line, new, message):
    path = write_dmig(tmp_path / "beam.pch", K, 0 * M, DOFS)
    lines = path.read_text().splitlines(keepends=True)
    lines[line - 1] = new
    path.write_text("".join(lines))
    with pytest.raises(ValueError, match=rf"beam\.pch.*{message}"):
        ef.read_matrices(path)


def test_loads_and_complex_matrices_of_OP4_are_passed_over(tmp_path):
    path = write_op4(tmp_path / "beam.op4", "dense", PG=K[:, :3], KAA=K, K4AA=M)
    read = ef.read_matrices(path)
    assert [*read.matrices] == ["K", "K4AA"]
    np.testing.assert_array_equal(read.K.toarray(), K)


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("word", [4, 8])
def test_binary_OP4_is_refused_with_the_export_that_is_read(tmp_path, order, word):
    """The first record: columns, rows, form, type and a name of two words."""
    record = b"".join(n.to_bytes(word, order) for n in (4, 4, 6, 2))
    record += b"KAA ".ljust(2 * word)
    mark = len(record).to_bytes(4, order)
    path = tmp_path / "beam.op4"
    path.write_bytes(mark + record + mark + bytes(400))
    with pytest.raises(
        ValueError, match=r"beam\.op4: .*OUTPUT4='beam\.op4'.*FORMATTED"
    ):
        ef.read_matrices(path)
    path.write_bytes(mark + bytes(60))
    with pytest.raises(ValueError, match=r"beam\.op4: .*got binary content"):
        ef.read_matrices(path)


def test_single_precision_of_OP4_has_one_word_a_value(tmp_path):
    lines = ["       2      -2       6       1KGG     1P,5E16.9"]
    lines += ["       1       0       4", "       3       1"]
    lines += [" 2.000000000E+00-1.000000000E+00", "       2       0       4"]
    lines += ["       3       1", "-1.000000000E+00 3.000000000E+00"]
    lines += ["       3       1       1", " 1.000000000E+00"]
    path = tmp_path / "k.op4"
    path.write_text("".join(line + "\n" for line in lines))
    assert ef.read_matrices(path).K.toarray().tolist() == [[2.0, -1.0], [-1.0, 3.0]]
    path.write_text(
        "".join(line + "\n" for line in lines).replace("       3", "       2")
    )
    with pytest.raises(ValueError, match=r"k\.op4, line 3: expected .* finite values"):
        ef.read_matrices(path)


def test_a_punch_file_that_was_cut_at_the_end_of_a_line_is_noticed(tmp_path):
    """It has no end mark; what is left is a matrix, but hardly that of a structure."""
    path = write_dmig(tmp_path / "beam.pch", K, M, DOFS)
    lines = path.read_text().splitlines(keepends=True)
    mass = next(i for i, line in enumerate(lines) if "MAAX" in line)
    said = {"refused": 0, "warned": 0, "no mass": 0, "silent": 0}
    for end in range(1, len(lines) - 1):
        path.write_text("".join(lines[:end]))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                read = ef.read_matrices(path)
            except ValueError as error:
                assert "beam.pch" in str(error)
                said["refused"] += 1
                continue
        assert end > 2 and all("27, has no mass" in str(w.message) for w in caught)
        missing = end <= mass + 1
        assert missing == ("M" not in read.matrices)
        said["no mass" if missing else "warned" if caught else "silent"] += 1
    assert said["silent"] <= 6 and said["warned"] > 20 and said["refused"] > 60
