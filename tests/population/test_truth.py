"""Pooled tests against quadrature, a joint run of all parameters, and calibration."""

import numpy as np
import pytest
from scipy import stats
from support import repeated
from support.normal_tests import many

import emcee_femu as ef
from emcee_femu.extensions.population.marginal import (
    Draws,
    PopulationModel,
    PopulationTerm,
    read_tests,
)

PLAIN = ef.population.NormalPopulation(["k1", "k2"])
BOX = np.array([[6.0, 14.0], [3.0, 7.0]])


def model(tests, population, number=10_000):
    """Return the likelihood of a population."""
    draws = read_tests(tests, population.names, number)
    complete = population.complete(*next(iter(draws.values())).prior)
    return PopulationModel(complete, draws)


def at(population, rows):
    return dict(zip(population.parameters, np.transpose(rows), strict=True))


def test_marginals_are_those_of_quadrature():
    """Priors divided out, densities normalised, each test's weights its own."""
    rng = np.random.default_rng(1)
    measured = repeated.frequencies(np.array([1.05, 0.95]), np.array([1.1, 1.2]))
    tests = {str(i): repeated.make_test(rng, m, 20_000) for i, m in enumerate(measured)}
    found = model(tests, PLAIN, 20_000)
    rows = [[1.0, 1.1, 0.1, 0.1], [1.05, 1.12, 0.05, 0.08], [0.97, 1.2, 0.2, 0.03]]
    rows += [[1.05, 1.15, 0.4, 0.4]]
    pooled = found(at(PLAIN, rows))["log_marginal"]
    grid = repeated.GRID
    k1, k2 = np.meshgrid(grid, grid, indexing="ij")
    likelihoods = [np.exp(repeated.log_likelihood(m, k1, k2)) for m in measured]
    exact = np.array(
        [
            [stats.norm(a, s).pdf(grid) @ own @ stats.norm(b, t).pdf(grid)
             for own in likelihoods]
            for a, b, s, t in rows
        ]
    )  # fmt: skip
    # Each is known but for a constant.
    apart = (pooled - pooled[0]) - np.log(exact / exact[0])
    np.testing.assert_allclose(apart, 0, atol=0.06)


def test_a_population_is_normalised_inside_the_bounds_and_impossible_beyond():
    rows = [[10.0, 5.0, 4.0, 2.0], [7.0, 3.5, 3.0, 3.0]]
    cut, free = (model(many(6, tests=2, bounds=b)[0], PLAIN) for b in (BOX, None))
    mean, sd = np.split(np.array(rows), 2, axis=1)
    law = stats.norm(mean, sd)
    mass = (law.cdf(BOX[:, 1]) - law.cdf(BOX[:, 0])).prod(axis=1)
    gained = (
        cut(at(PLAIN, rows))["log_marginal"] - free(at(PLAIN, rows))["log_marginal"]
    )
    np.testing.assert_allclose(gained, -np.log(mass)[:, None] * [1, 1], rtol=1e-9)
    rows = [[10.0, 5.0, 0.5, 0.5], [15.5, 5.0, 1.0, 0.5], [10.0, 7.5, 0.1, 0.3]]
    rows += [[10.0, 5.0, 1e-9, 1e-9], [10.0, 5.0, 1e-12, 0.0]]
    likely = PopulationTerm(cut.variables)({}, cut(at(PLAIN, rows)))
    np.testing.assert_array_equal(likely > -100, [True, False, False, True, True])
    assert likely[3] == pytest.approx(likely[4], abs=1e-6)  # no draw alone decides


@pytest.mark.slow
def test_two_parameter_structures_are_pooled_as_by_nested_quadrature():
    """The law of the whole: draws of tests, weights, and the run of the population."""
    rng, number = np.random.default_rng(20), 20
    measured, _ = repeated.simulate(rng, number)
    tests = {f"t{i}": repeated.make_test(rng, m, 3_000) for i, m in enumerate(measured)}
    population = ef.population.NormalPopulation(repeated.NAMES)
    found = ef.pool_tests(
        tests, population, seed=1, draws=3_000, steps=150, ensembles=2
    )
    exact = repeated.quadrature(measured, found.population.hyperpriors)
    posterior = found.idata["posterior"]
    got = np.array([posterior[name].values.ravel() for name in found.model.names])
    np.testing.assert_allclose((got.mean(axis=1) - exact.mean) / exact.sd, 0, atol=0.2)
    np.testing.assert_allclose(got.std(axis=1) / exact.sd, 1, atol=0.1)
    assert found.unreached == ()
    mean, sd = exact.tests[:, :, 0], exact.tests[:, :, 1]
    error = (found.theta.mean(axis=0) - mean) / sd  # by 1,000 draws of each
    assert np.sqrt((error**2).mean()) < 0.1 and abs(error).max() < 0.4
    ratio = found.theta.std(axis=0) / sd
    assert np.sqrt(((ratio - 1) ** 2).mean()) < 0.1


