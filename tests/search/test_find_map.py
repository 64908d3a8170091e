"""Maxima with their exact Gaussians and weights, in few solves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import optimize, stats
from support.examples import load
from support.free_posterior import free_posterior
from support.gradients import MEASURED, SHAPES, Derived
from support.pool_problems import forks
from support.runs import Counting
from support.tempered_laws import GaussianLaw

import emcee_femu as ef


def density_posterior(log_density, spread, bounds=None):
    """Return a posterior of that density, with a prior of that spread."""
    names = [f"x{i}" for i in range(len(spread))]
    mean = np.zeros(len(spread))
    if bounds is not None:  # within which a prior's mean has to be
        mean = np.clip(mean, *np.transpose(bounds))
    prior = ef.GaussianPrior(names, mean, spread, bounds)
    return free_posterior(lambda theta: log_density(theta) - prior.logpdf(theta), prior)


class Deriving(Counting):
    """A model that counts its solves, with derivatives."""

    def jacobian(self, parameters):
        self.solves += len(next(iter(parameters.values())))
        return self.model.jacobian(parameters)


def test_a_linear_gaussian_problem_is_exact_and_its_check_says_so():
    target, d = GaussianLaw(), 3
    result = ef.find_map(target.posterior, 5, seed=1, check=50)
    mean, covariance = target.moments(1.0)
    (best,) = result.maxima
    assert best.converged and not best.at_bound.any()
    assert_allclose(best.theta, mean, atol=1e-5)
    assert_allclose(best.covariance, covariance, rtol=1e-6)
    assert_allclose(best.log_evidence, target.log_evidence, atol=1e-7)
    assert_allclose(best.log_posterior, target.posterior(best.theta)[0], rtol=1e-12)
    assert result.weights.tolist() == [1.0] and result.climbs.tolist() == [5]
    # At the prior mean, and from each start to the maximum.
    assert result.solves == 1 + 5 * 2 * (d + 1) + 50
    assert result.draws == 50 and result.pareto_k < 0.7
    assert_allclose(result.efficiency, 1.0, atol=1e-4)


def turned(d, condition):
    """Return a covariance of that condition, in no axis's direction."""
    Q = np.linalg.qr(np.random.default_rng(0).normal(size=(d, d)))[0]
    return Q * np.geomspace(1, condition, d) @ Q.T / np.sqrt(condition)


RIDGE = np.full((6, 6), 0.9999) + 1e-4 * np.eye(6)


@pytest.mark.parametrize("covariance", [turned(20, 1e4), RIDGE])
def test_a_black_box_gaussian_is_exact_whatever_its_shape(covariance):
    d = len(covariance)
    target = stats.multivariate_normal(np.full(d, 0.5), covariance)
    posterior = density_posterior(target.logpdf, np.full(d, 20.0))
    result = ef.find_map(posterior, 6, seed=1)
    (best,) = result.maxima
    assert best.converged and result.climbs.tolist() == [6]
    rest = best.theta - 0.5
    assert rest @ np.linalg.solve(covariance, rest) < 0.1**2
    ratio = np.linalg.eigvals(np.linalg.solve(covariance, best.covariance))
    assert_allclose(ratio, 1.0, atol=2e-3)
    assert_allclose(best.log_evidence, 0.0, atol=1e-3)
    # Two Hessians for the first climb; the others begin with what it learned.
    hessian = 1 + 2 * d + d * (d - 1) // 2
    assert result.solves <= 2 * hessian + 5 * 2 * (2 * d + 1)


class Level:
    """A level that was measured three times."""

    names, variables = ("level",), {"y": ef.Variable({"i": range(3)})}

    def __call__(self, p):
        return {"y": p["level"][:, None] + RESIDUALS}


class InferredNoise(ef.likelihoods.term.Term):
    """Measurements of zero, whose standard deviation is inferred."""

    name, reads, observed = "y", Level.variables, {"y": np.zeros(3)}
    names, bounds = ("sd",), {"sd": (0, np.inf)}

    def deviations(self, parameters, response):
        r = response["y"]
        return r, np.broadcast_to(parameters["sd"][:, None], r.shape)


RESIDUALS = np.array([0.01, -0.01, 0.0])
WIDE = ef.IndependentPrior(
    {"level": stats.norm(0, 1), "sd": stats.lognorm(1, scale=0.02)}
)
NOISY = {
    "deviations": ef.LogPosterior(Level(), InferredNoise(), WIDE),
    "rows": free_posterior(
        lambda x: stats.norm.logpdf(x[:, :1] + RESIDUALS, 0, x[:, 1:]).sum(axis=1),
        WIDE,
    ),
}
FROM = {
    "prior": 40,
    "far": np.column_stack([np.zeros(6), [1e-3, 0.02, 1.0, 5.0, 18.0, 30.0]]),
}


