"""CalculiX's matrices, and files of any names."""

from pathlib import Path

import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.exports import cantilever, write_calculix

import emcee_femu as ef

DATA = Path(__file__).parents[2] / "data"


def test_a_block_has_the_frequencies_that_calculix_prints():
    # One C3D8 element of steel, 2.20-1 of Debian; its own .dat has these two.
    read = ef.read_matrices(DATA / "block.sti")
    model = ef.MatrixModel(read.K, read.M, {}, n_modes=2)
    assert_allclose(model({}).frequencies[0], [2264.413, 2344.663], atol=5e-4)
    assert read.labels[:4] == ("5:ux", "5:uy", "5:uz", "6:ux")
    assert "block.sti: 12 DOFs" in str(read) and "0.785 along uz" in str(read)


@pytest.mark.parametrize("end", ["sti", "mas", "dof"])
def test_any_file_of_the_job_gives_all_three(tmp_path, end):
    K, M, dofs = cantilever()
    write_calculix(tmp_path, K, M, dofs)
    read = ef.read_matrices(tmp_path / f"beam.{end}")
    assert_allclose(read.K.toarray(), K, rtol=1e-12)
    assert_allclose(read.M.toarray(), M, rtol=1e-12)
    assert_array_equal(read.nodes, dofs)


def test_files_may_have_any_names(tmp_path):
    path = write_calculix(tmp_path, *cantilever())
    files = {"K": "stiffness.txt", "M": "mass.txt", "dofs": "labels.txt"}
    for end, name in zip(("sti", "mas", "dof"), files.values(), strict=True):
        path.with_suffix(f".{end}").rename(tmp_path / name)
    read = ef.read_matrices({k: tmp_path / name for k, name in files.items()})
    assert [*read.matrices] == ["K", "M"] and read.labels[-1] == "27:ry"
    del files["dofs"]
    read = ef.read_matrices({k: tmp_path / name for k, name in files.items()})
    assert read.labels == ()
    with pytest.raises(ValueError, match=r"names: .*does not say what its rows are"):
        read.dofs("node 12 z")
    with pytest.raises(ValueError, match=r"stiffness.txt: .*does not say which matrix"):
        ef.read_matrices(tmp_path / "stiffness.txt")


@pytest.fixture
def beam(tmp_path):
    return write_calculix(tmp_path, *cantilever())


@pytest.mark.parametrize(
    ("end", "new", "message"),
    [
        ("sti", None, r"sti: .*last line.*\[15, 16\]"),
        ("dof", None, r"beam\.sti: .*last line.*row 15, column 15"),
        ("sti", "1 2\n", r"beam\.sti, line 7"),
        ("sti", "0 4 1.0\n", r"beam\.sti: .*from 1 on"),
        ("sti", "1 1 1.0\n", "row 1, column 1 is .*twice"),
        ("sti", "2 \0\n", r"beam\.sti, line 7: binary"),
        ("dof", "12\n", "dof, line 7"),
    ],
)
def test_a_damaged_file_is_refused_by_file_and_line(beam, end, new, message):
    damaged = beam.with_suffix(f".{end}")
    lines = damaged.read_text().splitlines(keepends=True)
    lines[-1 if new is None else 6] = new or ""
    damaged.write_text("".join(lines))
    with pytest.raises(ValueError, match=message):
        ef.read_matrices(beam)
