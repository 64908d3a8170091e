"""The pipeline against closed forms and other routes; the paper's printed numbers."""

import emcee
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.tempered_laws import GaussianLaw

import emcee_femu as ef

LAW = GaussianLaw()


def test_conjugate_gaussian_posterior_is_recovered():
    moves = [(ef.DEMCMove(), 0.8), (ef.DEMCMove(gamma0=1.0), 0.2)]
    samplers = ef.run(LAW.posterior, moves, 20, 300, ensembles=4, seed=1)
    diagnosis = ef.diagnose(samplers, discard=50)
    draws = np.concatenate([s.get_chain(discard=50, flat=True) for s in samplers])
    mean, covariance = LAW.moments(1.0)
    sd = np.sqrt(np.diag(covariance))
    ess = diagnosis.ess_bulk.min()
    assert ess > 700  # else the next lines would prove little
    z = (draws.mean(axis=0) - mean) / (sd / np.sqrt(diagnosis.ess_bulk))
    assert np.abs(z).max() < 5
    ratio = np.cov(draws, rowvar=False) / np.outer(sd, sd)
    exact = covariance / np.outer(sd, sd)
    assert np.abs(ratio - exact).max() < 5 * np.sqrt(2 / ess)


def test_the_evidence_is_the_mean_of_the_likelihood_over_the_prior():
    theta = LAW.posterior.start(100_000, seed=2)
    likelihood = np.exp(LAW.posterior(theta)[:, 2])
    error = likelihood.std() / np.sqrt(len(likelihood))
    assert error < 0.1 * likelihood.mean()
    assert abs(likelihood.mean() - np.exp(LAW.log_evidence)) < 5 * error


def importance_moments(posterior, pilots, draws, seed):
    """Return mean, sd and Kish size; pilots only shape the proposal, of Student-t's."""
    rng = np.random.default_rng(seed)
    scale = np.abs(pilots[0].mean(axis=0))  # areas beside moments of area
    laws = []
    for pilot in pilots:
        x = pilot / scale
        centre, covariance = x.mean(axis=0), np.cov(x, rowvar=False)
        laws.append(stats.multivariate_t(centre, covariance, df=5, seed=rng))
        laws.append(stats.multivariate_t(centre, 6 * covariance, df=5, seed=rng))
    x = np.vstack([law.rvs(draws // len(laws)) for law in laws])
    density = np.mean([law.pdf(x) for law in laws], axis=0)
    parts = np.array_split(x * scale, 1 + len(x) // 5_000)
    log_prob = np.concatenate([posterior(part)[:, 0] for part in parts])
    weights = np.exp(log_prob - log_prob.max()) / density
    weights /= weights.sum()
    mean = weights @ x
    sd = np.sqrt(weights @ (x - mean) ** 2)
    return mean * scale, sd * scale, 1 / (weights**2).sum()


@pytest.mark.slow
def test_mass_spring_agrees_with_importance_sampling():
    """The law of the default run: moments by a route without chains."""
    posterior = ef.paper.mass_spring().posterior
    pilot = ef.run(posterior, steps=200, seed=3, ensembles=1)[0].get_chain(flat=True)
    lobe = pilot[pilot[:, 2] < 1_980]  # a second mode of 3 % of the mass
    mean, sd, kish = importance_moments(posterior, [pilot, lobe], 60_000, seed=3)
    assert kish > 6_000
    ensembles = ef.run(posterior, seed=2026, ess=5_000, ensembles=8)
    z = (np.stack([s.get_chain(flat=True) for s in ensembles]) - mean) / sd
    for power, exact in ((1, 0.0), (2, 1.0)):
        each = (z**power).mean(axis=1)  # (ensembles, d)
        error = np.hypot(each.std(axis=0, ddof=1) / np.sqrt(8), 4 / np.sqrt(kish))
        assert error.max() < 0.1 and np.median(error) < 0.05
        assert np.abs((each.mean(axis=0) - exact) / error).max() < 4.5


@pytest.mark.slow
def test_h_structure_with_the_implied_beta_agrees_with_importance_sampling():
    """The law of a narrow posterior: moments by a route without chains."""
    posterior = ef.paper.h_structure(5e4).posterior
    (run,) = ef.run(posterior, nwalkers=14, solves=14_000, seed=3, ensembles=1)
    chain = run.get_chain()
    draws = chain.reshape(-1, 6)
    mean, sd, kish = importance_moments(posterior, [draws], 10_000, seed=3)
    assert kish > 1_800
    # First and second powers, in the chain's own errors, and those of the weights.
    for power, expected in ((1, 0.0), (2, 1.0)):
        values = ((chain - mean) / sd) ** power
        tau = emcee.autocorr.integrated_time(values, quiet=True)
        error = values.std(axis=(0, 1)) * np.sqrt(tau / len(draws) + 1 / kish)
        assert (np.abs(values.mean(axis=(0, 1)) - expected) < 4 * error).all()
        assert error.max() < 0.1
    # A local mode at A3 = 4.9e-4 with a mass near 2e-4 would make the last one 3.1.
    assert_allclose(100 * sd / mean, [35.5, 4.3, 29.5, 1.8, 2.25, 2.9], rtol=0.08)


MASS_SPRING, H = ef.paper.mass_spring(), ef.paper.h_structure()
PRINTED = MASS_SPRING.published


def frequencies(problem, values):
    return problem.model({name: np.array([v]) for name, v in values.items()})[0][0]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (MASS_SPRING.target, [3.50745, 5.14931, 7.08276, 8.89167, 9.42645]),
        (MASS_SPRING.initial, [3.57645, 5.37087, 7.23927, 9.03010, 9.41166]),
        (PRINTED.parameters["paper mean"], PRINTED.frequencies["paper Hz"]),
        (MASS_SPRING.target, MASS_SPRING.measured),
        (MASS_SPRING.nominal, [3.508, 5.154, 7.088, 8.897, 9.434]),
    ],
)
def test_mass_spring_rows(values, expected):
    digits = 1e-5 if len(f"{expected[0]}") > 5 else 6e-4
    computed = frequencies(MASS_SPRING, values)
    np.testing.assert_allclose(computed, expected, rtol=0, atol=digits)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("initial", [51.03, 115.91, 199.70, 246.04, 387.66]),
        ("paper DE-MC", [52.36, 119.35, 210.07, 253.93, 434.19]),
        ("paper M-H", [53.92, 122.26, 211.83, 259.76, 410.09]),
    ],
)
def test_h_structure_rows(name, expected):
    known = H.published.parameters | {"initial": H.initial}
    initially = {"initial": [51.04, 115.79, 199.88, 245.76, 387.53]}
    printed = (H.published.frequencies | initially)[name]
    computed = frequencies(H, known[name])
    np.testing.assert_allclose(computed, expected, rtol=0, atol=0.02)
    np.testing.assert_allclose(computed, printed, rtol=0.005)
