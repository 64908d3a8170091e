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


@pytest.mark.parametrize("kind", [TAIL, CARRIER])
def test_what_spans_two_maxima_does_not_join_them_but_a_bridge_does(kind):
    """Only a way without a valley joins them, whatever a component is for."""
    before = Proposal.fitted(CORE).separate()[:4]
    wide = Component(0.1, np.array([4.0, 5.0]), 15.0 * np.eye(2))
    spanned = Proposal.fitted(CORE).extended([wide], kind).separate()
    np.testing.assert_array_equal(spanned[:4], before)
    assert spanned[4] in before and spanned[5] == -1
    places = np.linspace([1.0, 0.0], [9.0, 9.0], 7)[1:-1]
    bridge = [Component(0.05, place, np.eye(2)) for place in places]
    joined = Proposal.fitted(CORE).extended(bridge, kind).separate()
    assert joined[0] == joined[2] != joined[3]
    assert (joined[4:-1] == joined[0]).all()


@pytest.mark.parametrize(("apart", "maxima"), [(4.0, 1), (5.5, 2)])
@pytest.mark.parametrize("logs", [None, np.array([True, False])])
def test_equal_gaussians_are_apart_from_some_five_standard_deviations(
    apart, maxima, logs
):
    """In whichever coordinates a mixture is."""
    means = np.array([[0.0, 0.0], [apart, 0.0]])
    core = Mixture(np.full(2, 0.5), means, np.tile(np.eye(2), (2, 1, 1)), 1e6, logs)
    assert len(np.unique(Proposal.fitted(core).separate()[:2])) == maxima
