from itertools import product

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation
from support.modal_models import assert_batch_is_a_loop

from emcee_femu.interfaces import modal_variables
from emcee_femu.measurements import Measurements
from emcee_femu.models.frame.model import DOFS, FrameModel, Section
from emcee_femu.models.paired import PairedModel


def solve(model):
    return model({}).frequencies[0]


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
TURN = Rotation.from_rotvec([0.7, -1.9, 0.4])
HELD = {7: "all", 12: ("ux", "ry")}


def h_frame(
    named=(), base=H, spread=SPREAD, turn=None, order=None, supports=None, **options
):
    turn, order = turn or Rotation.identity(), range(13) if order is None else order
    place, sections = np.argsort(order), {}
    for bar, tilt in TILTS.items():
        values = {key: base[key] * spread[bar] for key in H}
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


def h_matrices(model):
    parts = zip(
        model._mass, model._problem.M[1:], strict=True
    )  # rho varies: none folded
    M = sum(
        model.sections[s].coefficient(k, h_values(["rho"])) * m for (s, k), m in parts
    )
    return model._problem.K[0], M


def rigid_motions(nodes):
    turns = np.stack([np.cross(axis, nodes) for axis in np.eye(3)], axis=2)
    moves, zero = np.broadcast_to(np.eye(3), turns.shape), np.zeros_like(turns)
    return np.block([[moves, turns], [zero, moves]]).reshape(-1, 6)


@pytest.mark.parametrize("supports", [None, HELD])
def test_turning_the_frame_or_renumbering_its_nodes_does_not_matter(supports):
    order = np.random.default_rng(2).permutation(13)
    expected = solve(h_frame(supports=supports))
    for change in ({"order": order}, {} if supports else {"turn": TURN}):
        same = solve(h_frame(supports=supports, **change))
        np.testing.assert_allclose(same, expected, rtol=1e-9)


@pytest.mark.parametrize("turn", [None, TURN])
def test_rigid_motions_have_no_strain_energy_and_the_inertia_of_lines(turn):
    model, nodes = h_frame(["rho"], turn=turn), (turn or TURN**0).apply(H_NODES)
    (K, M), R, inertia = h_matrices(model), rigid_motions(nodes), np.zeros((6, 6))
    assert np.abs(K @ R).max() < 1e-10 * np.abs(K).max()
    for i, j, name in H_BARS:
        span, rho = nodes[j] - nodes[i], H["rho"] * SPREAD[name]
        bar, tangent = model.sections[name], np.r_[0, 0, 0, span] / np.linalg.norm(span)
        per_length = rho * (bar.Iy + bar.Iz) * np.outer(tangent, tangent)
        for s, weight in ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6)):  # Simpson is exact
            motion = rigid_motions([nodes[i] + s * span])[:3]
            line = rho * bar.A * motion.T @ motion + per_length
            inertia += weight * np.linalg.norm(span) * line
    np.testing.assert_allclose(R.T @ M @ R, inertia, rtol=0, atol=1e-14)


@pytest.mark.parametrize("supports", [None, HELD])
def test_shapes_are_mass_normalised_eigenvectors_over_the_free_dofs(supports):
    model = h_frame(["rho"], supports=supports, shapes=True)
    (f, (phi,)), (K, M) = model(h_values(["rho"])), h_matrices(model)
    held = {f"{k}:{dof}" for k, dof in product((7,), DOFS)} | {"12:ux", "12:ry"}
    every = [f"{k}:{dof}" for k, dof in product(range(13), DOFS)]
    assert model.dofs == tuple(d for d in every if not supports or d not in held)
    assert phi.shape == (len(model.dofs), 12)
    np.testing.assert_allclose(phi.T @ M @ phi, np.eye(12), rtol=0, atol=1e-11)
    expected = np.sqrt(eigh(K, M, eigvals_only=True)[model.skip :][:12]) / (2 * np.pi)
    np.testing.assert_allclose(f[0], expected, rtol=1e-9)
    residual = K @ phi - M @ phi * (2 * np.pi * f[0]) ** 2
    assert np.abs(residual).max() < 1e-11 * np.abs(K).max() * np.abs(phi).max()


