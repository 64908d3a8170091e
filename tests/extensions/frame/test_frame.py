"""Frames: beam theory and its rates of convergence, assembly, parameters."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import brentq
from support.contracts import assert_model, assert_shapes

import emcee_femu as ef
from emcee_femu import FrameModel, Section

DOFS = ("ux", "uy", "uz", "rx", "ry", "rz")
L = 1.3
BAR = dict(E=7.1e10, GJ=700.0, rho=2750.0, A=3e-4, Iy=2e-9, Iz=9e-9)
POLAR, MASS = BAR["rho"] * (BAR["Iy"] + BAR["Iz"]), BAR["rho"] * BAR["A"]
# The default orientation makes local y the global z: Iz resists uz, Iy resists uy.
FAMILIES = {  # free DOFs, a, p of the frequencies (beta L / L)^p a / (2 pi)
    "uz": (("uz", "ry"), np.sqrt(BAR["E"] * BAR["Iz"] / MASS), 2),
    "uy": (("uy", "rz"), np.sqrt(BAR["E"] * BAR["Iy"] / MASS), 2),
    "rx": (("rx",), np.sqrt(BAR["GJ"] / POLAR), 1),
    "ux": (("ux",), np.sqrt(BAR["E"] / BAR["rho"]), 1),
}


def roots(equation, first):
    return np.array([brentq(equation, j * np.pi, (j + 1) * np.pi) for j in first])


BETA_L = {
    (2, "cantilever"): roots(lambda x: np.cos(x) + 1 / np.cosh(x), range(4)),
    (2, "free"): roots(lambda x: np.cos(x) - 1 / np.cosh(x), range(1, 5)),
    (2, "propped"): roots(lambda x: np.sin(x) - np.cos(x) * np.tanh(x), range(1, 4)),
    (2, "pinned"): np.pi * np.arange(1, 5),
    (1, "cantilever"): np.pi * np.array([0.5, 1.5, 2.5]),
    (1, "pinned"): np.pi * np.array([0.5, 1.5, 2.5]),  # a rod is held at one end
    (1, "free"): np.pi * np.array([1.0, 2.0, 3.0]),
}


def theory(family, ends):
    _, a, p = FAMILIES[family]
    return (BETA_L[p, ends] / L) ** p * a / (2 * np.pi)


def beam(n, supports=None, orientation=(0.0, 0.0, 1.0), **options):
    nodes = [(x, 0.0, 0.0) for x in np.linspace(0.0, L, n + 1)]
    elements = [(i, i + 1, "bar") for i in range(n)]
    sections = {"bar": Section(**BAR, orientation=orientation)}
    return FrameModel(nodes, elements, sections, supports, **options)


def only(free, n, ends):
    held = [dof for dof in DOFS if dof not in free]
    clamped = {0: "all"} if ends == "cantilever" else {}
    pinned = {i: [*held, free[0]] for i in (0, n)} if ends == "pinned" else {}
    return {node: held for node in range(n + 1)} | clamped | pinned


def solve(model):
    return model({}).frequencies[0]


@pytest.mark.parametrize(
    ("family", "ends"),
    [*product(FAMILIES, ("cantilever", "free")), ("uz", "pinned"), ("uy", "pinned")],
)
def test_frequencies_converge_in_fourth_order_and_of_rods_in_second(family, ends):
    free, _, p = FAMILIES[family]
    errors, skip = [], p if ends == "free" else 0
    for n in (12, 24):
        model = beam(n, only(free, n, ends), modes=(2, 3), skip=skip)
        errors.append(solve(model) / theory(family, ends)[1:3] - 1)
    assert (np.abs(np.log2(errors[0] / errors[1]) - 2 * p) < 0.1).all()
    leading = (BETA_L[p, ends][1:3] / 24) ** (2 * p) / {1: 24, 2: 1440}[p]
    np.testing.assert_allclose(errors[1], leading, rtol=0.05)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 75.0, 90.0])
def test_a_tilted_section_bends_with_the_moment_of_its_tilt(degrees):
    tilt = np.deg2rad(degrees)  # of local y from global y
    orientation = (5.0, 2 * np.cos(tilt), 2 * np.sin(tilt))  # 5.0: along the bar
    inertia = BAR["Iz"] * np.cos(tilt) ** 2 + BAR["Iy"] * np.sin(tilt) ** 2
    exact = theory("uy", "cantilever")[:2] * np.sqrt(inertia / BAR["Iy"])
    model = beam(16, only(("uy", "rz"), 16, "cantilever"), orientation, n_modes=2)
    np.testing.assert_allclose(solve(model), exact, rtol=6e-6)


@pytest.mark.parametrize("degrees", [50.0, 90.0, 135.0])
def test_a_plane_frame_has_the_modes_of_its_clamped_legs(degrees):
    # The corner cannot move: it turns (propped legs) or does not (clamped legs).
    legs = [(np.cos(a), np.sin(a), 0.0) for a in (0.0, np.deg2rad(degrees))]
    steps = L * np.arange(1, 17)[:, None] / 16
    nodes = np.vstack([np.zeros((1, 3)), steps * legs[0], steps * legs[1]])
    elements = [(i if i != 16 else 0, i + 1, "bar") for i in range(32)]
    held = {i: ("uz", "rx", "ry") for i in range(33)}
    supports = held | {0: DOFS[:5], 16: "all", 32: "all"}
    bar = Section(**BAR, orientation=(0, 0, 1))
    frame = FrameModel(nodes, elements, {"bar": bar}, supports, n_modes=4)
    exact = np.sort([theory("uy", ends)[:2] for ends in ("propped", "free")], axis=None)
    np.testing.assert_allclose(solve(frame), exact, rtol=5e-5)


# The unsymmetrical H of Application 2 of the paper.
H = dict(E=7.2e10, GJ=720.0, rho=2785.0, A=3.1556e-4, Iy=2.5255e-9, Iz=2.7265e-8)
# 45, 30 and 45 degrees from z; only the direction of the part normal to the bar counts.
TILTS = {"left": (1, 0.3, 1), "mid": (0.2, 1, 3**0.5), "right": (1, -2, 1)}
SPREAD = {"left": 1.0, "mid": 0.7, "right": 1.3}
H_NODES = [(0.115 * i, 0, 0) for i in range(7)]
H_NODES += [(0, y, 0) for y in (-0.21, -0.105, 0.095, 0.19)]
H_NODES += [(0.69, -0.105, 0), (0.69, 0.105, 0)]
H_BARS = [(i, i + 1, "mid") for i in range(6)] + [(7, 8, "left"), (8, 0, "left")]
H_BARS += [(0, 9, "left"), (9, 10, "left"), (11, 6, "right"), (6, 12, "right")]
HELD = {7: "all", 12: ("ux", "ry")}
ROUNDING = 1e-6  # of stretched bars, whose eigenvalues are 1e8 of the lowest


def h_frame(named=(), base=H, supports=None, **options):
    sections = {}
    for bar, tilt in TILTS.items():
        values = {key: base[key] * SPREAD[bar] for key in H}
        values |= {key: f"{key} {bar}" for key in named}
        sections[bar] = Section(**values, orientation=tilt)
    options = {"n_modes": 12, "skip": 0 if supports else 6} | options
    return FrameModel(H_NODES, H_BARS, sections, supports, **options)


def h_values(named, factors=(1.0,)):
    at = np.array(factors)
    return {f"{key} {bar}": H[key] * SPREAD[bar] * at for key in named for bar in TILTS}


@pytest.mark.parametrize("supports", [None, HELD])
def test_shapes_are_over_the_free_dofs_and_where_they_are_asked_for(supports):
    full = h_frame(["rho"], supports=supports, shapes=True)
    held = {f"{k}:{dof}" for k, dof in product((7,), DOFS)} | {"12:ux", "12:ry"}
    every = [f"{k}:{dof}" for k, dof in product(range(13), DOFS)]
    assert full.dofs == tuple(d for d in every if not supports or d not in held)
    assert full.shape_dofs == full.dofs
    dofs = ["12:uy", "0:rz", "8:ux"]
    some = h_frame(["rho"], supports=supports, shapes=dofs)
    assert some.variables == ef.modal_variables(12, tuple(dofs))
    expected = full(h_values(["rho"])).shapes[:, [full.dofs.index(d) for d in dofs]]
    np.testing.assert_allclose(some(h_values(["rho"])).shapes, expected, atol=1e-12)


NAMED = [["E"], ["A"], ["E", "A"], ["rho", "A", "Iy"], list(H)]


@pytest.mark.parametrize("named", NAMED, ids="-".join)
def test_named_properties_equal_numbers(named):
    model, factors = h_frame(named), np.linspace(0.8, 1.3, 4)
    values = h_values(named, factors)
    assert {*model.names} == {*model.bounds} == {*values}
    assert_model(model, values)
    for row, factor in enumerate(factors):
        numbers = solve(h_frame(base=H | {key: factor * H[key] for key in named}))
        batch = model(values).frequencies
        np.testing.assert_allclose(batch[row], numbers, rtol=ROUNDING)


LIGHT = BAR | {"rho": 1e-3}  # beside the point masses
STIFFNESS = BAR["E"] * BAR["Iz"]  # resists uz


@pytest.mark.parametrize("how", ["mass", "bar"])
def test_a_mass_beyond_the_end_of_a_cantilever(how):
    """Its arm is that of the mass, or that of the bar."""
    m, arm, turning = 0.4, 0.13, 2e-3
    bar = Section(**LIGHT, orientation=(0, 0, 1))
    ends = [(0, 0, 0), (L + arm * (how == "bar"), 0, 0)]
    elements = (
        [(0, 1, "bar", (None, (-arm, 0, 0)))] if how == "bar" else [(0, 1, "bar")]
    )
    offset = None if how == "bar" else (arm, 0, 0)
    tip = [(1, (m, "tip"), offset, (np.int64(0), turning, 0)), (1, 1e-9)]
    held = {0: "all", 1: ("ux", "uy", "rx", "rz")}
    model = FrameModel(ends, elements, {"bar": bar}, held, masses=tip, n_modes=1)
    K = STIFFNESS / L**3 * np.array([[12, -6 * L], [-6 * L, 4 * L**2]])
    factors = np.array([1.0, 0.5])
    M = np.array([[[x, x * arm], [x * arm, turning + x * arm**2]] for x in m * factors])
    squares = np.linalg.eigvals(np.linalg.solve(M, K)).min(axis=1)
    parameters, exact = {"tip": factors}, np.sqrt(squares) / (2 * np.pi)
    np.testing.assert_allclose(model(parameters).frequencies[:, 0], exact, rtol=2e-6)
    assert model.names == ("tip",) and model.bounds == {"tip": (0.0, np.inf)}
    assert_model(model, parameters)
    with pytest.raises(ValueError, match="'tip' must be above zero"):
        model({"tip": np.array([-1.0])})


@pytest.mark.parametrize("relative", [1e-3, 1.0, 1e3])
def test_two_bars_joined_by_a_spring_that_turns(relative):
    """Clamped at their outer ends, a mass between them."""
    m, c = 0.4, relative * STIFFNESS / L
    nodes = [(0, 0, 0), (L, 0, 0), (L, 0, 0), (2 * L, 0, 0)]
    held = {0: "all", 3: "all"} | dict.fromkeys((1, 2), ("ux", "uy", "rx", "rz"))
    bar = Section(**LIGHT, orientation=(0, 0, 1))
    model = FrameModel(
        nodes, [(0, 1, "bar"), (2, 3, "bar")], {"bar": bar}, held,
        masses=[(1, m / 2), (2, m / 2)],
        springs=[(1, 2, {"uz": 1e6 * STIFFNESS, "ry": (2.0, "joint")})], n_modes=1,
    )  # fmt: skip
    give = L**3 / (6 * STIFFNESS) - c * L**4 / (4 * STIFFNESS**2) / (
        1 + 2 * c * L / STIFFNESS
    )
    found = model({"joint": np.array([c / 2])}).frequencies
    np.testing.assert_allclose(found, 1 / np.sqrt(give * m) / (2 * np.pi), rtol=1e-5)


def test_rigid_motions_strain_nothing_and_weigh_what_the_parts_do():
    """Whatever the offsets, also of nodes that a spring joins from afar."""
    rng = np.random.default_rng(4)
    nodes = rng.normal(size=(4, 3))
    a, b, arm, moments = *rng.normal(size=(3, 3)), (0.3, 0.5, 0.7)
    elements = [(0, 1, "bar", (a, None)), (1, 2, "bar", (None, b))]
    springs = [(2, 3, dict.fromkeys(DOFS, 4e3)), (0, 3, {"uy": (2e3, "k"), "rx": "k"})]
    masses = [(3, 1.7, arm, moments), (0, (0.6, "m"))]
    model = FrameModel(
        nodes, elements, {"bar": Section(**BAR)}, springs=springs, masses=masses,
        n_modes=3, skip=6,
    )  # fmt: skip
    rigid = np.zeros((24, 6))
    for i, place in enumerate(nodes):
        rigid[6 * i : 6 * i + 6] = np.eye(6)
        rigid[6 * i : 6 * i + 3, 3:] = np.cross(np.eye(3), place).T
    for K in (model.K0, model.K["k"]):
        assert np.abs(K @ rigid).max() < 1e-12 * np.abs(K).max() * np.abs(rigid).max()
    total = rigid.T @ (model.M0 + model.M["m"]) @ rigid
    ends = np.array([[nodes[0] + a, nodes[1]], [nodes[1], nodes[2] + b]])
    bars = MASS * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    weights = [*bars, 1.7, 0.6]
    places = np.array([*ends.mean(axis=1), nodes[3] + arm, nodes[0]])
    centre = np.average(places, axis=0, weights=weights)
    np.testing.assert_allclose(total[:3, :3], np.sum(weights) * np.eye(3), atol=1e-9)
    moved = np.sum(weights) * np.cross(np.eye(3), centre).T
    np.testing.assert_allclose(total[:3, 3:], moved, atol=1e-9)
    at = {"k": np.array([0.5, 2.0]), "m": np.array([1.0, 0.4])}
    assert (model(at).frequencies > 0).all()  # six rigid modes, or it refuses
    alone = FrameModel(
        nodes, elements, {"bar": Section(**BAR)}, springs=springs,
        masses=[masses[1]], n_modes=3, skip=6,
    )  # fmt: skip
    there = np.eye(3) * moments + 1.7 * (
        (nodes[3] + arm) @ (nodes[3] + arm) * np.eye(3)
        - np.outer(nodes[3] + arm, nodes[3] + arm)
    )
    rest = total - rigid.T @ (alone.M0 + alone.M["m"]).toarray() @ rigid
    np.testing.assert_allclose(rest[3:, 3:], there, atol=1e-9)


def test_a_number_times_a_parameter_is_their_product():
    factors = {"E": 1.1, "rho": 0.9, "Iz": 1.3, "Ip": 2.0}
    numbers = BAR | {"Ip": 3e-8}
    named = numbers | {key: (numbers[key], f"f {key}") for key in factors}
    plain = numbers | {key: numbers[key] * x for key, x in factors.items()}
    nodes = [(x, 0.0, 0.1 * x**2) for x in np.linspace(0.0, L, 4)]
    elements = [(i, i + 1, "bar") for i in range(3)]
    models = [
        FrameModel(nodes, elements, {"bar": Section(**bar)}, {0: "all"}, n_modes=6)
        for bar in (named, plain)
    ]
    values = {f"f {key}": np.array([x]) for key, x in factors.items()}
    found, expected = models[0](values).frequencies, models[1]({}).frequencies
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert {*models[0].K} == {"f E", "f E * f Iz"}
    assert {*models[0].M} == {"f rho", "f Ip * f rho"}


@pytest.mark.filterwarnings("ignore:the reduction does not pay")
def test_a_reduced_frame_has_its_modes_also_with_gaps():
    options = dict(n_modes=None, modes=[1, 3, 4], shapes=["2:uy", "12:rx"])
    full = h_frame(["E", "Iz"], **options)
    middle = h_values(["E", "Iz"])
    bounds = {name: (0.8 * x.item(), 1.2 * x.item()) for name, x in middle.items()}
    small = ef.reduce_model(full, bounds, test_points=4)
    at = h_values(["E", "Iz"], [0.9, 1.1])
    exact, near = full(at), small(at)
    np.testing.assert_allclose(near.frequencies, exact.frequencies, rtol=1e-4)
    assert small.variables == full.variables and small.dofs == full.dofs
    assert_shapes(near.shapes, exact.shapes, atol=0.02 * np.abs(near.shapes).max())


def test_a_link_too_stiff_to_be_solved_is_named_by_its_ratio():
    nodes = [(x, 0.0, 0.0) for x in np.linspace(0.0, L, 6)]
    elements = [(i, i + 1, "bar") for i in range(5)]
    link = [(0, 5, dict.fromkeys(DOFS, 1e30))]
    model = FrameModel(
        nodes, elements, {"bar": Section(**BAR)}, springs=link, n_modes=2, skip=6
    )
    with pytest.raises(ValueError, match=r"a ratio of \de\+\d+"):
        model({})


def test_parts_that_do_not_fit_are_refused_by_their_numbers():
    nodes, bar = [(0, 0, 0), (L, 0, 0), (L, 1, 0)], {"bar": Section(**BAR)}

    def frame(**parts):
        return FrameModel(nodes, [(0, 1, "bar")], bar, {0: "all"}, n_modes=1, **parts)

    for parts, match in (
        ({}, r"nodes: .*\[2\]"),
        ({"masses": [(1, 1.0), (2, -1.0)]}, r"masses\[1\]"),
        ({"masses": [(2, 1.0, None, (1.0, 1.0))]}, r"masses\[0\]"),
        ({"springs": [(1, 2, {"ux": 1.0}), (1, 7, {"ux": 1.0})]}, r"springs\[1\].*7"),
        ({"springs": [(1, 2, {"u": 1.0})]}, r"springs\[0\].*'u'"),
        ({"springs": [(1, 0, {"ry": 1.0}), (0, None, {"ry": 1.0})]}, r"springs\[1\]"),
    ):
        with pytest.raises((TypeError, ValueError), match=match):
            frame(**parts)
    with pytest.raises(TypeError, match=r"elements\[0\]"):
        FrameModel(nodes[:2], [(0, 1, "bar", (None,))], bar, {0: "all"}, n_modes=1)


def test_nodes_without_mass_are_condensed():
    """A spring from a bar to a node that nothing but another spring holds."""
    nodes, stiff = [(0, 0, 0), (L, 0, 0), (L, 0, 0)], dict.fromkeys(DOFS, 5e3)
    springs = [(1, 2, stiff), (2, None, stiff)]
    options = dict(n_modes=3, shapes=["1:uz"])
    bars = [(0, 1, "bar")], {"bar": Section(**BAR)}, {0: "all"}
    two = FrameModel(nodes, *bars, springs=springs, **options)
    half = [(1, None, {dof: k / 2 for dof, k in stiff.items()})]
    one = FrameModel(nodes[:2], *bars, springs=half, **options)
    np.testing.assert_allclose(solve(two), solve(one), rtol=1e-8)


@pytest.mark.parametrize("zero", [0, 0.0])
def test_bars_of_a_truss_stay_straight_and_leave_no_rotations(zero):
    bar = Section(E="E", GJ=zero, rho=2700.0, A=(3e-4, "area"), Iy=zero, Iz=zero)
    nodes = np.array([(0.0, 0, 0), (3, 0, 0), (0, 4, 0), (1, 1, 2)])
    legs, held = [(i, 3, "bar") for i in range(3)], {i: "all" for i in range(3)}
    model = FrameModel(nodes, legs, {"bar": bar}, held, n_modes=3, shapes=True)
    assert model.dofs == ("3:ux", "3:uy", "3:uz")
    K, m = np.zeros((3, 3)), 0.0
    for leg in nodes[3] - nodes[:3]:
        length = np.linalg.norm(leg)
        K += 7e10 * 3e-4 * np.outer(leg, leg) / length**3
        m += 2700.0 * 3e-4 * length / 3
    found = model({"E": np.array([7e10]), "area": np.ones(1)})
    exact = np.sqrt(np.linalg.eigvalsh(K) / m) / (2 * np.pi)
    np.testing.assert_allclose(found.frequencies[0], exact, rtol=1e-12)


def test_a_truss_that_does_not_stand_and_other_zeros_are_refused():
    bar = Section(E=7e10, GJ=0.0, rho=2700.0, A=3e-4, Iy=0.0, Iz=0.0)
    nodes, bars = [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, "bar"), (1, 2, "bar")]
    model = FrameModel(nodes, bars, {"bar": bar}, {0: "all", 2: "all"}, n_modes=1)
    with pytest.raises(ValueError, match="skip"):
        model({})  # its middle has no hold across
    for name in ("E", "rho", "A", "Ip"):
        with pytest.raises(ValueError, match=name):
            Section(**BAR | {name: 0.0})
    with pytest.raises(ValueError, match="Iy"):
        Section(**BAR | {"Iy": (0.0, "f")})
