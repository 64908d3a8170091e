"""The maxima of a search: which are one, who found them, and what they explain."""

import numpy as np
import pytest
from scipy import stats

from emcee_femu.search.climbing import Maximum
from emcee_femu.search.maxima import NEGLIGIBLE, Maxima

LOG_2_PI = np.log(2 * np.pi)


def maximum(at, sd=1.0, log_evidence=0.0):
    theta, d = np.asarray(at, float), len(at)
    peak = log_evidence - 0.5 * d * LOG_2_PI - d * np.log(sd)
    row = np.array([peak])
    inside = np.zeros(d, bool)
    covariance = sd**2 * np.eye(d)
    return Maximum(theta, row, covariance, np.zeros(d), log_evidence, inside, True, "")


def test_each_maximum_is_there_once_and_knows_who_found_it():
    maxima = Maxima(ensembles=3)
    assert maxima.add(maximum([0.0, 0.0]), 0)
    assert maxima.add(maximum([9.0, 0.0]), 1)
    assert not maxima.add(maximum([0.01, 0.0]), 2)
    assert not maxima.add(maximum([9.0, 0.01]), 1)
    assert not maxima.add(maximum([5.0, 5.0], log_evidence=-np.inf), 0)
    assert maxima.found_by == [[1, 0, 1], [0, 2, 0]]


def test_the_evidence_is_that_of_all_parts():
    maxima = Maxima(ensembles=1)
    maxima.add(maximum([0.0], log_evidence=np.log(0.3)), 0)
    maxima.add(maximum([20.0], log_evidence=np.log(0.5)), 0)
    maxima.shoulders.append(maximum([4.0], log_evidence=np.log(0.2)))
    assert maxima.log_evidence == pytest.approx(0.0)
    np.testing.assert_allclose(maxima.mixture().weights, [0.3, 0.5, 0.2])


def test_a_negligible_maximum_gets_no_component():
    maxima = Maxima(ensembles=1)
    maxima.add(maximum([0.0]), 0)
    maxima.add(maximum([20.0], log_evidence=-NEGLIGIBLE - 0.1), 0)
    assert len(maxima.found) == 2 and len(maxima.mixture().weights) == 1


def test_nothing_is_unexplained_where_the_density_is_that_of_the_parts():
    maxima, shares = Maxima(ensembles=1), [0.3, 0.7]
    for share, at in zip(shares, ([0.0, 0.0], [6.0, 1.0]), strict=True):
        maxima.add(maximum(at, log_evidence=np.log(share)), 0)
    theta = np.random.default_rng(0).normal(scale=4.0, size=(50, 2))
    parts = [
        np.log(share) + stats.multivariate_normal(at).logpdf(theta)
        for share, at in zip(shares, ([0.0, 0.0], [6.0, 1.0]), strict=True)
    ]
    heights = np.logaddexp(*parts)
    np.testing.assert_allclose(maxima.excess(theta, heights), 0.0, atol=0.01)
    np.testing.assert_allclose(maxima.excess(theta, heights + 3.0), 3.0, atol=0.01)
    near = maxima.nearest(np.array([5.5, 0.5]))
    np.testing.assert_allclose(near, np.eye(2), rtol=1e-6)
