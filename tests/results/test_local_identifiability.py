"""What is said before any sampling is exact where the posterior is Gaussian."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import emcee_femu as ef

DESIGN = np.array([[3.0, 1.0, 0.0], [1.0, -2.0, 0.0]])  # Hz per unit of the parameters
SD, MEASURED, RELATIVE = np.array([1.0, 0.5, 2.0]), np.array([21.0, 49.0]), 0.02


def frequencies(p):
    return [20 + 3 * p["a"] + p["b"], 50 + p["a"] - 2 * p["b"]]


def linear_posterior(bounds=None):
    prior = ef.GaussianPrior(["a", "b", "c"], np.zeros(3), SD)
    if bounds is not None:  # which the mean need not be within
        laws = {name: stats.norm(0, sd) for name, sd in zip("abc", SD, strict=True)}
        prior = ef.IndependentPrior(laws, dict(zip("abc", bounds, strict=True)))
    model = ef.FunctionModel(frequencies, n_modes=2)
    term = ef.FrequencyTerm(MEASURED, relative_sd=RELATIVE)
    return ef.LogPosterior(model, term, prior)


@pytest.fixture
def found():
    return ef.identifiability(ef.find_map(linear_posterior(), 3, seed=1))


def test_a_linear_gaussian_problem_has_its_exact_answer(found):
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


def test_it_is_said_to_be_local(found):
    assert found.findings[0].startswith("Local: of the Gaussian about the maximum, not")
    assert found.findings[1].startswith("The data leave c as uncertain as before")
    assert len(found.findings) == 2
    assert "R^2" not in str(found) and "Local: " in str(found)
    assert found.sensitivity_table.column("parameter") == ["a", "b", "c"]


def test_sensitivities_of_the_paper_are_those_of_its_stiffness():
    """All springs together would have d ln(lambda) / d ln(k) = 1; some are fixed."""
    posterior = ef.paper.mass_spring().posterior
    start = [4000.0, 2200.0, 2120.0, 2600.0, 2400.0]
    maximum = ef.find_map(posterior, start, seed=1)
    found = ef.identifiability(maximum)
    elastic = (found.sensitivities / found.prior_sd) @ maximum.maxima[0].theta
    assert ((elastic > 0) & (elastic < 1)).all()
    assert found.modes == tuple(f"mode {i}" for i in range(1, 6))


def test_a_bound_pressed_upon_is_the_gaussians_not_the_samples():
    posterior = linear_posterior(bounds=[(0.8, 3.0), (-4, 4), (-9, 9)])
    found = ef.identifiability(ef.find_map(posterior, 3, seed=1))
    (sentence,) = [text for text in found.findings if "pressed" in text]
    assert sentence.startswith("a is pressed against its lower bound 0.8")
    assert "of the Gaussian's draws lie" in sentence
    # The mean of what is inside the bounds is not on one of them.
    assert 0.8 + 0.5 * np.sqrt(found.covariance[0, 0]) < found.mean[0] < 0.9
