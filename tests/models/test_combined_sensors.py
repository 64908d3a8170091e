"""Sensors that measure combinations of DOFs: models, pairing, terms, drawings."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse
from support.figures import assert_readable

import emcee_femu as ef

L, E, INERTIA = 2.0, 7e10, 9e-9
BAR = ef.Section(E=(E, "e"), GJ=700.0, rho=2700.0, A=3e-4, Iy=2e-9, Iz=INERTIA)
NODES = [(x, 0, 0) for x in np.linspace(0, L, 5)]
BARS = [(i, i + 1, "bar") for i in range(4)]
SENSORS = {
    "skew": {"4:uy": 0.6, "4:uz": 0.8},
    "turned": "2:-uy",
    "gauge": {"1:ry": -0.25, "2:ry": 0.25},
    "gap": {"4:uz": 1.0, "2:uz": -1.0},
}
T = {"e": np.array([0.9, 1.1])}


def beam(shapes, n_modes=3, **options):
    supports = {0: "all"} | options.pop("supports", {})
    return ef.FrameModel(
        NODES, BARS, {"bar": BAR}, supports, n_modes=n_modes, shapes=shapes, **options
    )


def by_hand(dofs, shapes):
    """Return what SENSORS measure of shapes at all DOFs, ``(..., n_dof, n_modes)``."""
    rows = np.zeros((len(SENSORS), len(dofs)))
    for row, parts in zip(rows, SENSORS.values(), strict=True):
        for dof, factor in ({"2:uy": -1.0} if parts == "2:-uy" else parts).items():
            row[dofs.index(dof)] = factor
    return rows @ shapes


def numbered(dofs):
    """Return SENSORS by the numbers of rows."""
    return {
        label: {dofs.index("2:uy"): -1.0}
        if parts == "2:-uy"
        else {dofs.index(dof): factor for dof, factor in parts.items()}
        for label, parts in SENSORS.items()
    }


def the_models(shapes):
    """Return the beam by labels, from dense and sparse matrices, assembled, reduced."""
    frame, numbers = beam(True), numbered(beam(True).dofs)
    K, M = frame.K["e"], frame.M0
    if shapes is not True:
        frame, shapes = beam(SENSORS), numbers
    yield frame
    zero = np.zeros_like(K)
    yield ef.MatrixModel(frame.K0, M, {"e": K}, n_modes=3, shapes=shapes)
    K0, M0, in_K = map(sparse.csc_array, (frame.K0, M, K))
    yield ef.MatrixModel(K0, M0, {"e": in_K}, n_modes=3, shapes=shapes)
    yield ef.reduce_model(frame, {"e": (0.5, 2.0)}, seed=1)
    at = {"n_modes": 3, "shapes": numbers if shapes is not True else range(len(zero))}
    yield ef.AssembledModel(lambda p: (frame.K0 + p["e"] * K, M), ["e"], **at)


def test_every_model_returns_combinations_and_their_derivatives():
    dofs = beam(True).dofs
    for every, some in zip(the_models(True), the_models(SENSORS), strict=True):
        whole, slopes = every.jacobian(T)
        found, its = some.jacobian(T)
        assert list(some.variables["shapes"].coords["dof"]) == list(SENSORS)
        expected = by_hand(dofs, whole.shapes)
        sign = np.sign((expected * found.shapes).sum(axis=1, keepdims=True))
        assert_allclose(found.shapes * sign, expected, rtol=0, atol=2e-5)
        turn = by_hand(dofs, slopes["shapes"]["e"]) * sign
        assert_allclose(its["shapes"]["e"], turn, rtol=0, atol=2e-5)


def test_pairing_and_terms_see_what_the_sensors_measured():
    model, every = beam(SENSORS), beam(True)
    shapes = by_hand(every.dofs, every(T).shapes)[0, :, ::-1]
    noisy = shapes + 0.01 * np.random.default_rng(3).normal(size=shapes.shape)
    hertz, noisy = every(T).frequencies[0], noisy[:, ::-1]
    test = ef.Measurements(hertz, noisy, dofs=list(SENSORS))
    bare = ef.Measurements(hertz, noisy)
    paired = ef.PairedModel(model, test, candidates=3)
    found = paired(T)
    assert found.mac.min() > 0.99
    term = ef.ShapeTerm(test, delta=0.03)
    prior = ef.IndependentPrior({"e": (0.5, 2.0)})
    frequency = ef.FrequencyTerm(test, relative_sd=0.01)
    posterior = ef.LogPosterior(paired, [frequency, term], prior)
    plain = ef.PairedModel(  # the same rows, formed by a function
        ef.FunctionModel(
            lambda p: ef.ModalSolution(
                every({"e": np.array([p["e"]])}).frequencies[0],
                by_hand(every.dofs, every({"e": np.array([p["e"]])}).shapes[0]),
            ),
            n_modes=3,
        ),
        bare,
        candidates=3,
    )
    by_row = ef.ShapeTerm(bare, delta=0.03)
    same = ef.LogPosterior(plain, [frequency, by_row], prior)
    theta = np.array([[0.9], [1.05], [1.2]])
    assert_allclose(posterior(theta)[:, 0], same(theta)[:, 0], rtol=1e-9)
    found = posterior.linearize(theta[1:])
    h = 1e-5
    ahead, behind = (posterior(theta[1:] + step)[:, 0] for step in (h, -h))
    assert_allclose(found.gradient[:, 0], (ahead - behind) / (2 * h), rtol=1e-4)


def test_a_frame_gives_a_static_test_of_itself_by_labels():
    model = beam(False)
    loads = {"tip": {"4:uz": 30.0}, "down": {"4:-uz": 30.0}, "side": {"4:uy": 12.0}}
    points = {"tip": "4:uz", "skew": {"4:uy": 0.6, "4:uz": 0.8}, "gap": SENSORS["gap"]}
    static = model.static(loads, points=points)
    u = static(T)["displacement"]
    x = np.array([L, L / 2])
    uz = 30.0 * x**2 * (3 * L - x) / (6 * E * INERTIA)
    uy = 12.0 * L**3 / (3 * E * 2e-9)
    tip = np.array([uz[0], 0.8 * uz[0], uz[0] - uz[1]])
    expected = np.array([tip, -tip, [0.0, 0.6 * uy, 0.0]])
    assert_allclose(u, expected / T["e"][:, None, None], rtol=1e-8, atol=1e-15)
    slope = static.jacobian(T)[1]["displacement"]["e"]
    assert_allclose(
        slope, -expected / T["e"][:, None, None] ** 2, rtol=1e-7, atol=1e-14
    )
    prior = ef.IndependentPrior({"e": (0.5, 2.0)})
    tests = {
        "modal": (model, ef.FrequencyTerm(model(T).frequencies[0], relative_sd=0.01)),
        "static": (static, ef.DisplacementTerm(u[0], sd=1e-4)),
    }
    at = ef.find_map(ef.LogPosterior.joint(tests, prior), seed=1).maxima[0].theta
    assert_allclose(at, 0.9, rtol=1e-3)


@pytest.mark.parametrize("residual", [False, True])
def test_a_frf_of_a_combination_is_the_combination_of_frfs(residual):
    dofs = ["4:uy", "4:uz", "2:uz"]
    plain = beam(dofs)
    skew = beam({"skew": SENSORS["skew"], "2:uz": "2:uz"})
    lines = np.linspace(1.0, 30.0, 7)
    options = {"damping": 0.02, "residual": residual, "kind": "receptance"}
    channels = [(i, j) for i in dofs for j in dofs]
    full = ef.frf.FRFModel(plain, lines, channels, **options)(T)["receptance"]
    full = (full @ [1, 1j]).reshape(2, 3, 3, len(lines))
    some = [("skew", "skew"), ("2:uz", "skew")]
    found = ef.frf.FRFModel(skew, lines, some, **options)(T)["receptance"] @ [1, 1j]
    w = np.array([0.6, 0.8, 0.0])
    assert_allclose(found[:, 0], np.einsum("i,nijl,j->nl", w, full, w), rtol=1e-6)
    assert_allclose(found[:, 1], np.einsum("njl,j->nl", full[:, 2], w), rtol=1e-6)


def test_combined_sensors_are_drawn_along_their_direction_or_left_out():
    model = beam(SENSORS)
    assert_allclose(model.geometry.locate("skew")[1], [0.0, 0.6, 0.8])
    assert model.geometry.undrawn == {"gauge", "gap"}
    tower = ef.Geometry({0: (0, 0), 1: (0, 1)}, sensors={"gauge": None})
    assert tower.undrawn == {"gauge"} and tower.locate("gauge") is None
    one = {"e": np.ones(1)}
    test = ef.Measurements(
        model(one).frequencies[0], model(one).shapes[0], dofs=list(SENSORS)
    )
    paired = ef.PairedModel(model, test, candidates=3)
    prior = ef.IndependentPrior({"e": (0.5, 2.0)})
    term = ef.FrequencyTerm(test, relative_sd=0.01)
    run = ef.run(
        ef.LogPosterior(paired, term, prior), ef.DEMCMove(), 8, 20, seed=1, ensembles=1
    )
    assert_readable(ef.figures.plot_shapes(run))


@pytest.mark.parametrize(
    ("shapes", "words"),
    [
        (["1:UX"], r"'1:UX'.*did you mean '1:ux'"),
        (["9:ux"], r"nodes.*are 1 to 4"),
        (["2:u30"], r"node 2 has .*2:uz.*combination"),
        ({"tip": {"4:uy": 0.6, "4:uq": 0.8}}, r"shapes\['tip'\].*'4:uq'"),
        ({"tip": {"4:uy": 0.0}}, r"shapes\['tip'\].*0"),
        ({"tip": {}}, r"shapes\['tip'\]"),
        ({"tip": {"4:uy": np.nan}}, r"shapes\['tip'\].*finite"),
    ],
)
def test_a_dof_that_is_none_names_what_may_be_meant(shapes, words):
    with pytest.raises(ValueError, match=words):
        beam(shapes)


@pytest.mark.parametrize(
    ("dof", "words"),
    [("4:u30", "combination"), ("4:UX", "'4:ux'"), ("7:uz", "1 to 4"), ("3:uy", "ask")],
)
def test_measured_dofs_that_the_model_has_not(dof, words):
    test = ef.Measurements([1.0], [[1.0], [0.5]], dofs=["4:uz", dof])
    with pytest.raises(ValueError, match=words):
        ef.PairedModel(beam(["4:uz", "2:uz"]), test, candidates=1)
