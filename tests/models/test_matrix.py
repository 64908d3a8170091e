import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh
from support.modal_models import assert_batch_is_a_loop

from emcee_femu.interfaces import modal_variables
from emcee_femu.models.matrix import MatrixModel

SIZE = 7
CASES = {
    "constant M": ({"a", "b"}, set()),
    "M of its own parameter": ({"a"}, {"c"}),
    "M of two, K of none": (set(), {"b", "c"}),
    "a name in both K and M": ({"a", "b"}, {"b", "c"}),
}


def spd(rng, size=SIZE):
    root = rng.normal(size=(size, size))
    return root @ root.T + size * np.eye(size)


def matrices(case, seed=11):
    rng = np.random.default_rng(seed)
    in_K, in_M = CASES[case]
    K0, M0 = 50.0 * spd(rng), spd(rng)
    K = {name: 30.0 * spd(rng) for name in sorted(in_K)}
    M = {name: spd(rng) for name in sorted(in_M)}
    return K0, M0, K, M


def random_parameters(n, seed=5):
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(0.2, 3.0, n) for name in "abc"}


def combined(constant, units, parameters, row):
    return constant + sum(parameters[name][row] * u for name, u in units.items())


def free_chain(n):
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = K[-1, -1] = 1.0
    return K


@pytest.mark.parametrize("case", list(CASES))
@pytest.mark.parametrize("shapes", [False, True])
def test_frequencies_and_shapes_agree_with_scipy(case, shapes):
    K0, M0, K, M = matrices(case)
    parameters = random_parameters(5)
    model = MatrixModel(K0, M0, K, M, n_modes=4, shapes=shapes)
    solution = model(parameters)
    assert solution.frequencies.shape == (5, 4)
    assert (solution.shapes is not None) == shapes
    for row in range(5):
        k = combined(K0, K, parameters, row)
        m = combined(M0, M, parameters, row)
        omega_squared, vectors = eigh(k, m)
        expected = np.sqrt(omega_squared[:4]) / (2 * np.pi)
        np.testing.assert_allclose(solution.frequencies[row], expected, rtol=1e-10)
        if shapes:
            phi = solution.shapes[row]
            np.testing.assert_allclose(phi.T @ m @ phi, np.eye(4), atol=1e-12, rtol=0)
            signs = np.sign(np.sum(phi * vectors[:, :4], axis=0))
            np.testing.assert_allclose(phi * signs, vectors[:, :4], atol=1e-10, rtol=0)


@pytest.mark.parametrize("case", list(CASES))
@pytest.mark.parametrize("dofs", [[4], np.array([5, 0, 2]), range(SIZE)[::-1]])
def test_shapes_at_some_DOFs_are_those_rows_in_that_order(case, dofs):
    K0, M0, K, M = matrices(case)
    parameters = random_parameters(3)
    full = MatrixModel(K0, M0, K, M, n_modes=4, shapes=True)
    some = MatrixModel(K0, M0, K, M, n_modes=4, shapes=dofs)
    assert full.shape_dofs == tuple(range(SIZE)) and some.shape_dofs == tuple(dofs)
    expected = full(parameters).shapes[:, list(dofs)]
    np.testing.assert_allclose(some(parameters).shapes, expected, atol=1e-14, rtol=0)


@pytest.mark.parametrize("case", list(CASES))
@pytest.mark.parametrize("n", [2, 9, 40])
def test_a_batch_equals_a_loop_to_the_bit(case, n):
    K0, M0, K, M = matrices(case)
    model = MatrixModel(K0, M0, K, M, n_modes=SIZE, shapes=True)
    assert_batch_is_a_loop(model, random_parameters(n))


def test_a_mass_parameter_of_one_equals_the_folded_constant_mass():
    K0, M0, K, _ = matrices("constant M")
    parameters = random_parameters(6) | {"one": np.ones(6)}
    folded = MatrixModel(K0, M0, K, n_modes=5)(parameters)
    split = MatrixModel(K0, 0.25 * M0, K, {"one": 0.75 * M0}, n_modes=5)(parameters)
    np.testing.assert_allclose(folded.frequencies, split.frequencies, rtol=1e-12)


