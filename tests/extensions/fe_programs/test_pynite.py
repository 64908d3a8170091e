"""PyNite: matrices and names against its own static analysis and eigenvalues."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigh
from support.examples import load

import emcee_femu as ef

pytest.importorskip("Pynite", reason="pip install 'emcee_femu[pynite]'")
THETA = {"columns": 0.7, "long beams": 1.3, "short beams": 0.8}
AXES = {"u": "D", "r": "R"}  # of displacements in PyNite


@pytest.fixture
def platform():
    """The page: a platform with masses at nodes and self-weight."""
    return load("how_to/pynite")


def build_bracket():
    """A quad on a bar with a spring support; nodes with blanks in their names."""
    from Pynite import FEModel3D

    model = FEModel3D()
    model.add_material("steel", 2e11, 8e10, 0.3, 77e3)
    model.add_section("tube", 4e-3, 2e-5, 2e-5, 3e-5)
    places = {"node 1": (0, 0, 0), "node 2": (2, 0, 0), "c": (2, 1, 0), "d": (0, 1, 0)}
    for name, place in places.items():
        model.add_node(name, *map(float, place))
        model.add_node_load(name, "FZ", -50.0, case="dead")
    model.def_support("node 1", *[True] * 6)
    model.def_support("d", support_DX=True)
    model.def_support_spring("c", "DZ", 1e6)
    model.def_node_disp("d", "DY", 0.001)
    model.add_member("bar", "node 1", "node 2", "steel", "tube")
    model.add_quad("q", *places, 0.01, "steel")
    model.add_load_combo("mass", {"dead": 1.0})
    model.analyze_modal(4, "mass", "Z", 9.81, check_stability=False)
    return model


def test_frequencies_are_those_of_pynite(platform):
    model = platform.build(THETA)
    bracket = build_bracket()
    plate = ef.from_pynite(bracket, "mass", "Z", gravity=9.81)
    for analysed, base in ((model, platform.assemble(THETA)), (bracket, plate)):
        count = len(analysed.frequencies)
        squares = eigh(base.K.toarray(), base.M.toarray(), eigvals_only=True)[:count]
        found = np.sqrt(squares) / (2 * np.pi)
        # The largest eigenvalues are 1e8 of the lowest, and round by 1e-16.
        assert_allclose(found, analysed.frequencies, rtol=1e-6)
    # A support and a prescribed displacement at d, a spring at c.
    assert plate.size == 16 and not {"d:ux", "d:uy"} & {*plate.labels}
    assert plate.dofs("node 2:uz") == plate.labels.index("node 2:uz")


def test_rows_are_those_that_a_unit_load_moves(platform):
    model = platform.build(THETA)
    base = ef.from_pynite(model, "Mass", "Y", gravity=platform.GRAVITY)
    assert base.size == len({*base.labels}) == 48
    flexibility = np.linalg.inv(base.K.toarray())
    chosen = ["AB:ux", "C:uz", "BC:rx", "D:ry", "CD:uy"]
    for label in chosen:
        node, direction = label.split(":")
        force = ("F" if direction[0] == "u" else "M") + direction[1].upper()
        model.add_node_load(node, force, 1e3, case=label)
        model.add_load_combo(label, {label: 1.0})
    model.analyze_linear(check_stability=False, combo_tags=None)
    rows = [label.split(":") for label in base.labels]
    for label in chosen:
        moved = [
            getattr(model.nodes[node], AXES[at[0]] + at[1].upper())[label]
            for node, at in rows
        ]
        column = 1e3 * flexibility[:, base.dofs(label)]
        assert_allclose(moved, column, rtol=1e-7, atol=1e-9 * np.abs(column).max())


def test_moving_mass_is_that_of_members_and_node_loads(platform):
    length = {
        "columns": 4 * platform.HEIGHT,
        "long beams": 2 * platform.LENGTH,
        "short beams": 2 * platform.WIDTH,
    }
    steel = {
        group: length[group] * platform.SECTIONS[group][0] * platform.WEIGHT
        for group in length
    }
    total = sum(steel.values()) / platform.GRAVITY + platform.PUMP + 7 * platform.DECK
    found = platform.assemble(THETA).moving_mass
    # Of a column moves 156/420 where it bends, 1/3 where it is stretched.
    for axis, share in (("ux", 156 / 420), ("uy", 1 / 3), ("uz", 156 / 420)):
        held = (1 - share) * steel["columns"] / platform.GRAVITY
        assert found[axis] == pytest.approx(total - held, rel=1e-12)


def hold(model):
    for name in model.nodes:
        model.def_support(name, *[True] * 6)


@pytest.mark.parametrize(
    ("spoil", "given", "message"),
    [
        (None, {"mass_combo_name": "Mass"}, r"mass_combo_name: .*\['mass'"),
        (None, {"mass_direction": "FY"}, r"mass_direction: .* got 'FY'"),
        (None, {"mass_direction": "X"}, r"model: .*massless.* along X: add_"),
        (None, {"gravity": -9.81}, r"gravity: expected numbers above zero"),
        (lambda m: m.add_node("new", 9.0, 9.0, 9.0), {}, r"model: .*analyze_modal\("),
        (hold, {}, "model: .* free DOF"),
    ],
)
def test_what_cannot_be_read_is_refused(spoil, given, message):
    model = build_bracket()
    if spoil:
        spoil(model)
    arguments = {"mass_combo_name": "mass", "mass_direction": "Z", "gravity": 9.81}
    with pytest.raises(ValueError, match=message):
        ef.from_pynite(model, **arguments | given)
