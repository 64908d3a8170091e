"""Sparse solutions lack no mode, whatever coincides: structures with symmetries.

Against LAPACK, which finds all eigenvalues, at 200 parameter sets each.
"""

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh
from scipy.sparse import csc_array
from support.beams import assemble, bending, inertia
from support.examples import load

import emcee_femu as ef
from emcee_femu.models import eigen_sparse

SETS = 200
HALVES = [range(6), range(6, 12)]  # of 12 elements


def rotated(K):
    """Return matrices of two bending planes, turned about the axis at each node."""
    n = len(K) // 4  # nodes with (w, r) in each plane
    order = np.arange(4 * n).reshape(2, n, 2).transpose(1, 0, 2).ravel()
    turns = []
    for angle in np.random.default_rng(3).uniform(0, 2 * np.pi, n):
        c, s = np.cos(angle), np.sin(angle)
        turns.append(np.kron([[c, -s], [s, c]], np.eye(2)))
    turn = block_diag(*turns)
    return turn @ K[np.ix_(order, order)] @ turn.T


def pole(lumped=False, free=False):
    """Return M and parts of K of a pole, as stiff in one plane as in the other."""
    kept = slice(0 if free else 2, None)

    def both(block, elements=None):
        one = assemble(block, 12, elements)[kept, kept]
        return rotated(block_diag(one, one))

    return both(inertia(1 / 12, lumped)), [both(bending(1 / 12), e) for e in HALVES]


def mast():
    """Return those of a pole with seven equal pendulums, near its second mode."""
    M, parts = pole()
    count, springs = 7, np.diag(np.r_[np.zeros(len(M)), np.full(7, 485.5 * 1e-3)])
    parts = [block_diag(K, np.zeros((count, count))) for K in parts]
    return block_diag(M, 1e-3 * np.eye(count)), [parts[0] + springs, parts[1]]


def ring():
    """Return those of a ring of 40 masses, bent and stretched, on a soft ground."""
    stretch = 2 * np.eye(40) - np.roll(np.eye(40), 1, 0) - np.roll(np.eye(40), -1, 0)
    return np.eye(40), [stretch + 0.01 * np.eye(40), stretch @ stretch]


def bricks(shape, free):
    """Return those of a square block of bricks, of ``shape`` bricks."""
    brick = load("large_model").brick(np.ones(3)) / 30e9
    nodes = np.array(shape) + 1
    number = np.arange(nodes.prod()).reshape(nodes)
    ends = slice(None, -1), slice(1, None)
    corners = np.stack(
        [number[x, y, z] for z in ends for y in ends for x in ends], -1
    ).reshape(-1, 8)
    at = (3 * corners[:, :, None] + np.arange(3)).reshape(-1, 24)
    K, mass = np.zeros((3 * number.size,) * 2), np.zeros(3 * number.size)
    for rows in at:
        K[np.ix_(rows, rows)] += brick
        mass[rows] += 1 / 8
    # Unequal masses with the symmetry of the block, so that M is a parameter as well.
    middle = 3 * number[tuple(slice(1, -1) if n > 2 else slice(None) for n in nodes)]
    more = np.zeros_like(mass)
    more[np.add.outer(middle.ravel(), np.arange(3)).ravel()] = 0.3
    kept = np.arange(0 if free else 3 * nodes[1] * nodes[2], len(mass))
    if not free and len({*shape}) == 1:  # a cube held in its middle keeps its symmetry
        kept = np.delete(
            np.arange(len(mass)), np.add.outer(middle.ravel(), np.arange(3)).ravel()
        )
    return np.diag(mass + more)[np.ix_(kept, kept)], [K[np.ix_(kept, kept)]]


STRUCTURES = {  # name: (M, parts of K), rigid-body modes, modes
    "pole": (pole(), 0, 9),
    "pole without rotary inertia": (pole(lumped=True), 0, 9),
    "free pole": (pole(free=True), 4, 7),
    "mast": (mast(), 0, 10),
    "ring": (ring(), 0, 8),
    "plate": (bricks((1, 4, 4), False), 0, 8),
    "free plate": (bricks((4, 4, 1), True), 6, 9),
    "cube": (bricks((3, 3, 3), False), 0, 10),
    "free cube": (bricks((2, 2, 2), True), 6, 10),
}


def exact(K, M, count):
    """Return the lowest eigenvalues by LAPACK; of massless DOFs by the flexibility."""
    if np.linalg.matrix_rank(M) < len(M):
        return 1 / eigh(M, K, eigvals_only=True)[: -count - 1 : -1]
    return eigh(K, M, eigvals_only=True, subset_by_index=[0, count - 1])


@pytest.mark.parametrize("name", STRUCTURES)
def test_no_mode_is_missing(name):
    (M, parts), skip, n_modes = STRUCTURES[name]
    stiffness = {f"k{i}": csc_array(K) for i, K in enumerate(parts)}
    zero = csc_array(M.shape)
    model = ef.MatrixModel(zero, csc_array(M), stiffness, n_modes=n_modes, skip=skip)
    assert isinstance(model.problem, eigen_sparse.SparseEigenproblem)
    values = np.random.default_rng(1).lognormal(0, 0.4, (SETS, len(parts)))
    parameters = dict(zip(stiffness, values.T, strict=True))
    found = (2 * np.pi * model(parameters).frequencies) ** 2
    if len(parts) == 1:  # LAPACK need not solve for each factor
        expected = values * exact(parts[0], M, skip + n_modes)
    else:
        expected = [
            exact(sum(map(np.multiply, factors, parts)), M, skip + n_modes)
            for factors in values
        ]
    expected = np.array(expected)[:, skip:]
    assert (
        (np.diff(expected) < 1e-9 * expected[:, 1:]).any(axis=1).all()
    )  # some coincide
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("gap", [0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4])
@pytest.mark.parametrize("copies", [2, 3, 4, 6, 11])
def test_modes_that_nearly_coincide_are_all_found(copies, gap):
    rng = np.random.default_rng(copies)
    squares = np.arange(1.0, 101.0) ** 2
    squares[4 : 4 + copies] = squares[4] * (1 + gap * np.arange(copies))
    axes = np.linalg.qr(rng.normal(size=(100, 100)))[0]
    K, M = csc_array(axes * squares @ axes.T), csc_array(np.eye(100))
    for count in (5, 4 + copies - 1, 4 + copies, 5 + copies):
        found = eigen_sparse.lowest_modes(K, M, count, 0, "here")[0]
        np.testing.assert_allclose(found, np.sort(squares)[:count], rtol=1e-9)


def test_many_equal_modes_of_few_masses_are_all_found():
    M = csc_array(np.diag(np.r_[np.ones(9), np.zeros(30)]))
    K = csc_array(4.0 * np.eye(39))
    values, vectors = eigen_sparse.lowest_modes(K, M, 9, 0, "here")
    np.testing.assert_allclose(values, 4.0)
    np.testing.assert_allclose(vectors.T @ (M @ vectors), np.eye(9), atol=1e-12)