def test_the_constant_mass_may_be_zero_where_a_parameter_carries_it():
    K0, M0, _, _ = matrices("constant M")
    model = MatrixModel(K0, np.zeros_like(M0), {}, {"m": M0}, n_modes=SIZE)
    f = model({"m": np.array([1.0, 4.0])}).frequencies
    np.testing.assert_allclose(f[1], f[0] / 2, rtol=1e-12)
    expected = np.sqrt(eigh(K0, M0, eigvals_only=True)) / (2 * np.pi)
    np.testing.assert_allclose(f[0], expected, rtol=1e-12)


@pytest.mark.parametrize("n", [2, 5, 30])
@pytest.mark.parametrize("mass_varies", [False, True])
def test_a_free_chain_skips_its_rigid_body_mode(n, mass_varies):
    K0, M0 = np.zeros((n, n)), np.zeros((n, n)) if mass_varies else np.eye(n)
    M = {"m": np.eye(n)} if mass_varies else {}
    model = MatrixModel(K0, M0, {"k": free_chain(n)}, M, n_modes=n - 1, skip=1)
    k, m = np.array([1.0, 900.0]), np.array([1.0, 2.5] if mass_varies else [1.0, 1.0])
    omega = 2 * np.sin(np.arange(1, n) * np.pi / (2 * n)) * np.sqrt(k / m)[:, None]
    frequencies = model({"k": k, "m": m}).frequencies
    np.testing.assert_allclose(frequencies, omega / (2 * np.pi), rtol=1e-11)


@pytest.mark.parametrize(
    ("skip", "message"),
    [
        (0, r"mode 1 is not elastic.*at \{'k': 4.0\}.*beyond skip=0"),
        (2, r"skip=2, but mode 2 is elastic: 0\.\d+ Hz at \{'k': 4.0\}.*fewer"),
    ],
)
def test_a_wrong_count_of_rigid_body_modes_is_refused(skip, message):
    K = {"k": free_chain(5)}
    model = MatrixModel(np.zeros((5, 5)), np.eye(5), K, n_modes=2, skip=skip)
    with pytest.raises(ValueError, match=message):
        model({"k": np.array([4.0])})


def test_a_parameter_that_makes_K_negative_is_named_by_its_value():
    model = MatrixModel(np.eye(2), np.eye(2), {"k": np.eye(2)}, n_modes=1)
    with pytest.raises(ValueError, match=r"omega\^2 = -1 .*at \{'k': -2.0\}"):
        model({"k": np.array([1.0, -2.0, 3.0])})


def test_a_parameter_that_makes_M_indefinite_is_named_by_its_value():
    K = {"k": np.eye(2)}
    model = MatrixModel(np.eye(2), np.eye(2), K, {"m": np.diag([1.0, 0.0])}, n_modes=1)
    parameters = {"k": np.array([7.0, 8.0, 9.0]), "m": np.array([-0.5, -3.0, 2.0])}
    message = r"mass matrix is not positive definite at \{'k': 8.0, 'm': -3.0\}"
    with pytest.raises(ValueError, match=message):
        model(parameters)


def test_the_model_says_what_it_reads_and_returns():
    K0, M0, K, M = matrices("a name in both K and M")
    model = MatrixModel(K0, M0, K, M, n_modes=np.int64(3), skip=0)
    assert model.names == model.required == ("a", "b", "c")
    assert (model.n_modes, model.skip) == (3, 0)
    assert model.variables == modal_variables(3)
    declared = MatrixModel(K0, M0, K, M, n_modes=3, shapes=[4, 1]).variables
    assert declared["shapes"].coords == {"dof": (4, 1), "mode": range(1, 4)}


def test_a_model_without_parameters_solves_once():
    K0, M0, _, _ = matrices("constant M")
    frequencies = MatrixModel(K0, M0, {}, n_modes=2)({}).frequencies
    expected = np.sqrt(eigh(K0, M0, eigvals_only=True)[:2]) / (2 * np.pi)
    np.testing.assert_allclose(frequencies, expected[None], rtol=1e-12)


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_array])
def test_an_asymmetry_of_printed_digits_is_averaged_out(kind):
    nearly = np.eye(30)
    nearly[1, 2] = 9e-9
    model = MatrixModel(kind(nearly), kind(np.eye(30)), {}, n_modes=1)
    assert model.K0[1, 2] == model.K0[2, 1] == 4.5e-9
    nearly[1, 2] = 2e-8
    with pytest.raises(ValueError, match="K0: expected a symmetric .* up to 2e-08 "):
        MatrixModel(kind(nearly), kind(np.eye(30)), {}, n_modes=1)


