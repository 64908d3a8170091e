"""Tails that hold much of a variance are covered, and noise that data do not bound."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.free_posterior import box, free_posterior

import emcee_femu as ef

SHARE, LENGTH, BEND = 0.02, 3.0, 0.15  # of the mass, along x1, away from its axis


def place(t):
    """Return centre and sd across an arm that begins where x1 is below -2."""
    u = np.minimum(t + 2.0, 0.0)
    return BEND * u[:, None] ** 2 * [1.0, -1.0], 1 / (1 - 0.6 * u)[:, None]


def arm(x):
    """Return the density of a Gaussian with a thin, bent arm."""
    tail = stats.expon.pdf(-3.0 - x[:, 0], scale=LENGTH)
    mean, sd = place(x[:, 0])
    along = np.log((1 - SHARE) * stats.norm.pdf(x[:, 0]) + SHARE * tail)
    return along + stats.norm.logpdf(x[:, 1:], mean, sd).sum(axis=1)


ACROSS = {"x2": stats.uniform(-60, 120), "x3": stats.uniform(-60, 120)}
LIMITS = ef.IndependentPrior({"x1": stats.uniform(-25, 33)} | ACROSS)
POSTERIOR = free_posterior(arm, LIMITS)
TWO = ef.IndependentPrior({"x1": stats.uniform(-25, 50)} | ACROSS)


@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_a_thin_arm_is_met_all_along(seed):
    """Exact draws of the arm are where the proposal draws too, not in a gap of it."""
    found = ef.run(POSTERIOR, steps=2, ensembles=2, seed=seed).search
    t = -3.0 - np.random.default_rng(5).exponential(LENGTH, 2_000)
    mean, sd = place(t)
    x = mean + sd * np.random.default_rng(6).normal(size=(len(t), 2))
    x = np.column_stack([t, x])[t > -20]
    lack = arm(x) - found.mixture.log_density(x)
    assert np.quantile(lack, 0.9) < 4.0


def two_arms(x):
    """Return the density of half a thin arm to either side of a Gaussian."""
    arms = [arm(np.column_stack([side * x[:, 0], x[:, 1:]])) for side in (-1, 1)]
    return np.logaddexp(*arms)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 7])
def test_tails_are_followed_although_climbs_took_many_solves(seed):
    """Their variance is in the weighted draws: climbs by differences are dear."""
    posterior = free_posterior(two_arms, TWO)
    found = ef.run(posterior, solves=60_000, ess=1.0, seed=seed).search
    assert found.kurtosis[1:].min() > 100  # the law has 310; 4 if no tail is followed


def test_a_gaussian_needs_no_more_than_a_few_climbs():
    """Tails that the draws have seen cost little, and no component of their own."""
    gaussian = free_posterior(lambda x: -0.5 * (x**2).sum(axis=1), box(-9, 9, 3))
    found = ef.run(gaussian, steps=2, ensembles=2, seed=1).search
    assert found.efficiency > 0.85 and len(found.mixture.weights) <= 4


@pytest.mark.slow
def test_the_standard_deviations_of_converged_runs_are_not_too_small():
    """Law: a tail of .22 % of the mass and 14 % of the variance of k4 is sampled."""
    posterior, exact = ef.paper.mass_spring().posterior, 57.61
    runs = [ef.run(posterior, steps=300, seed=seed) for seed in range(60, 65)]
    found = [(run, ef.diagnose(run)) for run in runs]
    good = [(run, d) for run, d in found if d.converged]
    assert len(good) >= 3
    sds = np.array([np.std([s.get_chain()[..., 2] for s in run]) for run, _ in good])
    claimed = np.array([d.sd_error[2] for _, d in good])
    assert sds.mean() > 0.98 * exact
    assert np.sqrt(np.mean(((sds / exact - 1) / claimed) ** 2)) < 1.6


@pytest.mark.slow
def test_claimed_errors_know_the_tail_that_a_short_chain_did_not_visit():
    """Law: errors of sds are as claimed; by the chain's own kurtosis they are 2.5."""
    rng, n = np.random.default_rng(5), 1_000_000
    arm_of_it = rng.random(n) < SHARE
    t = np.where(arm_of_it, -3 - rng.exponential(LENGTH, n), rng.normal(size=n))
    mean, sd = place(t[t > -25])
    across = mean + sd * rng.normal(size=mean.shape)
    exact = np.append(t[t > -25].std(), across.std(axis=0))
    z = []
    for seed in range(8):
        run = ef.run(POSTERIOR, steps=60, seed=seed)
        sds = np.std([sampler.get_chain() for sampler in run], axis=(0, 1, 2))
        z.append((sds / exact - 1) / ef.diagnose(run).sd_error)
    assert (np.sqrt(np.mean(np.square(z), axis=0)) < 1.5).all()


HERTZ = {"k1": 8.0, "k2": 10.5}
ENDS = {"k1": (5.0, 9.0), "k2": (9.0, 14.0)}
HALF_NORMAL = stats.halfnorm(scale=0.02)
ADVISED = stats.uniform(0.001, 0.049)  # what pages and messages advise


def noisy(names, law, modes):
    """Return that of parameters that each fit a frequency, or several."""

    def model(parameters):
        return ef.ModalSolution(np.column_stack([parameters[n] for n in modes]))

    model.names, model.variables = (*names,), ef.modal_variables(len(modes))
    term = ef.FrequencyTerm([HERTZ[name] for name in modes], discrepancy="noise")
    laws = {name: ENDS[name] for name in names} | {"noise": law}
    return ef.LogPosterior(model, term, ef.IndependentPrior(laws))


def exact_sds(names, law, repeats):
    """Return standard deviations: given the noise, frequencies are cut normals."""
    noise = law.ppf((np.arange(4_000) + 0.5) / 4_000)
    cut = []
    for name in names:
        centre, spread = HERTZ[name], HERTZ[name] * noise / repeats**0.5
        ends = [(end - centre) / spread for end in ENDS[name]]
        cut.append(stats.truncnorm(*ends, centre, spread))
    mass = [stats.norm.cdf(one.args[1]) - stats.norm.cdf(one.args[0]) for one in cut]
    weights = np.prod(mass, axis=0) * noise ** (len(names) * (1 - repeats))
    moments = [(one.mean(), one.var()) for one in cut] + [(noise, 0.0 * noise)]

    def sd(mean, variance):
        centre = np.average(mean, weights=weights)
        return np.average(variance + (mean - centre) ** 2, weights=weights) ** 0.5

    return [sd(*pair) for pair in moments]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "law", "repeats"),
    [(["k1"], HALF_NORMAL, 1), (["k1", "k2"], ADVISED, 1), (["k1"], ADVISED, 2)],
)
def test_noise_that_the_data_do_not_bound_has_exact_moments(names, law, repeats):
    """The law of a likelihood with a spike: exact moments, and no false alarm."""
    run = ef.run(noisy(names, law, repeats * names), seed=3)
    draws = np.concatenate([one.get_chain(flat=True) for one in run])
    assert_allclose(draws.std(axis=0), exact_sds(names, law, repeats), rtol=0.12)
    assert ef.diagnose(run).chains.status == "converged"


def test_an_integral_without_bound_is_refused_before_sampling():
    """Two frequencies that one parameter fits: the integral of 1 / noise."""
    posterior = noisy(["k1"], HALF_NORMAL, ["k1", "k1"])
    with pytest.raises(ValueError, match=r"'noise'.*0\.001"):
        ef.run(posterior, steps=20, seed=1)
