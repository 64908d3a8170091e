"""Pool the posteriors of many tests: what is common to them, and how they differ."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import checks
from ..posterior.log_posterior import LogPosterior
from ..results.diagnostics import diagnose
from ..results.inference_data import to_inference_data
from ..sampling.run import run
from .draws import Drawn, read_tests
from .hyperprior import PopulationPrior
from .marginal import PopulationModel
from .normal import NormalPopulation
from .pooled import PooledTests
from .shrink import shrink
from .term import PopulationTerm


def pool_tests(
    tests: Mapping[str, Any],
    population: NormalPopulation,
    *,
    seed: int,
    nsteps: int = 300,
    ensembles: int = 4,
    draws: int = 1_000,
    posteriors: Mapping[str, LogPosterior] | None = None,
) -> PooledTests:
    r"""Infer the population of a structure's parameters from its tests, one by one.

    .. math:: p(\phi | D_1, \dots, D_T) \propto p(\phi)
        \prod_t \int L_t(\theta) N(\theta; \phi) \, d\theta

    The integrals are over the draws of each test's own posterior, from which its prior
    is divided out: there is no new FE solve. Parameters that are not pooled, such as
    errors, stay each test's own, under its own prior. The parameters of the population
    are sampled with ``run(..., "auto")``.

    A test is judged by the Pareto k of its weights under the population. Above 0.7 its
    draws hardly reach where the population puts it, and a normal law that resembles
    them stands in, or, where none does, the result is not to be trusted: the test has
    to be sampled again under the population. That is done here if its posterior is
    given; with pools and files of your own run ``result.under_population(test,
    posterior)`` and pool again.

    Args:
        tests: Of two tests at least, by name, what :func:`to_inference_data` returned;
            their priors may differ, but not the bounds of the pooled parameters.
        population: The population's law.
        seed: A whole number.
        nsteps: Stored steps of each ensemble.
        ensembles: Independent ensembles.
        draws: Draws of each test that are used, evenly spaced.
        posteriors: By name, posteriors of tests that may be sampled again, once, with
            as many FE solves as ``run(posterior, "auto", nsteps=1_000)`` takes.

    Returns:
        Samplers and an ArviZ object of the population, each test's parameters in its
        light, and tables; ``print`` it.

    Raises:
        TypeError: If an argument is of another type.
        ValueError: If a test does not fit the others or the population, by its name;
            or covariates are not those of the tests.

    Source: Hogg, Myers and Bovy (2010), doi:10.1088/0004-637X/725/2/2166, on weights;
    Behmanesh, Moaveni, Lombaert and Papadimitriou (2015),
    doi:10.1016/j.ymssp.2015.03.018, on populations in FE model updating.

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
        >>> prior = ef.GaussianPrior(["k"], [9.0], [1.0], [(5.0, 13.0)])
        >>> tests = {}
        >>> for name, f in {"May": 2.95, "June": 3.05}.items():
        ...     term = ef.FrequencyTerm([f], sd=0.01)
        ...     posterior = ef.LogPosterior(model, term, prior)
        ...     samplers = ef.run(posterior, nwalkers=16, nsteps=60, seed=1)
        ...     tests[name] = ef.to_inference_data(samplers, posterior, discard=30)
        >>> pooled = ef.pool_tests(tests, ef.NormalPopulation(["k"]), seed=1, nsteps=50,
        ...                        ensembles=1, draws=100)
        >>> bool(abs(pooled.hyperdraws["mean k"].mean() - 9.0) < 0.2)
        True
        >>> len(pooled.next_test()["k"])  # draws of a test not yet made
        1000
    """
    if not isinstance(population, NormalPopulation):
        raise TypeError(
            "population: expected a NormalPopulation, got "
            f"{type(population).__name__}; write NormalPopulation(names)"
        )
    number = checks.whole_number("draws", draws, 100)
    settings = {
        "seed": checks.whole_number("seed", seed),
        "nsteps": checks.whole_number("nsteps", nsteps, 1),
        "ensembles": checks.whole_number("ensembles", ensembles, 1),
    }
    found = read_tests(tests, population.names, number)
    _check_covariates(population, [*found])
    given = {} if posteriors is None else _check_posteriors(posteriors, found)
    mean, second = (
        np.mean([own.prior[0] for own in found.values()], axis=0),
        np.mean([own.prior[1] ** 2 for own in found.values()], axis=0),
    )
    complete = population.complete(mean, np.sqrt(second))
    pooled = _pool(found, complete, settings)
    again = [t for t in (*pooled.unreached, *pooled.by_law) if t in given]
    for test in again:
        under = pooled.under_population(test, given[test])
        idata = to_inference_data(run(under, "auto", nsteps=1_000, seed=seed), under)
        found |= read_tests({**tests, test: idata}, population.names, number)
    return _pool(found, complete, settings) if again else pooled


def _pool(
    found: Mapping[str, Drawn], population: NormalPopulation, settings: Any
) -> PooledTests:
    model = PopulationModel(population, found)
    prior = PopulationPrior(population, model.bounds_of, model.centred)
    posterior = LogPosterior(model, PopulationTerm(model.tests), prior)
    samplers = run(posterior, "auto", **settings)
    idata = to_inference_data(samplers, posterior)
    reached = shrink(idata, model, np.random.default_rng(settings["seed"]))
    return PooledTests(
        population=population,
        posterior=posterior,
        samplers=samplers,
        idata=idata,
        model=model,
        verdict=diagnose(idata).verdict,
        **reached,
    )


def _check_covariates(population: NormalPopulation, tests: list[str]) -> None:
    for name, values in population.covariates.items():
        missing = [test for test in tests if test not in values]
        unknown = [test for test in values if test not in tests]
        if missing or unknown:
            raise ValueError(
                f"population: its covariate {name!r} is not given for {missing}, and "
                f"given for {unknown}, which are no tests; give it for {tests}"
            )


def _check_posteriors(posteriors: Any, tests: Mapping[str, Drawn]) -> dict[str, Any]:
    if not isinstance(posteriors, Mapping):
        raise TypeError(
            f"posteriors: expected {{test: LogPosterior}}, got {posteriors!r}"
        )
    for test, posterior in posteriors.items():
        if test not in tests:
            raise ValueError(
                f"posteriors: there is no test {test!r}; there are {list(tests)}"
            )
        if not isinstance(posterior, LogPosterior):
            raise TypeError(
                f"posteriors[{test!r}]: expected a LogPosterior, got {posterior!r}"
            )
    return dict(posteriors)
