"""Maxima with their weights, in how many solves, and what is said of them."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import emcee_femu as ef
from tests.support.examples import load
from tests.support.pool_problems import forks
from tests.support.tempered_laws import GaussianLaw


class Counting:
    """A model that counts its solves, without derivatives."""

    def __init__(self, model):
        self.model, self.n_modes, self.solves = model, model.n_modes, 0

    def __call__(self, parameters):
        self.solves += len(next(iter(parameters.values())))
        return self.model(parameters)


class Deriving(Counting):
    """The same, with derivatives."""

    def jacobian(self, parameters):
        self.solves += len(next(iter(parameters.values())))
        return self.model.jacobian(parameters)


def paper_posterior(problem, kind):
    model = kind(problem.model)
    return ef.LogPosterior(model, problem.posterior.terms, problem.posterior.prior)


def test_a_linear_gaussian_problem_is_exact_and_its_check_says_so():
    law = GaussianLaw()
    found = ef.find_map(law.posterior, 5, seed=1, check=50)
    mean, covariance = law.moments(1.0)
    (best,) = found.maxima
    assert_allclose(best.theta, mean, atol=1e-5)
    assert_allclose(best.covariance, covariance, rtol=1e-6)
    assert_allclose(best.log_evidence, law.log_evidence, atol=1e-7)
    assert found.weights.tolist() == [1.0] and found.climbs.tolist() == [5]
    assert found.solves == 5 * 2 * 4 + 50
    assert_allclose(found.efficiency, 1.0, atol=1e-4)
    assert found.findings[0] == (
        "A start and a quick look: 1 maximum from 5 climbs and 90 solves."
    )
    assert found.findings[-1].startswith("The posterior is nearly Gaussian about them")
    assert_allclose(found.table.column("maximum 1"), mean, atol=1e-5)
    assert_allclose(found.table.column("sd 1"), np.sqrt(np.diag(covariance)), rtol=1e-6)


def test_the_draws_of_a_check_are_those_of_the_gaussian():
    law, points = GaussianLaw(), []

    class Recording:
        n_modes = 4

        def __call__(self, parameters):
            points.append(np.column_stack([*parameters.values()]))
            return law.solve(parameters)

    posterior = ef.LogPosterior(Recording(), law.posterior.terms, law.posterior.prior)
    ef.find_map(posterior, 1, seed=1, check=4_000)
    mean, covariance = law.moments(1.0)
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, (np.concatenate(points)[-4_000:] - mean).T)
    assert_allclose(white.mean(axis=1), 0, atol=4 / 4_000**0.5)
    assert_allclose(np.cov(white), np.eye(3), atol=4 * (2 / 4_000) ** 0.5)


def test_two_modes_have_the_weights_of_quadrature():
    found = ef.find_map(load("evidence").beck_au().posterior, seed=1)
    assert len(found.maxima) == 2 and found.climbs.sum() == 16
    left = [m.theta[0] < 1 for m in found.maxima].index(True)
    assert_allclose(found.weights[left], 0.53079, atol=0.02)
    total = np.logaddexp.reduce([m.log_evidence for m in found.maxima])
    assert_allclose(total, np.log(1.50950e-3), atol=0.05)
    assert found.weights[0] >= found.weights[1]
    assert found.draws == 0 and np.isnan(found.pareto_k)
    assert "was not checked" in found.findings[-1]
    assert "0.53" in str(found.maxima_table)
    assert found._repr_html_().count("<table") == 2


def test_the_heaviest_maximum_is_first_not_the_highest():
    """A needle of a tenth of the mass, 100 times as narrow in area."""
    prior = ef.GaussianPrior(["a", "b"], [0, 0], [9, 9])

    def term(p, response):
        theta = np.stack([p["a"], p["b"]], axis=1)
        broad = np.log(0.9) - 0.5 * (theta**2).sum(axis=1)
        needle = np.log(0.1 * 100) - 50 * ((theta - 4) ** 2).sum(axis=1)
        return np.logaddexp(broad, needle) - prior.logpdf(theta)

    model = ef.FunctionModel(lambda p: [1.0], n_modes=1)
    posterior = ef.LogPosterior(model, term, prior)
    found = ef.find_map(posterior, [[4.01, 3.99], [0.5, 0.5]], seed=1, check=100)
    first, second = found.maxima
    assert_allclose(first.theta, 0, atol=0.05)
    assert second.log_posterior > first.log_posterior + 2
    assert_allclose(found.weights, [0.9, 0.1], atol=0.01)
    assert found.efficiency > 0.99


@pytest.mark.parametrize("problem", [ef.paper.mass_spring(), ef.paper.h_structure()])
def test_the_problems_of_the_paper_take_few_solves(problem):
    for kind, each in ((Deriving, 5), (Counting, 5 * (1 + problem.posterior.ndim))):
        posterior = paper_posterior(problem, kind)
        found = ef.find_map(posterior, 8, seed=3)
        assert found.solves == posterior.model.solves
        assert found.solves <= 8 * each
        best = found.maxima[0]
        again = ef.find_map(posterior, best.theta, seed=1)
        assert again.solves == each // 5  # it is one
        assert_array_equal(again.maxima[0].theta, best.theta)


def test_a_solver_that_prints_six_digits_is_climbed_too():
    problem = ef.paper.mass_spring()

    def solve(p):
        found = problem.model({k: np.array([v]) for k, v in p.items()}).frequencies[0]
        return [float(f"{frequency:.6g}") for frequency in found]

    prior, terms = problem.posterior.prior, problem.posterior.terms
    rounded = ef.LogPosterior(ef.FunctionModel(solve, n_modes=5), terms, prior)
    exact = ef.find_map(problem.posterior, 6, seed=1).maxima[0]
    found = ef.find_map(rounded, 6, seed=1)
    step = found.maxima[0].theta - exact.theta

    assert step @ np.linalg.solve(exact.covariance, step) < 0.5**2
    assert found.solves < 6 * 60


def test_solves_are_those_of_the_model():
    posterior = paper_posterior(ef.paper.mass_spring(), Counting)
    found = ef.find_map(posterior, 3, seed=1, check=40)
    assert found.solves == posterior.model.solves


@forks
@pytest.mark.parametrize("kind", [Counting, Deriving])
def test_pools_give_the_same_bits(kind):
    posterior = paper_posterior(ef.paper.mass_spring(), kind)
    serial = ef.find_map(posterior, 4, seed=1, check=30)
    with ThreadPoolExecutor(2) as threads:
        for where in ({"workers": 2}, {"pool": threads}):
            found = ef.find_map(posterior, 4, seed=1, check=30, **where)
            assert str(found) == str(serial)
            for one, other in zip(found.maxima, serial.maxima, strict=True):
                assert_array_equal(one.theta, other.theta)
                assert_array_equal(one.covariance, other.covariance)


def curved(p):
    return [np.sqrt(p["a"] ** 2 + p["b"] ** 2)]


def curved_posterior(function=curved):
    model = ef.FunctionModel(function, n_modes=1)
    prior = ef.GaussianPrior(["a", "b"], [1, 1], [2, 2], [(0.0, 9.0)] * 2)
    return ef.LogPosterior(model, ef.FrequencyTerm([3.0], relative_sd=0.01), prior)


def test_it_says_where_the_posterior_is_not_gaussian():
    found = ef.find_map(curved_posterior(), 4, seed=1, check=100)
    assert found.efficiency < 0.5
    assert "The posterior is not Gaussian about them" in found.findings[-1]
    assert "sample it" in found.findings[-1]


def broken(p):
    if p["a"] > 1.5:
        raise ArithmeticError("no equilibrium")
    return curved(p)


def test_failures_follow_the_policy():
    posterior = curved_posterior(broken)
    starts = np.array([[2.0, 1.0], [0.5, 1.0], [3.0, 0.1]])
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        ef.find_map(posterior, starts, seed=1)
    found = ef.find_map(
        posterior, starts, seed=1, on_failure="reject", max_failures=1.0
    )
    assert found.climbs.sum() == 1 and len(found.lost) == 2
    assert found.findings[1].startswith("2 of 3 starts led nowhere: the posterior")
    with pytest.raises(RuntimeError, match=r"starts: none of 2 led to a maximum"):
        ef.find_map(posterior, starts[[0, 2]], seed=1, on_failure="reject")


def test_a_maximum_at_a_bound_is_named():
    prior = ef.GaussianPrior(["a", "b"], [1, 1], [2, 2], [(4.0, 9.0), (0.0, 9.0)])
    term = ef.FrequencyTerm([3.0], relative_sd=0.01)
    posterior = ef.LogPosterior(ef.FunctionModel(curved, n_modes=1), term, prior)
    found = ef.find_map(posterior, 3, seed=1)
    (named,) = found.maxima_table.column("at a bound")
    assert named.startswith("a")
    # All draws of a check are inside, and solved.
    assert ef.find_map(posterior, 3, seed=1, check=60).solves == found.solves + 60
    assert_allclose(found.table.column("maximum 1"), [4.0, 0.0], atol=0.01)


def test_what_is_refused():
    posterior = curved_posterior()
    with pytest.raises(ValueError, match="check: expected 0 or at least 25 draws"):
        ef.find_map(posterior, seed=1, check=10)
    with pytest.raises(ValueError, match=r"starts: a = 10 of point 0 is outside"):
        ef.find_map(posterior, [10.0, 1.0], seed=1)
    with pytest.raises(TypeError, match="starts: expected a whole number"):
        ef.find_map(posterior, 2.5, seed=1)
    with pytest.raises(TypeError, match="posterior: expected a LogPosterior"):
        ef.find_map(len, seed=1)


def test_chains_start_from_draws_of_the_gaussians():
    law = GaussianLaw()
    found = ef.find_map(law.posterior, 3, seed=1)
    draws = found.draw(4_000, seed=2)
    mean, covariance = law.moments(1.0)
    sd = np.sqrt(np.diag(covariance))
    assert (np.abs(draws.mean(axis=0) - mean) < 5 * sd / np.sqrt(4_000)).all()
    off = np.cov(draws.T) - covariance
    assert np.abs(off / np.outer(sd, sd)).max() < 0.12
    assert_array_equal(found.draw(4_000, 2), draws)
    start = found.draw(16, 3)
    (sampler,) = ef.run(law.posterior, nwalkers=16, nsteps=2, seed=1, initial=start)
    assert np.isfinite(sampler.get_log_prob()).all()


def test_draws_share_out_the_maxima_and_stay_inside_the_bounds():
    term = ef.FrequencyTerm([3.0, 4.0], sd=0.1)
    model = ef.FunctionModel(lambda p: [p["a"], p["b"]], n_modes=2)
    prior = ef.GaussianPrior(["a", "b"], [3, 4], [1, 1], [(0.0, 9.0)] * 2)
    best = ef.find_map(ef.LogPosterior(model, term, prior), 3, seed=1)
    (one,) = best.maxima
    corner = replace(one, theta=np.zeros(2))
    two = replace(best, maxima=(one, corner), weights=np.array([0.6, 0.4]))
    draws = two.draw(3_000, 5)
    assert ((draws >= 0.0) & (draws <= 9.0)).all() and len(draws) == 3_000
    # A quarter of the other is inside.
    assert abs((draws[:, 0] < 1.5).mean() - 0.1 / 0.7) < 5 * 0.35 / np.sqrt(3_000)
    lost = replace(one, theta=np.full(2, 99.0))
    with pytest.raises(ValueError, match="n: of 200 draws .* only 0 are inside"):
        replace(best, maxima=(lost,)).draw(2, 1)
    for wrong in ({"n": 0, "seed": 1}, {"n": 1.5, "seed": 1}, {"n": 2, "seed": None}):
        with pytest.raises((TypeError, ValueError), match="n:|seed:"):
            best.draw(**wrong)
