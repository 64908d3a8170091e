"""MatrixModel of dense matrices: against scipy, closed forms, and what it refuses."""

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh
from support.contracts import assert_model, assert_shapes

import emcee_femu as ef
from emcee_femu import MatrixModel

SIZE = 7
CASES = {
    "constant M": ("ab", ""),
    "M of its own parameter": ("a", "c"),
    "M of two, K of none": ("", "bc"),
    "a name in both K and M": ("ab", "bc"),
}


def spd(rng):
    root = rng.normal(size=(SIZE, SIZE))
    return root @ root.T + SIZE * np.eye(SIZE)


def matrices(case):
    rng = np.random.default_rng(11)
    K0, M0 = 50.0 * spd(rng), spd(rng)
    in_K, in_M = CASES[case]
    return K0, M0, {name: 30 * spd(rng) for name in in_K}, {n: spd(rng) for n in in_M}


def combined(constant, units, parameters, row):
    return constant + sum(parameters[name][row] * u for name, u in units.items())


def free_chain(n):
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = K[-1, -1] = 1.0
    return K


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("shapes", [False, True, [4], np.array([5, 0, 2])])
def test_frequencies_and_shapes_agree_with_scipy(case, shapes):
    K0, M0, K, M = matrices(case)
    rng = np.random.default_rng(5)
    parameters = {name: rng.uniform(0.2, 3.0, 4) for name in {**K, **M}}
    model = MatrixModel(K0, M0, K, M, n_modes=4, shapes=shapes)
    assert_model(model, parameters)
    dofs = [] if shapes is False else range(SIZE) if shapes is True else list(shapes)
    solution = model(parameters)
    assert (solution.shapes is None) == (shapes is False)
    for row in range(4):
        k = combined(K0, K, parameters, row)
        m = combined(M0, M, parameters, row)
        omega_squared, vectors = eigh(k, m)
        expected = np.sqrt(omega_squared[:4]) / (2 * np.pi)
        np.testing.assert_allclose(solution.frequencies[row], expected, rtol=1e-10)
        if len(dofs):
            assert_shapes(solution.shapes[row], vectors[dofs][:, :4], atol=1e-10)


def test_the_model_says_what_it_reads_and_returns():
    K0, M0, K, M = matrices("a name in both K and M")
    model = MatrixModel(K0, M0, K, M, n_modes=np.int64(3))
    assert model.names == ("a", "b", "c") and (model.n_modes, model.skip) == (3, 0)
    assert model.variables == ef.modal_variables(3)
    with pytest.raises(ValueError, match=r"no value for \['c'\]"):
        model({"a": np.ones(2), "b": np.ones(2)})
    declared = MatrixModel(K0, M0, K, M, n_modes=3, shapes=[4, 1])
    assert declared.variables["shapes"].coords["dof"] == (4, 1) == declared.shape_dofs
    named = MatrixModel(K0, M0, K, M, n_modes=3, shapes={"roof": 4, "base": 1})
    assert named.variables["shapes"].coords["dof"] == ("roof", "base")
    assert named.shape_dofs == (4, 1)


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_array])
def test_an_asymmetry_of_printed_digits_is_averaged_out(kind):
    nearly = np.eye(30) + 0.1 * (np.eye(30, k=2) + np.eye(30, k=-2))
    nearly[1, 2] = 9e-7
    model = MatrixModel(kind(nearly), kind(np.eye(30)), {}, n_modes=1)
    assert model.K0[1, 2] == model.K0[2, 1] == 4.5e-7
    nearly[1, 2] = 2e-6
    with pytest.raises(ValueError, match="K0: expected a symmetric .* up to 2e-06 "):
        MatrixModel(kind(nearly), kind(np.eye(30)), {}, n_modes=1)


FREE = {"k": free_chain(5)}
ONE, INDEFINITE = {"k": np.eye(5)}, {"m": np.diag([1.0, 1, 1, 1, 0])}


@pytest.mark.parametrize(
    ("K0", "K", "M", "skip", "message"),
    [
        (0, FREE, {}, 0, r"mode 1 is not elastic.*at \{'k': 4.0\}.*beyond skip=0"),
        (0, FREE, {}, 2, r"skip=2, but mode 2 is elastic: 0\.\d+ Hz at \{'k': 4.0\}"),
        (1, ONE, {}, 1, r"skip=1, but mode 1 is elastic: 0\.\d+ Hz at \{'k': 4.0\}"),
        (-5, ONE, {}, 0, r"omega\^2 = -1 .*at \{'k': 4.0\}"),
        (1, ONE, INDEFINITE, 0, r"mass .* at \{'k': 8.0, 'm': -3.0\}"),
    ],
)
@pytest.mark.parametrize("kind", [np.asarray, sparse.csc_array])
def test_wrong_matrices_are_named_by_their_parameters(kind, K0, K, M, skip, message):
    K, M = ({n: kind(A) for n, A in units.items()} for units in (K, M))
    model = MatrixModel(
        kind(K0 * np.eye(5)), kind(np.eye(5)), K, M, n_modes=2, skip=skip
    )
    if kind is not np.asarray and K0 < 0:  # a pivot says no more
        message = r"mode 1 is not elastic .*at \{'k': 4.0\}"
    with pytest.raises(ValueError, match=message):
        model({"k": np.array([4.0, 8.0]), "m": np.array([2.0, -3.0])})
    with pytest.raises(ValueError, match="K0 and M0 swapped"):
        MatrixModel(np.eye(5), FREE["k"], {}, n_modes=1)


