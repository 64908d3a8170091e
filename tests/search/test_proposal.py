"""Components are known by what they are for, wherever they stand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from emcee_femu.moves.mixture import Mixture
from emcee_femu.search.proposal import CARRIER, TAIL, Component, Proposal, assign

CENTRES = np.array([[0.0, 0.0], [1.0, 0.0], [9.0, 9.0], [-9.0, 9.0]])
WEIGHTS = np.array([0.4, 0.3, 0.2, 0.1])
CORE = Mixture(WEIGHTS, CENTRES, np.tile(np.eye(2), (4, 1, 1)), 8.0)


def test_the_law_is_nine_parts_the_core_and_bounds_its_weights():
    """Importance weights of a law within the spread of the core have a bound."""
    law = Proposal.fitted(CORE).law
    x = np.random.default_rng(1).uniform(-30, 30, (2_000, 2))
    core, whole = np.exp(CORE.log_density(x)), np.exp(law.log_density(x))
    assert (whole >= 0.9 * core * (1 - 1e-12)).all()
    rest = Proposal.fitted(CORE).law.draw(np.random.default_rng(2), 40_000)
    mean, covariance = rest.mean(axis=0), np.cov(rest.T)
    drawn = CORE.draw(np.random.default_rng(3), 40_000)
    assert_allclose(mean, drawn.mean(axis=0), atol=0.2)
    # .9 of the core, .1 of its covariance times 2^2.
    assert_allclose(covariance, 1.3 * np.cov(drawn.T), rtol=0.1, atol=1.0)


def test_without_its_defence_a_proposal_is_its_core():
    proposal = Proposal.fitted(CORE)
    assert_allclose(proposal.undefended.weights, WEIGHTS, rtol=1e-12)
    assert_allclose(proposal.undefended.means, CENTRES)


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 1, 0, 2], [2, 3, 1, 0]])
def test_no_position_means_anything(order):
    """Parts in another order: the same law, the same maxima, as often of each kind."""
    new = [Component(0.1, np.array([-9.0, 9.5]), np.eye(2))]
    shuffled = Mixture(WEIGHTS[order], CENTRES[order], CORE.matrices, 8.0)
    one, other = (
        Proposal.fitted(core).extended(new, TAIL).extended(new, CARRIER)
        for core in (CORE, shuffled)
    )
    x = np.random.default_rng(1).uniform(-12, 12, (500, 2))
    assert_allclose(one.law.log_density(x), other.law.log_density(x), rtol=1e-9)
    assert sorted(one.law_kinds) == sorted(other.law_kinds)
    labels = [assign(x, each.law, each.separate()) for each in (one, other)]
    pairs = {*zip(*map(np.ndarray.tolist, labels), strict=True)}
    assert len(pairs) == len(np.unique(labels[0])) == 3  # 0 and 1 overlap
    at = assign(CENTRES, one.law, one.separate())
    assert at[0] == at[1] and len(np.unique(at)) == 3


def test_what_is_added_has_its_weight_but_never_more_than_a_third():
    new = [Component(weight, np.zeros(2), np.eye(2)) for weight in (0.2, 0.1)]
    proposal = Proposal.fitted(CORE).extended(new, TAIL)
    added = proposal.kinds == TAIL
    assert_allclose(proposal.core.weights[added], [0.2, 0.1])
    heavy = [part._replace(weight=10 * part.weight) for part in new]
    proposal = Proposal.fitted(CORE).extended(heavy, TAIL)
    assert_allclose(proposal.core.weights[added].sum(), 0.35)


def test_a_carrier_that_spans_two_maxima_joins_them_not_but_a_tail_between_does():
    wide = [Component(0.1, np.array([4.0, 5.0]), 15.0 * np.eye(2))]
    before = Proposal.fitted(CORE).separate()[:4]
    with_carrier = Proposal.fitted(CORE).extended(wide, CARRIER).separate()
    np.testing.assert_array_equal(with_carrier[:4], before)
    assert with_carrier[4] in before and with_carrier[5] == -1
    with_tail = Proposal.fitted(CORE).extended(wide, TAIL).separate()
    assert with_tail[0] == with_tail[2] != with_tail[3]


def test_a_tail_makes_no_maximum_of_its_own():
    """Slabs of a funnel, of which none overlaps the body, are the tail of one."""
    slabs = [Component(0.05, np.array([9.0, y]), np.eye(2)) for y in (14, 16, 18)]
    labels = Proposal.fitted(CORE).extended(slabs, TAIL).separate()
    assert labels.max() == 2 and (labels[4:7] == labels[2]).all()
