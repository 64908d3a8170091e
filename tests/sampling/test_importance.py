"""Statistics of weighted draws, by laws of which all is known; of internal names."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from emcee_femu.moves.mixture import Mixture
from emcee_femu.sampling.auto import is_better
from emcee_femu.sampling.importance import bridge, pareto_k, resample
from emcee_femu.sampling.proposals import Draws, Trial, refine


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


# A Gaussian cut at zero, whose evidence is LOG_Z, and proposals that reach beyond.
LOG_Z = -7.0
AREA = 0.5 * np.sqrt(2 * np.pi) * stats.norm.cdf(1.0)


def half(x):
    """Return rows of the log-posterior and the log-prior."""
    log_p = LOG_Z - np.log(AREA) - 2 * (x - 0.5) ** 2
    log_prior = -0.125 * x**2 - 0.5 * np.log(8 * np.pi)
    return np.hstack([np.where(x > 0, log_p, -np.inf), log_prior])


def component(mean, sd):
    return Mixture(np.ones(1), np.array([[mean]]), np.array([[[sd**2]]]), 50.0)


def test_draws_of_several_proposals_weigh_as_those_of_their_mixture():
    """Of the evidence they are an unbiased estimate, though half are impossible."""
    proposals, evidences = [component(1.0, 0.3), component(-0.5, 1.0)], []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        x = rng.normal(0.0, 2.0, (20, 1))
        draws = Draws(x, half(x))
        for proposal, number in zip(proposals, (40, 20), strict=True):
            x = proposal.draw(rng, number)
            draws.add(x, half(x), proposal)
        evidences.append(np.exp(draws.log_evidence - LOG_Z))
    error = np.std(evidences, ddof=1) / np.sqrt(400)
    assert abs(np.mean(evidences) - 1) < 4 * error < 0.05


def test_draws_and_trials_know_what_a_proposal_is_worth():
    rng, proposal = np.random.default_rng(1), component(0.0, 1.5)
    x = rng.normal(0.0, 2.0, (20_000, 1))
    draws = Draws(x, half(x))
    grid = np.linspace(0, 4, 10_001)[:, None]
    log_ratio = half(grid)[:, 0] - LOG_Z - proposal.log_density(grid)
    shares = np.exp(half(grid)[:, 0] - LOG_Z) * 4e-4
    exact = 1 / (shares @ np.exp(log_ratio))
    assert draws.effective_share(proposal) == pytest.approx(exact, rel=0.03)
    assert draws.lack(proposal) == pytest.approx(log_ratio.max(), abs=0.03)
    x = proposal.draw(rng, 20_000)
    trial = Trial(proposal, x, half(x))
    assert trial.efficiency == pytest.approx(exact, rel=0.03)
    assert trial.log_evidence == pytest.approx(LOG_Z, abs=0.03)


def gaussian(x):
    return -0.5 * (x**2).sum(axis=1) - 3 * np.log(2 * np.pi)


def three_modes(x):
    sds = np.array([[1.0, 1.0], [0.4, 1.0], [1.0, 0.3]])
    z = (x[:, None] - [[0.0, 0.0], [4.0, 0.0], [0.0, 5.0]]) / sds
    heights = np.log([0.5, 0.3, 0.2] / sds.prod(axis=1)) - np.log(2 * np.pi)
    return np.logaddexp.reduce(heights - 0.5 * (z**2).sum(axis=2), axis=1)


@pytest.mark.parametrize(
    ("log_density", "d", "centre", "sd", "least"),
    [
        (gaussian, 6, 0.0, 1.0, 0.88),  # too heavy tails
        (gaussian, 6, 0.5, 0.3, 0.83),  # too narrow, and beside it
        (three_modes, 2, 0.0, 1.0, 0.6),  # of one mode alone
    ],
)
def test_a_proposal_gets_what_it_lacks(log_density, d, centre, sd, least):
    """Of some two thousand draws; the best share with covering components is .95."""
    start = Mixture(np.ones(1), np.full((1, d), centre), sd**2 * np.eye(d)[None], 8.0)
    shares, evidences = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)

        def look(x):  # under a uniform prior between -8 and 8
            rows = np.stack([log_density(x), np.full(len(x), -d * np.log(16.0))], 1)
            inside = (np.abs(x) < 8).all(axis=1, keepdims=True)
            return x, np.where(inside, rows, -np.inf)

        def propose(mixture, number, rng=rng, look=look):
            return look(mixture.draw(rng, number))

        draws = Draws(*look(rng.uniform(-8, 8, (500, d))))
        draws.add(*propose(start, 500), start)
        refined = refine(draws, start, 300, 1_500, propose)
        shares.append(Trial(refined, *propose(refined, 2_000)).efficiency)
        evidences.append(draws.log_evidence)
    assert min(shares) > least
    assert abs(np.mean(evidences)) < 0.03
