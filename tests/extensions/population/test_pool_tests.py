"""Pooled tests: quadrature, what is shown, tests out of reach, and refusals."""

import dataclasses

import numpy as np
import pytest
from scipy import stats
from support.normal_tests import as_idata, many, normal_test
from support.runs import leave_out

import emcee_femu as ef
from emcee_femu.search import auto

POPULATION = ef.population.NormalPopulation(["k1", "k2"])
HEAT = np.linspace(-5, 30, 6)
WARMER = np.array([10.0, 5.0]) + np.outer(0.05 * (HEAT - HEAT.mean()), [1, 0])
GIVEN = {"sd k2": stats.lognorm(0.5, scale=0.3)}


@pytest.fixture(scope="module")
def pooled():
    """Two parameters at six temperatures: the first depends on them."""
    tests, measured = many(1, 6, WARMER, number=250)
    population = ef.population.NormalPopulation(
        ["k1", "k2"],
        covariates={"T": dict(zip(tests, HEAT.tolist(), strict=True))},
        hyperpriors=GIVEN,
    )
    with pytest.MonkeyPatch.context() as patch:
        # Surfaces and climbs in tails cost 8 s.
        leave_out(patch, auto.bend, auto.follow_tails)
        found = ef.pool_tests(tests, population, seed=1, steps=120, ensembles=2)
    return found, measured


def exact_population(measured, error, design, hyperpriors):
    """Return mean and sd of ``mean, slope, sd`` of one parameter, by quadrature."""
    *linear, sd_law = hyperpriors
    prior = np.diag([law.var() for law in linear])
    centre = np.array([law.mean() for law in linear])
    spreads = np.linspace(0.004, 1.6, 200)
    weights, means, variances = [], [], []
    for s in spreads:
        noise = (s**2 + error**2) * np.eye(len(measured))
        scatter = design @ prior @ design.T + noise
        gain = prior @ design.T @ np.linalg.inv(scatter)
        law = stats.multivariate_normal(design @ centre, scatter)
        weights.append(law.logpdf(measured) + sd_law.logpdf(s))
        means.append([*(centre + gain @ (measured - design @ centre)), s])
        variances.append([*np.diag(prior - gain @ design @ prior), 0.0])
    w = np.exp(weights - np.max(weights))
    w /= w.sum()
    mean = w @ np.array(means)
    return mean, np.sqrt(w @ (np.array(variances) + (means - mean) ** 2))


def test_means_slopes_and_spreads_are_those_of_quadrature(pooled):
    found, measured = pooled
    design = np.column_stack([np.ones(6), HEAT - HEAT.mean()])
    for i, name in enumerate(["k1", "k2"]):
        keys = [f"mean {name}", f"{name} per T", f"sd {name}"]
        laws = [found.population.hyperpriors[key] for key in keys]
        mean, sd = exact_population(measured[:, i], 0.2, design, laws)
        drawn = np.array([found.idata["posterior"][key].values.ravel() for key in keys])
        np.testing.assert_allclose((drawn.mean(axis=1) - mean) / sd, 0, atol=0.15)
        np.testing.assert_allclose(drawn.std(axis=1) / sd, 1, atol=0.15)


def test_each_test_shrinks_towards_the_population(pooled):
    found, measured = pooled
    centred = HEAT - HEAT.mean()
    hyper = found.hyperdraws
    for i, name in enumerate(["k1", "k2"]):
        location = hyper[f"mean {name}"] + centred[:, None] * hyper[f"{name} per T"]
        gain = hyper[f"sd {name}"] ** 2 / (hyper[f"sd {name}"] ** 2 + 0.04)
        means = location + gain * (measured[:, i][:, None] - location)
        expected = means.mean(axis=1)
        sd = np.sqrt((0.04 * gain).mean() + means.var(axis=1))
        error = (found.theta[:, :, i].mean(axis=0) - expected) / sd
        assert abs(error).max() < 0.25  # 1,000 draws, and 250 of each test
        np.testing.assert_allclose(found.theta[:, :, i].std(axis=0) / sd, 1, atol=0.2)
    np.testing.assert_array_equal(found.draws("test 3")["k2"], found.theta[:, 2, 1])


