"""Student-t mixtures and their fit to weighted draws, by SciPy and closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from emcee_femu.moves.mixture_em import Mixture, draw, improve, log_density

S1 = np.array([[2.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 0.5]])
LAW = Mixture(
    np.array([0.3, 0.7]),
    np.array([[0.0, 1.0, 2.0], [3.0, -1.0, 0.0]]),
    np.array([S1, np.diag([1e-4, 1.0, 9.0])]),
    8.0,
)
GAUSSIAN = 1e12  # degrees of freedom


@pytest.mark.parametrize("d", [1, 3])
def test_the_density_is_that_of_scipy(d):
    law = Mixture(LAW.weights, LAW.means[:, :d], LAW.matrices[:, :d, :d], 3.5)
    x = 3 * np.random.default_rng(1).normal(size=(50, d))
    parts = [
        weight * stats.multivariate_t(mean, matrix, df=3.5).pdf(x)
        for weight, mean, matrix in zip(*law[:3], strict=True)
    ]
    assert_allclose(log_density(x, law), np.log(np.sum(parts, axis=0)), rtol=1e-9)


def test_draws_have_the_moments_of_the_mixture():
    n = 20_000
    x = draw(np.random.default_rng(2), LAW, n)
    mean = LAW.weights @ LAW.means
    assert (np.abs(x.mean(axis=0) - mean) < 4.5 * x.std(axis=0) / n**0.5).all()
    products = np.einsum("ni,nj->nij", x - mean, x - mean)
    apart = LAW.means - mean
    exact = LAW.matrices * 8 / 6 + np.einsum("ki,kj->kij", apart, apart)
    error = products.std(axis=0) / n**0.5
    wrong = products.mean(axis=0) - np.tensordot(LAW.weights, exact, 1)
    assert (np.abs(wrong) < 4.5 * error).all()


def test_one_gaussian_has_the_moments_of_the_weighted_draws():
    rng = np.random.default_rng(3)
    x, shares = rng.normal(size=(200, 3)), rng.random(200) ** 4
    shares /= shares.sum()
    before = 2 * np.eye(3)
    start = Mixture(np.ones(1), np.full((1, 3), 5.0), before[None], GAUSSIAN)
    fit, gained = improve(x, shares, start)
    mean = shares @ x
    covariance = (shares * (x - mean).T) @ (x - mean)
    n = 1 / np.sum(shares**2)  # draws that the weights are worth
    assert_allclose(fit.means[0], mean, rtol=1e-6)
    expected = (n * covariance + 4 * before) / (n + 4)  # d + 1 draws said before
    assert_allclose(fit.matrices[0], expected, rtol=1e-6)
    assert gained == pytest.approx(shares @ log_density(x, fit), rel=1e-9)


def test_weighted_draws_of_another_law_give_the_target():
    """Uniform draws with the weights of a mixture are fitted by that mixture."""
    rng = np.random.default_rng(4)
    law = Mixture(
        np.array([0.25, 0.75]),
        np.array([[-3.0, 0], [2, 1]]),
        np.array([S1[:2, :2]] * 2),
        8,
    )
    x = rng.uniform(-12, 12, (40_000, 2))
    shares = np.exp(log_density(x, law))
    shares /= shares.sum()
    start = law._replace(weights=np.full(2, 0.5), means=law.means + 0.7)
    fit, _ = improve(x, shares, start, tolerance=1e-7)
    assert_allclose(fit.weights, law.weights, atol=0.02)
    assert_allclose(fit.means, law.means, atol=0.1)
    assert_allclose(fit.matrices, law.matrices, atol=0.15)


def test_a_component_without_draws_is_dropped():
    x = np.random.default_rng(5).normal(size=(100, 2))
    start = Mixture(
        np.full(2, 0.5), np.array([[0.0, 0], [1e3, 0]]), np.array([np.eye(2)] * 2), 8.0
    )
    fit, _ = improve(x, np.full(100, 0.01), start)
    assert fit.weights.tolist() == [1.0]
    assert np.abs(fit.means).max() < 1
