"""What a user does with the DOFs of exported matrices."""

import numpy as np
import pytest
from support.exports import cantilever, write_calculix

import emcee_femu as ef


@pytest.fixture
def beam(tmp_path):
    return write_calculix(tmp_path, *cantilever())


@pytest.mark.parametrize("name", ["node 15 z", "15:uz", "15 3", " Node 15, UZ "])
def test_a_DOF_is_named_as_people_do(beam, name):
    read = ef.read_matrices(beam)
    row = read.dofs(name)
    assert type(row) is int and read.labels[row] == "15:uz"
    rows = read.dofs([name, "13:ry"])
    assert rows.dtype == np.intp and rows.tolist() == [row, 1]
    assert read.sensors([name, "13:ry"]) == {name: row, "13:ry": 1}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("node 14 z", "no node 14 among 8 nodes, 13 to 27"),
        ("15:uy", r"node 15 has \['15:uz', '15:ry'\]"),
        ("15", "'node 12 z'"),
        ("15:w", "'node 12 z'"),
        ("roof z", "'node 12 z'"),
    ],
)
def test_a_DOF_that_is_not_there_is_refused(beam, name, message):
    with pytest.raises(ValueError, match=message):
        ef.read_matrices(beam).dofs(name)


def test_a_node_that_became_several_is_chosen_by_row(tmp_path):
    K, M, dofs = cantilever()
    dofs[4:6, 0] = dofs[2, 0]  # as in beams and shells of CalculiX
    read = ef.read_matrices(write_calculix(tmp_path, K, M, dofs))
    with pytest.raises(ValueError, match=r"'15:uz' is rows \[2, 4\].*\{'15:uz': 2\}"):
        read.sensors(["27:uz", "15:uz"])
    assert read.dofs("27:uz") == 14
