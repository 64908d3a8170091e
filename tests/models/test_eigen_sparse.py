"""MatrixModel of scipy.sparse matrices: against closed forms and the dense path."""

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh, null_space
from support.beams import assemble, bending, inertia
from support.contracts import assert_shapes

from emcee_femu import MatrixModel

SIZE = 60


def chain(n, free=False, at=None):
    """Return the stiffness of n masses in a row, or of their springs ``at`` alone."""
    K = sparse.lil_array((n, n))
    for spring in range(n + 1) if at is None else at:
        ends = [i for i in (spring - 1, spring) if 0 <= i < n]
        if free and len(ends) == 1:
            continue
        for i in ends:
            K[i, i] += 1.0
        if len(ends) == 2:
            K[ends[0], ends[1]] = K[ends[1], ends[0]] = -1.0
    return K.tocsc()


def groups(free=False):
    """Return matrices of two spring groups and a mass group, of other patterns."""
    K = {
        "lower": 40.0 * chain(SIZE, free, range(0, SIZE // 3)),
        "upper": 90.0 * chain(SIZE, free, range(SIZE // 3, SIZE + 1)),
    }
    M = sparse.lil_array(sparse.eye_array(SIZE))
    M.setdiag(0.3, 7)
    M.setdiag(0.3, -7)
    return K, {"load": M.tocsc()}


def dense(matrices):
    return {name: matrix.toarray() for name, matrix in matrices.items()}


def draw(n, seed=3):
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(0.5, 2.0, n) for name in ("lower", "upper", "load")}


@pytest.mark.parametrize("skip", [0, 1])
@pytest.mark.parametrize("mass_varies", [False, True])
@pytest.mark.parametrize("n_modes", [3, SIZE - 1])
def test_sparse_equals_dense(skip, mass_varies, n_modes):
    K, M = groups(free=skip == 1)
    K0, M0 = sparse.csc_array((SIZE, SIZE)), sparse.eye_array(SIZE, format="csc")
    M = M if mass_varies else {}
    options = {"n_modes": n_modes, "skip": skip, "shapes": [40, 3, 59]}
    ours = MatrixModel(K0, M0, K, M, **options)(draw(4))
    both = MatrixModel(K0.toarray(), M0.toarray(), dense(K), dense(M), **options)
    theirs = both(draw(4))
    assert ours.shapes.shape == (4, 3, n_modes)
    np.testing.assert_allclose(ours.frequencies, theirs.frequencies, rtol=1e-7)
    assert_shapes(ours.shapes, theirs.shapes, atol=1e-6)
    mixed = MatrixModel(K0, M0.toarray(), dense(K), dense(M), **options)(draw(4))
    np.testing.assert_allclose(mixed.frequencies, ours.frequencies, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("free", [False, True])
def test_a_chain_of_30_000_masses_has_its_analytic_frequencies(free):
    """The law of a large model: closed forms, in memory for sparse matrices only."""
    n, diagonal, side = 30_000, np.full(30_000, 2.0), np.full(29_999, -1.0)
    if free:
        diagonal[[0, -1]] = 1.0
    K = sparse.diags_array([diagonal, side, side], offsets=[0, 1, -1])
    nothing, eye = sparse.csc_array((n, n)), sparse.eye_array(n)
    model = MatrixModel(nothing, eye, {"k": K}, n_modes=5, skip=int(free))
    k = np.array([4.0, 9e6])
    half_angle = np.arange(1, 6) * np.pi / (2 * n if free else 2 * (n + 1))
    expected = np.sqrt(k)[:, None] * np.sin(half_angle) / np.pi
    np.testing.assert_allclose(model({"k": k}).frequencies, expected, rtol=1e-7)


@pytest.mark.parametrize("lumped", [False, True])
def test_a_pinned_beam_converges_to_theory(lumped):
    exact, errors = np.arange(1, 5) ** 2 * np.pi / 2, []
    for n in (20, 40):  # massless rotations stay where the mass is lumped
        kept = np.arange(2 * n + 2) % (2 * n) > 0  # all but both deflections
        blocks = bending(1 / n), inertia(1 / n, lumped)
        K, M = (sparse.csc_array(assemble(b, n)[kept][:, kept]) for b in blocks)
        model = MatrixModel(K, M, {}, n_modes=4)
        errors.append(model({}).frequencies[0] / exact - 1)
    assert np.abs(errors[1]).max() < 1e-4
    assert (np.abs(np.log2(errors[0] / errors[1]) - 4) < 0.1).all()


@pytest.mark.parametrize(
    ("n", "stiff", "factor"), [(90, 1e2, 1e9), (90, 1e5, 1e-9), (600, 1e5, 1e9)]
)
def test_rigid_body_modes_are_skipped_at_any_scale(n, stiff, factor):
    # Pairs of masses, rigid but for 1 / stiff, on soft springs: a chain of the pairs.
    K = stiff * chain(n, True, range(1, n, 2)) + chain(n, True, range(2, n, 2))
    model = MatrixModel(factor * K, sparse.eye_array(n), {}, n_modes=4, skip=1)
    omega = 2 * np.sqrt(0.5) * np.sin(np.arange(1, 5) * np.pi / n)
    frequencies = model({}).frequencies[0] / np.sqrt(factor)
    np.testing.assert_allclose(frequencies, omega / (2 * np.pi), rtol=1 / stiff)


@pytest.mark.parametrize("n", [50, 500])
def test_a_free_chain_is_no_elastic_one(n):
    # Its last pivot is rounding, of either sign.
    for seed in range(12):
        k = np.random.default_rng(seed).uniform(1e8, 9e8, n - 1)
        diagonals = [np.append(k, 0) + np.append(0, k), -k, -k]
        K = sparse.diags_array(diagonals, offsets=[0, 1, -1])
        with pytest.raises(ValueError, match=r"mode 1 is not elastic"):
            MatrixModel(K, sparse.eye_array(n), {}, n_modes=3)({})


def test_a_constraint_by_a_lagrange_multiplier_is_solved():
    """Two masses that a multiplier ties: k = 3 + 5 and m = 2; then on a chain."""
    K = sparse.csc_array(np.array([[3.0, 0, 1], [0, 5, -1], [1, -1, 0]]))
    model = MatrixModel(K, sparse.csc_array(np.diag([1.0, 1, 0])), {}, n_modes=1)
    np.testing.assert_allclose(model({}).frequencies, [[2 / (2 * np.pi)]], rtol=1e-9)
    n, tie = 40, np.zeros((2, 40))
    tie[0, [3, 20]], tie[1, [9, 30]] = (1, -1), (1, -2)
    K = np.block([[chain(n).toarray(), tie.T], [tie, np.zeros((2, 2))]])
    M = sparse.csc_array(np.diag(np.r_[np.ones(n), 0, 0]))
    free = null_space(tie)
    exact = eigh(free.T @ chain(n) @ free, eigvals_only=True)[:5]
    found = MatrixModel(sparse.csc_array(K), M, {}, n_modes=5)({}).frequencies[0]
    np.testing.assert_allclose((2 * np.pi * found) ** 2, exact, rtol=1e-8)
