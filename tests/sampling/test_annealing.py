"""An annealed population has the posterior's law, and the evidence its exact value."""

import numpy as np
import pytest
from scipy.special import logsumexp
from support.examples import load
from support.tempered_laws import BoundedLaw, GaussianLaw

import emcee_femu as ef
from emcee_femu.moves import IndependenceMove
from emcee_femu.sampling import annealing
from emcee_femu.sampling.annealing import anneal_population
from emcee_femu.sampling.renewing import renew

LIMIT = 5.0


class Counted:
    """Evaluate a posterior, or a log-likelihood under a prior, and count solves."""

    def __init__(self, prior, log_likelihood=None, posterior=None):
        self.prior, self.log_likelihood, self.posterior = (
            prior,
            log_likelihood,
            posterior,
        )
        self.solves = 0

    def rows(self, theta):
        self.solves += int((self.prior.logpdf(theta) > -np.inf).sum())
        if self.posterior is not None:
            return self.posterior(theta)
        log_prior = self.prior.logpdf(theta)
        values = np.where(log_prior > -np.inf, self.log_likelihood(theta), -np.inf)
        return np.column_stack([log_prior + values, log_prior, values])


def anneal(law, seed, size):
    posterior = law.posterior
    evaluation = Counted(posterior.prior, posterior=posterior)
    rng = np.random.default_rng(seed)
    return anneal_population(evaluation, posterior.prior, rng, size)


def box(d, half_width):
    ends = ef.uniform_between(-half_width, half_width)
    return ef.IndependentPrior({f"x{i}": ends for i in range(d)})


def two_modes(theta):
    """Return the log of a density: .3 at 5 and .7 at -5 along the first axis."""
    rest = (theta[:, 1:] ** 2).sum(axis=1)
    modes = [
        np.log(share) - 0.5 * ((theta[:, 0] - centre) ** 2 + rest)
        for share, centre in ((0.7, -5.0), (0.3, 5.0))
    ]
    return np.logaddexp(*modes) - 0.5 * theta.shape[1] * np.log(2 * np.pi)


@pytest.mark.parametrize("law", [GaussianLaw(), BoundedLaw()], ids=["free", "bounded"])
def test_population_and_evidence_are_exact_over_replicates(law):
    found = [anneal(law, seed, 160) for seed in range(12)]
    averages = np.array([law.statistics(p.theta, 1.0).mean(axis=0) for p in found])
    errors = averages.std(axis=0, ddof=1) / np.sqrt(len(found))
    assert np.abs(averages.mean(axis=0) / errors).max() < LIMIT
    assert errors.max() < 0.1  # of statistics of unit size: a test that can fail
    off = np.array([p.log_evidence - law.log_evidence for p in found])
    claimed = np.array([p.log_evidence_error for p in found])
    assert abs(off.mean()) < LIMIT * off.std(ddof=1) / np.sqrt(len(found))
    assert 1 / 2 < claimed.mean() / np.sqrt((off**2).mean()) < 2
    assert claimed.mean() < 0.2


def test_two_modes_keep_their_shares():
    prior = box(2, 10.0)
    shares, off = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        found = anneal_population(Counted(prior, two_modes), prior, rng, 300)
        shares.append((found.theta[:, 0] > 0).mean())
        off.append(found.log_evidence + 2 * np.log(20.0))
    assert abs(np.mean(shares) - 0.3) < LIMIT * np.std(shares, ddof=1) / np.sqrt(6)
    assert np.std(shares) < 0.06
    assert abs(np.mean(off)) < 0.2


def test_draws_of_zero_likelihood_have_no_weight_and_lower_the_evidence():
    prior = box(2, 10.0)

    def right_half(theta):
        return np.where(theta[:, 1] > 0, two_modes(theta), -np.inf)

    rng = np.random.default_rng(1)
    found = anneal_population(Counted(prior, right_half), prior, rng, 400)
    assert (found.theta[:, 1] > 0).all()
    assert np.isfinite(found.rows[:, 0]).all()
    off = found.log_evidence + np.log(2 * 400.0)
    assert abs(off) < LIMIT * found.log_evidence_error < 1


def test_a_prior_that_hardly_ever_has_a_likelihood_is_refused():
    prior = box(2, 10.0)

    def corner(theta):
        return np.where((theta > 9.9).all(axis=1), 0.0, -np.inf)

    with pytest.raises(ValueError, match="2000 draws of the prior have a finite"):
        anneal_population(Counted(prior, corner), prior, np.random.default_rng(1), 100)


def test_the_same_stream_gives_the_same_population_and_all_solves_are_counted():
    prior, seeds = box(3, 10.0), (1, 1, 2)
    counted = [Counted(prior, two_modes) for _ in seeds]
    one, same, other = (
        anneal_population(own, prior, np.random.default_rng(seed), 100)
        for own, seed in zip(counted, seeds, strict=True)
    )
    assert one.theta.tobytes() == same.theta.tobytes()
    assert one.log_evidence == same.log_evidence != other.log_evidence
    assert one.solves == counted[0].solves >= one.sweeps.sum()
    row = Counted(prior, two_modes).rows(one.theta)
    assert np.array_equal(row, one.rows)


def test_a_likelihood_that_says_nothing_takes_one_step():
    prior = box(2, 1.0)
    evaluation = Counted(prior, lambda theta: np.full(len(theta), -3.5))
    found = anneal_population(evaluation, prior, np.random.default_rng(1), 100)
    assert found.powers.tolist() == [0.0, 1.0]
    assert found.log_evidence == pytest.approx(-3.5, abs=1e-12)
    assert found.log_evidence_error == pytest.approx(0.0, abs=1e-6)


