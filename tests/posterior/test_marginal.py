"""The likelihood under a model that knows its own error."""

import dataclasses

import numpy as np
import pytest
from scipy import stats
from support.gradients import DATA, LINEAR, LinearDerived, LinearModel

import emcee_femu as ef
from emcee_femu.interfaces import ModalSolution

RNG = np.random.default_rng(3)
SPREAD = 0.3 * RNG.standard_normal((4, 2))  # of y, along two directions
SD = 0.2
THETA = RNG.standard_normal((6, 3))


def directions(y):
    return {"y": {j: np.broadcast_to(SPREAD[:, j], y.shape) for j in range(2)}}


class Uncertain(LinearModel):
    """A linear response that knows its error."""

    def spread(self, parameters):
        response = self(parameters)
        return response, directions(response["y"])


class UncertainDerived(LinearDerived, Uncertain):
    """The same with derivatives."""


@dataclasses.dataclass
class Gaussian:
    """Independent Gaussian errors of some of the data."""

    points: slice

    def __call__(self, parameters, response):
        r, sd = self.deviations(parameters, response)
        return stats.norm.logpdf(r, scale=sd).sum(axis=1)

    def deviations(self, parameters, response):
        r = response["y"][:, self.points] - DATA[self.points]
        return r, np.full_like(r, SD)


def exact(y, spread=SPREAD):
    """Return the log-density of the data, the model's variance beside theirs."""
    law = stats.multivariate_normal(np.zeros(4), SD**2 * np.eye(4) + spread @ spread.T)
    return law.logpdf(y - DATA)


PRIOR = ef.GaussianPrior(LinearModel.names, np.zeros(3), np.ones(3))


@pytest.mark.parametrize("model", [Uncertain(), UncertainDerived()])
@pytest.mark.parametrize(
    "terms",
    [[Gaussian(slice(None))], [Gaussian(slice(0, 3)), Gaussian(slice(3, None))]],
)
def test_the_variance_of_the_model_adds_to_that_of_the_data(model, terms):
    posterior = ef.LogPosterior(model, terms, PRIOR)
    rows = posterior(THETA)
    likelihood = rows[:, 2 : 2 + len(terms)].sum(axis=1)
    np.testing.assert_allclose(likelihood, exact(THETA @ LINEAR.T), rtol=1e-9)
    np.testing.assert_allclose(rows[:, 0], rows[:, 1] + likelihood)
    # What goes on beside it, with derivatives or differences, has the same rows.
    np.testing.assert_allclose(posterior.gradient(THETA)[0], rows)
    np.testing.assert_allclose(posterior.linearize(THETA).rows, rows)


def test_a_second_term_knows_what_the_first_has_told():
    terms = [Gaussian(slice(0, 3)), Gaussian(slice(3, None))]
    first = ef.LogPosterior(Uncertain(), terms[0], PRIOR)(THETA)[:, 2]
    both = ef.LogPosterior(Uncertain(), terms, PRIOR)(THETA)
    np.testing.assert_allclose(both[:, 2], first)
    np.testing.assert_allclose(both[:, 3], exact(THETA @ LINEAR.T) - first)


def test_a_function_as_a_term():
    """Without derivatives directions count as independent: here they are."""

    class OneByOne(Uncertain):
        def spread(self, parameters):
            response = self(parameters)
            y = response["y"]
            own = {j: 0.3 * np.eye(4)[j] * np.ones_like(y) for j in (0, 2)}
            return response, {"y": own}

    term = Gaussian(slice(None))
    posterior = ef.LogPosterior(OneByOne(), lambda p, r: term(p, r), PRIOR)
    found = posterior(THETA)[:, 2]
    wider = exact(THETA @ LINEAR.T, 0.3 * np.eye(4)[:, [0, 2]])
    np.testing.assert_allclose(found, wider)


def test_a_point_that_a_term_refuses_stays_refused():
    def refuse(parameters, response):
        return np.where(parameters["a"] > 0, -np.inf, 0.0)

    terms = [refuse, Gaussian(slice(None))]
    rows = ef.LogPosterior(Uncertain(), terms, PRIOR)(THETA)
    np.testing.assert_array_equal(rows[:, 0] == -np.inf, THETA[:, 0] > 0)
    kept = rows[:, 0] > -np.inf
    assert kept.any() and not kept.all()
    expected = exact(THETA[kept] @ LINEAR.T)
    np.testing.assert_allclose(rows[kept, 3], expected)


class Modes:
    """Two modes that change places, in their frequencies uncertain by one direction."""

    names = required = ("a",)
    variables = ef.modal_variables(2, [1, 2])

    def __call__(self, parameters):
        a = parameters["a"]
        f = np.sort(np.stack([a, np.full_like(a, 10.0)], axis=1))
        shapes = np.where((a < 10)[:, None, None], np.eye(2), np.eye(2)[::-1])
        return ModalSolution(f, shapes)

    def spread(self, parameters):
        response = self(parameters)
        one = np.where((parameters["a"] < 10)[:, None], [0.5, 0.0], [0.0, 0.5])
        return response, {
            "frequency": {"of a": one},
            "shapes": {"of shape": 0.1 * np.ones_like(response.shapes)},
        }


def test_what_a_paired_model_knows_of_its_error():
    measured = ef.Measurements([9.0, 10.0], shapes=np.eye(2), dofs=[1, 2])
    paired = ef.PairedModel(Modes(), measured, candidates=2, min_gap=0.0)
    term = ef.FrequencyTerm([9.0, 10.0], relative_sd=0.01)
    prior = ef.GaussianPrior(["a"], [10.0], [2.0], [(5.0, 15.0)])
    theta = np.array([[8.5], [11.5]])
    found = ef.LogPosterior(paired, term, prior)(theta)[:, 2]
    sd = [np.hypot(0.09, 0.5), 0.1]
    f = np.column_stack([theta, [10.0, 10.0]])
    np.testing.assert_allclose(found, stats.norm.logpdf(f, [9, 10], sd).sum(axis=1))


def test_a_spread_of_the_wrong_shape_is_refused():
    class Wrong(Uncertain):
        def spread(self, parameters):
            response = self(parameters)
            return response, {"y": {"z": np.zeros((len(response["y"]), 3))}}

    posterior = ef.LogPosterior(Wrong(), Gaussian(slice(None)), PRIOR)
    with pytest.raises(ValueError, match=r"spread: expected .* of shape \(6, 4\)"):
        posterior(THETA)
