"""The Gaussian at a maximum: its mass inside bounds, however thin it is."""

import numpy as np
import pytest
from scipy import stats

from emcee_femu.sampling.quadratic import log_integral, make_positive, moments_inside


@pytest.mark.parametrize("seed", range(20))
def test_the_mass_of_a_very_thin_gaussian_is_that_of_its_draws(seed):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    values = np.array([1e14, 1e6, 1.0, 1.0])
    curvature = make_positive((axes * values) @ axes.T)
    draws = rng.standard_normal((100_000, 4)) / np.sqrt(values) @ axes.T
    inside = (np.abs(draws) < 1.0).all(axis=1).mean()
    expected = np.log(inside) + 0.5 * (4 * np.log(2 * np.pi) - np.log(values).sum())
    found = log_integral(np.zeros(4), curvature, np.full(4, -1.0), np.full(4, 1.0))
    np.testing.assert_allclose(found, expected, atol=0.15)


def test_the_moments_of_a_gaussian_inside_bounds_are_those_of_its_cut_marginals():
    mean, sd = np.array([-0.5, 1.0, 3.0]), np.array([1.0, 2.0, 0.1])
    low, high = np.array([0.0, 0.5, -9.0]), np.array([np.inf, 2.0, 9.0])
    ends = (low - mean) / sd, (high - mean) / sd
    laws = [stats.truncnorm(*args) for args in zip(*ends, mean, sd, strict=True)]
    means, sds = np.array([(law.mean(), law.std()) for law in laws]).T
    centre, covariance = moments_inside(mean, np.diag(sd**2), low, high)
    np.testing.assert_allclose((centre - means) / sds, 0.0, atol=0.1)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), sds, rtol=0.08)
    assert abs(covariance[0, 1]) < 0.1 * sds[0] * sds[1]


def test_the_moments_of_a_correlated_gaussian_inside_bounds_are_those_of_its_draws():
    mean, covariance = np.array([-0.5, 0.0]), np.array([[1.0, -0.7], [-0.7, 1.0]])
    rng = np.random.default_rng(1)
    draws = rng.multivariate_normal(mean, covariance, 400_000)
    draws = draws[(draws > 0.5).all(axis=1)]
    low, high = np.full(2, 0.5), np.full(2, np.inf)
    centre, found = moments_inside(mean, covariance, low, high)
    sds = draws.std(axis=0)
    np.testing.assert_allclose((centre - draws.mean(axis=0)) / sds, 0.0, atol=0.15)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), sds, rtol=0.15)


def test_a_saddle_keeps_its_scales():
    turned = np.array([[0.8, -0.6], [0.6, 0.8]])
    saddle = turned @ np.diag([-4.0, 9.0]) @ turned.T
    expected = turned @ np.diag([4.0, 9.0]) @ turned.T
    np.testing.assert_allclose(make_positive(saddle), expected, atol=1e-12)