NAMED = [["E"], ["A"], ["E", "A"], ["rho", "A", "Iy"], list(H)]


@pytest.mark.parametrize("named", NAMED, ids="-".join)
def test_named_properties_equal_numbers_and_a_batch_a_loop_to_the_bit(named):
    model, factors = h_frame(named, shapes=True), np.linspace(0.8, 1.3, 6)
    values = h_values(named, factors)
    assert set(model.names) == set(model.positive) == set(model.required) == set(values)
    assert_batch_is_a_loop(model, values)
    for row, factor in enumerate(factors):
        numbers = solve(h_frame(base=H | {key: factor * H[key] for key in named}))
        batch = model(values).frequencies
        np.testing.assert_allclose(batch[row], numbers, rtol=1e-9)


def test_frequencies_scale_with_the_root_of_stiffness_over_density():
    stiffness, density = h_values(["E", "GJ"], [1, 2, 2]), h_values(["rho"], [1, 1, 4])
    f = h_frame(["E", "GJ", "rho"])(stiffness | density).frequencies
    np.testing.assert_allclose(f[1:], f[0] * np.sqrt([[2.0], [0.5]]), rtol=1e-11)


def test_modes_pick_from_the_lowest():
    picked = h_frame(n_modes=None, modes=(1, 2, 4, 5, 7))
    assert picked.n_modes == 5
    assert np.array_equal(solve(picked), solve(h_frame(n_modes=7))[[0, 1, 3, 4, 6]])


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (None, r"no value for \['E left', 'E mid', 'E right'\]"),
        (0.0, "'E left' must be above zero, got 0;"),
        (np.nan, "'E left' must be above zero, got nan"),
    ],
)
def test_a_missing_or_non_positive_parameter_is_named(value, message):
    values = h_values(["E"], [1.0, 1.0])
    values["E left"][1] = value or 0.0
    with pytest.raises(ValueError, match=message):
        h_frame(["E"])({} if value is None else values)


def test_shapes_at_some_DOFs_are_named_by_node_and_direction():
    full, dofs = h_frame(supports=HELD, shapes=True), ["12:uy", "0:rz", "8:ux"]
    some = h_frame(supports=HELD, shapes=dofs)
    assert full.shape_dofs == full.dofs and some.shape_dofs == tuple(dofs)
    rows = [full.dofs.index(dof) for dof in dofs]
    np.testing.assert_allclose(
        some({}).shapes, full({}).shapes[:, rows], rtol=0, atol=1e-13
    )
    assert some.variables == modal_variables(12, tuple(dofs))
    for wrong, message in ((["12:ux"], "no DOF 12:ux; DOFs are 0:ux"), ([3], "DOF 3")):
        with pytest.raises(ValueError, match=message):
            h_frame(supports=HELD, shapes=wrong)


def test_sensors_are_matched_to_the_DOFs_of_the_same_name():
    # Fault 13: in any order of sensors and of the model's shapes.
    dofs, truth = ["12:uz", "0:uy", "8:uz", "3:uy", "10:uz"], h_values(["E"])
    modes = h_frame(["E"], shapes=dofs, n_modes=5)(truth)
    for order in ([0, 1, 2, 3, 4], [3, 0, 4, 2, 1]):
        labels = [dofs[i] for i in order]
        test = Measurements(
            modes.frequencies[0], shapes=modes.shapes[0][order], dofs=labels
        )
        for shapes in (True, dofs, sorted(dofs)):
            model = PairedModel(h_frame(["E"], shapes=shapes), test, candidates=8)
            np.testing.assert_allclose(model(truth).mac, 1.0, rtol=1e-9)
    test = Measurements(modes.frequencies[0], shapes=modes.shapes[0], dofs=range(5))
    with pytest.raises(ValueError, match="sensors at .0, 1, 2, 3, 4., but the model"):
        PairedModel(h_frame(["E"], shapes=dofs), test, candidates=8)
