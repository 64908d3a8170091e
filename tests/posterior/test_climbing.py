"""Climbs end at the maximum, with its exact Gaussian, in few solves."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import emcee_femu as ef
from emcee_femu.posterior.climbing import Maximum, climb, climb_each, distinct
from emcee_femu.posterior.laplace import log_probability
from emcee_femu.sampling.evaluation import Evaluation
from tests.support.examples import load
from tests.support.tempered_laws import GaussianLaw


@dataclass(frozen=True)
class NoModel:
    """Counts its solves; the density stands in the term."""

    calls: list
    variables = {"x": ef.Variable({})}

    def __call__(self, parameters):
        n = len(next(iter(parameters.values())))
        self.calls.append(n)
        return {"x": np.zeros(n)}


def density_posterior(log_density, spread, bounds=None):
    names = [f"x{i}" for i in range(len(spread))]
    prior = ef.GaussianPrior(names, np.zeros(len(spread)), spread, bounds)

    def term(parameters, response):
        theta = np.stack([parameters[name] for name in names], axis=1)
        return log_density(theta) - prior.logpdf(theta)

    return ef.LogPosterior(NoModel([]), term, prior)


def evaluate(posterior, on_failure="raise"):
    return Evaluation.of(posterior, None, on_failure, 1.0)


def climb_from_draws(posterior, n=6, seed=1):
    starts = posterior.start(n, seed)
    return climb_each(evaluate(posterior), starts, posterior.prior)


def turned(d, condition):
    """Return a covariance of that condition, in no axis's direction."""
    Q = np.linalg.qr(np.random.default_rng(0).normal(size=(d, d)))[0]
    return Q * np.geomspace(1, condition, d) @ Q.T / np.sqrt(condition)


RIDGE = np.full((6, 6), 0.9999) + 1e-4 * np.eye(6)


def test_a_linear_gaussian_problem_has_its_exact_answer_after_one_step():
    law = GaussianLaw()
    (mean, covariance), d = law.moments(1.0), 3
    for found in climb_from_draws(law.posterior):
        assert found.converged and not found.at_bound.any()
        assert found.solves == 2 * (d + 1)  # the start and the maximum
        assert_allclose(found.theta, mean, atol=1e-5)
        assert_allclose(found.covariance, covariance, rtol=1e-6)
        assert_allclose(found.log_evidence, law.log_evidence, atol=1e-7)
        assert_allclose(found.row, law.posterior(found.theta), rtol=1e-12)


@pytest.mark.parametrize(
    "covariance", [turned(2, 1e4), turned(20, 1e4), turned(50, 1e4), RIDGE]
)
def test_a_black_box_gaussian_is_exact_whatever_its_shape(covariance):
    d = len(covariance)
    law = stats.multivariate_normal(np.full(d, 0.5), covariance)
    posterior = density_posterior(law.logpdf, np.full(d, 20.0))
    first, *others = climb_from_draws(posterior)
    hessian = 1 + 2 * d + d * (d - 1) // 2
    assert first.solves <= hessian + 4 * d + 3 + d * (d - 1) // 2
    for found in (first, *others):
        assert found.converged
        rest = found.theta - 0.5
        assert rest @ np.linalg.solve(covariance, rest) < 0.1**2
        ratio = np.linalg.eigvals(np.linalg.solve(covariance, found.covariance))
        assert_allclose(ratio, 1.0, atol=2e-3)
        assert_allclose(found.log_evidence, 0.0, atol=1e-3)
    # They begin with what the first one learned.
    assert max(other.solves for other in others) <= 2 * (2 * d + 1)


