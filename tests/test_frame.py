import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from emcee_femu.models.frame import DOFS, FrameModel, Section

L = 1.3
BAR = dict(E=7.1e10, GJ=700.0, rho=2750.0, A=3e-4, Iy=2e-9, Iz=9e-9)
POLAR = BAR["rho"] * (BAR["Iy"] + BAR["Iz"])
MASS = BAR["rho"] * BAR["A"]
# The default orientation makes local y the global z: Iz resists uz, Iy resists uy.
PLANES = {"uz": (("uz", "ry"), "Iz"), "uy": (("uy", "rz"), "Iy")}


def roots(equation, first):
    return np.array([brentq(equation, j * np.pi, (j + 1) * np.pi) for j in first])


BETA_L = {
    "cantilever": roots(lambda x: np.cos(x) + 1 / np.cosh(x), range(4)),
    "pinned": np.pi * np.arange(1, 5),
    "free": roots(lambda x: np.cos(x) - 1 / np.cosh(x), range(1, 5)),
}


def bending(ends, inertia):
    omega = (BETA_L[ends] / L) ** 2 * np.sqrt(BAR["E"] * inertia / MASS)
    return omega / (2 * np.pi)


def rod(stiffness, mass, ends, count):
    j = np.arange(1, count + 1) - (0.5 if ends == "cantilever" else 0.0)
    return j / (2 * L) * np.sqrt(stiffness / mass)


def beam(n, supports=None, orientation=(0.0, 0.0, 1.0), **options):
    nodes = [(x, 0.0, 0.0) for x in np.linspace(0.0, L, n + 1)]
    elements = [(i, i + 1, "bar") for i in range(n)]
    section = Section(**BAR, orientation=orientation)
    return FrameModel(nodes, elements, {"bar": section}, supports, **options)


def only(free, n, ends):
    held = [dof for dof in DOFS if dof not in free]
    supports = {node: held for node in range(n + 1)}
    if ends == "cantilever":
        supports[0] = "all"
    if ends == "pinned":
        supports[0] = supports[n] = [*held, free[0]]
    return supports


def solve(model):
    return model({}).frequencies[0]


@pytest.mark.parametrize("plane", list(PLANES))
@pytest.mark.parametrize("ends", list(BETA_L))
def test_bending_converges_with_fourth_order_to_euler_bernoulli(ends, plane):
    free, inertia = PLANES[plane]
    skip = 2 if ends == "free" else 0
    exact = bending(ends, BAR[inertia])[:3]
    errors = []
    for n in (8, 16):
        model = beam(n, only(free, n, ends), n_modes=3, skip=skip)
        errors.append(solve(model) / exact - 1)
    assert (errors[1] > 0).all()  # a consistent mass bounds from above
    assert (errors[1] < [1e-7, 2e-6, 1.2e-5]).all()
    rates = np.log2(errors[0][1:] / errors[1][1:])  # the first is near rounding
    assert (np.abs(rates - 4) < 0.15).all()


@pytest.mark.parametrize("ends", ["cantilever", "free"])
@pytest.mark.parametrize(
    ("dof", "stiffness", "mass"),
    [("ux", BAR["E"], BAR["rho"]), ("rx", BAR["GJ"], POLAR)],
    ids=["axial", "torsion"],
)
def test_rods_converge_with_second_order(dof, stiffness, mass, ends):
    exact = rod(stiffness, mass, ends, 3)
    errors = []
    for n in (24, 48):
        model = beam(n, only((dof,), n, ends), n_modes=3, skip=int(ends == "free"))
        errors.append(solve(model) / exact - 1)
    assert (errors[1] > 0).all()
    assert (errors[1] < 2e-3).all()
    assert (np.abs(np.log2(errors[0] / errors[1]) - 2) < 0.03).all()


@pytest.mark.parametrize("ends", list(BETA_L))
def test_a_beam_in_space_has_the_modes_of_both_planes_and_both_rods(ends):
    supports = {
        "cantilever": {0: "all"},
        "pinned": {0: ("ux", "uy", "uz", "rx"), 20: ("uy", "uz")},
        "free": None,
    }[ends]
    rods = "free" if ends == "free" else "cantilever"
    families = [bending(ends, BAR["Iz"]), bending(ends, BAR["Iy"])]
    families += [
        rod(BAR["GJ"], POLAR, rods, 2),
        rod(BAR["E"], BAR["rho"], rods, 1),
    ]
    exact = np.sort(np.concatenate(families))
    covered = exact[exact <= min(family.max() for family in families[:3])]
    assert len(covered) >= 6
    skip = 6 if ends == "free" else 0
    model = beam(20, supports, n_modes=len(covered), skip=skip)
    np.testing.assert_allclose(solve(model), covered, rtol=1e-3)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 75.0, 90.0])
def test_a_tilted_section_bends_with_the_moment_of_its_tilt(degrees):
    tilt = np.deg2rad(degrees)  # of local y from global y
    orientation = (5.0, 2 * np.cos(tilt), 2 * np.sin(tilt))
    inertia = BAR["Iz"] * np.cos(tilt) ** 2 + BAR["Iy"] * np.sin(tilt) ** 2
    free = PLANES["uy"][0]
    model = beam(16, only(free, 16, "cantilever"), orientation, n_modes=2)
    np.testing.assert_allclose(
        solve(model), bending("cantilever", inertia)[:2], rtol=2e-6
    )


