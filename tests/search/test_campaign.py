"""Stages of a search, each by itself on a campaign made by hand, and ablations."""

import numpy as np
import pytest
from scipy import stats
from support.campaigns import by_hand
from support.free_posterior import box, free_posterior
from support.runs import leave_out

import emcee_femu as ef
from emcee_femu.moves.mixture import Mixture
from emcee_femu.search import auto, tails
from emcee_femu.search.adapt import adapt, carry, judge
from emcee_femu.search.climbing import climb
from emcee_femu.search.explore import _Exploration, explore
from emcee_femu.search.proposal import CARRIER, TAIL, Component, Proposal
from emcee_femu.search.tails import follow_tails

FAR, LIGHT = 25.0, 0.002


def two(x):
    """Return a Gaussian, and a light one far off that holds half of a variance."""
    centre = np.zeros(x.shape[1])
    far = centre + FAR * np.eye(x.shape[1])[0]
    parts = [
        np.log(share) + stats.multivariate_normal(mean).logpdf(x).reshape(-1)
        for share, mean in ((1 - LIGHT, centre), (LIGHT, far))
    ]
    return np.logaddexp(*parts)


def long_tail(x):
    """Return a Gaussian whose first parameter is Student's t of 2.5 degrees."""
    return stats.t(2.5).logpdf(x[:, 0]) + stats.norm.logpdf(x[:, 1])


def about(centre, d):
    return Proposal.fitted(Mixture(np.ones(1), centre[None], np.eye(d)[None], 8.0))


def test_exploring_finds_both_maxima_and_fills_the_archive():
    c = by_hand(free_posterior(two, box(-40, 40, 2)), ensembles=2)
    explore(c)
    tops = sorted(maximum.theta[0] for maximum in c.maxima.found)
    np.testing.assert_allclose(tops, [0.0, FAR], atol=0.05)
    light = c.proposal.core.means[:, 0] > FAR / 2
    assert abs(c.proposal.core.weights[light].sum() / LIGHT - 1) < 0.05
    assert np.sum(c.maxima.found_by) == c.maxima.climbs > 2  # each ended at one
    assert c.points > 900 and len(c.archive.x) > 500
    assert c.evaluator.solves < c.ledger.end() < c.ledger.total


def test_points_beyond_a_valley_are_told_from_those_on_a_slope():
    c = by_hand(free_posterior(two, box(-40, 40, 2)), ensembles=1)
    (top,) = climb(c.evaluator, np.zeros((1, 2)))
    c.maxima.add(top, 0)
    search, slope = _Exploration(c), [[0.5, 0.0], [-3.0, 2.0], [6.0, -1.0], [0, 30]]
    beyond = [[FAR, 0.0], [FAR - 1, 2.0], [FAR + 3, -3.0]]
    search.evaluate([np.array([*slope, *beyond])])
    assert search._find_valleys(range(7)) == [4, 5, 6]


def test_draws_that_carry_a_variance_get_a_component():
    """A tenth of a percent of the draws holds half of the variance of x1."""
    c = by_hand(free_posterior(two, box(-40, 40, 2)))
    c.proposal = about(np.zeros(2), 2)
    x = c.posterior.prior.sample(c.streams[0], 20_000)
    c.archive.add(x, c.evaluator.rows(x))
    c.archive.add(*c.draw(c.proposal.law, 2_000), c.proposal.law)
    carry(c)
    added = c.proposal.core.means[c.proposal.kinds == CARRIER]
    assert len(added) and (np.abs(added - [FAR, 0.0]) < 3.0).all(axis=1).any()


def test_a_maximum_that_a_climb_found_is_not_lost():
    """Of two equal Gaussians a proposal has one, and no draw of it meets the other."""
    centres = np.array([[0.0, 0.0], [FAR, 0.0]])

    def equal(x):
        far = ((x[:, None] - centres) ** 2).sum(axis=2)
        return np.logaddexp(*(-0.5 * far.T))

    c = by_hand(free_posterior(equal, box(-40, 40, 2)))
    for maximum in climb(c.evaluator, centres + 0.1):
        c.maxima.add(maximum, 0)
    c.proposal = about(centres[0], 2)
    c.archive.add(*c.draw(c.proposal.core, 500), c.proposal.core)
    adapt(c)
    exact = np.log(4 * np.pi) - 2 * np.log(80.0)
    assert abs(c.archive.log_evidence - exact) < 0.1  # of one alone -.69
    log_q = c.proposal.law.log_density(centres)
    assert np.abs(log_q + np.log(4 * np.pi)).max() < 0.5


