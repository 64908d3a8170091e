"""Positive parameters in logarithms where these fit better, and only there."""

import json

import numpy as np
import pytest
from scipy import stats
from support.campaigns import by_hand
from support.free_posterior import free_posterior

import emcee_femu as ef
from emcee_femu.search.adapt import adapt, judge
from emcee_femu.search.campaign import Campaign
from emcee_femu.search.explore import explore
from emcee_femu.search.record import SearchRecord

WIDE = {name: stats.uniform(0.2, 4.8) for name in "ab"}


def product(x):
    """Return the density of data that know a b to 2 percent, and x nearly."""
    far = (np.sqrt(np.abs(x[:, 0] * x[:, 1])) - 1) / 0.01
    return -0.5 * (far**2 + (x[:, 2:] ** 2).sum(axis=1))


def refined(posterior):
    """Return a campaign after exploration and refinement."""
    c = by_hand(posterior)
    explore(c)
    adapt(c)
    judge(c)
    return c


def test_a_product_is_proposed_in_logarithms_but_what_may_be_negative_is_not(
    monkeypatch,
):
    prior = ef.IndependentPrior(WIDE | {"x": stats.uniform(-9, 18)})
    posterior = free_posterior(product, prior)
    c = refined(posterior)
    assert c.best.proposal.law.logs.tolist() == [True, True, False]
    assert c.best.efficiency > 0.5
    monkeypatch.setattr(Campaign, "coordinates", (None,))
    assert refined(posterior).best.efficiency < 0.5 * c.best.efficiency


@pytest.mark.parametrize("law", [stats.uniform(-9, 18), stats.norm(0, 3)])
def test_without_positive_parameters_there_are_no_logarithms(law):
    posterior = free_posterior(
        lambda x: -0.5 * (x**2).sum(axis=1), ef.IndependentPrior({"x": law, "y": law})
    )
    c = refined(posterior)
    assert c.coordinates == (None,) and c.best.proposal.law.logs is None


@pytest.mark.parametrize("law", [stats.halfnorm(scale=0.5), stats.expon()])
def test_what_may_be_next_to_zero_is_not_in_logarithms(law):
    """A standard deviation that data hardly know: weights beside zero are bounded."""
    prior = ef.IndependentPrior({"sd": law, "k": stats.lognorm(0.5)})
    posterior = free_posterior(lambda x: -0.5 * (x[:, 0] / 0.3) ** 2, prior)
    c = refined(posterior)
    assert c.coordinates[1].tolist() == [False, True]
    beside = np.column_stack([np.geomspace(1e-9, 0.1, 50), np.full(50, 1.0)])
    rows = c.evaluator.rows(beside)
    c.archive.add(beside, rows, c.best.proposal.law)
    lack = c.archive.log_ratio(c.best.proposal.law)[-50:]
    assert lack.max() < 1.0


def test_a_record_in_logarithms_is_read_as_it_was_written():
    posterior = free_posterior(product, ef.IndependentPrior(WIDE))
    record = ef.run(posterior, steps=2, ensembles=1, seed=1).search
    assert record.mixture.logs.all()
    read = SearchRecord.from_json(json.loads(json.dumps(record.to_json())))
    x = posterior.prior.sample(np.random.default_rng(1), 9)
    np.testing.assert_array_equal(
        read.mixture.log_density(x), record.mixture.log_density(x)
    )
    np.testing.assert_array_equal(read.label(x), record.label(x))
