"""Frames in a plane: closed forms, the frame in space, words for supports, refusals."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from emcee_femu import FrameModel, Section

E, RHO, A, INERTIA, L = 2.1e11, 7850.0, 4e-3, 9e-6, 3.0
FLAT = Section(E=(E, "e"), rho=RHO, A=A, I=INERTIA)
PLANES = {"xy": (0, 1, "rz"), "xz": (0, 2, "ry"), "yz": (1, 2, "rx")}
ONE = {"e": np.ones(1)}


def beam(plane, supports, n=16, **options):
    points = np.column_stack([np.linspace(0, L, n + 1), np.zeros(n + 1)])
    bars = [(i, i + 1, "bar") for i in range(n)]
    held = {node % (n + 1): how for node, how in supports.items()}
    options = {"n_modes": 2} | options
    return FrameModel(points, bars, {"bar": FLAT}, held, plane=plane, **options)


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize(
    ("supports", "beta"),
    [
        ({0: "fixed"}, [1.8751041, 4.6940911]),
        ({0: "pinned", -1: "roller"}, [np.pi, 2 * np.pi]),
        ({0: "fixed", -1: "roller"}, [3.9266023, 7.0685827]),
        ({0: "fixed", -1: "all"}, [4.7300407, 7.8532046]),
    ],
)
def test_beams_in_each_plane_and_by_words_for_supports(plane, supports, beta):
    exact = (np.array(beta) / L) ** 2 * np.sqrt(E * INERTIA / (RHO * A)) / (2 * np.pi)
    found = beam(plane, supports)(ONE).frequencies[0]
    assert_allclose(found, exact, rtol=6e-5)  # (beta L / n)^4 / 1440


@pytest.mark.parametrize("plane", PLANES)
def test_a_portal_is_that_in_space_without_the_dofs_out_of_its_plane(plane):
    first, second, turn = PLANES[plane]
    flat = np.array([(0, 0), (0, 2), (1.5, 2.5), (3, 2), (3, 0)], dtype=float)
    bars = [(i, i + 1, "bar") for i in range(4)]
    bars[1] = (1, 2, "bar", ((0.1, 0.0), None))
    masses, springs = [(2, 30.0, (0.0, 0.2), 1.5)], [(3, None, {f"u{plane[0]}": 4e5})]
    options = {"masses": masses, "springs": springs, "n_modes": 4, "shapes": True}
    supports = {0: "fixed", 4: "pinned"}
    model = FrameModel(flat, bars, {"bar": FLAT}, supports, plane=plane, **options)
    assert set(model.dofs[:3]) == {f"1:u{plane[0]}", f"1:u{plane[1]}", f"1:{turn}"}

    def lift(vector):
        lifted = np.zeros(3)
        lifted[[first, second]] = vector
        return tuple(lifted)

    normal, kept = 3 - first - second, {f"u{plane[0]}", f"u{plane[1]}", turn}
    out = {"ux", "uy", "uz", "rx", "ry", "rz"} - kept
    moments = tuple(1.5 * np.eye(3)[normal])
    options["masses"] = [(2, 30.0, lift((0.0, 0.2)), moments)]
    bars[1] = (1, 2, "bar", (lift((0.1, 0.0)), None))
    solid = Section(
        E=(E, "e"), GJ=1.0, rho=RHO, A=A, Iy=INERTIA, Iz=5 * INERTIA,
        orientation=tuple(np.eye(3)[normal]),
    )  # fmt: skip
    held = dict.fromkeys(range(5), out) | {0: "all"}
    held[4] = out | kept - {turn}
    space = FrameModel([lift(x) for x in flat], bars, {"bar": solid}, held, **options)
    assert model.dofs == space.dofs
    assert_allclose(model(ONE).frequencies, space(ONE).frequencies, rtol=1e-9)
    assert_allclose(
        np.abs(model(ONE).shapes), np.abs(space(ONE).shapes), rtol=1e-6, atol=1e-9
    )


def test_a_section_of_two_sides_in_a_plane_is_asked_about_and_the_cures_work():
    points = [(x, 0, 0) for x in np.linspace(0, L, 9)]
    bars, sides = [(i, i + 1, "bar") for i in range(8)], {"Iy": 1e-7, "Iz": INERTIA}
    values = {"E": (E, "e"), "GJ": 1.0, "rho": RHO, "A": A, **sides}
    held = dict.fromkeys(range(9), ("uz", "rx", "ry")) | {0: "all"}
    with pytest.raises(ValueError, match=r"xy.*plane='xy'.*orientation=\(0, 0, 1\)"):
        FrameModel(points, bars, {"bar": Section(**values)}, held, n_modes=1)
    by_side = {}
    for normal in ((0, 0, 1), (0, 1, 0)):
        section = Section(**values, orientation=normal)
        model = FrameModel(points, bars, {"bar": section}, held, n_modes=1)
        by_side[normal] = model(ONE).frequencies[0, 0]
    flat = beam("xy", {0: "fixed"}, 8, n_modes=1)(ONE).frequencies[0, 0]
    assert_allclose(by_side[0, 1, 0], flat, rtol=1e-9)
    assert_allclose(by_side[0, 0, 1], flat * np.sqrt(1e-7 / INERTIA), rtol=1e-6)


SOLID = Section(E=E, GJ=1.0, rho=RHO, A=A, Iy=INERTIA, Iz=INERTIA)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"plane": None}, "plane='xy'"),
        ({"plane": "x"}, "plane"),
        ({"nodes": [(0, 0, 0), (1, 0, 0)]}, "nodes"),
        ({"sections": {"bar": SOLID}}, "A, I"),
        ({"supports": {0: "clamped"}}, "'fixed'"),
        ({"supports": {0: ["uz"]}}, "supports"),
        ({"springs": [(1, None, {"uz": 1.0})]}, "springs"),
        ({"masses": [(1, 1.0, (0.0, 0.0, 0.1))]}, "masses"),
    ],
)
def test_what_does_not_fit_a_plane_is_refused_by_name(changed, words):
    given = {"nodes": [(0, 0), (1, 0)], "elements": [(0, 1, "bar")], "plane": "xy"}
    given |= {"sections": {"bar": FLAT}, "supports": {0: "fixed"}, "n_modes": 1}
    FrameModel(**given)
    with pytest.raises((ValueError, TypeError), match=words):
        FrameModel(**given | changed)


def test_a_section_says_what_it_lacks():
    for missing in ("rho", "A"):
        values = {"E": E, "rho": RHO, "A": A, "I": INERTIA}
        values.pop(missing)
        with pytest.raises(TypeError, match=missing):
            Section(**values)
    with pytest.raises(TypeError, match="Iz"):
        Section(E=E, rho=RHO, A=A, I=INERTIA, Iz=INERTIA)
