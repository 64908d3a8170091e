"""Pages that update a structure with the matrices of a real FE program.

Each is held to routes that share nothing with it: the program's static analysis, closed
forms, and the Gaussian posterior of a least-squares fit by scipy.
"""

import runpy
import sys

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import least_squares
from support.examples import EXAMPLES, load

PROGRAMS = {"opensees": "openseespy", "pynite": "Pynite", "scikit_fem": "skfem"}


@pytest.fixture
def frame():
    return load("how_to/opensees")


@pytest.fixture
def ops(frame):
    try:
        return frame.load_opensees()
    except ImportError as error:
        pytest.skip(str(error))


@pytest.fixture
def platform():
    pytest.importorskip("Pynite", reason="pip install 'emcee_femu[pynite]'")
    return load("how_to/pynite")


@pytest.fixture
def plate():
    pytest.importorskip("skfem", reason="pip install 'emcee_femu[skfem]'")
    return load("how_to/scikit_fem")


def check_update(name, mean_gap=0.2, sd_gap=0.1):
    """The posterior of a page, against scipy alone."""
    page = runpy.run_path(str(EXAMPLES / "how_to" / f"{name}.py"), run_name="__main__")
    model, parts = page["model"], page["model"].K
    K0, M = (np.asarray(matrix) for matrix in (model.K0, model.M0))
    largest = max(np.abs(part).max() for part in parts.values())
    assert np.abs(K0).max() < 1e-12 * largest  # each element is in a group

    def residuals(theta):
        K = K0 + sum(t * part for t, part in zip(theta, parts.values(), strict=True))
        omega2 = eigh(K, M, eigvals_only=True)[: page["N_MODES"]]
        ratio = np.sqrt(omega2) / (2 * np.pi) / page["measured"]
        return np.append((ratio - 1) / page["NOISE"], (theta - 1) / 0.2)

    fit = least_squares(residuals, np.ones(len(page["TRUTH"])), jac="3-point")
    sd = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    draws = page["run"][0].get_chain(flat=True)
    np.testing.assert_array_less(np.abs(draws.mean(axis=0) - fit.x) / sd, mean_gap)
    np.testing.assert_allclose(draws.std(axis=0), sd, rtol=sd_gap)


def test_opensees_frame(ops, capsys):
    check_update("opensees")
    shown = capsys.readouterr().out
    assert "sd/prior sd" in shown and "TAE" in shown and "upper columns" in shown


def test_pynite_frame(platform):
    check_update("pynite")


def test_skfem_plate(plate):
    check_update("scikit_fem")


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_page_can_be_imported_without_its_program(name, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, PROGRAMS[name], None)
    load(f"how_to/{name}")
    assert capsys.readouterr().out == ""


def test_where_opensees_does_not_import_the_example_says_what_to_do(frame, monkeypatch):
    monkeypatch.setattr(frame.metadata, "files", lambda name: None)
    monkeypatch.setitem(sys.modules, "openseespy", None)
    monkeypatch.setitem(sys.modules, "openseespy.opensees", None)
    with pytest.raises(ImportError, match=r"pip install .*\[opensees\].*apt install"):
        frame.load_opensees()


def test_rows_of_opensees_are_those_that_a_unit_load_moves(frame, ops):
    theta = {"lower columns": 0.7, "upper columns": 1.3, "beams": 0.8}
    frame.build(ops, theta)
    K, M, labels = frame.matrices(ops)
    assert len(set(labels)) == len(labels) == len(K)
    flexibility = np.linalg.inv(K)
    for column, (node, direction) in enumerate(labels):
        frame.build(ops, theta)
        ops.timeSeries("Linear", 1)
        ops.pattern("Plain", 1, 1)
        load_vector = np.zeros(3)
        load_vector[direction - 1] = 1e3
        ops.load(node, *load_vector.tolist())
        ops.system("BandGeneral")
        ops.numberer("RCM")
        ops.constraints("Transformation")
        ops.integrator("LoadControl", 1.0)
        ops.algorithm("Linear")
        ops.analysis("Static")
        assert ops.analyze(1) == 0
        moved = [ops.nodeDisp(*label) for label in labels]
        scale = 1e3 * np.abs(flexibility[:, column]).max()
        np.testing.assert_allclose(
            moved, 1e3 * flexibility[:, column], rtol=1e-8, atol=1e-10 * scale
        )
        assert ops.nodeDisp(22, 1) == pytest.approx(ops.nodeDisp(21, 1), rel=1e-12)


def test_mass_of_opensees_is_that_of_floors_and_elements(frame, ops):
    frame.build(ops, dict.fromkeys(frame.TRUTH, 1.0))
    _, M, labels = frame.matrices(ops)
    column, beam = frame.LINE_MASS * frame.STOREY, frame.LINE_MASS * frame.BAY
    # Of the lower columns only the part of the upper end moves: 156/420 of a bent and
    # 1/3 of a stretched element.
    for direction, share in ((1, 156 / 420), (2, 1 / 3)):
        moves = np.array([label[1] == direction for label in labels], dtype=float)
        expected = sum(frame.FLOORS) + 2 * beam + 2 * column * (1 + share)
        assert moves @ M @ moves == pytest.approx(expected, rel=1e-12)


