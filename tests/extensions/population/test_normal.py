"""Pooled tests against closed forms, and calibration of their population."""

import numpy as np
import pytest
from scipy import stats
from support.normal_tests import many

import emcee_femu as ef
from emcee_femu.extensions.population import normal

PLAIN = ef.population.NormalPopulation(["k1", "k2"])
BOX = np.array([[6.0, 14.0], [3.0, 7.0]])


def model(tests, population, number=10_000):
    """Return the likelihood of a population."""
    draws = normal.read_tests(tests, population.names, number)
    complete = population.complete(*next(iter(draws.values())).prior)
    return normal.PopulationModel(complete, draws)


def at(population, rows):
    return dict(zip(population.parameters, np.transpose(rows), strict=True))


def test_marginals_are_those_in_closed_form():
    """Priors divided out, densities normalised, each test's weights its own."""
    tests, measured = many(1, tests=2, number=20_000, width=0.3)
    rows = [[10.0, 5.0, 0.5, 0.5], [10.2, 5.1, 0.3, 0.2], [9.8, 5.2, 0.6, 0.3]]
    rows += [[10.2, 4.9, 1.5, 1.5]]
    pooled = model(tests, PLAIN, 20_000)(at(PLAIN, rows))["log_marginal"]
    mean, sd = np.split(np.array(rows)[:, None], 2, axis=2)
    exact = stats.norm(mean, np.hypot(sd, 0.2)).logpdf(measured).sum(axis=2)
    # Each is known but for a constant.
    apart = (pooled - pooled[0]) - (exact - exact[0])
    np.testing.assert_allclose(apart, 0, atol=0.06)


def test_a_population_is_normalised_inside_the_bounds_and_impossible_beyond():
    rows = [[10.0, 5.0, 4.0, 2.0], [7.0, 3.5, 3.0, 3.0]]
    cut, free = (model(many(6, tests=2, bounds=b)[0], PLAIN) for b in (BOX, None))
    mean, sd = np.split(np.array(rows), 2, axis=1)
    law = stats.norm(mean, sd)
    mass = (law.cdf(BOX[:, 1]) - law.cdf(BOX[:, 0])).prod(axis=1)
    own, other = (m(at(PLAIN, rows))["log_marginal"] for m in (cut, free))
    np.testing.assert_allclose(own - other, -np.log(mass)[:, None] * [1, 1], rtol=1e-9)
    rows = [[10.0, 5.0, 0.5, 0.5], [15.5, 5.0, 1.0, 0.5], [10.0, 7.5, 0.1, 0.3]]
    rows += [[10.0, 5.0, 1e-9, 1e-9], [10.0, 5.0, 1e-12, 0.0]]
    likely = normal.PopulationTerm(cut.variables)({}, cut(at(PLAIN, rows)))
    np.testing.assert_array_equal(likely > -100, [True, False, False, True, True])
    assert likely[3] == pytest.approx(likely[4], abs=1e-6)  # no draw alone decides


HYPER = {
    "mean k1": stats.norm(1.0, 0.05),
    "mean k2": stats.norm(1.0, 0.1),
    "sd k1": stats.uniform(0.03, 0.1),
    "sd k2": stats.uniform(0.03, 0.1),
}
POPULATION = ef.population.NormalPopulation(["k1", "k2"], hyperpriors=HYPER)
ERROR = 0.1
WIDTH, CENTRE = 0.12, 1.15  # of ln of the tests' own prior, which pulls hard


class Unnormalised(normal.PopulationModel):
    """Forgets the constant of the population's density, wherever it is."""

    def __call__(self, parameters):
        found = super().__call__(parameters)
        sds = parameters["sd k1"] * parameters["sd k2"]
        found["log_marginal"] += np.log(sds)[:, None]
        return found


def keep_prior(draws):
    return draws._replace(log_prior=0 * draws.log_prior)


def calibrate(datasets, seed, kind=normal.PopulationModel, bend=lambda draws: draws):
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
            x = mean / precision + rng.standard_normal((300, 2)) / np.sqrt(precision)
            log_prior = stats.lognorm(WIDTH, scale=CENTRE).logpdf(np.exp(x)).sum(axis=1)
            draws[f"t{t}"] = bend(normal.Draws(np.exp(x), log_prior, free, moments))
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
    p = calibrate(60, 2, **mutant) if mutant else calibrate(90, 1)
    assert (p > 0.001 / 4) != bool(mutant)
