"""What is said before any sampling is exact where the posterior is Gaussian."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import emcee_femu as ef

DESIGN = np.array([[3.0, 1.0, 0.0], [1.0, -2.0, 0.0]])  # Hz per unit of the parameters
SD, MEASURED, RELATIVE = np.array([1.0, 0.5, 2.0]), np.array([21.0, 49.0]), 0.02


def linear_posterior(**bounds):
    laws = {name: stats.norm(0, sd) for name, sd in zip("abc", SD, strict=True)}
    model = ef.FunctionModel(
        lambda p: [20 + 3 * p["a"] + p["b"], 50 + p["a"] - 2 * p["b"]], n_modes=2
    )
    term = ef.FrequencyTerm(MEASURED, relative_sd=RELATIVE)
    return ef.LogPosterior(model, term, ef.IndependentPrior(laws, bounds))


def test_a_linear_gaussian_problem_has_its_exact_answer():
    found = ef.identifiability(ef.find_map(linear_posterior(), 3, seed=1))
    noise = np.diag((RELATIVE * MEASURED) ** -2.0)
    covariance = np.linalg.inv(DESIGN.T @ noise @ DESIGN + np.diag(SD**-2.0))
    mean = covariance @ DESIGN.T @ noise @ (MEASURED - [20, 50])
    sd = np.sqrt(np.diag(covariance))
    # The prior's own are those of its draws, good to 1 %.
    assert_allclose(found.sd_ratio, sd / SD, rtol=0.02)
    assert_allclose(found.shift, mean / SD, atol=0.03)
    assert_allclose(found.correlation, covariance / np.outer(sd, sd), atol=1e-4)
    predicted = [20, 50] + DESIGN @ mean
    expected = 2 * DESIGN * found.prior_sd / predicted[:, None]
    assert_allclose(found.sensitivities, expected, atol=1e-6)
    assert np.isnan(found.r_squared).all() and (found.at_bound == 0).all()
    local, left = found.findings
    assert local.startswith("Local") and left.startswith("The data leave c")
    # The effect in errors is the design by the errors, locally and by samples: of a
    # linear model the log-likelihood is a quadratic, whatever the samples are.
    effect = np.linalg.norm(DESIGN / (RELATIVE * MEASURED)[:, None], axis=0)
    assert_allclose(found.effect, effect * found.prior_sd, rtol=1e-5)
    run = ef.run(linear_posterior(), ef.DEMCMove(), steps=30, ensembles=1, seed=1)
    sampled = ef.identifiability(run)
    assert_allclose(sampled.effect, effect * sampled.prior_sd, rtol=1e-5, atol=1e-5)


def test_a_bound_pressed_upon_is_the_gaussians_not_the_samples():
    posterior = linear_posterior(a=(0.8, 3.0), b=(-4, 4), c=(-9, 9))
    found = ef.identifiability(ef.find_map(posterior, 3, seed=1))
    (sentence,) = [text for text in found.findings if "pressed" in text]
    assert sentence.startswith("a ") and "lower bound 0.8" in sentence
    # The mean of what is inside the bounds is not on one of them.
    assert 0.8 + 0.5 * np.sqrt(found.covariance[0, 0]) < found.mean[0] < 0.9


@pytest.mark.parametrize("sampled", [False, True])
def test_lognormal_priors_are_compared_by_logarithms(sampled):
    """Fault 7: else a c.o.v. that has fallen may be "as uncertain as before"."""
    sd, error = 0.8, 0.4
    term = ef.FrequencyTerm([3.0], beta=(3.0 / error) ** 2)
    laws = {"k": stats.lognorm(sd), "u": (0.5, 1.5)}
    model = ef.FunctionModel(lambda p: [3 + np.log(p["k"])], n_modes=1)
    prior = ef.IndependentPrior(laws, bounds={"k": (np.exp(-2.99), np.inf)})
    posterior = ef.LogPosterior(model, term, prior)
    if sampled:
        run = ef.run(posterior, ef.DEMCMove(), 40, 500, ensembles=1, seed=1)
        found = ef.identifiability(ef.to_inference_data(run, discard=100))
        assert_allclose(found.shift[0], 0, atol=0.06)
        assert (found.mean - found.prior_mean)[0] / found.prior_sd[0] < -0.2
    else:
        found = ef.identifiability(ef.find_map(posterior, 4, seed=1))
    # ln k is normal, and 3 + ln k is measured as 3.0 +- 0.4.
    after = 1 / np.sqrt(sd**-2 + error**-2)
    assert_allclose(found.sd_ratio[0], after / sd, rtol=0.06)
    assert np.isnan(found.logarithms[:, 1]).all()
