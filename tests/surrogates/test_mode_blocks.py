"""Blocks of modes: there and back, smooth through crossings, slopes by differences."""

import numpy as np
import pytest
from support.crossing import matrices, solve

from emcee_femu.surrogates.mode_blocks import Aligned, Modes, Symmetric

RNG = np.random.default_rng(3)
X = RNG.standard_normal((40, 2))
UNIT = np.array([0.5, 0.4, 0.6])


def aligned(first=0, last=3, shape_unit=0.02):
    own = slice(first, last)
    reference = solve(np.zeros((1, 2))).shapes[0][:, own]
    unit = None if shape_unit is None else np.full(reference.shape, shape_unit)
    return Aligned.of(first, UNIT[own], unit, reference)


def symmetric(count):
    return Symmetric.of(0, UNIT[:count], solve(X).eigenvalues[:, :count])


@pytest.mark.parametrize("count", [2, 3])
def test_symmetric_functions_give_the_eigenvalues_back(count):
    modes, block = solve(X), symmetric(count)
    found = block.decode(block.encode(modes)).eigenvalues
    np.testing.assert_allclose(found, modes.eigenvalues[:, :count], atol=1e-6)


def test_they_do_not_mind_the_order_and_are_polynomials_of_the_matrix():
    block, A = symmetric(3), matrices(X)
    values = block.encode(solve(X)) * block.unit
    mean = np.trace(A, axis1=1, axis2=2) / 3
    centred = A - mean[:, None, None] * np.eye(3)
    square, cube = centred @ centred, centred @ centred @ centred
    np.testing.assert_allclose(values[:, 0], mean)
    np.testing.assert_allclose(values[:, 1], np.trace(square, axis1=1, axis2=2) / 3)
    np.testing.assert_allclose(
        values[:, 2], np.trace(cube, axis1=1, axis2=2) / 3, atol=1e-9
    )


@pytest.mark.parametrize("count", [2, 3])
def test_whatever_is_predicted_is_real_and_sorted(count):
    values = RNG.standard_normal((500, count)) * [200.0, *[5.0] * (count - 1)]
    found = symmetric(count).decode(values).eigenvalues
    assert np.isfinite(found).all() and (np.diff(found, axis=1) >= 0).all()
    np.testing.assert_allclose(
        found.mean(axis=1) / symmetric(count).unit[0], values[:, 0]
    )


@pytest.mark.parametrize("sign", [None, 1])
def test_an_aligned_block_gives_modes_back_up_to_sign(sign):
    modes, block = solve(X, seed=sign), aligned()
    found = block.decode(block.encode(modes))
    np.testing.assert_allclose(found.eigenvalues, modes.eigenvalues, rtol=1e-9)
    side = np.sign((found.shapes * modes.shapes).sum(axis=1, keepdims=True))
    np.testing.assert_allclose(found.shapes * side, modes.shapes, atol=1e-7)


def test_signs_of_shapes_do_not_matter_and_A_is_the_matrix_behind():
    block = aligned()
    code = block.encode(solve(X))
    np.testing.assert_allclose(block.encode(solve(X, seed=9)), code, atol=1e-8)
    # At the reference the modes are the basis: A is the matrix in that basis.
    basis = np.linalg.eigh(matrices(np.zeros((1, 2))))[1][0]
    expected = basis.T @ matrices(X) @ basis
    rows, columns = np.triu_indices(3)
    A = code[:, :6] * np.sqrt(UNIT[rows] * UNIT[columns])
    np.testing.assert_allclose(A, expected[:, rows, columns], atol=1e-8)


def test_procrustes_is_the_nearest_rotation():
    from scipy.linalg import orthogonal_procrustes

    block, modes = aligned(), solve(X)
    reference = np.linalg.pinv(block.inverse)
    # Modal coordinates of the reference turn the least squares into the usual ones.
    for i in range(5):
        Q = orthogonal_procrustes((block.inverse @ modes.shapes[i]), np.eye(3))[0]
        A = Q.T @ np.diag(modes.eigenvalues[i]) @ Q
        entries = (A / np.sqrt(np.outer(UNIT, UNIT)))[np.triu_indices(3)]
        np.testing.assert_allclose(block.encode(modes)[i, :6], entries, rtol=1e-9)
        turned = block.encode(modes)[i, 6:].reshape(5, 3) * 0.02
        assert np.abs(turned - reference).max() < 0.6 * np.abs(reference).max()


def test_eigenvalues_alone_through_shapes_and_a_single_mode_without():
    modes = solve(X)
    block = aligned(shape_unit=None)
    found = block.decode(block.encode(modes))
    np.testing.assert_allclose(found.eigenvalues, modes.eigenvalues, rtol=1e-9)
    assert found.shapes is None and block.size == 6
    alone = Aligned.of(1, UNIT[1:2], None, None)
    values = alone.encode(Modes(modes.eigenvalues))
    np.testing.assert_allclose(values * UNIT[1], modes.eigenvalues[:, 1:2])


BLOCKS = [
    aligned(),
    aligned(shape_unit=None),
    symmetric(2),
    symmetric(3),
    aligned(1, 2),
]


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.parametrize("finite", [False, True])
def test_slopes_are_those_of_decoding(block, finite):
    values = block.encode(solve(X[:6]))
    directions = RNG.standard_normal((6, block.size, 4))
    step = 1e-5
    if finite:
        directions *= step
    modes, slopes = block.decode_slopes(values, directions, finite)
    np.testing.assert_array_equal(modes.eigenvalues, block.decode(values).eigenvalues)
    for k in range(4):
        move = directions[:, :, k] * (1.0 if finite else step)
        ahead, behind = block.decode(values + move), block.decode(values - move)
        scale = 2.0 if finite else 2.0 * step
        change = (ahead.eigenvalues - behind.eigenvalues) / scale
        size = np.abs(change).max()
        np.testing.assert_allclose(
            slopes.eigenvalues[:, :, k], change, rtol=1e-5, atol=1e-5 * size
        )
        if modes.shapes is not None:
            side = np.sign((ahead.shapes * modes.shapes).sum(axis=1, keepdims=True))
            back = np.sign((behind.shapes * modes.shapes).sum(axis=1, keepdims=True))
            change = (ahead.shapes * side - behind.shapes * back) / scale
            size = np.abs(change).max()
            np.testing.assert_allclose(
                slopes.shapes[..., k], change, rtol=1e-4, atol=1e-4 * size
            )


@pytest.mark.parametrize("block", BLOCKS)
def test_finite_moves_stay_finite_where_modes_coincide(block):
    modes = Modes(np.full((1, 3), 100.0), solve(np.zeros((1, 2))).shapes)
    values = block.encode(modes)
    directions = 3.0 * np.eye(block.size)[None]
    _, moved = block.decode_slopes(values, directions, True)
    assert np.isfinite(moved.eigenvalues).all()
    assert np.abs(moved.eigenvalues).max() < 30.0
    if moved.shapes is not None:
        assert np.abs(moved.shapes).max() < 10.0


@pytest.mark.parametrize("count", [2, 3])
def test_an_uncertain_gap_is_uncertain_where_modes_coincide(count):
    block = symmetric(count)
    values = block.encode(Modes(np.full((1, 3), 100.0)))
    _, moved = block.decode_slopes(values, np.eye(count)[None], True)
    # Half of what the spread is after the move: before it and behind it is none.
    spread = np.sqrt(block.unit[1]) / 2.0
    assert np.sqrt((moved.eigenvalues[0, :, 1] ** 2).mean()) == pytest.approx(spread)
