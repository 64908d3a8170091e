"""Where DOFs are, and along which direction: of nodes, sensors and combinations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import emcee_femu as ef

CORNER = ef.Geometry(
    {"a": (0, 0), "b": (3, 0, 1)},
    [("a", "b")],
    {"skew": ("b", (3, 4, 0)), "gauge": None},
    supports=["a"],
)


def test_a_frame_knows_its_nodes_and_elements():
    bar = ef.Section(E=7e10, GJ=700.0, rho=2700.0, A=3e-4, Iy=2e-9, Iz="Iz")
    points = [(0.0, 0.0, 0.0), (0.5, 0.0, 0.1), (1.0, 0.0, 0.0)]
    lines = [(0, 1, "bar"), (1, 2, "bar")]
    beam = ef.FrameModel(points, lines, {"bar": bar}, {0: "all"}, n_modes=2)
    nodes = {node: place.tolist() for node, place in beam.geometry.nodes.items()}
    assert nodes == {i: list(point) for i, point in enumerate(points)}
    assert beam.geometry.lines == [(0, 1), (1, 2)]
    node, along = beam.geometry.locate("2:uy")
    assert node == 2 and along.tolist() == [0.0, 1.0, 0.0]


def test_a_missing_coordinate_is_zero_and_a_direction_has_unit_length():
    assert_allclose(CORNER.nodes["a"], np.zeros(3))
    node, along = CORNER.locate("skew")
    assert node == "b"
    assert_allclose(along, [0.6, 0.8, 0.0])


@pytest.mark.parametrize(
    ("dof", "along"),
    [
        ("b:uz", [0, 0, 1]),
        ("0.6*b:ux + 0.8*b:uy", [0.6, 0.8, 0.0]),
        ("2*b:ux", [2.0, 0.0, 0.0]),  # what is measured is twice the motion
        ("b:rz", None),  # it moves no node
        ("a:ux + b:ux", None),  # which of the two?
        ("c:ux", None),
        ("gauge", None),
    ],
)
def test_a_dof_is_where_its_name_says(dof, along):
    found = CORNER.locate(dof)
    assert (found is None) == (along is None)
    if found is not None:
        assert found[0] == "b"
        assert_allclose(found[1], along)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (({},), "nodes"),
        (({0: (1.0,)},), r"nodes\[0\]"),
        (({0: (0, 0)}, [(0, 1)]), r"lines\[0\].*no node 1"),
        (({0: (0, 0)}, (), {"s": (0, "up")}), r"sensors\['s'\].*ux uy uz"),
        (({0: (0, 0)}, (), {"s": (0, (0, 0, 0))}), "not zero"),
        (({0: (0, 0)}, (), {}, [3]), "supports.*no node 3"),
    ],
)
def test_what_is_nowhere_is_refused(arguments, named):
    with pytest.raises((TypeError, ValueError), match=named):
        ef.Geometry(*arguments)
