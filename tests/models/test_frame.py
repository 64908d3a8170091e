"""Frames: beam theory and its rates of convergence, assembly, parameters."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from support.contracts import assert_model

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


@pytest.mark.parametrize("ends", ["cantilever", "pinned", "free"])
def test_a_beam_in_space_has_the_modes_of_both_planes_and_of_the_rods(ends):
    pins = {0: ("ux", "uy", "uz", "rx"), 20: ("uy", "uz")}
    supports = {"cantilever": {0: "all"}, "pinned": pins, "free": None}[ends]
    families = [theory(family, ends) for family in FAMILIES]
    exact = np.sort(np.concatenate(families))
    exact = exact[exact <= min(family[-1] for family in families)]
    model = beam(20, supports, n_modes=len(exact), skip=6 if ends == "free" else 0)
    assert len(exact) >= 6
    np.testing.assert_allclose(solve(model), exact, rtol=2e-3)


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
    frame = FrameModel(nodes, elements, {"bar": Section(**BAR)}, supports, n_modes=4)
    exact = np.sort([theory("uy", ends)[:2] for ends in ("propped", "free")], axis=None)
    np.testing.assert_allclose(solve(frame), exact, rtol=5e-5)


# --- The unsymmetrical H of Application 2 of the paper: assembly and parameters.
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


def h_frame(named=(), base=H, turn=None, order=None, supports=None, **options):
    turn, order = turn or Rotation.identity(), range(13) if order is None else order
    place, sections = np.argsort(order), {}
    for bar, tilt in TILTS.items():
        values = {key: base[key] * SPREAD[bar] for key in H}
        values |= {key: f"{key} {bar}" for key in named}
        sections[bar] = Section(**values, orientation=tuple(turn.apply(tilt)))
    nodes = turn.apply(H_NODES)[order]
    elements = [(place[i], place[j], bar) for i, j, bar in H_BARS]
    held = {place[node]: dofs for node, dofs in (supports or {}).items()}
    options = {"n_modes": 12, "skip": 0 if supports else 6} | options
    return FrameModel(nodes, elements, sections, held, **options)


def h_values(named, factors=(1.0,)):
    at = np.array(factors)
    return {f"{key} {bar}": H[key] * SPREAD[bar] * at for key in named for bar in TILTS}


@pytest.mark.parametrize("supports", [None, HELD])
def test_turning_the_frame_or_renumbering_its_nodes_does_not_matter(supports):
    order = np.random.default_rng(2).permutation(13)
    turn = Rotation.from_rotvec([0.7, -1.9, 0.4])
    expected = solve(h_frame(supports=supports))
    for change in ({"order": order}, {} if supports else {"turn": turn}):
        same = solve(h_frame(supports=supports, **change))
        np.testing.assert_allclose(same, expected, rtol=ROUNDING)


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


def test_a_large_frame_is_solved_by_sparse_matrices_as_a_dense_one():
    halves = {k: Section(**BAR | {"E": f"E {k}", "rho": "rho"}) for k in ("in", "out")}
    nodes = [(x, 0.1 * np.sin(9 * x), 0.0) for x in np.linspace(0.0, L, 38)]
    elements = [(i, i + 1, "in" if i < 12 else "out") for i in range(37)]
    values = {"E in": np.array([6e10, 8e10]), "E out": np.full(2, 7e10)}
    values["rho"] = np.array([2700.0, 2900.0])
    solved = []
    for modes in ((1, 2, 3), (1, 2, 3, 5)):  # with a gap they are taken of all
        options = dict(modes=modes, shapes=["37:uy", "20:uz"])
        frame = FrameModel(nodes, elements, halves, {0: "all"}, **options)
        assert len(frame.dofs) > 200
        modal, slopes = frame.jacobian(values)
        slopes = [
            slopes[kind][name] * values[name].max()
            for kind in slopes
            for name in values
        ]
        solved.append([np.abs(x)[..., :3] for x in (*modal, *slopes)])
    for sparse, dense in zip(*solved, strict=True):
        np.testing.assert_allclose(sparse, dense, rtol=1e-6, atol=1e-7 * dense.max())
