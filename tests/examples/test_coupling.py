"""Examples that update a structure with the matrices of a real FE program.

Each is held to routes that share nothing with it: the program's static analysis, closed
forms, and the Gaussian posterior of a least-squares fit by scipy.
"""

import sys

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import least_squares
from support.examples import load

PROGRAMS = {
    "opensees_frame": "openseespy",
    "pynite_frame": "Pynite",
    "skfem_plate": "skfem",
}


@pytest.fixture
def frame():
    return load("opensees_frame")


@pytest.fixture
def ops(frame):
    try:
        return frame.load_opensees()
    except ImportError as error:
        pytest.skip(str(error))


@pytest.fixture
def platform():
    pytest.importorskip("Pynite", reason="pip install 'emcee_femu[pynite]'")
    return load("pynite_frame")


@pytest.fixture
def plate():
    pytest.importorskip("skfem", reason="pip install 'emcee_femu[skfem]'")
    return load("skfem_plate")


def check_update(example, found, split, mean_gap, sd_gap, capsys):
    """The figures that an example returns, against scipy alone where there is a way."""
    assert found["split"] < 1e-12
    largest = np.abs(next(iter(split[2].values()))).max()
    assert np.abs(split[0]).max() < 1e-12 * largest  # each element is in a group
    assert found["frequencies"] < 1e-9  # MatrixModel and the program's eigensolver
    assert found["speed-up"] > 2  # 40 to 90 on a quiet machine

    truth = np.array(list(example.TRUTH.values()))
    assert (np.abs(found["mean"] - truth) < 3 * found["sd"]).all()
    assert (found["sd"] < 0.5 * 0.2).all()  # the data said something of each

    def residuals(theta):
        K = example.combined(split, dict(zip(example.TRUTH, theta, strict=True)))
        omega2 = eigh(K, split[1], eigvals_only=True)[: example.N_MODES]
        ratio = np.sqrt(omega2) / (2 * np.pi) / found["measured"]
        return np.append((ratio - 1) / example.NOISE, (theta - 1) / 0.2)

    fit = least_squares(residuals, np.ones_like(truth), jac="3-point")
    sd = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    np.testing.assert_array_less(np.abs(found["mean"] - fit.x) / sd, mean_gap)
    np.testing.assert_allclose(found["sd"], sd, rtol=sd_gap)

    shown = capsys.readouterr().out
    assert "times faster" in shown and "sd/prior sd" in shown and "TAE" in shown
    assert all(name in shown for name in example.TRUTH)


def test_opensees_frame(frame, ops, capsys):
    found = frame.main(400, sets=5)

    def assemble(theta):
        frame.build(ops, theta)
        return frame.matrices(ops)[:2]

    split = frame.affine_split(assemble, list(frame.TRUTH))
    check_update(frame, found, split, mean_gap=0.2, sd_gap=0.1, capsys=capsys)
    assert found["inertia"] < 1e-5  # as the page says
    assert 0.013 < found["condensed"] < 0.015


def test_pynite_frame(platform, capsys):
    found = platform.main(400, sets=3)
    split = platform.affine_split(
        lambda theta: platform.matrices(platform.build(theta))[:2],
        list(platform.TRUTH),
    )
    check_update(platform, found, split, mean_gap=0.2, sd_gap=0.1, capsys=capsys)


def test_skfem_plate(plate, capsys):
    found = plate.main(500, sets=3)
    parts, M, _ = plate.matrices(plate.plate())
    dense = {name: part.toarray() for name, part in parts.items()}
    split = (0 * M.toarray(), M.toarray(), dense)
    # 375 generations of DE-MC are some 200 independent draws.
    plate.combined = load("pynite_frame").combined
    check_update(plate, found, split, mean_gap=0.3, sd_gap=0.25, capsys=capsys)


@pytest.mark.parametrize("name", PROGRAMS)
def test_an_example_can_be_read_without_its_program(name, monkeypatch):
    monkeypatch.setitem(sys.modules, PROGRAMS[name], None)
    page = load(name).__doc__
    extra = name.split("_")[0]
    assert f'pip install "emcee_femu[{extra}]"' in page


@pytest.mark.parametrize("name", ["opensees_frame", "pynite_frame"])
def test_the_split_finds_the_groups_and_what_belongs_to_none(name):
    rng = np.random.default_rng(0)
    A, B, C, M = rng.standard_normal((4, 3, 3))
    asked = []

    def assemble(theta):
        asked.append(theta)
        return A + theta["b"] * B + theta["c"] * C, M

    example = load(name)
    split = example.affine_split(assemble, ["b", "c"])
    np.testing.assert_allclose(split[0], A, atol=1e-14)
    np.testing.assert_array_equal(split[1], M)
    np.testing.assert_allclose([split[2]["b"], split[2]["c"]], [B, C], atol=1e-14)
    assert len(asked) == 3  # one assembly more than there are groups
    theta = {"b": 0.3, "c": -2.0}
    K = example.combined(split, theta)
    np.testing.assert_allclose(K, assemble(theta)[0], atol=1e-14)


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


def test_condensation_keeps_the_frequencies_of_a_singular_mass(frame, ops):
    frame.build(ops, frame.TRUTH, lumped=True)
    K, M, labels = frame.matrices(ops)
    massless = {
        label[1] for label, m in zip(labels, M.diagonal(), strict=True) if not m
    }
    assert massless == {3}
    inverse = eigh(M, K, eigvals_only=True)[::-1][: frame.N_MODES]  # of 1 / omega^2
    condensed = eigh(*frame.condensed(K, M), eigvals_only=True)[: frame.N_MODES]
    np.testing.assert_allclose(condensed, 1 / inverse, rtol=1e-10)


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