@pytest.mark.parametrize(
    ("seen", "starts"),
    [
        ("deviations", "prior"),
        ("rows", "far"),
        pytest.param("deviations", "far", marks=pytest.mark.slow),
        pytest.param("rows", "prior", marks=pytest.mark.slow),
    ],
)
def test_a_slope_is_no_maximum_however_gentle(seen, starts):
    """The density falls as the noise grows, in each prior sd by less."""
    found = ef.find_map(NOISY[seen], FROM[starts], seed=1)
    (top,) = found.maxima
    squares = RESIDUALS @ RESIDUALS
    sd = optimize.brentq(lambda s: squares / s**2 - 4 - np.log(s / 0.02), 1e-3, 1.0)
    best = NOISY[seen](np.array([0.0, sd]))[0]
    assert top.converged
    assert top.log_posterior == pytest.approx(best, abs=1e-3)
    if starts == "prior":  # no step on the way led to the slope
        assert not found.lost


def test_a_maximum_in_a_corner_has_the_evidence_of_the_exponential():
    bounds = [(0.0, 5.0), (-1.0, 1.0), (-9.0, 9.0)]
    posterior = density_posterior(
        lambda x: -20 * x[:, 0] + 30 * x[:, 1] - x[:, 2] ** 2 / 2, [2.0] * 3, bounds
    )
    result = ef.find_map(posterior, 6, seed=1)
    (best,) = result.maxima
    assert best.converged
    assert best.at_bound.tolist() == [True, True, False]
    assert_allclose(best.theta, [0, 1, 0], atol=0.05)
    assert_allclose(np.sqrt(np.diag(best.covariance)), [1 / 20, 1 / 30, 1], rtol=1e-3)
    expected = np.log(1 / 20) + 30 + np.log(1 / 30) + 0.5 * np.log(2 * np.pi)
    assert_allclose(best.log_evidence, expected, atol=1e-3)
    assert result.maxima_table.column("at a bound") == ["x0 x1"]
    assert_allclose(result.table.column("sd 1"), [1 / 20, 1 / 30, 1], rtol=0.1)
    # All draws of a check are inside, and solved.
    assert ef.find_map(posterior, 6, seed=1, check=60).solves == result.solves + 60


@pytest.mark.parametrize("outside", [1.0, 5.0])
def test_a_gaussian_beyond_its_bounds_has_the_mass_that_is_inside(outside):
    scale = np.diag([1.0, 2.0, 0.7])
    covariance = scale @ [[1.0, 0.5, 0.2], [0.5, 1.0, 0.3], [0.2, 0.3, 1.0]] @ scale
    target = stats.multivariate_normal([-outside, 0.3, 0.5], covariance)
    bounds = np.array([(0.0, np.inf), (-2.0, 6.0), (-5.0, 0.7 + outside)])
    posterior = density_posterior(target.logpdf, np.full(3, 3.0), bounds)
    result = ef.find_map(posterior, 6, seed=1)
    (best,) = result.maxima
    assert best.converged and best.at_bound[0]
    # Draw the first from its tail, and the others given the first.
    rng, n = np.random.default_rng(1), 200_000
    tail = stats.truncnorm(outside, np.inf, -outside, 1.0)
    along = covariance[1:, 0]
    rest = covariance[1:, 1:] - np.outer(along, along)
    first = tail.rvs(n, random_state=rng)
    others = target.mean[1:] + (first + outside)[:, None] * along
    others += rng.standard_normal((n, 2)) @ np.linalg.cholesky(rest).T
    inside = ((others > bounds[1:, 0]) & (others < bounds[1:, 1])).all(axis=1)
    exact = stats.norm.logsf(outside) + np.log(inside.mean())
    assert_allclose(best.log_evidence, exact, atol=0.05)
    kept = np.column_stack([first, others])[inside]
    stated = np.array(result.table.column("sd 1"))
    assert_allclose(stated / kept.std(axis=0), 1.0, atol=0.15)


def test_two_modes_have_the_weights_of_quadrature():
    result = ef.find_map(load("evidence").beck_au().posterior, seed=1)
    assert len(result.maxima) == 2 and result.climbs.sum() == 16
    assert all(best.converged for best in result.maxima)
    left = [best.theta[0] < 1 for best in result.maxima].index(True)
    assert_allclose(result.weights[left], 0.53079, atol=0.02)
    total = np.logaddexp.reduce([best.log_evidence for best in result.maxima])
    assert_allclose(total, np.log(1.50950e-3), atol=0.05)
    assert result.weights[0] >= result.weights[1]
    assert result.draws == 0 and np.isnan(result.pareto_k)
    draws = result.draw(2_000, seed=5)
    share = (draws[:, 0] < 1).mean()
    assert abs(share - result.weights[left]) < 5 * 0.5 / np.sqrt(2_000)
    assert np.isfinite(result.posterior(draws)[:, 0]).all()


