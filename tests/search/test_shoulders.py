"""Mass beside a maximum that its curvature does not show."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.campaigns import by_hand
from support.free_posterior import box, free_posterior

from emcee_femu.search.climbing import climb
from emcee_femu.search.shoulders import find_shoulders

D = 8
SDS = np.where(np.arange(D) < D // 2, [[2.0], [0.2]], [[0.2], [2.0]])
WEIGHTS = np.array([0.7, 0.3])
LIGHT = np.where(np.arange(D) < 2, 1.5, 0.0)


def crossed(x):
    """Return two flat Gaussians across each other, the lighter one 1.5 off."""
    laws = zip(WEIGHTS, ([0.0] * D, LIGHT), SDS, strict=True)
    parts = [np.log(w) + stats.norm(m, s).logpdf(x).sum(axis=1) for w, m, s in laws]
    return np.logaddexp(*parts)


def gaussian(x):
    return stats.norm(0, SDS[0]).logpdf(x).sum(axis=1)


def looked_for(density, tops):
    """Return maxima from climbs, and what they were before, with their shoulders."""
    c = by_hand(free_posterior(density, box(-12, 12, D)))
    for maximum in climb(c.evaluator, np.array(tops)):
        c.maxima.add(maximum, 0)
    before, alone = c.evaluator.solves, c.maxima.log_evidence
    none = np.empty((0, D)), np.empty(0)
    find_shoulders(c.evaluator, c.maxima, *none, 4, np.inf)
    return c.maxima, alone, c.evaluator.solves - before


def test_the_evidence_of_parts_across_each_other_is_exact_with_shoulders():
    """The curvature at either maximum is that of neither part."""
    maxima, _, _ = looked_for(crossed, [np.zeros(D), LIGHT])
    volume = -D * np.log(24.0)
    (light,) = (one for one in maxima.found if np.abs(one.theta[0] - 1.5) < 0.5)
    assert light.log_evidence < np.log(WEIGHTS[1]) + volume - 2
    assert_allclose(maxima.log_evidence, volume, atol=0.3)
    best = max(maxima.shoulders, key=lambda part: part.log_evidence)
    assert abs(best.log_evidence - np.log(WEIGHTS[1]) - volume) < 1.0
    assert_allclose(best.theta[:4], LIGHT[:4], atol=0.05)
    assert_allclose(np.sqrt(np.diag(best.covariance)), SDS[1], rtol=1.5)


def test_a_gaussian_has_no_shoulders_and_costs_two_solves_by_axis():
    maxima, alone, spent = looked_for(gaussian, [np.zeros(D)])
    assert not maxima.shoulders and maxima.log_evidence == alone
    assert spent == 2 * D


@pytest.mark.parametrize("bend", [0.3, 1.0])
def test_a_shoulder_promises_no_more_than_is_there(bend):
    """A quadratic on the limb of a bent ridge is far too high at its own centre."""

    def banana(x):
        rest = (x[:, 1] - bend * x[:, 0] ** 2) / 0.2
        return -0.5 * (x[:, 0] ** 2 + rest**2 + (x[:, 2:] ** 2).sum(axis=1))

    maxima, _, _ = looked_for(banana, [np.zeros(D)])
    exact = np.log(0.2) + D * (0.5 * np.log(2 * np.pi) - np.log(24.0))
    assert maxima.log_evidence < exact + 1.0