@pytest.mark.slow
def test_the_monte_carlo_error_is_the_scatter_among_other_draws():
    """Of likelihoods that are flat above a limit, which few draws know well."""
    limits, grid = np.linspace(1.4, 2.4, 12), np.linspace(-9, 12, 20_001)
    prior, means, claimed = stats.norm(1.5, 3.0), [], []
    for seed in range(8):
        rng, tests = np.random.default_rng(seed), {}
        for i, limit in enumerate(limits):
            likelihood = stats.norm(limit, 0.05).logcdf
            weights = np.exp(likelihood(grid)) * prior.pdf(grid)
            theta = rng.choice(grid, 1_000, p=weights / weights.sum())[:, None]
            log_prior = prior.logpdf(theta)
            lp = likelihood(theta[:, 0]) + log_prior[:, 0]
            moments = np.array([[1.5], [3.0]])
            tests[f"t{i}"] = repeated.as_idata(["k"], theta, lp, log_prior, moments)
        population = ef.population.NormalPopulation(["k"])
        options = {"draws": 250, "steps": 150, "ensembles": 2}
        found = ef.pool_tests(tests, population, seed=seed, **options)
        draws = found.idata["posterior"]["mean k"].values
        means.append([draws.mean(), draws.std()])
        claimed.append(found.monte_carlo[0, 0])
    scatter = np.std(means, axis=0, ddof=1)[0] / np.mean(means, axis=0)[1]
    assert 0.5 < np.mean(claimed) / scatter < 2.0


HYPER = {
    "mean k1": stats.norm(1.0, 0.05),
    "mean k2": stats.norm(1.0, 0.1),
    "sd k1": stats.uniform(0.03, 0.1),
    "sd k2": stats.uniform(0.03, 0.1),
}
POPULATION = ef.population.NormalPopulation(["k1", "k2"], hyperpriors=HYPER)
ERROR, WIDTH, CENTRE = (
    0.1,
    0.12,
    1.15,
)  # of ln of the tests' own prior, which pulls hard


class Unnormalised(PopulationModel):
    """Forgets the constant of the population's density, wherever it is."""

    def __call__(self, parameters):
        found = super().__call__(parameters)
        sds = parameters["sd k1"] * parameters["sd k2"]
        found["log_marginal"] += np.log(sds)[:, None]
        return found


def keep_prior(draws):
    return draws._replace(log_prior=0 * draws.log_prior)


def calibrate(datasets, seed, kind=PopulationModel, bend=lambda draws: draws):
    """Return the least p-value of uniform ranks of the truth among weighted draws."""
    rng = np.random.default_rng(seed)
    found = np.empty((datasets, 4))
    free, moments = np.array([[0.0, np.inf]] * 2), np.ones((2, 2))
    for k in range(datasets):
        truth = POPULATION.prior.sample(rng, 1)[0]
        theta = rng.normal(truth[:2], truth[2:], (6, 2))
        measured = np.log(np.maximum(theta, 0.05))
        measured += ERROR * rng.standard_normal((6, 2))
        precision = 1 / ERROR**2 + 1 / WIDTH**2
        draws = {}
        for t, log_measured in enumerate(measured):
            mean = log_measured / ERROR**2 + np.log(CENTRE) / WIDTH**2
            x = mean / precision + rng.standard_normal((500, 2)) / np.sqrt(precision)
            log_prior = stats.lognorm(WIDTH, scale=CENTRE).logpdf(np.exp(x)).sum(axis=1)
            draws[f"t{t}"] = bend(Draws(np.exp(x), log_prior, free, moments))
        hyper = POPULATION.prior.sample(rng, 1_500)
        total = kind(POPULATION, draws)(at(POPULATION, hyper))["log_marginal"]
        total = total.sum(axis=1)
        weights = np.exp(total - total.max())
        found[k] = (weights @ (hyper < truth)) / weights.sum()
    return min(stats.kstest(column, stats.uniform.cdf).pvalue for column in found.T)


@pytest.mark.slow
@pytest.mark.parametrize("mutant", [{"bend": keep_prior}, {"kind": Unnormalised}, {}])
def test_the_truth_ranks_uniformly_in_data_sets_and_not_under_mutants(mutant):
    """The prior not divided out; the population's density without its constant."""
    p = calibrate(100, 2, **mutant) if mutant else calibrate(150, 1)
    assert (p > 0.001 / 4) != bool(mutant)
