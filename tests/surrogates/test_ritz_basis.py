"""The Ritz basis: its estimate, projection, principal directions and points."""

import numpy as np
import pytest
from scipy.linalg import eigh
from support.reduced_beam import BOUNDS, OPTIONS, beam, draws

from emcee_femu.models.matrix import MatrixModel, sparse_problem
from emcee_femu.surrogates.full_model import FullModel
from emcee_femu.surrogates.ritz_basis import empty_basis
from emcee_femu.surrogates.ritz_points import corners, independent_points


@pytest.fixture(scope="module")
def full():
    return MatrixModel(*beam(), **OPTIONS)


@pytest.fixture(scope="module")
def basis(full):
    """Return a basis of the shapes at the centre and at another point."""
    problem = sparse_problem(full)
    k = np.array([[1.0, 1.0, 25.0], [0.7, 1.2, 40.0]])
    found = empty_basis(problem, k[0], k[0, :0], 0.0, 0.0, np.random.default_rng(1))
    for row in k:
        found = found.extend(*problem.lowest(row, row[:0], 7, "here"))
    return found


def test_the_estimate_is_the_error_within_a_factor_of_two_or_so(full, basis):
    parameters = draws(25)
    k = np.array([*parameters.values()]).T
    exact = full(parameters).frequencies
    ritz = basis.projection.eigenproblem(False).solve(k, k[:, :0], str)
    true = ritz.frequencies / exact - 1
    ratio = (basis.projection.estimate(k, k[:, :0]) / true)[true > 1e-8]
    assert ratio.size > 100
    assert 0.8 < np.median(ratio) < 1.25
    low, high = np.quantile(ratio, [0.05, 0.95])
    assert 0.4 < low and high < 2.5


def test_the_shape_error_is_what_no_close_mode_explains(full):
    problem, centre = sparse_problem(full), np.array([1.0, 1.0, 25.0])
    basis = empty_basis(problem, centre, centre[:0], 0.0, 0.0, np.random.default_rng(1))
    basis = basis.extend(*problem.lowest(centre, centre[:0], 7, "here"))
    box = np.array([*BOUNDS.values()])
    point = np.array([0.9, 0.0, 1.0])
    measured = FullModel(full, problem, BOUNDS).errors(
        basis.projection, basis.vectors, point[None]
    )
    k = box[:, 0] + point * (box[:, 1] - box[:, 0])
    stiffness = full.K0 + sum(c * q for c, q in zip(k, full.K.values(), strict=True))
    values, exact = eigh(stiffness.toarray(), full.M0.toarray())
    ritz = basis.projection.eigenproblem().solve(k[None], k[None, :0], str)
    f, g = np.sqrt(values) / (2 * np.pi), ritz.frequencies[0]
    mac = (exact.T @ (full.M0 @ (basis.vectors @ ritz.shapes[0]))) ** 2
    explained = np.where(np.abs(f[:, None] / g - 1) < 0.02, mac, 0.0).sum(axis=0)
    np.testing.assert_allclose(measured[0], np.abs(g / f[:5] - 1).max(), rtol=1e-4)
    np.testing.assert_allclose(measured[1], (1 - explained).max(), rtol=1e-3)
    assert measured[1] > 1e-4


def test_the_basis_is_orthonormal_and_holds_its_snapshots(full, basis):
    V, A = basis.vectors, basis.A
    np.testing.assert_allclose(V.T @ (A @ V), np.eye(V.shape[1]), atol=1e-6)
    row = {"left": np.array([0.7]), "middle": np.array([1.2]), "spring": [40.0]}
    k = np.array([[0.7, 1.2, 40.0]])
    ritz = basis.projection.eigenproblem(False).solve(k, k[:, :0], str).frequencies
    np.testing.assert_allclose(ritz, full(row).frequencies, rtol=1e-9)
    for q, projected in zip(
        basis.matrices[0], basis.projection.matrices[0], strict=True
    ):
        np.testing.assert_allclose(V.T @ (q @ V), projected, atol=1e-6)


def test_more_principal_directions_err_less(full, basis):
    parameters = draws(10)
    k = np.array([*parameters.values()]).T
    exact = full(parameters).frequencies
    turned = basis.projection.rotate(basis.principal_directions())
    errors = []
    for size in (5, 7, 9, 11):
        part = turned.rotate(np.eye(len(turned.matrices[0][0]))[:, :size])
        f = part.eigenproblem(False).solve(k, k[:, :0], str).frequencies
        errors.append((f / exact - 1).max())
    assert all(a > 2 * b for a, b in zip(errors, errors[1:], strict=False))


@pytest.mark.parametrize("d", [1, 2, 6, 12])
def test_test_points_are_corners_that_were_no_candidates_and_uniform_ones(d):
    rng = np.random.default_rng(0)
    outer = corners(d, rng)
    assert len(outer) == min(2**d, 1024) or d > 10
    assert len({tuple(c) for c in outer}) == len(outer)
    points = independent_points(outer, outer[5:9], 12, rng)
    assert points.shape == (12, d)
    used = {tuple(c) for c in outer[5:9]}
    assert not used & {tuple(p) for p in points}
    at_corner = np.isin(points, [0.0, 1.0]).all(axis=1)
    assert at_corner.sum() == min(6, len(outer) - len(outer[5:9]))