def test_a_variance_that_many_draws_carry_needs_no_component():
    """Though the proposal is too narrow for a Gaussian."""
    c = by_hand(free_posterior(lambda x: -0.2 * (x**2).sum(axis=1), box(-9, 9, 2)))
    c.proposal = about(np.zeros(2), 2)
    c.archive.add(*c.draw(c.proposal.law, 4_000), c.proposal.law)
    assert (c.archive.log_ratio(c.proposal.law) > 0.3).any()
    carry(c)
    assert not (c.proposal.kinds == CARRIER).any()


def test_tails_are_followed_to_both_sides_and_only_where_they_are():
    c = by_hand(free_posterior(long_tail, box(-60, 60, 2)))
    c.proposal = about(np.zeros(2), 2)
    narrow = c.proposal.core
    c.archive.add(*c.draw(narrow, 2_000), narrow)
    follow_tails(c)
    tails = c.proposal.core.means[c.proposal.kinds == TAIL]
    assert tails[:, 0].min() < -8 and tails[:, 0].max() > 8
    assert np.median(np.abs(tails[:, 1])) < 0.1 and np.abs(tails[:, 1]).max() < 2.0


def test_the_tails_of_each_parameter_are_followed(monkeypatch):
    """Also after those of others had components."""
    c = by_hand(free_posterior(lambda x: -0.5 * (x**2).sum(axis=1), box(-9, 9, 4)))
    c.proposal = about(np.zeros(4), 4)
    c.archive.add(*c.draw(c.proposal.law, 500), c.proposal.law)
    followed = []

    def follow(evaluator, archive, j, side, most):
        followed.append((j, side, len(archive.x)))
        return [Component(0.1, 3.0 * np.eye(4)[j], np.eye(4))] if side else []

    monkeypatch.setattr(tails, "_follow", follow)
    follow_tails(c)
    parameters, sides, drawn = zip(*followed, strict=True)
    assert parameters == (0, 0, 1, 1, 2, 2, 3, 3) and sides == 4 * (0, 1)
    assert (np.diff(drawn[::2]) > 0).all()  # draws of the new components come before
    assert (c.proposal.kinds == TAIL).sum() == 4


def test_what_is_in_a_slab_lies_on_the_way_to_it():
    """Not beyond its highest point, which is at its inner edge."""
    limits = box(-40, 40, 2)
    c = by_hand(free_posterior(long_tail, limits))
    slab = np.array([[5.0, 6.0], [-40.0, 40.0]])
    (top,) = climb(c.evaluator, np.array([[5.5, 0.3]]), box=slab)
    way = top.theta - [3.0, 0.0]
    mean, matrix = tails._within(top, 0, limits.bounds, way, np.full(2, 2.0))
    assert 3.0 < mean[0] < top.theta[0] < 5.01
    assert matrix[0, 0] > way[0] ** 2 / 12


@pytest.mark.slow
@pytest.mark.parametrize("without", [auto.follow_tails, auto.carry, auto.anneal_starts])
def test_an_ablation_is_a_tuple_without_a_stage(without, monkeypatch):
    posterior = free_posterior(long_tail, box(-60, 60, 2))
    whole = ef.run(posterior, steps=2, ensembles=2, seed=1).search
    assert TAIL in whole.kinds and whole.spent["follow_tails"] > 0
    leave_out(monkeypatch, without)
    found = ef.run(posterior, steps=2, ensembles=2, seed=1).search
    assert without.__name__ not in found.spent
    assert (TAIL in found.kinds) == (without is not auto.follow_tails)
    assert np.isfinite(found.weights).all()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_poor_mixture_is_fitted_anew_although_few_draws_weigh(seed):
    """Five times too wide in six dimensions, as far from the top of a funnel."""
    d = 6
    density = free_posterior(lambda x: -0.5 * (x**2).sum(axis=1), box(-15, 15, d))
    c = by_hand(density, seed=seed)
    wide = Mixture(np.ones(1), np.zeros((1, d)), 25.0 * np.eye(d)[None], 8.0)
    c.proposal = Proposal.fitted(wide)
    adapt(c)
    judge(c)
    assert c.best.efficiency > 0.6
