"""Gradients, scores and deviations of the terms, for all their options."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

import emcee_femu as ef
from emcee_femu.interfaces import PairedSolution, Pairing
from tests.support.gradients import MEASURED, SHAPES, Derived, modes, numerical

COVARIANCE = (
    np.diag([0.02, 0.03, 0.05]) @ (0.6 + 0.4 * np.eye(3)) @ np.diag([0.02, 0.03, 0.05])
)
SENSORS = np.random.default_rng(1).uniform(0.1, 0.3, SHAPES.shape)
TERMS = {
    "beta": ef.FrequencyTerm(MEASURED, beta=[1e4, 2e4, 5e3]),
    "fewer modes": ef.FrequencyTerm(MEASURED[:2], sd=[0.02, 0.03]),
    "covariance": ef.FrequencyTerm(MEASURED, covariance=COVARIANCE),
    "discrepancy": ef.FrequencyTerm(MEASURED, discrepancy="s"),
    "discrepancy and sd": ef.FrequencyTerm(MEASURED, sd=0.02, discrepancy="s"),
    "discrepancy and covariance": ef.FrequencyTerm(
        MEASURED, covariance=COVARIANCE, discrepancy="s"
    ),
    "delta": ef.ShapeTerm(SHAPES, delta=0.1),
    "delta of each mode": ef.ShapeTerm(SHAPES, delta=[0.1, 0.05, 0.2]),
    "inferred delta": ef.ShapeTerm(SHAPES, discrepancy="s"),
    "sensors": ef.ShapeTerm(SHAPES, sd=SENSORS),
    "fewer shapes": ef.ShapeTerm(SHAPES[:, :2], sd=SENSORS[:, :2]),
    "one sensor moves": ef.ShapeTerm([[-1.0], [0.0], [0.0], [0.0]], delta=0.5),
    "some sensors": ef.ShapeTerm(
        ef.Measurements(MEASURED, shapes=SHAPES[[2, 0]], dofs=[2, 0]), delta=0.1
    ),
}
THETA = np.random.default_rng(2).uniform([0.8, 0.8, 0.05], [1.3, 1.3, 0.2], (5, 3))
PARAMETERS = dict(zip(("a", "b", "s"), THETA.T, strict=True))


def tangents_at(parameters, sign=1.0):
    """Return the response of Derived, its shapes scaled, and all derivatives."""
    solution, by_name = Derived().jacobian(parameters)
    n = len(parameters["a"])
    found = {
        name: np.tile(unit, (n, 1)) for name, unit in zip("abs", np.eye(3), strict=True)
    }
    for variable, by in by_name.items():
        parts = [by["a"], by["b"], np.zeros_like(by["a"])]
        found[variable] = np.stack(parts, axis=-1)
    found["shapes"] = sign * found["shapes"]
    response = {"frequency": solution.frequencies, "shapes": sign * solution.shapes}
    return response, found


def log_likelihood(term, sign=1.0):
    def function(theta):
        frequencies, shapes = modes(theta[:, 0], theta[:, 1])
        response = {"frequency": frequencies, "shapes": sign * shapes}
        return term({"s": theta[:, 2]}, response)

    return function


@pytest.mark.parametrize("sign", [1.0, -3.0])
@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_the_gradient_is_that_of_the_log_likelihood(term, sign):
    response, tangents = tangents_at(PARAMETERS, sign)
    gradient, _ = term.linearize(PARAMETERS, response, tangents)
    expected = numerical(log_likelihood(term, sign), THETA)
    assert_allclose(gradient, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_deviations_hold_all_but_a_constant_of_the_log_likelihood(term):
    response, _ = tangents_at(PARAMETERS)
    deviations, sd = term.deviations(PARAMETERS, response)
    assert deviations.shape == sd.shape
    left = term(PARAMETERS, response) - stats.norm.logpdf(deviations, 0, sd).sum(axis=1)
    assert_allclose(left, left[0], rtol=0, atol=1e-11)


@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_the_scores_are_the_derivatives_of_mean_and_deviation(term):
    """Fisher's of a Gaussian: dmu dmu / sigma^2 + 2 dsigma dsigma / sigma^2."""
    response, tangents = tangents_at(PARAMETERS)
    _, scores = term.linearize(PARAMETERS, response, tangents)
    sd = term.deviations(PARAMETERS, response)[1]

    def part(which):
        def function(theta):
            frequencies, shapes = modes(theta[:, 0], theta[:, 1])
            response = {"frequency": frequencies, "shapes": shapes}
            return term.deviations({"s": theta[:, 2]}, response)[which]

        return function

    slopes = [numerical(part(which), THETA).swapaxes(1, 2) for which in (0, 1)]
    means, sds = (slope / sd[:, :, None] for slope in slopes)
    information = means.swapaxes(1, 2) @ means + 2 * sds.swapaxes(1, 2) @ sds
    found = scores.swapaxes(1, 2) @ scores
    assert_allclose(found, information, rtol=1e-6, atol=1e-6 * np.abs(found).max())


def test_fisher_information_is_the_mean_square_of_the_gradient():
    """Over data drawn from the model; the shape of each mode has three ways to err."""
    rng, delta, n = np.random.default_rng(3), 0.01, 4000
    at = {name: value[:1] for name, value in PARAMETERS.items()} | {"s": [delta]}
    at["s"] = np.array(at["s"])
    response, tangents = tangents_at(at)
    true = response["shapes"][0] / np.linalg.norm(response["shapes"][0], axis=0)
    gradients = []
    for _ in range(n):
        term = ef.ShapeTerm(
            true + delta * rng.standard_normal(true.shape), discrepancy="s"
        )
        gradients.append(term.linearize(at, response, tangents)[0][0])
    squares = np.einsum("ni,nj->nij", gradients, gradients)
    _, scores = ef.ShapeTerm(true, discrepancy="s").linearize(at, response, tangents)
    error = (squares.mean(axis=0) - scores[0].T @ scores[0]) / squares.std(axis=0)
    assert (np.abs(error) * np.sqrt(n) < 5).all()
    assert scores[0, :, 2] @ scores[0, :, 2] == pytest.approx(2 * 9 / delta**2)


def test_unpaired_modes_change_no_gradient():
    response, tangents = tangents_at(PARAMETERS)
    n = len(THETA)
    pairing = Pairing(np.ones((n, 3)), np.ones((n, 3), int), np.ones((n, 3), bool))
    paired = PairedSolution(response["frequency"], response["shapes"], pairing)
    for label in ("beta", "sensors"):
        term = TERMS[label]
        alike = [term.linearize(PARAMETERS, r, tangents)[0] for r in (response, paired)]
        assert_array_equal(*alike)


@pytest.mark.parametrize("label", ["discrepancy and covariance", "sensors", "delta"])
def test_a_row_has_the_same_bits_alone_and_among_many(label):
    term = TERMS[label]
    many = term.linearize(PARAMETERS, *tangents_at(PARAMETERS))
    for i in range(len(THETA)):
        alone = {name: value[i : i + 1] for name, value in PARAMETERS.items()}
        one = term.linearize(alone, *tangents_at(alone))
        assert_array_equal(many[0][i], one[0][0])
        assert_array_equal(many[1][i], one[1][0])
