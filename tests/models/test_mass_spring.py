import numpy as np
import pytest
from scipy.linalg import eigh
from support.modal_models import assert_batch_is_a_loop

from emcee_femu import paper
from emcee_femu.interfaces import modal_variables
from emcee_femu.models.mass_spring import MassSpringModel

# Application 1 of the paper: nodes 1 to 5 are m1 to m5, node 0 the ground.
FIVE_MASSES, TEN_SPRINGS = (
    getattr(paper.mass_spring().model, name) for name in ("masses", "springs")
)


def five_mass_model(**options):
    return MassSpringModel(FIVE_MASSES, TEN_SPRINGS, **options)


def random_stiffnesses(n, seed=3):
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(500.0, 5000.0, n) for name in TEN_SPRINGS}


def matrices_by_hand(parameters, row):
    K = np.zeros((6, 6))  # node by node, the ground included
    for name, (i, j, _) in TEN_SPRINGS.items():
        k = parameters["k2" if name == "k7" else name][row]
        K[i, i] += k
        K[j, j] += k
        K[i, j] -= k
        K[j, i] -= k
    return K[1:, 1:], np.diag(FIVE_MASSES)


@pytest.mark.parametrize("n", [1, 2, 5, 20])
@pytest.mark.parametrize(("k", "m"), [(1.0, 1.0), (3.7e6, 0.42)])
def test_fixed_fixed_chain_has_the_textbook_frequencies(n, k, m):
    springs = {f"k{i}": (i, (i + 1) % (n + 1), k) for i in range(1, n + 1)}
    springs["k0"] = (0, 1, k)
    if n == 1:
        springs["k1"] = (1, 0, k)
    model = MassSpringModel([m] * n, springs)
    j = np.arange(1, n + 1)
    omega = 2 * np.sqrt(k / m) * np.sin(j * np.pi / (2 * (n + 1)))
    frequencies = model({}).frequencies
    assert frequencies.shape == (1, n)
    np.testing.assert_allclose(frequencies[0], omega / (2 * np.pi), rtol=1e-12)


def test_frequencies_agree_with_scipy_on_matrices_built_by_hand():
    parameters = random_stiffnesses(6)
    frequencies = five_mass_model()(parameters).frequencies
    for row in range(6):
        omega_squared = eigh(*matrices_by_hand(parameters, row), eigvals_only=True)
        expected = np.sqrt(omega_squared) / (2 * np.pi)
        np.testing.assert_allclose(frequencies[row], expected, rtol=1e-12)


def test_a_parameter_overrides_the_default_of_its_spring_only():
    changed = TEN_SPRINGS | {"k3": (1, 4, 900.0), "k10": (3, 5, 4100.0)}
    expected = MassSpringModel(FIVE_MASSES, changed)({}).frequencies
    parameters = {"k10": np.array([4100.0]), "k3": np.array([900.0])}
    assert np.array_equal(five_mass_model()(parameters).frequencies, expected)
    assert not np.allclose(five_mass_model()({}).frequencies, expected, rtol=1e-3)


@pytest.mark.parametrize("other", ["log_beta", "k7"])
def test_a_parameter_that_no_spring_reads_does_not_change_the_frequencies(other):
    values = {"k1": np.array([4000.0, 4100.0]), other: np.array([-3.0, 9.0])}
    with_other = five_mass_model()(values).frequencies
    del values[other]
    assert np.array_equal(with_other, five_mass_model()(values).frequencies)


@pytest.mark.parametrize("k2", [None, 900.0])
def test_a_follower_has_the_stiffness_of_its_leader(k2):
    value = TEN_SPRINGS["k2"][2] if k2 is None else k2
    own = TEN_SPRINGS | {"k2": (0, 1, value), "k7": (0, 2, value)}
    expected = MassSpringModel(FIVE_MASSES, own)({}).frequencies
    parameters = {} if k2 is None else {"k2": np.array([k2])}
    frequencies = five_mass_model()(parameters).frequencies
    np.testing.assert_allclose(frequencies, expected, rtol=1e-13)


def test_neither_the_order_of_springs_nor_that_of_their_ends_matters():
    parameters, expected = random_stiffnesses(4), five_mass_model()
    backwards = dict(reversed(TEN_SPRINGS.items()))
    swapped = {name: (j, i, k) for name, (i, j, k) in TEN_SPRINGS.items()}
    for springs in (backwards, swapped):
        same = MassSpringModel(FIVE_MASSES, springs)(parameters).frequencies
        np.testing.assert_allclose(same, expected(parameters).frequencies, rtol=1e-13)


@pytest.mark.parametrize("shapes", [False, True])
@pytest.mark.parametrize("n", [2, 7, 64])
def test_a_batch_equals_a_loop_to_the_bit(n, shapes):
    assert_batch_is_a_loop(five_mass_model(shapes=shapes), random_stiffnesses(n))