def test_tables_say_what_was_found_and_hyperpriors_are_stated_or_replaced(pooled):
    found, _ = pooled
    assert found.test_table.column("test") == [f"test {i}" for i in range(1, 7)]
    names = ef.parameter_table(found.idata).column("parameter")
    assert (*names,) == found.population.parameters == found.run.posterior.names
    assert found.idata["log_likelihood"]["tests"].shape[2:] == (6,)  # for loo
    theta = np.array([[9.5, 5.0, 0.01, 0.02, 1.0, 0.4]])
    values = dict(zip(names, theta[0], strict=True))
    laws = found.population.hyperpriors
    expected = sum(laws[name].logpdf(value) for name, value in values.items())
    assert found.run.posterior.prior.logpdf(theta)[0] == pytest.approx(expected)
    assert laws["sd k2"].logpdf(0.4) == GIVEN["sd k2"].logpdf(0.4)


def test_few_effective_draws_with_a_heavy_tail_are_out_of_reach(pooled):
    k, effective = np.full(6, 0.8), np.full(6, 300.0)
    k[0], effective[[0, 3]] = 0.6, 50.0
    found = dataclasses.replace(pooled[0], pareto_k=k, effective=effective)
    assert found.unreached == ("test 4",) and "test 4" in found.conclusion


def test_the_figures_show_each_test_and_the_population(pooled):
    found, _ = pooled
    grey, blue = ef.figures.plot_population(found).axes[1].collections[:2]
    alone, together = (np.array(c.get_segments())[:, :, 0] for c in (grey, blue))
    assert np.ptp(alone, axis=1).mean() > np.ptp(together, axis=1).mean()
    expected = np.quantile(found.theta[:, 0, 1], [0.025, 0.975])
    np.testing.assert_allclose(together[0], expected)
    line = ef.figures.plot_population(found, "T").axes[0].lines[0]
    slope = np.polyfit(*line.get_data(), 1)[0]
    assert slope == pytest.approx(found.hyperdraws["k1 per T"].mean(), rel=0.05)


def three_solutions(parameters, response):
    k = parameters["k1"][:, None]
    distance = (k - [1.0, 2.4, 5.2]) / [0.1, 0.1, 0.2]
    return np.logaddexp.reduce(-0.5 * distance**2, axis=1)


@pytest.mark.slow
def test_a_test_out_of_reach_is_named_and_reached_when_it_is_sampled_again():
    """The law of ``posteriors``: draws in two wrong ones of three solutions.

    They drag the population, and so far that another test, 4.5 sds off, is lost too.
    """
    rng, names, prior = np.random.default_rng(2), ["k1"], np.array([[3.0], [3.0]])
    tests = {
        f"t{i}": normal_test(rng, np.array([m]), np.array([[0.04]]), prior, names=names)
        for i, m in enumerate(5 + 0.1 * np.arange(6))
    }
    gaussian = ef.GaussianPrior(names, *prior)
    model = ef.FunctionModel(lambda p: [1.0], n_modes=1)
    posterior = ef.LogPosterior(model, three_solutions, gaussian)
    theta = rng.normal(np.repeat([1.0, 2.4], 200), 0.1)[:, None]
    log_prior = gaussian.logpdfs(theta)
    lp = three_solutions({"k1": theta[:, 0]}, None) + log_prior[:, 0]
    tests["odd"] = as_idata(names, theta, lp, log_prior, prior)
    narrow = {"sd k1": stats.uniform(0.0, 0.2)}
    population = ef.population.NormalPopulation(names, hyperpriors=narrow)
    options = {"seed": 1, "steps": 300, "ensembles": 2}
    dragged = ef.pool_tests(tests, population, **options)
    assert dragged.unreached == ("odd", "t5") and dragged.effective[-2] < 15
    assert "odd" in dragged.conclusion and dragged.pareto_k[-1] > 1
    options["posteriors"] = {"odd": posterior}
    mended = ef.pool_tests(tests, population, **options)
    assert mended.unreached == ()
    assert mended.draws("odd")["k1"].mean() == pytest.approx(5.22, abs=0.15)
    assert mended.hyperdraws["sd k1"].mean() < dragged.hyperdraws["sd k1"].mean()


