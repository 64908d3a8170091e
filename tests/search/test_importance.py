"""Weighted draws and proposals, by laws of which all is known."""

import numpy as np
import pytest
from scipy import stats
from support.campaigns import by_hand
from support.free_posterior import box, free_posterior

from emcee_femu.moves.mixture import Mixture
from emcee_femu.search.adapt import adapt, judge
from emcee_femu.search.importance import find_acceptance, kish_share, pareto_k, resample
from emcee_femu.search.proposal import Proposal


@pytest.mark.parametrize("k", [0.2, 0.9])
def test_the_tail_of_pareto_weights_has_their_k(k):
    rng = np.random.default_rng(3)
    estimate = [pareto_k(-k * np.log(rng.random(4_000))) for _ in range(10)]
    assert np.mean(estimate) == pytest.approx(k, abs=0.06)


@pytest.mark.parametrize("spread", [1e3, 1e4, 1e6, 1e8])
def test_weights_of_which_one_is_all_are_never_called_good(spread):
    log_weights = -spread * np.random.default_rng(0).exponential(size=112)
    assert pareto_k(log_weights) > 0.7


def test_resampling_is_unbiased_and_off_by_less_than_one_each():
    rng = np.random.default_rng(2)
    weights = rng.dirichlet(np.full(40, 0.5))
    draws = [resample(weights, 40, rng.random()) for _ in range(4_000)]
    counts = np.array([np.bincount(draw, minlength=40) for draw in draws])
    assert (np.abs(counts - 40 * weights) < 1).all()
    error = np.sqrt((40 * weights % 1) * (1 - 40 * weights % 1) / 4_000)
    assert (np.abs(counts.mean(axis=0) - 40 * weights) < 5 * error + 1e-12).all()


def gaussian(x):
    return -0.5 * (x**2 + np.log(2 * np.pi)).sum(axis=1)


def three_modes(x):
    sds = np.array([[1.0, 1.0], [0.4, 1.0], [1.0, 0.3]])
    z = (x[:, None] - [[0.0, 0.0], [4.0, 0.0], [0.0, 5.0]]) / sds
    heights = np.log([0.5, 0.3, 0.2] / sds.prod(axis=1)) - np.log(2 * np.pi)
    return np.logaddexp.reduce(heights - 0.5 * (z**2).sum(axis=2), axis=1)


@pytest.mark.parametrize(
    ("log_density", "d", "centre", "sd", "least"),
    [
        (gaussian, 6, 0.0, 1.0, 0.88),  # too heavy tails
        (gaussian, 6, 0.5, 0.3, 0.65),  # too narrow, and beside it
        pytest.param(  # nothing but tails, though draws are few
            *(gaussian, 20, 0.0, 1.0, 0.8), marks=pytest.mark.slow
        ),
        (three_modes, 2, 0.0, 1.0, 0.6),  # of one mode alone
    ],
)
def test_a_proposal_gets_what_it_lacks(log_density, d, centre, sd, least):
    """Of some two thousand draws; the best share with covering components is .95."""
    start = Mixture(np.ones(1), np.full((1, d), centre), sd**2 * np.eye(d)[None], 8.0)
    posterior = free_posterior(log_density, box(-8, 8, d))
    shares, evidences = [], []
    for seed in range(3):
        c = by_hand(posterior, seed)
        x = posterior.prior.sample(c.streams[0], 500)
        c.archive.add(x, c.evaluator.rows(x))
        c.archive.add(*c.draw(start, 500), start)
        c.proposal = Proposal.fitted(start)
        adapt(c)
        judge(c)
        shares.append(c.best.efficiency)
        evidences.append(c.archive.log_evidence)
    assert min(shares) > least
    # Of draws to which the proposal was fitted it is a little low.
    assert abs(np.mean(evidences) + d * np.log(16.0)) < 0.06


def test_acceptance_is_that_of_independent_proposals():
    rng = np.random.default_rng(3)
    p, c, q = stats.norm(0, 1), stats.norm(0.4, 1.2), stats.norm(0.2, 1.6)
    x = q.rvs(500, random_state=rng)
    found = find_acceptance(p.logpdf(x), c.logpdf(x) + 9.0, q.logpdf(x))
    here, there = p.rvs(50_000, random_state=rng), c.rvs(50_000, random_state=rng)
    log_ratio = p.logpdf(there) + c.logpdf(here) - p.logpdf(here) - c.logpdf(there)
    assert abs(found - np.exp(np.minimum(log_ratio, 0)).mean()) < 0.05
    # Where c lacks half of p, those who are there stay.
    log_c = np.where(x > 0, c.logpdf(x), -np.inf)
    cut = find_acceptance(p.logpdf(x), log_c, q.logpdf(x))
    accepted = (here > 0) * np.exp(np.minimum(log_ratio, 0))
    assert abs(cut - accepted[there > 0].mean()) < 0.05 < found - cut


def test_no_share_of_nearly_equal_weights_exceeds_one():
    rng = np.random.default_rng(1)
    alike = [1e-9 * rng.normal(size=n) for n in range(2, 300)]
    shares = [kish_share(each) for each in alike]
    shares += [kish_share(each, rng.normal(size=len(each))) for each in alike]
    assert max(shares) <= 1 and min(shares) > 0.999


def test_a_draw_of_twice_the_share_counts_as_two():
    log_weights, twice = np.array([0.0, 1.0, -2.0]), np.log([2.0, 1.0, 1.0])
    both = kish_share(np.array([0.0, 0.0, 1.0, -2.0]))
    assert np.isclose(kish_share(log_weights, twice), both, rtol=1e-12)