@pytest.mark.parametrize(
    ("centre", "sharpness", "maxima"),
    [([0.04, 0.0], 1, 1), ([3.0, 0.0], 1, 2), ([0.5, 0.0], 400, 2)],
)
def test_tops_are_one_where_both_gaussians_would_have_both(centre, sharpness, maxima):
    """Close and alike, far apart, and a needle, which is lighter though higher."""

    def log_density(x):
        broad = -0.5 * (x**2).sum(axis=1)
        other = -0.5 * sharpness * ((x - centre) ** 2).sum(axis=1)
        return np.maximum(broad, other + 3 * (sharpness > 1))

    posterior = density_posterior(log_density, [9.0, 9.0])
    starts = np.array([[-0.1, 0.05], centre])
    result = ef.find_map(posterior, starts, seed=1)
    assert len(result.maxima) == maxima and result.climbs.sum() == 2
    if sharpness > 1:  # the heavier is first
        first, second = result.maxima
        assert second.log_posterior > first.log_posterior + 2
        assert_allclose(result.weights[1], np.exp(3) / (np.exp(3) + 400), atol=0.01)


def test_a_density_without_bound_is_told():
    """One parameter fits one frequency exactly, and its error goes to zero."""
    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
    prior = ef.IndependentPrior({"k": (5.0, 12.0), "s": stats.halfnorm(scale=0.01)})
    term = ef.FrequencyTerm([3.0], discrepancy="s")
    with pytest.raises(ValueError, match="without bound"):
        ef.find_map(ef.LogPosterior(model, term, prior), seed=1)


def test_the_problem_of_the_paper_takes_few_solves():
    problem = ef.paper.mass_spring()
    for kind, each in ((Deriving, 5), (Counting, 5 * (1 + problem.posterior.ndim))):
        posterior = problem.posterior.with_models(kind)
        result = ef.find_map(posterior, 8, seed=3)
        assert result.solves == posterior.model.solves <= 8 * each
        best = result.maxima[0]
        again = ef.find_map(posterior, best.theta, seed=1)
        assert again.solves <= each / 2  # it is one
        off = again.maxima[0].theta - best.theta
        assert off @ np.linalg.solve(best.covariance, off) < 0.05**2


@forks
@pytest.mark.parametrize("kind", [Counting, Deriving])
def test_the_number_of_workers_changes_nothing(kind):
    posterior = ef.paper.mass_spring().posterior.with_models(kind)
    serial, model, two = (
        ef.find_map(posterior, 4, seed=1, check=30, workers=n) for n in (None, 1, 2)
    )
    assert str(model) == str(two)
    assert serial.solves == model.solves == two.solves
    for a, b, c in zip(serial.maxima, model.maxima, two.maxima, strict=True):
        assert_array_equal(b.theta, c.theta)
        assert_array_equal(b.covariance, c.covariance)
        assert_allclose(a.theta, b.theta, rtol=1e-6)


def broken(p):
    if p["a"] > 1.5:
        raise ArithmeticError("no equilibrium")
    return [np.hypot(p["a"], p["b"])]


def test_failures_follow_the_policy():
    prior = ef.GaussianPrior(["a", "b"], [1, 1], [2, 2], [(0.0, 9.0)] * 2)
    term = ef.FrequencyTerm([3.0], relative_sd=0.01)
    posterior = ef.LogPosterior(ef.FunctionModel(broken, n_modes=1), term, prior)
    # The second can be climbed from; beside the last a solve fails.
    starts = np.array([[2.0, 1.0], [0.5, 1.0], [3.0, 0.1], [1.4999999, 0.0]])
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        ef.find_map(posterior, starts, seed=1)
    reject = {"seed": 1, "on_failure": "reject"}
    result = ef.find_map(posterior, starts, **reject, max_failures=1.0)
    assert result.climbs.sum() == 1 and len(result.lost) == 3
    assert all("solve" in reason and "failed" in reason for reason in result.lost)
    with pytest.raises(RuntimeError, match="starts: none of 2"):
        ef.find_map(posterior, starts[[0, 2]], **reject)


class WithoutDerivatives(Derived):
    """Its jacobian raises where a is large; its solves do not."""

    def jacobian(self, parameters):
        if (parameters["a"] > 1.0).any():
            raise np.linalg.LinAlgError("singular")
        return super().jacobian(parameters)


