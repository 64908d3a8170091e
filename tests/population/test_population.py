import numpy as np
import pytest
from scipy import stats
from support.normal_tests import many, normal_test
from support.repeated import (
    GRID,
    NAMES,
    PRIOR,
    draw_test,
    frequencies,
    log_likelihood,
    make_test,
)

import emcee_femu as ef
from emcee_femu.population import marginal
from emcee_femu.population.box import log_mass
from emcee_femu.population.draws import read_tests
from emcee_femu.population.marginal import PopulationModel

PLAIN = ef.NormalPopulation(NAMES)
MEASURED = frequencies(np.array([1.05, 0.95]), np.array([1.1, 1.2]))


def model(tests, population, number=10_000, use_laws=True):
    found = read_tests(tests, population.names, number)
    complete = population.complete(*next(iter(found.values())).prior)
    return PopulationModel(complete, found, use_laws)


def values(population, rows):
    return dict(zip(population.parameters, np.transpose(rows), strict=True))


@pytest.mark.parametrize("use_laws", [True, False])
def test_marginals_are_those_of_quadrature(use_laws):
    """Priors divided out, densities normalised, each test's weights its own."""
    rng = np.random.default_rng(1)
    tests = {str(i): make_test(rng, m, 20_000) for i, m in enumerate(MEASURED)}
    found = model(tests, PLAIN, 20_000, use_laws)
    assert all(law.good for law in found.laws) == use_laws
    rows = [[1.0, 1.1, 0.1, 0.1], [1.05, 1.12, 0.05, 0.08], [0.97, 1.2, 0.2, 0.03]]
    rows += [[1.05, 1.15, 0.4, 0.4]]
    given = found(values(PLAIN, rows))["log_marginal"]
    k1, k2 = np.meshgrid(GRID, GRID, indexing="ij")
    likelihoods = [np.exp(log_likelihood(m, k1, k2)) for m in MEASURED]
    exact = np.array(
        [
            [
                np.log(stats.norm(a, s).pdf(GRID) @ own @ stats.norm(b, t).pdf(GRID))
                for own in likelihoods
            ]
            for a, b, s, t in rows
        ]
    )
    apart = (given - given[0]) - (exact - exact[0])  # each is known but for a constant
    np.testing.assert_allclose(apart, 0, atol=0.02 if use_laws else 0.06)


def test_the_weights_give_each_tests_moments_under_the_population():
    rng = np.random.default_rng(2)
    tests = {str(i): make_test(rng, m, 20_000) for i, m in enumerate(MEASURED)}
    found = model(tests, PLAIN, 20_000)
    weights = found.weights(values(PLAIN, [[1.0, 1.1, 0.06, 0.05]]))[0]
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    k1, k2 = np.meshgrid(GRID, GRID, indexing="ij")
    law = np.outer(stats.norm(1.0, 0.06).pdf(GRID), stats.norm(1.1, 0.05).pdf(GRID))
    for own, draws, m in zip(weights, found.draws, MEASURED, strict=True):
        density = np.exp(log_likelihood(m, k1, k2)) * law
        exact = (density * k1).sum() / density.sum()
        assert own @ draws.theta[:, 0] == pytest.approx(exact, abs=0.002)


def test_weights_are_the_ratio_of_the_populations_density_to_the_prior():
    tests, _ = many(7, tests=2)
    population = ef.NormalPopulation(["k1", "k2"], correlated=True)
    found = model(tests, population)
    weights = found.weights(values(population, [[10.1, 5.2, 0.4, 0.3, -0.7]]))[0]
    covariance = np.array([[0.16, -0.084], [-0.084, 0.09]])
    law = stats.multivariate_normal([10.1, 5.2], covariance)
    for own, draws in zip(weights, found.draws, strict=True):
        exact = np.exp(law.logpdf(draws.theta) - draws.log_prior)
        np.testing.assert_allclose(own, exact / exact.sum(), rtol=1e-6, atol=1e-15)