BARS = {
    "a": Section(**(BAR | {"rho": "rho_a"}), orientation=(0.3, 0.5, 1.0)),
    "b": Section(**(BAR | {"rho": "rho_b", "A": 5e-4}), orientation=(1.0, 0.2, 0.4)),
}
DENSITY = {"rho_a": np.array([2750.0]), "rho_b": np.array([7900.0])}


def h_frame(
    turn=None, order=None, sections=BARS, supports=None, scale=1.0, **options
):
    """Two legs that are not parallel, joined by a middle bar."""
    legs = [(0, -0.3, 0), (0, 0, 0), (0, 0.2, 0), (0.3, 0, 0), (0.6, 0.1, 0)]
    nodes = scale * np.array([*legs, (0.6, 0.1, -0.2), (0.6, 0.35, 0.3)], dtype=float)
    elements = [
        (0, 1, "a"), (1, 2, "a"), (1, 3, "b"), (3, 4, "b"), (5, 4, "a"), (4, 6, "a")
    ]  # fmt: skip
    if turn is not None:
        nodes = turn.apply(nodes)
        sections = {
            name: Section(
                **{key: getattr(s, key) for key in BAR},
                orientation=tuple(turn.apply(s.orientation)),
            )
            for name, s in sections.items()
        }
    if order is not None:
        nodes = nodes[order]
        place = np.argsort(order)
        elements = [(int(place[i]), int(place[j]), s) for i, j, s in elements]
        supports = {int(place[k]): held for k, held in (supports or {}).items()}
    options = {"n_modes": 12, "skip": 0 if supports else 6} | options
    return FrameModel(nodes, elements, sections, supports, **options), nodes, elements


def matrices(model):
    """K and M of a model whose K is constant and whose M is not: neither is folded."""
    M = model._problem.M0.copy()
    for (section, kind), unit in zip(model._mass, model._problem.M, strict=True):
        M += model.sections[section].coefficient(kind, DENSITY) * unit
    return model._problem.K0, M


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("supports", [None, {0: "all", 5: "all"}])
def test_a_turned_frame_has_the_same_frequencies(seed, supports):
    turn = Rotation.random(random_state=seed)
    expected = h_frame(supports=supports)[0](DENSITY).frequencies
    turned = h_frame(turn, supports=supports)[0](DENSITY).frequencies
    np.testing.assert_allclose(turned, expected, rtol=1e-9)


@pytest.mark.parametrize("supports", [None, {0: "all", 5: ("ux", "ry")}])
def test_the_numbers_of_the_nodes_do_not_matter(supports):
    order = np.random.default_rng(2).permutation(7)
    expected = h_frame(supports=supports)[0](DENSITY).frequencies
    renumbered = h_frame(order=order, supports=supports)[0](DENSITY).frequencies
    np.testing.assert_allclose(renumbered, expected, rtol=1e-9)


def rigid_motions(nodes):
    columns = np.zeros((len(nodes), 6, 6))
    for axis in range(3):
        unit = np.eye(3)[axis]
        columns[:, axis, axis] = columns[:, 3 + axis, 3 + axis] = 1.0
        columns[:, :3, 3 + axis] = np.cross(unit, nodes)
    return columns.reshape(-1, 6)


def test_rigid_motions_have_no_strain_energy_and_the_inertia_of_lines():
    model, nodes, elements = h_frame(Rotation.random(random_state=8))
    K, M = matrices(model)
    R = rigid_motions(nodes)
    assert np.abs(K @ R).max() < 1e-10 * np.abs(K).max()
    inertia = np.zeros((6, 6))  # by quadrature along every bar
    points, weights = np.polynomial.legendre.leggauss(4)
    for i, j, name in elements:
        bar, span = model.sections[name], nodes[j] - nodes[i]
        length, rho = np.linalg.norm(span), DENSITY[bar.rho][0]
        tangent = np.r_[np.zeros(3), span / length]
        for s, w in zip((points + 1) / 2, weights * length / 2, strict=True):
            motion = rigid_motions((nodes[i] + s * span)[None])
            inertia += w * rho * bar.A * motion[:3].T @ motion[:3]
        inertia += rho * (bar.Iy + bar.Iz) * length * np.outer(tangent, tangent)
    scale = np.sqrt(np.outer(np.diag(inertia), np.diag(inertia)))
    np.testing.assert_allclose(R.T @ M @ R / scale, inertia / scale, rtol=0, atol=1e-12)


@pytest.mark.parametrize("supports", [None, {0: "all", 6: ("uz",)}])
def test_shapes_are_mass_normalised_eigenvectors(supports):
    model = h_frame(supports=supports, shapes=True)[0]
    frequencies, shapes = model(DENSITY)
    K, M = matrices(model)
    phi, omega = shapes[0], 2 * np.pi * frequencies[0]
    assert phi.shape == (len(model.dofs), 12)
    np.testing.assert_allclose(phi.T @ M @ phi, np.eye(12), rtol=0, atol=1e-10)
    residual = K @ phi - M @ phi * omega**2
    assert np.abs(residual).max() < 1e-10 * np.abs(K).max() * np.abs(phi).max()
    expected = np.sqrt(eigh(K, M, eigvals_only=True)[model.skip :][:12]) / (2 * np.pi)
    np.testing.assert_allclose(frequencies[0], expected, rtol=1e-9)