def test_solves_are_those_of_the_model():
    posterior = density_posterior(
        stats.multivariate_t(np.zeros(3), np.eye(3), df=3).logpdf, np.full(3, 4.0)
    )
    evaluation = evaluate(posterior)
    maxima = climb_each(evaluation, posterior.start(5, 2), posterior.prior)
    calls = sum(posterior.model.calls)
    assert sum(m.solves for m in maxima) == evaluation.solves == calls
    assert_allclose([m.theta for m in maxima], 0.0, atol=0.05)
    # Curvature (3 + d) / 3 at the top.
    assert_allclose(maxima[0].covariance, np.eye(3) / 2, atol=0.02)
    # All climbs share their batches.
    assert len(posterior.model.calls) < 2 * max(m.solves for m in maxima) / 3


class Line:
    """A linear model with derivatives."""

    variables = {"x": ef.Variable({"i": [0, 1]})}

    def __call__(self, parameters):
        return self.jacobian(parameters)[0]

    def jacobian(self, parameters):
        a, b = parameters["a"], parameters["b"]
        one = np.ones_like(a)
        x = np.column_stack([a + 2 * b, a - b])
        slopes = {
            "a": np.column_stack([one, one]),
            "b": np.column_stack([2 * one, -one]),
        }
        return {"x": x}, {"x": slopes}


def test_a_term_of_unknown_form_takes_one_solve_for_a_gradient():
    def term(parameters, response):
        x = response["x"]
        return -0.5 * ((x[:, 0] - 1) ** 2 / 0.01 + (x[:, 1] - 2) ** 2 / 0.04)

    prior = ef.GaussianPrior(["a", "b"], [0.0, 0.0], [1.0, 2.0])
    posterior = ef.LogPosterior(Line(), term, prior)
    design = np.array([[1.0, 2.0], [1.0, -1.0]])
    precision = np.diag([1.0, 0.25]) + design.T @ np.diag([100.0, 25.0]) @ design
    mean = np.linalg.solve(precision, design.T @ np.array([100.0, 50.0]))
    for found in climb_from_draws(posterior):
        assert found.converged
        assert_allclose(found.theta, mean, atol=1e-4)
        assert_allclose(found.covariance, np.linalg.inv(precision), rtol=1e-4)
        assert found.solves <= 1 + 2 + 1 + 1 + 2


def test_a_maximum_in_a_corner_has_the_evidence_of_the_exponential():
    posterior = density_posterior(
        lambda x: -20 * x[:, 0] + 30 * x[:, 1] - x[:, 2] ** 2 / 2,
        np.full(3, 2.0),
        [(0.0, 5.0), (-1.0, 1.0), (-9.0, 9.0)],
    )
    for found in climb_from_draws(posterior):
        assert found.converged
        assert found.at_bound.tolist() == [True, True, False]
        assert_allclose(found.theta, [0, 1, 0], atol=0.05)
        sd = np.sqrt(np.diag(found.covariance))
        assert_allclose(sd, [1 / 20, 1 / 30, 1], rtol=1e-3)
        expected = np.log(1 / 20) + 30 + np.log(1 / 30) + 0.5 * np.log(2 * np.pi)
        assert_allclose(found.log_evidence, expected, atol=1e-3)


def test_rounding_leaves_no_maximum_an_ulp_out_of_bounds():
    rng = np.random.default_rng(4)
    bounds = np.sort(rng.normal(size=(30, 2)) * 10.0 ** rng.integers(-9, 9, (30, 1)))
    width = np.ptp(bounds, axis=1)
    slopes = np.where(rng.random(30) < 0.5, -9, 9) / width
    posterior = density_posterior(lambda x: x @ slopes, 3 * width, bounds)
    (found,) = climb_from_draws(posterior, 1)
    assert found.converged and found.at_bound.all()
    ends = np.where(slopes > 0, bounds[:, 1], bounds[:, 0])
    assert_allclose(found.theta, ends, 4e-16, 0)  # an ulp, which NumPy 2.0 leaves
    assert ((found.theta >= bounds[:, 0]) & (found.theta <= bounds[:, 1])).all()


