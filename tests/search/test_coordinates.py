"""Coordinates: the change of variables, by its own Jacobian and by quadrature."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate, stats
from support.free_posterior import free_posterior

import emcee_femu as ef
from emcee_femu.evaluation.evaluator import Evaluation, Solver
from emcee_femu.search.coordinates import Coordinates

LAWS = {
    "stiffness": stats.lognorm(2.0, scale=1e6),
    "share": stats.beta(2.0, 3.0, loc=-1.0, scale=4.0),
    "offset": stats.norm(-1.0, 2.0),
}
PRIOR = ef.IndependentPrior(LAWS)
KINDS = [Coordinates.plain, Coordinates.positive, Coordinates.unbounded, Coordinates.of]


@pytest.mark.parametrize("kind", KINDS)
def test_parameters_come_back_from_their_coordinates(kind):
    seen, theta = kind(PRIOR), PRIOR.sample(np.random.default_rng(1), 40)
    assert_allclose(seen.parameters(seen.coordinates(theta)), theta, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_the_volume_is_the_determinant_of_the_jacobian(kind):
    seen = kind(PRIOR)
    x, steps = seen.coordinates(PRIOR.sample(np.random.default_rng(1), 40)), []
    for axis in 1e-5 * np.diag(seen.scale):
        moved = seen.parameters(x + axis) - seen.parameters(x - axis)
        steps.append(moved / (2 * axis.sum()))
    log_det = np.linalg.slogdet(np.stack(steps, axis=-1))[1]
    assert_allclose(seen.log_volume(x), log_det, atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", LAWS)
def test_the_prior_of_a_coordinate_integrates_to_one(kind, name):
    law = LAWS[name]
    seen = kind(ef.IndependentPrior({name: law}))
    ends = law.ppf([1e-9, 0.01, 0.5, 0.99, 1 - 1e-9])
    x = seen.coordinates(ends[:, None])[:, 0]

    def density(value):
        return np.exp(seen.logpdf(np.array([[value]]))[0])

    parts = [integrate.quad(density, *pair)[0] for pair in zip(x, x[1:], strict=False)]
    assert sum(parts) == pytest.approx(1.0, abs=1e-5)


def test_logarithms_are_of_wide_positive_parameters_that_are_symmetric_so():
    laws = LAWS | {"narrow": stats.lognorm(0.2), "flat": stats.uniform(1.0, 99.0)}
    assert Coordinates.of(ef.IndependentPrior(laws)).logs.tolist() == [
        True,
        *[False] * 4,
    ]
    positive = Coordinates.positive(ef.IndependentPrior(laws)).logs
    assert positive.tolist() == [True, False, False, True, True]


def test_derivatives_are_those_of_the_logarithms():
    """The density of ln s and x is Gaussian; differences are to one side."""
    prior = ef.IndependentPrior({"s": LAWS["stiffness"], "x": LAWS["offset"]})
    measured, sd = np.array([13.0, 0.5]), np.array([0.5, 1.0])

    def density(theta):
        seen = np.column_stack([np.log(theta[:, 0]), theta[:, 1]])
        return stats.norm.logpdf(seen, measured, sd).sum(axis=1)

    evaluator = Evaluation(Solver(free_posterior(density, prior), False))
    x = np.array([[12.0, 0.3], [15.0, -2.0]])
    seen = Coordinates.positive(prior)
    rows, gradient, _ = seen.linearize(evaluator, x)
    before, wide = np.array([np.log(1e6), -1.0]), 2.0
    exact = -(x - measured) / sd**2 - (x - before) / wide**2
    assert_allclose(gradient, exact, atol=0.02)
    height = stats.norm.logpdf(x, measured, sd) + stats.norm.logpdf(x, before, wide)
    assert_allclose(rows[:, 0], height.sum(axis=1), rtol=1e-9)


def test_derivatives_of_a_model_are_carried_to_the_logarithms():
    """The response is ln s, which a model differentiates by s."""
    prior = ef.IndependentPrior({"s": LAWS["stiffness"]})
    variables, measured, sd = {"y": ef.Variable({"i": [0]})}, 13.0, 0.5

    class Logs:
        names = ("s",)

        def __init__(self):
            self.variables = variables

        def __call__(self, p):
            return {"y": np.log(p["s"])[:, None]}

        def jacobian(self, p):
            return self(p), {"y": {"s": 1 / p["s"][:, None]}}

    class Term(ef.likelihoods.term.Term):
        name, reads = "y", variables

        def deviations(self, parameters, response):
            r = response["y"] - measured
            return r, np.full(r.shape, sd)

    posterior = ef.LogPosterior(Logs(), Term(), prior)
    evaluator = Evaluation(Solver(posterior, False))
    top = (measured / sd**2 + np.log(1e6) / 4.0) / (1 / sd**2 + 1 / 4.0)
    x = np.array([[12.0], [15.0], [top]])
    _, gradient, information = Coordinates.positive(prior).linearize(evaluator, x)
    exact = -(x - measured) / sd**2 - (x - np.log(1e6)) / 4.0
    assert_allclose(gradient, exact, rtol=1e-3, atol=1e-3)
    # At the maximum, nearly: what the slope of the prior alone bends is left out.
    assert_allclose(information[-1, 0, 0], 1 / sd**2 + 1 / 4.0, rtol=0.1)