@pytest.mark.parametrize("missing", ["a", "c"])
def test_a_missing_parameter_is_named(missing):
    K0, M0, K, M = matrices("a name in both K and M")
    parameters = random_parameters(2)
    del parameters[missing]
    with pytest.raises(ValueError, match=rf"no value for \['{missing}'\]"):
        MatrixModel(K0, M0, K, M, n_modes=1)(parameters)


I2, I3 = np.eye(2), np.eye(3)
SKEWED = np.array([[1.0, 0.5], [0.0, 1.0]])


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_array])
@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"K0": SKEWED}, ValueError, r"K0: expected a symmetric.*up to 0.5 "),
        ({"M0": SKEWED}, ValueError, r"M0: expected a symmetric"),
        ({"K": {"a": SKEWED}}, ValueError, r"K\['a'\]: expected a symmetric"),
        ({"M": {"b": SKEWED}}, ValueError, r"M\['b'\]: expected a symmetric"),
        ({"K0": np.ones((2, 3))}, ValueError, r"K0: expected a square.*\(2, 3\)"),
        ({"M0": I3}, ValueError, r"M0: expected the shape of K0, \(2, 2\)"),
        ({"K": {"a": I3}}, ValueError, r"K\['a'\]: expected the shape of K0"),
        ({"M": {"b": I3}}, ValueError, r"M\['b'\]: expected the shape of K0"),
        ({"M0": np.diag([1.0, -1.0])}, ValueError, r"M0.* positive definite"),
        ({"M0": [[1.0, 2.0], [2.0, 1.0]]}, ValueError, r"M0.* positive definite"),
        (
            {"M0": [[1.0, 1.1], [1.1, 1.0]]},
            ValueError,
            r"M0.* positive definite.*massless",
        ),
        ({"M0": 0 * I2}, ValueError, r"M0.* positive definite.*massless"),
        ({"K0": np.diag([1.0, np.nan])}, ValueError, r"K0: .*finite.*\(1, 1\)"),
        ({"K": {"": I2}}, TypeError, r"K, M: expected non-empty strings"),
        ({"n_modes": 3}, ValueError, r"n_modes: .*<= 2 .*got 0 \+ 3"),
        ({"skip": 2}, ValueError, r"n_modes: .*<= 2 .*got 2 \+ 1"),
        ({"n_modes": 0}, ValueError, r"n_modes: expected at least 1, got 0"),
        ({"n_modes": 1.0}, TypeError, r"n_modes: expected a whole number, got 1.0"),
        ({"shapes": [1, 2]}, ValueError, r"shapes: no DOF 2; DOFs are 0 to 1"),
        ({"shapes": [1, 1]}, ValueError, r"shapes: each DOF once"),
        ({"shapes": [-1]}, ValueError, r"shapes: expected at least 0, got -1"),
        ({"shapes": [1.0]}, TypeError, r"shapes: expected a whole number"),
        ({"shapes": []}, ValueError, r"shapes: expected at least one DOF"),
        ({"shapes": "all"}, TypeError, r"shapes: expected True, False or DOFs"),
    ],
)
def test_wrong_arguments_are_refused_by_name(changed, error, message, kind):
    arguments = {"K0": I2, "M0": I2, "K": {"a": I2}} | changed
    matrices = {
        label: {name: kind(matrix) for name, matrix in given.items()}
        if isinstance(given, dict)
        else kind(given)
        for label, given in arguments.items()
        if label in ("K0", "M0", "K", "M")
    }
    with pytest.raises(error, match=message):
        MatrixModel(**{"n_modes": 1} | arguments | matrices)


def test_dense_matrices_need_mass_at_each_DOF():
    with pytest.raises(ValueError, match=r"M0: .*massless DOFs by static"):
        MatrixModel(I2, np.diag([1.0, 0.0]), {}, n_modes=1)