def test_a_gaussian_beyond_its_bounds_is_climbed_to_the_face_that_is_nearest():
    covariance = turned(4, 30)
    law = stats.multivariate_normal([-1.0, 0.3, 0.5, -0.2], covariance, seed=1)
    bounds = [(0.0, np.inf), (0.0, 2.0), (-5.0, 0.7), (-np.inf, np.inf)]
    posterior = density_posterior(law.logpdf, np.full(4, 2.0), bounds)
    found = climb_from_draws(posterior)
    low, high = np.transpose(bounds)
    inside = law.cdf(high, lower_limit=low)
    for one in found:
        assert one.converged and one.at_bound[0]
        assert_allclose(one.theta, found[0].theta, atol=0.05)
        assert_allclose(one.log_evidence, np.log(inside), atol=0.05)


def test_the_probability_of_a_box_far_in_the_tail():
    covariance = np.array([[1.0, 0.5, 0.2], [0.5, 1.0, 0.3], [0.2, 0.3, 1.0]])
    low, high = np.array([5.0, -1.0, -np.inf]), np.array([np.inf, 3.0, 1.0])
    law = stats.multivariate_normal(np.zeros(3), covariance)
    draws = np.random.default_rng(1).standard_normal((200_000, 2))
    # Given the first, which is 5 + an exponential or so, the others are Gaussian.
    x = 5 + np.random.default_rng(2).exponential(0.2, 200_000)
    weights = stats.norm.pdf(x) / (5 * np.exp(-5 * (x - 5)))
    rest = covariance[1:, 1:] - np.outer([0.5, 0.2], [0.5, 0.2])
    others = x[:, None] * [0.5, 0.2] + draws @ np.linalg.cholesky(rest).T
    expected = np.mean(weights * ((others > low[1:]) & (others < high[1:])).all(axis=1))
    found = log_probability(law.mean, covariance, low, high)
    assert_allclose(found, np.log(expected), atol=0.05)


def test_both_modes_of_beck_and_au_are_found():
    maxima = climb_from_draws(load("evidence").beck_au().posterior, 12)
    first, second = (maxima[group[0]] for group in distinct(maxima))
    assert sorted([round(m.theta[0], 1) for m in (first, second)]) == [0.5, 1.8]
    assert all(m.converged for m in maxima)


def test_a_curved_valley_is_followed_to_its_end():
    posterior = density_posterior(
        lambda x: -0.5 * (x[:, 0] ** 2 / 4 + 25 * (x[:, 1] + x[:, 0] ** 2 - 3) ** 2),
        np.array([4.0, 8.0]),
    )
    for found in climb_from_draws(posterior, 8):
        assert found.converged
        assert_allclose(found.theta, [0, 3], atol=0.2)
        assert found.solves < 250


def test_a_start_between_two_modes_is_left():
    def two(x):
        left = -0.5 * ((x - [-3, 0]) ** 2).sum(axis=1)
        return np.logaddexp(left, -0.5 * ((x - [3, 0]) ** 2).sum(axis=1))

    posterior = density_posterior(two, np.full(2, 4.0))
    found = climb(evaluate(posterior), np.zeros(2), posterior.prior)
    assert found.converged
    assert_allclose(np.abs(found.theta), [3, 0], atol=0.05)


def failing(p):
    if p["a"] > 1.5:
        raise ArithmeticError("no equilibrium")
    return [20 + 3 * p["a"] + p["b"], 50 + p["a"] - 2 * p["b"]]


def failing_posterior():
    model = ef.FunctionModel(failing, n_modes=2)
    prior = ef.GaussianPrior(["a", "b"], [0.0, 0.0], [1.0, 0.5])
    term = ef.FrequencyTerm([20.0, 50.0], relative_sd=0.02)
    return ef.LogPosterior(model, term, prior)