@pytest.mark.parametrize("kind", [np.asarray, sparse.csc_array])
def test_of_several_sets_that_with_a_mass_below_zero_is_named(kind):
    units = {"a": kind(np.diag([1.0, 0.0])), "b": kind(np.diag([0.0, 1.0]))}
    K0 = kind(np.array([[2.0, -1.0], [-1.0, 2.0]]))
    model = MatrixModel(K0, 0 * K0, {}, units, n_modes=1)
    with pytest.raises(ValueError, match="mass .*'a': -1.0, 'b': 100"):
        model({"a": np.array([1.0, -1.0, 2.0]), "b": np.array([1.0, 100.0, 2.0])})


@pytest.mark.parametrize("kind", [np.array, sparse.csc_array])
def test_rows_of_held_dofs_are_named(kind):
    """A free chain of four with two rows that an export kept, and parts of it."""
    held = np.pad(free_chain(4), (1, 1)) + np.diag([1.0, 0, 0.5, 0, 0, 1.0])
    K, M, part = kind(held), kind(np.eye(6)), kind(np.diag([0.0, 0, 1, 0, 0, 0]))
    makers = [
        lambda: MatrixModel(0 * K, M, {"E": K}, n_modes=2),
        lambda: MatrixModel(K, 0 * M, {}, {"rho": M}, n_modes=2),
        lambda: MatrixModel(K, M, {"k": part}, n_modes=2),
        lambda: MatrixModel.from_differences((K, M), {"E": {2: (2 * K, M)}}, n_modes=2),
    ]
    for make in makers:
        # By themselves both have omega = 1.
        with pytest.warns(UserWarning, match=r"0 \(0\.1592 Hz\), 5 \(0\.1592 Hz\)"):
            make()
    K = kind(np.diag([1.0, 4.0, 9.0]))
    MatrixModel(0 * K, kind(np.eye(3)), {"k": K}, n_modes=2)  # modal coordinates


@pytest.mark.parametrize("held", [1e13, 1e36])
@pytest.mark.parametrize("lumped", [True, False])
def test_dofs_that_a_large_stiffness_holds_are_held(held, lumped):
    """A dense solver rounds all eigenvalues to a share of the largest one."""
    n, kept = 8, [1, 2, 3, 4, 6, 7]
    K = 1e3 * (free_chain(n) + np.diag([1.0, *np.zeros(n - 1)]))
    M = np.eye(n) if lumped else (4 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)) / 6
    ground = 1e3 * np.diag([0.0, 0, 0, 0, 0, 0, 0, 1.0])
    penalty = np.diag([1.0, 0, 0, 0, 0, 1.0, 0, 0])
    options = {"n_modes": 4, "shapes": kept}
    model = MatrixModel(0 * K, M, {"k": K, "g": ground, "p": penalty}, **options)
    inner = np.ix_(kept, kept)
    K1, M1, g1 = K[inner], M[inner], ground[inner]
    exact = MatrixModel(0 * K1, M1, {"k": K1, "g": g1}, n_modes=4, shapes=True)
    given = {"k": np.array([1.0, 0.7]), "g": np.array([0.5, 2.0])}
    firmly = given | {"p": np.full(2, held)}
    solution, slopes = model.jacobian(firmly)
    expected, by = exact.jacobian(given)
    close = {"rtol": 1e-3 / held + 1e-8, "atol": 1e-8}
    np.testing.assert_allclose(solution.frequencies, expected.frequencies, **close)
    np.testing.assert_allclose(model(firmly).frequencies, expected.frequencies, **close)
    assert_shapes(solution.shapes, expected.shapes, **close)
    for name in given:
        np.testing.assert_allclose(
            slopes["frequency"][name], by["frequency"][name], rtol=1e-6, atol=1e-8
        )
    both = firmly | {"p": np.array([1e3, held])}
    for i, row in enumerate(model(both).frequencies):  # others in it change nothing
        alone = model({name: value[[i]] for name, value in both.items()})
        np.testing.assert_array_equal(row, alone.frequencies[0])
