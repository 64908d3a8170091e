"""Sparse solves of structures with equal modes: none is missing, by dense LAPACK."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh
from support.beams import assemble, bending, inertia
from support.examples import load

from emcee_femu import MatrixModel


def planes(n, lumped=False, copies=2):
    """Return a pole of n elements, with the same stiffness in each plane."""
    halves = np.array_split(np.arange(n), 2)
    one = [assemble(bending(1 / n), n, half)[2:, 2:] for half in halves]
    M = assemble(inertia(1 / n, lumped), n)[2:, 2:]
    return [np.kron(np.eye(copies), A) for A in (*one, M)], 0


def ring(n):
    """Return a free ring, which stretches and bends."""
    K = 2 * np.eye(n) - np.roll(np.eye(n), 1, axis=0) - np.roll(np.eye(n), -1, axis=0)
    return [K, 9 * K @ K, np.eye(n)], 1


def plate(n):
    """Return a square membrane with bending stiffness, held at its edges."""
    line = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K = np.kron(line, np.eye(n)) + np.kron(np.eye(n), line)
    return [K, K @ K, np.eye(n * n)], 0


def cube(n, free):
    """Return a cube of n^3 bricks, held at its faces or free."""
    brick = load("large_model").brick(np.ones(3)) / 1e10
    node = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    K, m = np.zeros((3 * node.size, 3 * node.size)), np.zeros(3 * node.size)
    for x, y, z in np.ndindex(n, n, n):
        nodes = node[z : z + 2, y : y + 2, x : x + 2].reshape(-1, 1)
        at = (3 * nodes + np.arange(3)).ravel()
        K[np.ix_(at, at)] += brick
        m[at] += 1.0
    kept = node if free else node[1:-1, 1:-1, 1:-1]
    at = (3 * kept.reshape(-1, 1) + np.arange(3)).ravel()
    K = K[np.ix_(at, at)]
    return [K, K @ K, np.diag(m[at])], 6 if free else 0


def middles(n):
    """Return two chains alike whose mass, of reduced integration, is singular."""
    line = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    B = np.eye(n - 1, n) + np.eye(n - 1, n, k=1)
    return [np.kron(np.eye(2), A) for A in (line, line @ line, B.T @ B)], 0


def near(gap, copies=3):
    """Return clusters with relative gaps, in units that are mixed by reflections."""
    n = 120 // copies
    values = np.outer(np.arange(1, n + 1) ** 2.0, 1 + gap * np.arange(copies)).ravel()
    v = np.sqrt(np.arange(len(values)) % 7 + 1)
    mirror = np.eye(len(v)) - 2 * np.outer(v, v) / (v @ v)
    return [(mirror * values) @ mirror, np.zeros((len(v),) * 2), np.eye(len(v))], 0


def alike(n):
    """Return a pencil whose modes are all equal, but five."""
    m = np.random.default_rng(4).uniform(0.5, 2.0, n)
    K = m * np.where(np.arange(n) < 5, 0.5, 1.0)
    return [np.diag(K), np.diag(m * (np.arange(n) < 3)), np.diag(m)], 0


STRUCTURES = {
    "pole": planes(30),
    "pole, massless rotations": planes(50, lumped=True),
    "three planes": planes(20, copies=3),
    "ring": ring(150),
    "plate": plate(13),
    "cube, clamped": cube(5, free=False),
    "cube, free": cube(3, free=True),
    "singular mass": middles(70),
    "gaps of 1e-4": near(1e-4),
    "gaps of 1e-8": near(1e-8),
    "gaps of 1e-12": near(1e-12),
    "nine alike": near(1e-8, 9),  # more than the start vectors
    "fourteen alike": near(0.0, 14),
    "all alike": alike(90),
}


def wrong(name, n_modes, draws, seed):
    """Return at how many of the draws an eigenvalue differs from LAPACK's."""
    (K1, K2, M), skip = STRUCTURES[name]
    K = {"a": sparse.csc_array(K1), "b": sparse.csc_array(K2)}
    nothing = sparse.csc_array(M.shape)
    model = MatrixModel(
        nothing, sparse.csc_array(M), K, n_modes=n_modes, skip=skip, shapes=True
    )
    rng = np.random.default_rng(seed)
    at = {"a": rng.uniform(0.5, 2.0, draws), "b": rng.uniform(0.05, 2.0, draws)}
    frequencies, shapes = model(at)
    squares, failed = (2 * np.pi * frequencies) ** 2, 0
    modes = slice(skip, skip + n_modes)
    for i in range(draws):
        shift = squares[i, 0] if skip else 0.0
        A = at["a"][i] * K1 + at["b"][i] * K2 + shift * M
        # The inverse has the lowest modes to more digits.
        inverse = eigh(M, A, eigvals_only=True)[::-1]
        right = np.allclose(squares[i], 1 / inverse[modes] - shift, rtol=1e-7, atol=0)
        phi = shapes[i]
        right &= np.allclose(phi.T @ M @ phi, np.eye(n_modes), atol=1e-8)
        left = np.linalg.solve(A, M @ phi) * (squares[i] + shift) - phi
        right &= bool((np.abs(left.T @ M @ left) < 1e-8**2).all())
        failed += not right
    return failed


