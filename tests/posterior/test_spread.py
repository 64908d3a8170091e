"""Linear Gaussian problems: derivatives, and a model that knows its own error."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.gradients import (
    DATA,
    LINEAR,
    Crossing,
    LinearDerived,
    LinearModel,
    LinearTerm,
)

import emcee_femu as ef

RNG = np.random.default_rng(3)
SPREAD = 0.3 * RNG.standard_normal((4, 2))  # of y, along two directions
THETA = RNG.standard_normal((6, 3))
PRIOR = ef.GaussianPrior(LinearModel.names, np.zeros(3), np.ones(3))


class Uncertain(LinearModel):
    """A linear response that knows its error: one sd along each direction."""

    directions = SPREAD

    def spread(self, parameters):
        response = self(parameters)
        columns = enumerate(self.directions.T)
        shape = response["y"].shape
        return response, {"y": {j: np.broadcast_to(c, shape) for j, c in columns}}


class UncertainDerived(LinearDerived, Uncertain):
    """The same with derivatives."""


class Diagonal(Uncertain):
    """Without derivatives of a term directions count as independent: here they are."""

    directions = 0.3 * np.eye(4)[:, [0, 2]]


@pytest.mark.parametrize("model", [LinearDerived(), LinearModel()])
def test_a_conjugate_gaussian_is_exact(model):
    prior = ef.GaussianPrior(model.names, np.zeros(3), np.ones(3))
    posterior = ef.LogPosterior(model, LinearTerm(), prior)
    precision = LINEAR.T @ LINEAR / 0.2**2 + np.eye(3)
    mean = np.linalg.solve(precision, LINEAR.T @ DATA / 0.2**2)
    theta = posterior.start(5, seed=0)
    local, expected = posterior.linearize(theta), (mean - theta) @ precision
    tolerance = 1e-10 if posterior.differentiable else 1e-8
    assert_allclose(local.gradient, expected, atol=tolerance * np.abs(expected).max())
    assert_allclose(local.information, np.tile(precision, (5, 1, 1)), rtol=1e-8)


ALL, FIRST, LAST = LinearTerm(), LinearTerm(last=3), LinearTerm(first=3)


def exact(theta, directions=SPREAD):
    """Return the log-density of the data, the model's variance beside theirs."""
    covariance = 0.2**2 * np.eye(4) + directions @ directions.T
    return stats.multivariate_normal(DATA, covariance).logpdf(theta @ LINEAR.T)


@pytest.mark.parametrize(
    ("model", "terms"),
    [
        (Uncertain(), [ALL]),
        (Uncertain(), [FIRST, LAST]),
        (UncertainDerived(), [FIRST, LAST]),
        (Diagonal(), [lambda p, r: ALL(p, r)]),
    ],
)
def test_the_variance_of_the_model_adds_to_that_of_the_data(model, terms):
    posterior = ef.LogPosterior(model, terms, PRIOR)
    rows = posterior(THETA)
    likelihood = rows[:, 2 : 2 + len(terms)].sum(axis=1)
    assert_allclose(likelihood, exact(THETA, model.directions), rtol=1e-9)
    assert_allclose(rows[:, 0], rows[:, 1] + likelihood)
    if len(terms) == 2:  # the second knows what the first has told
        alone = ef.LogPosterior(model, FIRST, PRIOR)(THETA)
        assert_allclose(rows[:, 2], alone[:, 2])
        # What goes on beside it, with derivatives or differences, has the same rows.
        assert_allclose(posterior.gradient(THETA)[0], rows)
        assert_allclose(posterior.linearize(THETA).rows, rows)


def test_a_point_that_a_term_refuses_stays_refused():
    def refuse(parameters, response):
        return np.where(parameters["a"] > 0, -np.inf, 0.0)

    rows = ef.LogPosterior(Uncertain(), [refuse, ALL], PRIOR)(THETA)
    assert_array_equal(rows[:, 0] == -np.inf, THETA[:, 0] > 0)
    kept = rows[:, 0] > -np.inf
    assert kept.any() and not kept.all()
    assert_allclose(rows[kept, 3], exact(THETA[kept]))


class Modes(Crossing):
    """Two modes that change places, in their frequencies uncertain by one direction."""

    def spread(self, parameters):
        response = self(parameters)
        along = np.where((parameters["a"] < 10)[:, None], [0.5, 0.0], [0.0, 0.5])
        return response, {
            "frequency": {"of a": along},
            "shapes": {"of shape": 0.1 * np.ones_like(response.shapes)},
        }


def test_what_a_paired_model_knows_of_its_error():
    measured = ef.Measurements([9.0, 10.0], shapes=np.eye(2))
    paired = ef.PairedModel(Modes(), measured, candidates=2, min_gap=0.0)
    term = ef.FrequencyTerm([9.0, 10.0], relative_sd=0.01)
    prior = ef.GaussianPrior(["a", "b"], [10.0, 10.0], 2.0, [(5.0, 15.0)] * 2)
    theta = np.array([[8.5, 10.0], [11.5, 10.0]])
    rows = ef.LogPosterior(paired, term, prior)(theta)
    sd = [np.hypot(0.09, 0.5), 0.1]
    assert_allclose(rows[:, 2], stats.norm.logpdf(theta, [9, 10], sd).sum(axis=1))


def test_a_spread_of_the_wrong_shape_is_refused():
    class Wrong(Uncertain):
        def spread(self, parameters):
            response = self(parameters)
            return response, {"y": {"z": np.zeros((len(response["y"]), 3))}}

    with pytest.raises(ValueError, match="spread"):
        ef.LogPosterior(Wrong(), ALL, PRIOR)(THETA)
