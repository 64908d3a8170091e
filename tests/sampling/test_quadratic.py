"""The Gaussian at a maximum: its mass inside bounds, however thin it is."""

import numpy as np
import pytest

from emcee_femu.sampling.quadratic import log_integral, make_positive


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
