"""Pooled tests against quadrature, a joint run of all parameters, and calibration."""

import time

import numpy as np
import pytest
from scipy import stats
from support import lognormal_tests as lognormal
from support import repeated
from support.free_posterior import FreeModel

import emcee_femu as ef
from emcee_femu.population.draws import Drawn, read_tests
from emcee_femu.population.hyperprior import PopulationPrior
from emcee_femu.population.marginal import PopulationModel

pytestmark = pytest.mark.slow
BOX = np.array([[0.0, np.inf]] * 2)


@pytest.mark.parametrize(("tests", "draws"), [(20, 4_000), (100, 2_000)])
def test_two_parameter_structures_are_pooled_as_by_nested_quadrature(tests, draws):
    rng = np.random.default_rng(tests)
    measured, _ = repeated.simulate(rng, tests)
    given = {
        f"t{i}": repeated.make_test(rng, own, draws) for i, own in enumerate(measured)
    }
    population = ef.NormalPopulation(repeated.NAMES)
    found = ef.pool_tests(
        given, population, seed=1, draws=draws, nsteps=200, ensembles=2
    )
    exact = repeated.quadrature(measured, found.population.hyperpriors)
    posterior = found.idata["posterior"]
    got = np.array([posterior[name].values.ravel() for name in found.posterior.names])
    np.testing.assert_allclose((got.mean(axis=1) - exact.mean) / exact.sd, 0, atol=0.1)
    np.testing.assert_allclose(got.std(axis=1) / exact.sd, 1, atol=0.05)
    mean, sd = exact.tests[:, :, 0], exact.tests[:, :, 1]
    reached = ~np.isin(found.tests, found.by_law)  # 1,000 draws of each
    error = (found.theta.mean(axis=0) - mean)[reached] / sd[reached]
    assert np.sqrt((error**2).mean()) < 0.1 and abs(error).max() < 0.4
    ratio = found.theta.std(axis=0)[reached] / sd[reached]
    assert np.sqrt(((ratio - 1) ** 2).mean()) < 0.1


def test_a_joint_run_of_all_parameters_agrees():
    """Four tests: twelve parameters at once, eight of them the tests' own."""
    rng = np.random.default_rng(5)
    measured, _ = repeated.simulate(rng, 4)
    given = {
        f"t{i}": repeated.make_test(rng, own, 4_000) for i, own in enumerate(measured)
    }
    laws = {f"sd {name}": stats.uniform(0.02, 0.2) for name in repeated.NAMES}
    population = ef.NormalPopulation(repeated.NAMES, hyperpriors=laws)
    found = ef.pool_tests(given, population, seed=1, draws=4_000, ensembles=2)
    own = [f"{name} {i}" for i in range(4) for name in repeated.NAMES]
    flat = dict.fromkeys(own, stats.uniform(0.4, 1.4))
    hyper = {n: found.population.hyperpriors[n] for n in population.parameters}
    prior = ef.IndependentPrior({**hyper, **flat})

    def joint(parameters, _):
        theta = np.stack([parameters[name] for name in own], axis=1).reshape(-1, 4, 2)
        total = repeated.log_likelihood(measured, theta[..., 0], theta[..., 1])
        for i, name in enumerate(repeated.NAMES):
            mean, sd = (parameters[f"{what} {name}"] for what in ("mean", "sd"))
            z = (theta[..., i] - mean[:, None]) / sd[:, None]
            total = total - z**2 / 2 - np.log(sd)[:, None]
        return total.sum(axis=1)

    posterior = ef.LogPosterior(FreeModel(), joint, prior)
    samplers = ef.run(posterior, "auto", 48, 1_200, ensembles=2, seed=1)
    chain = np.concatenate([run.get_chain(flat=True) for run in samplers])
    for i, name in enumerate(found.posterior.names):
        pooled = found.idata["posterior"][name].values.ravel()
        assert pooled.mean() == pytest.approx(
            chain[:, i].mean(), abs=0.1 * chain[:, i].std()
        )
        assert pooled.std() == pytest.approx(chain[:, i].std(), rel=0.08)
    for i, name in enumerate(own):
        drawn = found.theta.reshape(len(found.theta), -1)[:, i]
        joint_draws = chain[:, 4 + posterior.names[4:].index(name)]
        sd = joint_draws.std()
        assert drawn.mean() == pytest.approx(joint_draws.mean(), abs=0.15 * sd)
        assert drawn.std() == pytest.approx(sd, rel=0.12)


HYPER = {
    "mean k1": stats.norm(1.0, 0.05),
    "mean k2": stats.norm(1.0, 0.1),
    "sd k1": stats.uniform(0.03, 0.1),
    "sd k2": stats.uniform(0.03, 0.1),
}
POPULATION = ef.NormalPopulation(["k1", "k2"], hyperpriors=HYPER)
WIDTH, CENTRE = 0.12, 1.15  # of ln of the tests' own prior, which pulls hard


class Unnormalised(PopulationModel):
    """Forgets the constant of the population's density, wherever it is."""

    def __call__(self, parameters):
        found = super().__call__(parameters)
        sds = parameters["sd k1"] * parameters["sd k2"]
        found["log_marginal"] += np.log(sds)[:, None]
        return found