def test_shapes_are_mass_normalised_eigenvectors():
    parameters = random_stiffnesses(5)
    frequencies, shapes = five_mass_model(shapes=True)(parameters)
    assert shapes.shape == (5, 5, 5)
    for row in range(5):
        K, M = matrices_by_hand(parameters, row)
        phi, omega = shapes[row], 2 * np.pi * frequencies[row]
        np.testing.assert_allclose(phi.T @ M @ phi, np.eye(5), rtol=0, atol=1e-13)
        residual = K @ phi - M @ phi * omega**2
        assert np.abs(residual).max() < 1e-12 * np.abs(K @ phi).max()


def test_shapes_come_where_they_are_asked_for():
    parameters = random_stiffnesses(3)
    plain, full, some = (
        five_mass_model(shapes=shapes)(parameters) for shapes in (False, True, [3, 0])
    )
    assert plain.shapes is None
    np.testing.assert_allclose(plain.frequencies, full.frequencies, rtol=1e-13)
    np.testing.assert_allclose(some.shapes, full.shapes[:, [3, 0]], rtol=1e-13)
    assert five_mass_model(shapes=[3, 0]).shape_dofs == (3, 0)
    with pytest.raises(ValueError, match="no DOF 5; DOFs are 0 to 4"):
        five_mass_model(shapes=[5])


def test_the_model_says_what_it_reads_and_returns():
    model = five_mass_model()
    assert model.names == tuple(name for name in TEN_SPRINGS if name != "k7")
    assert model.positive == model.names
    assert model.n_modes == 5
    assert five_mass_model(shapes=[3, 0]).variables == modal_variables(5, (3, 0))


def test_later_changes_of_the_arguments_do_not_reach_the_model():
    masses, springs = np.array(FIVE_MASSES), dict(TEN_SPRINGS)
    model = MassSpringModel(masses, springs)
    masses[:] = 1.0
    springs.clear()
    assert np.array_equal(model({}).frequencies, five_mass_model()({}).frequencies)


@pytest.mark.parametrize("stiffness", [1.0, 1e9])
def test_a_system_without_ground_is_refused_as_a_rigid_body(stiffness):
    model = MassSpringModel([1.0, 2.0], {"k": (1, 2, stiffness)})
    with pytest.raises(ValueError, match=r"mode 1 is not elastic.*rigid-body.*skip=0"):
        model({})


@pytest.mark.parametrize("value", [0.0, -5.0, np.nan])
def test_a_stiffness_parameter_that_is_not_positive_is_named(value):
    parameters = {
        "k1": np.array([1.0, 2.0, 3.0]),
        "k6": np.array([4000.0, value, 4000.0]),
    }
    with pytest.raises(ValueError, match=rf"'k6' must be above zero, got {value:g}"):
        five_mass_model()(parameters)


ONE = {"k": (0, 1, 1.0)}
CHAIN = ONE | {"l": (0, 1, "k"), "m": (0, 1, "l")}


@pytest.mark.parametrize(
    ("masses", "springs", "error", "message"),
    [
        ([1.0, 0.0], ONE, ValueError, r"masses: .*above zero, got 0.0 at index \(1,\)"),
        ([-1.0], ONE, ValueError, r"masses: .*above zero, got -1.0 at index \(0,\)"),
        ([1.0, np.nan], ONE, ValueError, r"masses: .*finite.*nan at index \(1,\)"),
        ([1.0], [(0, 1, 1.0)], TypeError, r"springs: expected \{name: .*got list"),
        ([1.0], {}, ValueError, r"springs: expected at least one"),
        ([1.0], {1: (0, 1, 1.0)}, TypeError, r"springs: expected non-empty strings"),
        ([1.0], {"k": (0, 1)}, TypeError, r"springs\['k'\]: expected \(node, node"),
        ([1.0], {"k": (0, 2, 1.0)}, ValueError, r"'k'\]: no node 2; .* to 1"),
        ([1.0], {"k": (-1, 1, 1.0)}, ValueError, r"'k'\]: expected at least 0, got -1"),
        ([1.0], {"k": (0, 1.0, 1.0)}, TypeError, r"'k'\]: .*whole number, got 1.0"),
        ([1.0], {"k": (1, 1, 1.0)}, ValueError, r"'k'\]: both ends are node 1"),
        ([1.0], {"k": (0, 1, 0.0)}, ValueError, r"'k'\]: .*above zero, got 0"),
        ([1.0], {"k": (0, 1, np.inf)}, ValueError, r"'k'\]: .*finite numbers, got inf"),
        ([1.0], ONE | {"l": (0, 1, "z")}, ValueError, r"'l'\]: .*'z'; .* \['k'\]"),
        ([1.0], ONE | {"l": (0, 1, "l")}, ValueError, r"'l'\]: .*to follow, got 'l'"),
        ([1.0], CHAIN, ValueError, r"springs\['m'\]: .*of its own to follow, got 'l'"),
    ],
)
def test_wrong_arguments_are_refused_by_name(masses, springs, error, message):
    with pytest.raises(error, match=message):
        MassSpringModel(masses, springs)