def test_the_neck_of_a_funnel_is_missed_and_no_error_is_claimed():
    problem = load("evidence").funnel()
    found = ef.anneal(problem.posterior, seed=1)
    assert found.log_evidence < problem.exact - 1
    assert found.log_evidence_error == np.inf
    (problem_found,) = found.problems
    assert "heavy tail (Pareto k " in problem_found
    text = str(found)
    assert "(no standard error can be claimed)\nA region of the posterior" in text
    assert ef.log_evidence(found).problems == found.problems


@pytest.mark.parametrize("power", [0.3, 1.0])
def test_weights_of_independence_proposals_have_the_tempered_evidence_as_mean(power):
    prior, n = box(2, 10.0), 2_000
    scale = 1 / np.sqrt(power)  # of exp(-x^2 power / 2)
    rng = np.random.default_rng(1)
    theta = rng.normal(size=(n, 2)) * scale
    evaluation = Counted(prior, lambda x: -0.5 * (x**2).sum(axis=1))
    halves = [np.arange(n // 2), np.arange(n // 2, n)]
    rows = evaluation.rows(theta)
    random = np.random.RandomState(1)
    fits = [IndependenceMove.fit(theta)] * 2
    log_weights = renew(evaluation, theta, rows, halves, power, random, fits)[2]
    exact = np.log(2 * np.pi * scale**2 / 400)
    size = len(log_weights)
    error = np.exp(log_weights - exact).std() / np.sqrt(size)
    assert error < 0.02
    assert abs(logsumexp(log_weights) - np.log(size) - exact) < LIMIT * error


def test_a_half_of_copies_is_moved_and_moves_the_other_by_the_last_fits():
    prior, n = box(2, 10.0), 200
    theta = np.random.default_rng(1).normal(size=(n, 2))
    last = [IndependenceMove.fit(theta)] * 2
    theta[: n // 2] = theta[0]
    evaluation = Counted(prior, gaussian_in_a_box)
    halves = [np.arange(n // 2), np.arange(n // 2, n)]
    rows, fits = evaluation.rows(theta), list(last)
    renew(evaluation, theta, rows, halves, 1.0, np.random.RandomState(1), fits)
    assert fits[1] is last[1] and fits[0] is not last[0]
    assert len(np.unique(theta, axis=0)) > 0.8 * n
    assert (np.abs(theta.mean(axis=0)) < 0.4).all()
    np.testing.assert_allclose(np.cov(theta.T), np.eye(2), atol=0.4)


def test_a_posterior_of_a_ten_thousandth_of_the_prior_is_found():
    prior, sd = box(3, 1.0), 1e-4
    centre = np.array([0.3, -0.2, 0.7])

    def sharp(theta):
        x = (theta - centre) / sd
        return -0.5 * (x**2).sum(axis=1) - 3 * np.log(sd * np.sqrt(2 * np.pi))

    evaluation = Counted(prior, sharp)
    found = anneal_population(evaluation, prior, np.random.default_rng(1), 300)
    off = found.log_evidence + 3 * np.log(2.0)
    assert abs(off) < LIMIT * found.log_evidence_error < 2
    z = (found.theta.mean(axis=0) - centre) / sd
    assert np.abs(z).max() < 0.3
    assert (np.diff(found.powers) > 0).all()


def test_members_that_never_move_are_as_few_draws_as_their_ancestors(monkeypatch):
    # Then it is importance sampling from the prior, of known relative error.
    monkeypatch.setattr(annealing, "renew", lambda *_: (0.0, 1, np.zeros(9)))
    prior, size = ef.GaussianPrior(["a", "b"], [0.0, 0.0], 1.0), 2_000
    precision = 39.0

    def narrow(theta):
        return -0.5 * precision * (theta**2).sum(axis=1)

    evaluation = Counted(prior, narrow)
    found = anneal_population(evaluation, prior, np.random.default_rng(1), size)
    assert len(found.sweeps) > 2
    # E[L] = 1 / (1 + 39) and E[L^2] = 1 / (1 + 78).
    variance = (1 / 79 / (1 / 40) ** 2 - 1) / size
    assert found.log_evidence_error == pytest.approx(np.sqrt(variance), rel=0.2)
    assert abs(found.log_evidence + np.log(40.0)) < 3 * np.sqrt(variance)
    # And of the mean, as weighted draws know it: E[L^2 theta^2] = 1 / 79^2 per axis.
    exact = (1 / 40) / (40**2 / 79**2 / size)
    assert found.effective_size == pytest.approx([exact, exact], rel=0.3)
    assert evaluation.solves == size


def gaussian_in_a_box(theta):
    d = theta.shape[1]
    return -0.5 * (theta**2).sum(axis=1) - 0.5 * d * np.log(2 * np.pi)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "d", "size"),
    [
        (two_modes, 2, 1_000),
        (gaussian_in_a_box, 2, 500),
        (gaussian_in_a_box, 10, 1_000),
    ],
)
def test_the_claimed_error_of_the_evidence_is_its_spread(law, d, size):
    prior, off, claimed = box(d, 10.0), [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        found = anneal_population(Counted(prior, law), prior, rng, size)
        off.append(found.log_evidence + d * np.log(20.0))
        claimed.append(found.log_evidence_error)
    z = np.array(off) / claimed
    assert (np.abs(z) < 3).sum() >= 19
    assert 1 / 1.5 < np.mean(claimed) / np.std(off, ddof=1) < 1.5
    assert abs(np.mean(off)) < LIMIT * np.std(off, ddof=1) / np.sqrt(20)