def test_rows_of_pynite_are_those_that_a_unit_load_moves(platform):
    theta = {"columns": 0.7, "long beams": 1.3, "short beams": 0.8}
    model = platform.build(theta)
    K, M, labels = platform.matrices(model)
    assert len(labels) == len(K) == len(M) == 48
    flexibility = np.linalg.inv(K)
    chosen = [("AB", "DX"), ("C", "DZ"), ("BC", "RX"), ("D", "RY"), ("CD", "DY")]
    for node, axis in chosen:
        load_axis = axis.replace("D", "F").replace("R", "M")
        model.add_node_load(node, load_axis, 1e3, case=node)
        model.add_load_combo(node, {node: 1.0})
    model.analyze_linear(check_stability=False, combo_tags=None)
    for node, axis in chosen:
        moved = [getattr(model.nodes[name], d)[node] for name, d in labels]
        column = 1e3 * flexibility[:, labels.index((node, axis))]
        np.testing.assert_allclose(
            moved, column, rtol=1e-7, atol=1e-9 * np.abs(column).max()
        )


def test_mass_of_pynite_is_that_of_members_and_node_loads(platform):
    length = {
        "columns": 4 * platform.HEIGHT,
        "long beams": 2 * platform.LENGTH,
        "short beams": 2 * platform.WIDTH,
    }
    volume = sum(length[group] * s[0] for group, s in platform.SECTIONS.items())
    steel = volume * platform.WEIGHT / platform.GRAVITY
    total = steel + platform.PUMP + 7 * platform.DECK
    found = platform.total_mass(platform.build(platform.TRUTH))
    np.testing.assert_allclose(found, total, rtol=1e-12)


def test_pynite_has_no_mass_without_a_load_combination(platform):
    from Pynite import FEModel3D

    model = FEModel3D()
    model.add_material("steel", platform.E, platform.G, 0.3, platform.WEIGHT)
    model.add_section("tube", *platform.SECTIONS["columns"])
    model.add_node("fixed", 0.0, 0.0, 0.0)
    model.add_node("free", 4.0, 0.0, 0.0)
    model.def_support("fixed", True, True, True, True, True, True)
    model.add_member("beam", "fixed", "free", "steel", "tube")
    model.add_load_combo("Mass", {"dead": 1.0})
    with pytest.raises(Exception, match="massless"):
        model.analyze_modal(1, "Mass", "Y", platform.GRAVITY)


def test_strips_and_mass_of_the_plate_have_their_closed_forms(plate):
    parts, M, labels = plate.matrices(plate.plate())
    assert len(labels) == M.shape[0] == 96
    # w = x^2 y is clamped at x = 0 and lies in the space of the elements.
    values = {
        "u": lambda x, y: x**2 * y,
        "u_x": lambda x, y: 2 * x * y,
        "u_y": lambda x, y: x**2,
        "u_xy": lambda x, y: 2 * x,
    }
    w = np.array([values[name](x, y) for x, y, name in labels])
    L, W, nu = plate.LENGTH, plate.WIDTH, plate.NU
    mass = plate.RHO * plate.THICKNESS * L**5 / 5 * W**3 / 3
    assert w @ (M @ w) == pytest.approx(mass, rel=1e-10)
    D = plate.E * plate.THICKNESS**3 / (12 * (1 - nu**2))
    for i, part in enumerate(parts.values()):
        a, b = i * L / 4, (i + 1) * L / 4
        # w_xx = 2 y, w_xy = 2 x, w_yy = 0
        bent = 4 * W**3 / 3 * (b - a)
        twisted = 2 * (1 - nu) * 4 * W * (b**3 - a**3) / 3
        assert w @ (part @ w) == pytest.approx(D * (bent + twisted), rel=1e-9)


def test_a_uniform_square_plate_has_the_published_frequencies(plate, monkeypatch):
    for constant, value in (("LENGTH", 1.0), ("WIDTH", 1.0), ("NU", 0.3)):
        monkeypatch.setattr(plate, constant, value)
    monkeypatch.setattr(plate, "N_MODES", 5)
    found = plate.frequencies(plate.plate(8, 8), dict.fromkeys(plate.TRUTH, 1.0))
    D = plate.E * plate.THICKNESS**3 / (12 * (1 - plate.NU**2))
    factors = 2 * np.pi * found * np.sqrt(plate.RHO * plate.THICKNESS / D)
    # Leissa 1973, doi 10.1016/S0022-460X(73)80371-2: upper bounds by the Ritz method.
    published = np.array([3.4917, 8.5246, 21.429, 27.331, 31.111])
    assert (factors < published).all()
    np.testing.assert_allclose(factors, published, rtol=0.01)
