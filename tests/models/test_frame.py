from itertools import product

import numpy as np
import pytest
from scipy.optimize import brentq

from emcee_femu.models.frame.model import DOFS, FrameModel, Section

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
def test_frequencies_converge_to_theory_in_fourth_order_and_of_rods_in_second(
    family, ends
):
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
def test_supports_make_a_plane_frame_with_the_modes_of_its_clamped_legs(degrees):
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