def test_a_normal_likelihood_is_exact_however_far_the_population_pulls(monkeypatch):
    """Correlated parameters, one more that is not pooled, a covariate; tempered."""
    monkeypatch.setattr(marginal, "choose_powers", lambda *_: np.array([0.3, 1, 0.05]))
    rng = np.random.default_rng(3)
    d, tests = 4, 3
    root = rng.standard_normal((tests, d, d))
    errors = 0.05 * root @ root.transpose(0, 2, 1) + 0.01 * np.eye(d)
    measured = rng.normal(1.0, 0.3, (tests, d))
    names = ["k1", "k2", "k3", "error"]
    prior = np.array([1.0, 0.9, 1.1, 0.5]), np.array([2.0, 3.0, 2.5, 0.4])
    given = {
        f"t{i}": normal_test(rng, m, e, prior, names=names)
        for i, (m, e) in enumerate(zip(measured, errors, strict=True))
    }
    temperature = {"t0": 10.0, "t1": 22.0, "t2": 13.0}
    population = ef.NormalPopulation(
        names[:3], correlated=True, covariates={"T": temperature}
    )
    found = model(given, population)
    assert all(law.good for law in found.laws)
    rows = rng.normal(1.0, 0.2, (5, 12))
    rows[:, 3:6] = [[0.3, 0.2, 0.5], [1.0, 2.0, 3.0], [0.01] * 3, [1e-4] * 3, [5.0] * 3]
    rows[1, :3] += 20.0
    rows[:, 6:9] = rng.normal(0.0, 0.1, (5, 3))
    rows[:, 9:] = rng.uniform(-0.8, 0.8, (5, 3))
    log_marginal = found(values(population, rows))["log_marginal"]
    centred = np.array([*temperature.values()]) - 15.0
    exact = np.empty((5, tests))
    for i, row in enumerate(rows):
        r12, r13, partial = row[9:]
        r23 = partial * np.sqrt((1 - r12**2) * (1 - r13**2)) + r12 * r13
        r = np.array([[1, r12, r13], [r12, 1, r23], [r13, r23, 1]])
        for t in range(tests):
            # Mean and covariance of the measured values; the fourth has its prior.
            mean = np.append(row[:3] + centred[t] * row[6:9], prior[0][3])
            total = errors[t].copy()
            total[:3, :3] += r * np.outer(row[3:6], row[3:6])
            total[3, 3] += prior[1][3] ** 2
            law = stats.multivariate_normal(mean, total)
            exact[i, t] = law.logpdf(measured[t])
    apart = (log_marginal - log_marginal[0]) - (exact - exact[0])
    np.testing.assert_allclose(apart, 0, rtol=1e-6, atol=1e-6 * abs(exact).max())


def test_draws_by_normal_laws_have_the_moments_of_each_test_under_the_population():
    tests, measured = many(4, tests=3)
    population = ef.NormalPopulation(["k1", "k2"], correlated=True)
    found = model(tests, population)
    row = [10.2, 5.1, 0.3, 0.1, 0.6]
    n = 20_000
    drawn = found.draw_from_laws(
        np.random.default_rng(1), values(population, np.tile(row, (n, 1)))
    )
    between = np.array([[0.09, 0.018], [0.018, 0.01]])
    gain = between @ np.linalg.inv(between + 0.04 * np.eye(2))
    covariance = between - gain @ between
    for t, own in enumerate(measured):
        mean = row[:2] + gain @ (own - row[:2])
        z = (drawn[:, t].mean(axis=0) - mean) / np.sqrt(np.diag(covariance) / n)
        assert abs(z).max() < 4
        np.testing.assert_allclose(np.cov(drawn[:, t].T), covariance, rtol=0.05)


def test_padded_draws_of_a_shorter_run_weigh_nothing():
    tests, _ = many(5, tests=2)
    short, _ = many(5, tests=2, number=150)
    mixed = {"long": tests["test 1"], "short": short["test 2"]}
    row = values(PLAIN, [[10.0, 5.0, 0.4, 0.2], [10.1, 4.9, 0.2, 0.3]])
    for use_laws in (True, False):
        both = model(mixed, PLAIN, use_laws=use_laws)(row)["log_marginal"][:, 1]
        pair = {"a": short["test 2"], "b": short["test 2"]}
        alone = model(pair, PLAIN, use_laws=use_laws)(row)["log_marginal"][:, 0]
        np.testing.assert_allclose(both - both[0], alone - alone[0], atol=1e-9)
        assert (
            model(mixed, PLAIN, use_laws=use_laws).weights(row)[:, 1, 150:] == 0
        ).all()


def test_a_population_is_normalised_inside_the_bounds():
    row = values(PLAIN, [[10.0, 5.0, 4.0, 2.0], [7.0, 3.5, 3.0, 3.0]])
    bounds = np.array([[6.0, 14.0], [3.0, 7.0]])
    cut, free = (
        model(many(6, tests=2, bounds=b)[0], PLAIN)(row)["log_marginal"]
        for b in (bounds, None)
    )
    mean, sd = np.array([[10.0, 5.0], [7.0, 3.5]]), np.array([[4.0, 2.0], [3.0, 3.0]])
    law = stats.norm(mean, sd)
    mass = (law.cdf(bounds[:, 1]) - law.cdf(bounds[:, 0])).prod(axis=1)
    np.testing.assert_allclose(cut - free, -np.log(mass)[:, None] * [1, 1], rtol=1e-9)