EFFORT = [(8, 2)]  # which ends amid equal modes of some structures
EFFORT += [
    pytest.param(n_modes, 67, marks=pytest.mark.slow) for n_modes in (4, 5, 7, 20)
]


@pytest.mark.parametrize(("n_modes", "draws"), EFFORT)
@pytest.mark.parametrize("name", STRUCTURES)
def test_the_lowest_modes_are_all_found(name, n_modes, draws):
    """The law of complete modes: many solves of each structure, each beside LAPACK."""
    assert wrong(name, n_modes, draws, seed=n_modes) == 0


@pytest.mark.parametrize("rank", [9, 25])
def test_many_equal_modes_of_few_masses_are_all_found(rank):
    mass = np.kron(np.eye(rank), np.ones((3, 3)) if rank == 25 else np.eye(1))
    M = sparse.csc_array(np.pad(mass, (0, 30)))
    K = sparse.csc_array(4.0 * np.eye(len(mass) + 30))
    omega = 2.0 / np.sqrt(len(mass) / rank)
    model = MatrixModel(0 * K, M, {"k": K}, n_modes=rank, shapes=True)
    frequencies, shapes = model({"k": np.ones(1)})
    np.testing.assert_allclose(frequencies, omega / (2 * np.pi))
    np.testing.assert_allclose(shapes[0].T @ M @ shapes[0], np.eye(rank), atol=1e-12)
    with pytest.raises(ValueError, match=f"n_modes: .* <= {rank} "):
        MatrixModel(0 * K, M, {"k": K}, n_modes=rank + 1)({"k": np.ones(1)})


def test_an_eigenvalue_that_rounding_made_negative_ends_no_later_than_others(
    monkeypatch,
):
    calls, pivots = [], np.r_[-1e-9, np.linspace(20.0, 400.0, 399)]

    def solve(X):
        calls.append(X)
        return X / pivots[:, None]

    factor = SimpleNamespace(negative=0, solve=solve)
    module = "emcee_femu.models.eigen_sparse"
    monkeypatch.setattr(f"{module}.factor_definite", lambda A: factor)
    K = sparse.csc_array(sparse.diags_array(np.abs(pivots)))
    model = MatrixModel(0 * K, sparse.eye_array(400), {"k": K}, n_modes=2, skip=1)
    shift = 1e-6 * np.median(pivots[1:])
    found = (2 * np.pi * model({"k": np.ones(1)}).frequencies[0]) ** 2
    np.testing.assert_allclose(found, pivots[1:3] - shift, rtol=1e-6)
    assert len(calls) < 50  # of 100 that fill the space
