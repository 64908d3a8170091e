"""Masses on springs: textbook frequencies, and matrices built by hand."""

import numpy as np
import pytest
from scipy.linalg import eigh
from support.contracts import assert_model, assert_shapes
from support.derivatives import assert_jacobian

import emcee_femu as ef
from emcee_femu import MassSpringModel

# Application 1 of the paper: nodes 1 to 5 are m1 to m5, node 0 the ground.
PAPER = ef.paper.mass_spring().model
FIVE_MASSES, TEN_SPRINGS = PAPER.masses, PAPER.springs


def five_masses(springs=TEN_SPRINGS, **options):
    return MassSpringModel(FIVE_MASSES, springs, **options)


def matrices_by_hand(parameters, row):
    K = np.zeros((6, 6))  # node by node, the ground included
    for name, (i, j, _) in TEN_SPRINGS.items():
        k = parameters["k2" if name == "k7" else name][row]
        K[[i, j], [i, j]] += k
        K[[i, j], [j, i]] -= k
    return K[1:, 1:], np.diag(FIVE_MASSES)


@pytest.mark.parametrize(
    ("n", "k", "m"), [(1, 1.0, 1.0), (2, 9.0, 4.0), (20, 3.7e6, 0.42)]
)
def test_a_chain_between_walls_has_the_textbook_frequencies(n, k, m):
    springs = {f"k{i}": (i, (i + 1) % (n + 1), k) for i in range(1, n + 1)}
    springs["k0"] = (0, 1, k)
    omega = 2 * np.sqrt(k / m) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    frequencies = MassSpringModel([m] * n, springs)({}).frequencies
    np.testing.assert_allclose(frequencies, [omega / (2 * np.pi)], rtol=1e-12)


@pytest.mark.parametrize("shapes", [False, True, [3, 0]])
def test_modes_are_those_of_matrices_built_by_hand(shapes):
    rng = np.random.default_rng(3)
    parameters = {name: rng.uniform(500.0, 5000.0, 6) for name in TEN_SPRINGS}
    model = five_masses(shapes=shapes)
    assert_model(model, parameters)
    solution = model(parameters)
    dofs = [3, 0] if shapes == [3, 0] else range(5)
    for row in range(6):
        omega_squared, vectors = eigh(*matrices_by_hand(parameters, row))
        expected = np.sqrt(omega_squared) / (2 * np.pi)
        np.testing.assert_allclose(solution.frequencies[row], expected, rtol=1e-12)
        if shapes:
            assert_shapes(solution.shapes[row], vectors[dofs], atol=1e-11)


def test_a_parameter_overrides_the_default_of_its_spring_only():
    changed = TEN_SPRINGS | {"k3": (1, 4, 900.0), "k10": (3, 5, 4100.0)}
    expected = five_masses(changed)({}).frequencies
    parameters = {"k10": np.array([4100.0]), "k3": np.array([900.0])}
    parameters |= {"log_beta": np.array([-3.0]), "k7": np.array([9.0])}  # unread
    frequencies = five_masses()(parameters).frequencies
    np.testing.assert_allclose(frequencies, expected, rtol=1e-12)
    assert not np.allclose(five_masses()({}).frequencies, expected, rtol=1e-3)
    model = five_masses(shapes=[3, 0])
    assert model.names == () and {*model.bounds} == {*TEN_SPRINGS} - {"k7"}
    assert model.variables == ef.modal_variables(5, (3, 0))


@pytest.mark.parametrize("shapes", [False, True])
def test_a_free_chain_has_the_textbook_frequencies_and_masses_as_parameters(shapes):
    n, k, m = 4, 3.7e3, np.array([1.0, 2.5])
    masses = {f"m{i}": 1.0 for i in range(1, n + 1)}
    springs = {f"k{i}": (i, i + 1, k) for i in range(1, n)}
    model = MassSpringModel(masses, springs, skip=1, shapes=shapes)
    omega = 2 * np.sqrt(k / m[:, None]) * np.sin(np.arange(1, n) * np.pi / (2 * n))
    parameters = dict.fromkeys(masses, m)
    found = model(parameters).frequencies
    np.testing.assert_allclose(found, omega / (2 * np.pi), rtol=1e-9)
    assert_model(model, parameters)
    assert_jacobian(model, parameters | {"k1": np.array([k, 2 * k])})


def test_masses_below_zero_and_more_rigid_modes_than_masses_are_refused():
    chain = {"k1": (1, 2, 5.0)}
    with pytest.raises(ValueError, match="masses: .* skip=2"):
        MassSpringModel([1.0, 2.0], chain, skip=2)
    with pytest.raises(ValueError, match="m1"):
        MassSpringModel({"m1": 1.0, "m2": 1.0}, chain, skip=1)({"m1": np.array([-1.0])})