@pytest.mark.parametrize("low", [-1.0, -8.0, -np.inf, 9.0])
def test_the_mass_inside_bounds_of_independent_parameters(low):
    bounds = np.array([[low, 11.0], [-0.5, np.inf]])
    location, factor = np.array([[[0.2, 0.1]]]), np.diag([1.0, 2.0])[None]
    first = stats.truncnorm(low - 0.2, 10.8, 0.2, 1.0)
    exact = stats.norm(0.2).logpdf(10.0) - first.logpdf(10.0)
    exact += np.log(stats.norm(0.1, 2.0).sf(-0.5))
    found = log_mass(location, factor, bounds)
    np.testing.assert_allclose(found, exact, rtol=1e-6)


def test_the_mass_inside_bounds_of_correlated_parameters():
    rng = np.random.default_rng(1)
    d = 3
    root = np.linalg.cholesky(
        np.array([[1.0, 0.7, -0.3], [0.7, 1.0, 0.2], [-0.3, 0.2, 1.0]])
    )
    factor = np.array([1.0, 0.5, 2.0])[:, None] * root
    bounds = np.array([[-0.5, 2.0], [-0.4, np.inf], [-3.0, 1.0]])
    location = np.array([[[0.0, 0.0, 0.0], [0.5, -0.2, 1.0], [0.1, 40.0, -1.0]]])
    drawn = (factor @ rng.standard_normal((d, 400_000))).T
    found = np.exp(log_mass(location, factor[None], bounds))[0]
    for own, mass in zip(location[0], found, strict=True):
        inside = ((drawn + own > bounds[:, 0]) & (drawn + own < bounds[:, 1])).all(1)
        assert mass == pytest.approx(inside.mean(), abs=0.004)
    assert (
        log_mass(location, factor[None], np.tile([-np.inf, np.inf], (d, 1))) == 0
    ).all()


def test_correlation_matrices_are_equally_probable_before_the_tests():
    """Then each correlation is a Beta variable, and the determinant has known mean."""
    d = 4
    names = [f"k{i}" for i in range(d)]
    population = ef.NormalPopulation(names, correlated=True)
    complete = population.complete(np.zeros(d), np.ones(d))
    drawn = complete.prior.sample(np.random.default_rng(1), 20_000)
    root = complete.correlation_factor(values(complete, drawn))
    matrices = root @ root.transpose(0, 2, 1)
    law = stats.beta(d / 2, d / 2, loc=-1, scale=2)
    for i, j in zip(*np.triu_indices(d, 1), strict=True):
        assert stats.kstest(matrices[:, i, j], law.cdf).pvalue > 1e-4
    # Of partial correlations: E prod (1 - p^2), Beta(b, b) on (-1, 1): 2 b / (2 b + 1).
    shapes = [1 + (d - 2 - i) / 2 for i in range(d) for _ in range(i + 1, d)]
    expected = np.prod([2 * b / (2 * b + 1) for b in shapes])
    assert np.linalg.det(matrices).mean() == pytest.approx(expected, rel=0.02)


def test_hyperpriors_are_stated_and_can_be_replaced():
    population = ef.NormalPopulation(
        ["k1", "k2"], hyperpriors={"sd k2": stats.lognorm(0.5, scale=0.3)}
    )
    complete = population.complete(np.array([9.0, 5.0]), np.array([2.0, 1.0]))
    text = str(complete)
    assert "norm(9, 2)" in text and "halfnorm(scale=2)" in text
    assert "lognorm(0.5, scale=0.3)" in text and "by the tests" in str(population)
    theta = np.array([[9.5, 5.0, 1.0, 0.4]])
    expected = stats.norm(9, 2).logpdf(9.5) + stats.norm(5, 1).logpdf(5.0)
    expected += stats.halfnorm(scale=2).logpdf(1.0)
    expected += stats.lognorm(0.5, scale=0.3).logpdf(0.4)
    assert complete.prior.logpdf(theta)[0] == pytest.approx(expected)


def test_exact_draws_are_those_of_the_posterior_that_is_integrated():
    """The support code itself: means against the grid."""
    drawn = draw_test(np.random.default_rng(3), MEASURED[0], 5_000)
    k1, k2 = np.meshgrid(GRID, GRID, indexing="ij")
    points = np.stack([k1, k2], -1).reshape(-1, 2)
    density = np.exp(log_likelihood(MEASURED[0], *points.T) + PRIOR.logpdf(points))
    mean = density @ points / density.sum()
    sd = np.sqrt(density @ (points - mean) ** 2 / density.sum())
    assert (abs(drawn.mean(axis=0) - mean) < 4 * sd / np.sqrt(5_000)).all()