def keep_prior(draws):
    both = draws.log_rest + draws.log_prior
    return draws._replace(log_prior=0 * draws.log_prior, log_rest=both)


def calibrate(datasets, seed, kind=PopulationModel, bend=lambda draws: draws):
    """Return where the truth lies among the weighted draws, ``(datasets, 4)``."""
    rng = np.random.default_rng(seed)
    found = np.empty((datasets, 4))
    bounds, moments = BOX, np.ones((2, 2))
    for k in range(datasets):
        truth = POPULATION.prior.sample(rng, 1)[0]
        theta = rng.normal(truth[:2], truth[2:], (6, 2))
        measured = np.log(np.maximum(theta, 0.05))
        measured += lognormal.ERROR * rng.standard_normal((6, 2))
        precision = 1 / lognormal.ERROR**2 + 1 / WIDTH**2
        draws = {}
        for t, own in enumerate(measured):
            mean = own / lognormal.ERROR**2 + np.log(CENTRE) / WIDTH**2
            mean /= precision
            x = mean + rng.standard_normal((500, 2)) / np.sqrt(precision)
            likelihood = -0.5 * (((x - own) / lognormal.ERROR) ** 2).sum(axis=1)
            log_prior = stats.lognorm(WIDTH, scale=CENTRE).logpdf(np.exp(x)).sum(axis=1)
            none = np.empty((500, 0))
            given = Drawn(np.exp(x), none, log_prior, likelihood, bounds, moments)
            draws[f"t{t}"] = bend(given)
        hyper = POPULATION.prior.sample(rng, 1_500)
        model = kind(POPULATION, draws)
        by_name = dict(zip(POPULATION.parameters, hyper.T, strict=True))
        total = model(by_name)["log_marginal"].sum(axis=1)
        weights = np.exp(total - total.max())
        found[k] = (weights @ (hyper < truth)) / weights.sum()
    return found


def p_values(found):
    return np.array(
        [stats.kstest(column, stats.uniform.cdf).pvalue for column in found.T]
    )


def test_the_truth_ranks_uniformly_in_200_data_sets():
    assert p_values(calibrate(200, 1)).min() > 0.001 / 4


@pytest.mark.parametrize(
    "mutant", [{"bend": keep_prior}, {"kind": Unnormalised}], ids=["prior", "density"]
)
def test_the_truth_does_not_under_mutants(mutant):
    """The prior not divided out; the population's density without its constant."""
    assert p_values(calibrate(200, 2, **mutant)).min() < 0.001 / 4


def test_eighteen_parameters_in_eighty_tests():
    """Errors of each test's parameters are larger than what they differ by.

    By how much the estimated log-likelihood would move means and standard deviations
    off the exact posterior: its covariance with each of them under exact draws.
    """
    rng, d, n = np.random.default_rng(1), 18, 400
    measured = lognormal.simulate(rng, 80, d)
    names = tuple(f"k{i + 1}" for i in range(d))
    found = read_tests(lognormal.make_tests(rng, measured, 1_000), names, 1_000)
    law = lognormal.PRIOR
    population = ef.NormalPopulation(names)
    population = population.complete(np.full(d, law.mean()), np.full(d, law.std()))
    hyper, exact = np.empty((n, 2 * d)), np.zeros(n)
    for i in range(d):
        own = f"mean {names[i]}", f"sd {names[i]}"
        means, spreads, weights = lognormal.quadrature(
            measured[:, i], population.hyperpriors, own
        )
        picked = np.unravel_index(
            rng.choice(weights.size, n, p=weights.ravel()), weights.shape
        )
        for column, grid, place in zip(
            (i, d + i), (means, spreads), picked, strict=True
        ):
            cell = (grid[1] - grid[0]) * (rng.random(n) - 0.5)
            hyper[:, column] = grid[place] + 0.99 * cell
        exact += lognormal.log_marginals(
            measured[:, i], hyper[:, i], hyper[:, d + i]
        ).sum(axis=1)
    model = PopulationModel(population, found)
    by_name = dict(zip(population.parameters, hyper.T, strict=True))
    off = model(by_name)["log_marginal"].sum(axis=1) - exact
    z = (hyper - hyper.mean(axis=0)) / hyper.std(axis=0)
    shift = z.T @ (off - off.mean()) / n
    assert np.sqrt((shift[:d] ** 2).mean()) < 0.2
    assert np.sqrt((shift[d:] ** 2).mean()) < 0.35


def test_a_hundred_tests_for_64_walkers_take_milliseconds():
    rng = np.random.default_rng(1)
    measured = lognormal.simulate(rng, 100, 2)
    found = read_tests(lognormal.make_tests(rng, measured, 1_000), ("k1", "k2"), 1_000)
    population = ef.NormalPopulation(["k1", "k2"]).complete(np.ones(2), np.ones(2))
    model = PopulationModel(population, found)
    prior = PopulationPrior(population, model.bounds_of, model.centred)
    drawn = prior.sample(rng, 64)
    by_name = dict(zip(prior.names, drawn.T, strict=True))
    times = []
    for _ in range(10):
        start = time.perf_counter()
        model(by_name)
        times.append(time.perf_counter() - start)
    assert min(times) < 0.25  # 0.03 s on an idle core