def test_a_jacobian_that_fails_is_done_without():
    terms = [ef.FrequencyTerm(MEASURED, sd=0.05), ef.ShapeTerm(SHAPES, delta=0.2)]
    prior = ef.GaussianPrior(["a", "b"], [1, 1], [0.2, 0.2], [(0.5, 1.5)] * 2)
    exact, rejecting, stopping = (
        ef.LogPosterior(solver(), terms, prior)
        for solver in (Derived, WithoutDerivatives, WithoutDerivatives)
    )
    result = ef.find_map(rejecting, 4, seed=1, on_failure="reject")
    assert result.lost == () and result.climbs.sum() == 4
    (best,), (same,) = result.maxima, ef.find_map(exact, 4, seed=1).maxima
    off = best.theta - same.theta
    assert best.converged and off @ np.linalg.solve(same.covariance, off) < 0.05**2
    with pytest.raises(np.linalg.LinAlgError):
        ef.find_map(stopping, 4, seed=1)


def test_draws_are_those_of_the_gaussians():
    target = GaussianLaw()
    result = ef.find_map(target.posterior, 3, seed=1)
    draws = result.draw(4_000, seed=2)
    mean, covariance = target.moments(1.0)
    white = np.linalg.solve(np.linalg.cholesky(covariance), (draws - mean).T)
    assert_allclose(white.mean(axis=1), 0, atol=5 / 4_000**0.5)
    assert_allclose(np.cov(white), np.eye(3), atol=5 * (2 / 4_000) ** 0.5)
    assert_array_equal(result.draw(4_000, 2), draws)


@pytest.mark.parametrize("workers", [None, pytest.param(1, marks=forks)])
def test_modes_that_coincide_at_a_start_do_not_end_a_climb(workers):
    K = {"a": np.diag([1.0, 0.0]), "b": np.diag([0.0, 1.0])}
    model = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), K, n_modes=2)
    frequencies = np.sqrt([8.0, 12.0]) / (2 * np.pi)
    term = ef.FrequencyTerm(frequencies, relative_sd=0.01)
    prior = ef.GaussianPrior(["a", "b"], [10.0, 10.0], [3.0, 3.0], [(1, 30)] * 2)
    posterior = ef.LogPosterior(model, term, prior)
    starts = np.array([[10.0, 10.0], [9.0, 13.0]])  # the first has no derivatives
    with pytest.raises(ValueError, match="coincide"):
        model.jacobian({"a": starts[:1, 0], "b": starts[:1, 1]})
    maxima = ef.find_map(posterior, starts, seed=1, workers=workers)
    assert not maxima.lost
    assert_allclose(np.sort(maxima.maxima[0].theta), [8.0, 12.0], rtol=0.01)


def storeys(digits):
    """Return frequencies of two storeys, as they are printed with some digits."""

    def solve(p):
        k1, k2 = 1e6 * p["k1"], 1e6 * p["k2"]
        K = np.array([[k1 + k2, -k2], [-k2, k2]]) / 16.3e3
        hertz = np.sqrt(np.linalg.eigvalsh(K)) / (2 * np.pi)
        return [float(f"{f:.{digits}g}") for f in hertz]

    return ef.FunctionModel(solve, n_modes=2)


@pytest.mark.parametrize("gaussian", [True, False])
def test_digits_that_a_solver_prints_make_no_maxima(gaussian):
    term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.02)
    terms = term if gaussian else lambda p, response: term(p, response)
    prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [9, 3], [(20, 90), (1, 15)])
    found, exact = (
        ef.find_map(ef.LogPosterior(storeys(digits), terms, prior), 6, seed=1)
        for digits in (4, 17)
    )
    (maximum,), (expected,) = found.maxima, exact.maxima
    sd = np.sqrt(np.diag(expected.covariance))
    assert_allclose(np.sqrt(np.diag(maximum.covariance)), sd, rtol=0.05)
    assert (np.abs(maximum.theta - expected.theta) < 0.1 * sd).all()
    assert found.printed and not exact.printed


def test_it_says_how_small_a_maximum_it_may_have_missed_by_climbs_of_the_prior():
    """None of 3 n climbs ends at a maximum that draws one in n once in twenty times."""
    posterior = ef.paper.mass_spring().posterior
    said = [ef.find_map(posterior, n, seed=1).findings[1] for n in (1, 6, 12)]
    assert "2" in said[1] and "4" in said[2] and said[0] not in said[1:]
    given = posterior.prior.sample(np.random.default_rng(1), 6)
    assert ef.find_map(posterior, given, seed=1).findings[1] == said[0]
    assert 0.04 < (1 - 1 / 12) ** (3 * 12) < 0.05  # a twentieth