def test_a_start_that_fails_is_dropped_and_the_others_go_on():
    posterior = failing_posterior()
    starts = np.array([[1.6, 0.0], [1.0, 0.3], [1.4999999, 0.0], [-1.0, 0.2]])
    evaluation = evaluate(posterior, "reject")
    lost, found, beside, other = climb_each(evaluation, starts, posterior.prior)
    assert lost.message == "the posterior is zero at the start, or its solve failed"
    assert beside.message == "a solve beside the start failed"
    for one, start in ((lost, starts[0]), (beside, starts[2])):
        assert one.log_evidence == -np.inf and not one.converged
        assert np.isnan(one.covariance).all()
        assert_allclose(one.theta, start)
    assert found.converged and other.converged
    assert_allclose(found.theta, other.theta, atol=1e-4)
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        climb(evaluate(posterior), starts[0], posterior.prior)


@dataclass(frozen=True)
class Pothole:
    """Cannot be solved on both sides at once of a point."""

    at: np.ndarray
    variables = {"x": ef.Variable({})}

    def __call__(self, parameters):
        theta = np.column_stack([*parameters.values()])
        if ((theta > self.at) & (theta < self.at + 0.3)).all(axis=1).any():
            raise ArithmeticError("no equilibrium")
        return {"x": np.zeros(len(theta))}


class SlopingPothole(Pothole):
    def jacobian(self, parameters):
        response = self(parameters)
        return response, {"x": {}}


def test_a_curvature_does_without_a_solve_that_failed():
    law = stats.multivariate_normal([1.0, -1.0], [[1.0, 0.3], [0.3, 2.0]])
    names, start = ("x0", "x1"), np.array([-1.0, -3.0])
    prior = ef.GaussianPrior(names, [0, 0], [4, 4])

    def term(parameters, response):
        theta = np.column_stack([parameters[name] for name in names])
        return law.logpdf(theta) - prior.logpdf(theta)

    for model in (Pothole(start), SlopingPothole(start - [0.1, -1e-9])):
        posterior = ef.LogPosterior(model, term, prior)
        evaluation = evaluate(posterior, "reject")
        found = climb(evaluation, start, prior)
        assert evaluation.failures.causes["exception"] > 0
        assert found.converged
        assert_allclose(found.theta, law.mean, atol=0.1)
        assert_allclose(found.covariance, law.cov, rtol=0.01)


def maximum(theta, height, covariance):
    return Maximum(
        np.array(theta), np.array([height, 0.0]), covariance, 0.0, None, True, 1, ""
    )


def test_what_counts_as_one_maximum():
    unit, long = np.eye(2), np.diag([4.0, 0.01])
    same = [maximum([0, 0], 0, unit), maximum([0.04, 0], -0.001, unit)]
    assert distinct(same) == [[0, 1]]
    apart = [maximum([0, 0], 0, unit), maximum([3, 0], 0, unit)]
    assert distinct(apart) == [[0], [1]] or distinct(apart) == [[1], [0]]
    # A needle in a broad mode is near it by the broad covariance alone.
    needle = [maximum([0, 0], 0, unit), maximum([1, 0], 2, 0.01 * unit)]
    assert distinct(needle) == [[1], [0]]
    # Too high for a Gaussian that wide.
    assert len(distinct([maximum([0, 0], 0, unit), maximum([0.5, 0], 3, unit)])) == 2
    # A flat ridge: neighbours link those at its ends.
    ridge = [maximum([x, 0], 0, long) for x in (-6, 6, -3, 3, 0)]
    assert [sorted(group) for group in distinct(ridge)] == [[0, 1, 2, 3, 4]]


def test_a_density_without_bound_is_told():
    """One parameter fits one frequency exactly, and its error goes to zero."""
    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
    law = stats.halfnorm(scale=0.01)
    prior = ef.IndependentPrior({"k": ef.uniform_between(5.0, 12.0), "s": law})
    term = ef.FrequencyTerm([3.0], discrepancy="s")
    with pytest.raises(ValueError, match="density seems to grow without bound"):
        ef.find_map(ef.LogPosterior(model, term, prior), seed=1)
