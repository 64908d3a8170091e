"""The archive: weights, evidence and variance of draws of several laws, exact."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from emcee_femu.moves.mixture import Mixture
from emcee_femu.search.archive import Archive, JudgedProposal
from emcee_femu.search.importance import kish_share
from emcee_femu.search.proposal import Proposal

MEAN, SD, LOG_Z = np.array([1.0, -1.0]), np.array([0.5, 1.5]), 3.0
TARGET = stats.multivariate_normal(MEAN, np.diag(SD**2))


def student(centre, scale, df=8.0):
    return Mixture(np.ones(1), np.full((1, 2), centre), scale**2 * np.eye(2)[None], df)


LAWS = {None: 3_000, student(0.0, 1.0): 2_000, student(3.0, 2.0): 1_000}


def rows_of(x):
    """Return log-posteriors and log-priors: uniform between -8 and 8."""
    log_prior = np.full(len(x), -2 * np.log(16.0))
    rows = np.stack([LOG_Z + TARGET.logpdf(x), log_prior], axis=1)
    return np.where((np.abs(x) < 8).all(axis=1, keepdims=True), rows, -np.inf)


def draws_of(law, n, rng):
    return rng.uniform(-8, 8, (n, 2)) if law is None else law.draw(rng, n)


def fill(laws, seed):
    archive, rng = Archive(2), np.random.default_rng(seed)
    for law in laws:
        x = draws_of(law, LAWS[law], rng)
        archive.add(x, rows_of(x), law)
    return archive


def test_evidence_moments_and_influence_are_exact():
    found = [fill(LAWS, seed) for seed in range(20)]
    evidence = np.exp([a.log_evidence - LOG_Z for a in found])
    assert abs(evidence.mean() - 1) < 4 * evidence.std() / 20**0.5 < 0.05
    means = np.array([a.shares @ a.x for a in found])
    assert (np.abs(means.mean(axis=0) - MEAN) < 4 * means.std(axis=0) / 20**0.5).all()
    variances = np.array([a.influence.sum(axis=0) for a in found])
    assert_allclose(variances.mean(axis=0), SD**2, rtol=0.03)
    assert_allclose(np.mean([a.kurtosis for a in found], axis=0), 3.0, atol=0.2)
    assert_allclose([a.shares.sum() for a in found], 1.0)


def test_the_order_of_laws_does_not_matter():
    rng = np.random.default_rng(1)
    parts = [(law, draws_of(law, n, rng)) for law, n in LAWS.items()]
    one, other = Archive(2), Archive(2)
    for archive, ordered in ((one, parts), (other, parts[::-1])):
        for law, x in ordered:
            archive.add(x, rows_of(x), law)
    i, j = (np.lexsort(archive.x.T) for archive in (one, other))
    assert_allclose(one.log_weights[i], other.log_weights[j], rtol=1e-10)


def test_draws_that_are_impossible_count():
    """Of draws of twice the box half are impossible in each parameter."""
    archive, wide = Archive(2), student(0.0, 40.0, 1e7)
    x = wide.draw(np.random.default_rng(2), 100_000)
    archive.add(x, rows_of(x), wide)
    assert len(archive.x) < 0.1 * len(x)
    assert abs(archive.log_evidence - LOG_Z) < 0.3


@pytest.mark.parametrize("law", [student(0.5, 1.2), student(0.0, 1.8)])
def test_the_share_of_another_law_is_what_its_draws_have(law):
    x = law.draw(np.random.default_rng(3), 100_000)
    share = kish_share(rows_of(x)[:, 0] - law.log_density(x))
    told = np.mean([fill(LAWS, seed).effective_share(law) for seed in range(5)])
    assert_allclose(told, share, rtol=0.1)


def judged(law, n=4_000):
    proposal = Proposal.fitted(law)
    x = proposal.law.draw(np.random.default_rng(4), n)
    return JudgedProposal(proposal, x, rows_of(x))


def test_the_better_proposal_finds_more_or_fits_better():
    good, poor, far = (judged(student(*at)) for at in ((0.7, 1.3), (3, 1), (7.9, 0.01)))
    assert good.is_better(poor) and not poor.is_better(good)
    assert good.reliable and 0.1 < good.acceptance < 0.5
    assert abs(good.log_evidence - LOG_Z) < 0.1
    assert good.is_better(far) and not far.reliable


@pytest.mark.parametrize(("less", "better"), [(2.0, False), (0.5, True)])
def test_a_close_fit_of_half_the_posterior_is_not_better(less, better):
    """It may find less of the evidence by one at most."""
    law, rng = student(0.0, 1.0), np.random.default_rng(5)
    x = Proposal.fitted(law).law.draw(rng, 2_000)
    log_q = Proposal.fitted(law).law.log_density(x)
    found = []
    for spread, lost in ((0.3, 0.0), (0.05, less)):
        rows = np.stack([log_q - lost + rng.normal(0, spread, len(x)), log_q], axis=1)
        found.append(JudgedProposal(Proposal.fitted(law), x, rows))
    assert found[1].efficiency > found[0].efficiency
    assert found[1].is_better(found[0]) == better
    assert not found[0].is_better(found[1]) or not better
