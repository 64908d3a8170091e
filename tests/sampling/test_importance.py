"""Statistics of weighted draws, by laws of which all is known; of internal names."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from emcee_femu.moves.mixture import Mixture
from emcee_femu.sampling.auto import is_better
from emcee_femu.sampling.importance import bridge, pareto_k, resample
from emcee_femu.sampling.proposals import Trial


@pytest.mark.parametrize("k", [0.2, 0.5, 0.9])
def test_the_tail_of_pareto_weights_has_their_k(k):
    rng = np.random.default_rng(3)
    estimate = [pareto_k(-k * np.log(rng.random(4_000))) for _ in range(20)]
    assert np.mean(estimate) == pytest.approx(k, abs=0.06)


def test_no_tail_and_no_weights():
    assert pareto_k(np.zeros(100)) == -np.inf
    assert pareto_k(np.full(100, -np.inf)) == np.inf
    some = np.where(np.arange(1_000) % 2, -np.inf, 0.01 * np.arange(1_000.0) % 1)
    assert pareto_k(some) < 0.5


def test_resampling_is_unbiased_and_off_by_less_than_one_each():
    rng = np.random.default_rng(2)
    weights = rng.dirichlet(np.full(40, 0.5))
    draws = [resample(weights, 40, rng.random()) for _ in range(4_000)]
    counts = np.array([np.bincount(draw, minlength=40) for draw in draws])
    assert (np.abs(counts - 40 * weights) < 1).all()
    error = np.sqrt((40 * weights % 1) * (1 - 40 * weights % 1) / 4_000)
    assert (np.abs(counts.mean(axis=0) - 40 * weights) < 5 * error + 1e-12).all()


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_bridge_between_two_gaussians_has_the_ratio_of_their_constants(share):
    rng, ratios, errors = np.random.default_rng(1), [], []
    f, g = stats.norm(0.0, 1.0), stats.norm(0.5, 1.5)
    for _ in range(200):
        at_f, at_g = (
            3.7 + f.logpdf(x) - g.logpdf(x) for x in (rng.normal(0, 1, 100),
                                                      rng.normal(0.5, 1.5, 200))
        )  # fmt: skip
        estimate = bridge(at_f, at_g, share)
        ratios.append(estimate.log_ratio)
        variance = estimate.from_f.var() / 100 + estimate.from_g.var() / 200
        errors.append(np.sqrt(variance))
        assert 0 < estimate.overlap <= 1
    assert abs(np.mean(ratios) - 3.7) < 5 * np.std(ratios) / np.sqrt(200)
    assert_allclose(np.mean(errors), np.std(ratios), rtol=0.2)


def trial(weights, means, variance):
    """Return the trial of a proposal of two modes at 0 and 20, of weights .3 and .7."""
    matrices = np.full((len(means), 1, 1), variance)
    proposal = Mixture(np.array(weights), np.array(means)[:, None], matrices, 50.0)
    x = proposal.draw(np.random.default_rng(2), 4_000)
    laws = np.log([0.3, 0.7]) + stats.norm([0.0, 20.0], 1.0).logpdf(x)
    rows = np.logaddexp(*laws.T)[:, None]
    return Trial(proposal, x, rows)


def test_a_proposal_that_finds_more_is_better_though_it_is_less_efficient():
    one = trial([1.0], [0.0], 1.0)
    both = trial([0.5, 0.5], [0.0, 20.0], 3.0)
    assert one.efficiency > 0.9 > 0.7 > both.efficiency
    assert is_better(both, one) and not is_better(one, both)
    near = trial([0.3, 0.7], [0.0, 20.0], 1.0)
    assert near.log_evidence < both.log_evidence  # by chance, a little
    assert is_better(near, both) and not is_better(both, near)
    nothing = Trial(one.mixture, one.theta, np.full_like(one.rows, -np.inf))
    assert is_better(one, nothing) and not is_better(nothing, one)