def posed(prior):
    model = ef.FunctionModel(lambda p: [1.0], n_modes=1)
    return ef.LogPosterior(model, lambda p, r: np.zeros(len(r.frequencies)), prior)


def test_the_prior_of_parameters_that_are_not_pooled_stays(pooled):
    found, _ = pooled
    prior = ef.IndependentPrior({"k1": stats.norm(5, 2), "noise": stats.expon(scale=2)})
    with pytest.raises(ValueError, match=r"posterior: .*\['k2'\]"):
        found.under_population("test 1", posed(prior))
    both = ef.IndependentPrior({**prior.marginals, "k2": stats.norm(4, 1)})
    under = found.under_population("test 1", posed(both))
    assert under.names == ("k1", "noise", "k2")
    assert under.prior.marginals["noise"].mean() == 2.0
    gaussian = ef.GaussianPrior(["k1", "k2", "e"], [9.0, 5.0, 0.1], 1.0, [(0, 20)] * 3)
    under = found.under_population("test 1", posed(gaussian))
    grid = np.linspace(0.1, 3, 5)
    cut = stats.truncnorm(-0.1, 19.9, 0.1, 1.0).logpdf(grid)
    np.testing.assert_allclose(under.prior.marginals["e"].logpdf(grid), cut)
    assert under.prior.bounds.tolist() == [[0, 20]] * 3


TESTS, _ = many(3, tests=3, number=120)
ONE = ef.population.NormalPopulation(["k1"])
LACKING = many(3)[0]["test 2"]
del LACKING["log_prior"]
BOX = np.array([[0.0, 20.0], [0.0, 9.0]])


@pytest.mark.parametrize(
    ("test", "population", "named"),
    [
        (TESTS["test 1"], ef.population.NormalPopulation(["k1", "E"]), r"\['E'\]"),
        (LACKING, ONE, "log-prior"),
        (many(1, number=50)[0]["test 1"], POPULATION, "got 50"),
        (many(1, bounds=BOX)[0]["test 1"], POPULATION, r"bounds \[\[0.0, 20"),
    ],
)
def test_tests_that_do_not_fit_are_named(test, population, named):
    with pytest.raises(ValueError, match=rf"tests\['.*'\]: .*{named}"):
        ef.pool_tests({**TESTS, "b": test}, population, seed=1)


@pytest.mark.slow
def test_each_test_may_be_a_run_and_its_fit_is_judged_by_its_own_samples():
    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5, 2 * p["k"] ** 0.5], n_modes=2)
    prior = ef.GaussianPrior(["k"], [9.0], [1.0], [(5.0, 13.0)])
    tests = {}
    for name, measured in {"May": [2.95, 5.91], "June": [2.95, 6.4]}.items():
        term = ef.FrequencyTerm(measured, sd=0.01)
        run = ef.run(ef.LogPosterior(model, term, prior), "auto", steps=30, seed=1)
        tests[name] = run if name == "May" else ef.to_inference_data(run)
    population = ef.population.NormalPopulation(["k"])
    pooled = ef.pool_tests(tests, population, seed=1, steps=20, ensembles=1)
    assert [fit.status for fit in pooled.fits.values()] == ["fits", "does not fit"]
    assert "June, by itself" in pooled.conclusion
    assert "May, by itself" not in pooled.conclusion
