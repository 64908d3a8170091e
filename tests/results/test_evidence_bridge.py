"""The bridge from a frozen proposal: exact values, errors, and when none is claimed."""

from types import SimpleNamespace

import emcee
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import emcee_femu as ef
from emcee_femu.moves import IndependenceMove
from emcee_femu.results.evidence_bridge import bridge_evidence, standard_error
from emcee_femu.sampling.bridging import bridge

D, LOG_Z, KEPT = 4, -7.0, 0.9  # KEPT: a step's correlation with the one before
Q = IndependenceMove([1.0], np.full((1, D), 0.2), [1.3 * np.eye(D)], df=5.0)


def log_p(x):
    return LOG_Z + stats.norm.logpdf(x).sum(axis=-1)


def log_q(x):
    return Q.log_density(x.reshape(-1, D)).reshape(x.shape[:-1])


def correlated(rng, steps, ensembles, walkers):
    """Return draws of p that remember the last ones."""
    x = rng.normal(size=(steps, ensembles, walkers, D))
    for t in range(1, steps):
        x[t] = KEPT * x[t - 1] + np.sqrt(1 - KEPT**2) * x[t]
    return x


def from_q(n, seed):
    ((_, x, _),) = Q.batches(np.zeros((n, D)), np.random.RandomState(seed))
    return x


def estimate(seed, steps=1_000, ensembles=2, walkers=4, n=500):
    x = correlated(np.random.default_rng(seed), steps, ensembles, walkers)
    y = from_q(n, seed)
    return bridge_evidence(log_p(x) - log_q(x), log_p(y) - log_q(y))


def test_the_evidence_is_exact_and_its_error_the_spread():
    found = [estimate(seed) for seed in range(40)]
    values, errors = np.array([one[:2] for one in found]).T
    assert not any(problems for *_, problems in found)
    z = (values - LOG_Z) / errors
    assert (np.abs(z) < 3).mean() >= 0.95
    assert abs(z.mean()) < 4 / np.sqrt(len(z))
    assert 1 / 1.5 < values.std(ddof=1) / np.sqrt((errors**2).mean()) < 1.5


@pytest.mark.parametrize("ensembles", [1, 2, 4])
def test_the_spread_of_few_ensembles_does_not_make_the_error_too_large(ensembles):
    rng, steps = np.random.default_rng(1), 400
    errors = [
        standard_error(rng.normal(size=(steps, ensembles)))[0] for _ in range(400)
    ]
    claimed = np.sqrt(np.mean(np.square(errors)) * steps * ensembles)
    assert 0.97 < claimed < 1.15  # the larger of both is 1.25 with two ensembles


def test_ensembles_that_disagree_have_the_error_of_their_spread():
    series = np.random.default_rng(1).normal(size=(400, 3)) + [0.0, 1.0, 2.0]
    error = standard_error(series)[0]
    assert_allclose(error, series.mean(axis=0).std(ddof=1) / np.sqrt(3), rtol=1e-12)


def test_ratio_and_error_are_those_of_the_published_formulas():
    rng, n1, n2 = np.random.default_rng(1), 3_000, 1_000
    x, y = rng.normal(size=(n1, D)), from_q(n2, 1)
    at_f, at_g = log_p(x) - log_q(x), log_p(y) - log_q(y)
    s = n1 / (n1 + n2)
    ratio = 1.0
    for _ in range(200):  # Meng and Wong's iteration
        upper = np.exp(at_g) / (s * np.exp(at_g) + (1 - s) * ratio)
        lower = 1 / (s * np.exp(at_f) + (1 - s) * ratio)
        ratio = upper.mean() / lower.mean()
    found = bridge(at_f, at_g, s)
    assert_allclose(found.log_ratio, np.log(ratio), atol=1e-7)
    # Fruehwirth-Schnatter's relative variances, of independent draws.
    variance = (
        upper.var() / upper.mean() ** 2 / n2 + lower.var() / lower.mean() ** 2 / n1
    )
    mine = found.from_f.var() / n1 + found.from_g.var() / n2
    assert_allclose(mine, variance, rtol=1e-6)


def test_equal_laws_have_the_ratio_without_error():
    same = bridge(np.full((5, 2), 3.0), np.full(7, 3.0), 0.3)
    assert_allclose([same.log_ratio, same.overlap], [3.0, 1.0], atol=1e-8)
    # Half of the draws of g where f is zero: half of its mass.
    half = bridge(np.full(8, 3.0), np.r_[np.full(4, 3.0), np.full(4, -np.inf)], 0.5)
    assert_allclose(half.log_ratio, 3.0 + np.log(0.5), atol=1e-8)


@pytest.mark.parametrize("shift", [15.0, np.inf])
def test_no_overlap_claims_no_error(shift):
    x, y = correlated(np.random.default_rng(1), 400, 1, 4), from_q(400, 1)
    at_p, at_q = log_p(x) - log_q(x), log_p(y) - log_q(y)
    *_, problems = bridge_evidence(at_p + 15, at_q - shift)
    assert any("hardly overlap" in problem for problem in problems)


class Auto(emcee.backends.Backend):
    """A stored chain with the record of "auto", as log_evidence sees one."""

    def __init__(self, seed, in_file=False):
        super().__init__()
        x = correlated(np.random.default_rng(seed), 600, 1, 8)[:, 0]
        y = from_q(500, seed)
        weights = [*(log_p(y) - log_q(y)).tolist(), None]
        proposal = [Q.weights, Q.means, Q.scale_matrices, Q.df]
        record = {
            "proposal": [np.asarray(part).tolist() for part in proposal],
            "log_weights": weights,
        }
        if in_file:
            self.manifest = {"recipe": {"record": record}}
        else:
            self.recipe = SimpleNamespace(record=record)
        self.reset(8, D)
        self.grow(len(x), None)
        for own in x:
            self.save_step(emcee.State(own, log_prob=log_p(own)), np.ones(8, bool))


@pytest.mark.parametrize("in_file", [False, True])
def test_samplers_of_auto_give_the_evidence_from_their_proposal(in_file):
    found = ef.log_evidence([Auto(1, in_file), Auto(2, in_file)], discard=10)
    assert "frozen proposal" in str(found)
    assert 0 < found.log_evidence_error < 0.05
    assert abs(found.log_evidence - LOG_Z) < 3 * found.log_evidence_error
