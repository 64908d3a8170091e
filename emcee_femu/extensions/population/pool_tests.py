"""Pool the posteriors of several tests: what they share and how they differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from ... import checks
from ...contracts import Floats, Reported
from ...digits import show
from ...likelihoods.residuals import FITS
from ...posterior.log_posterior import LogPosterior
from ...posterior.priors import GaussianPrior, IndependentPrior
from ...results.arviz_objects import InferenceData, samples, unit_of
from ...results.diagnose import diagnose
from ...results.measured import INTERVAL
from ...results.to_arviz import read_samples, to_inference_data
from ...sampling.record import Run
from ...sampling.run import run
from ...search.importance import GOOD_K, kish_share, pareto_k
from ...table import Column, Parts, Report, Table
from ...verdict.diagnosis import Statement
from .normal import (
    LEAST_DENSITY,
    Draws,
    NormalPopulation,
    PopulationModel,
    PopulationTerm,
    read_tests,
)

SMALL_SHIFT = 0.1  # posterior sds by which few draws may shift estimates
ENOUGH_EFFECTIVE = 100  # effective draws of a test that suffice whatever the tail
RESAMPLED, BLOCKS = 50, 50  # number of resamplings, and of blocks in them
POPULATION_DRAWS = 1_000  # of the population and of each test's parameters, together
WIDER_PRIOR = 1.2  # sd over the population's, so that weights stay even


@dataclass(frozen=True, eq=False, repr=False)
class PooledTests(Report):
    """The result of :func:`.pool_tests`; ``print`` it for tables and what to do.

    Attributes:
        population: The population with all its hyperpriors.
        model: The likelihood of each test given the population.
        run: The run of the population's parameters, for :func:`.diagnose`.
        idata: Its ArviZ object, for :func:`.parameter_table` and others. Its
            ``log_likelihood`` holds one value per test, so ``arviz.loo`` leaves out one
            test at a time.
        hyperdraws: 1,000 draws of the population's parameters, ``{name: (1000,)}``.
        theta: A draw of every test's parameters for each of them, ``(1000, T, d)``.
        pareto_k: Pareto k of the weights of each test's draws given all tests,
            ``(T,)``.
        effective: Effective number of these draws, ``(T,)``.
        monte_carlo: Errors of the mean and the standard deviation of each population
            parameter, in posterior standard deviations, due to the finite number of
            draws of the tests, ``(2, p)``; from resampling blocks of these draws with
            replacement.
        verdict: The verdict of :func:`.diagnose` on the chains.
        fits: What :func:`.diagnose` says of the fit of each test at its own samples,
            ``{test: Statement}``.
    """

    population: NormalPopulation
    model: PopulationModel
    run: Run
    idata: InferenceData
    hyperdraws: Mapping[str, Floats]
    theta: Floats
    pareto_k: Floats
    effective: Floats
    monte_carlo: Floats
    verdict: str
    fits: Mapping[str, Statement]

    def reported(self) -> Reported:
        """Return the contents of a report on the tests and their population."""
        covariates = (
            f"{name}: {', '.join(f'{x} ({test})' for test, x in values.items())}."
            for name, values in self.population.covariates.items()
        )
        tests = f"{len(self.tests)} tests of one structure: {', '.join(self.tests)}."
        return Reported(
            "pooled",
            self.run,
            "The population",
            (tests, *covariates),
            "No model was solved again: the draws of the tests were weighed {} times.",
            "plot_population",
            "The parameters of each test, alone and given all tests; the population "
            "and the next test.",
        )

    @property
    def tests(self) -> tuple[str, ...]:
        """The names of the tests."""
        return tuple(self.model.tests)

    @property
    def unreached(self) -> tuple[str, ...]:
        """Tests to sample again under the population, the farthest first."""
        few = (self.pareto_k > GOOD_K) & (self.effective < ENOUGH_EFFECTIVE)
        order = np.argsort(-self.pareto_k)
        return tuple(self.tests[i] for i in order if few[i])

    def draws(self, test: str) -> dict[str, Floats]:
        """Return the parameters of a test given all tests, ``{name: (1000,)}``.

        Args:
            test: Its name.

        Raises:
            ValueError: If there is no such test.
        """
        checks.one_of("test", test, self.tests)
        columns = self.theta[:, self.tests.index(test)].T
        return dict(zip(self.population.names, columns, strict=True))

    def next_test(self, **covariates: float) -> dict[str, Floats]:
        """Return the predicted parameters of a new test, ``{name: (1000,)}``.

        Args:
            covariates: Their values in that test, ``T=25.0``; the average for those
                left out.

        Returns:
            Draws of the parameters of that test.

        Raises:
            ValueError: If there is no such covariate.
        """
        at = self.population.averages
        for name, value in checks.by_name("covariates", covariates, [*at]).items():
            at[name] = checks.real_number(name, value)
        by_name = {name: np.array([value]) for name, value in at.items()}
        mean = self.population.locate(self.hyperdraws, by_name)[:, 0]
        sd = self.population.spread(self.hyperdraws)
        low, high = (self.model.bounds_of.T[:, None] - mean) / sd
        rng = np.random.default_rng(0)
        theta = stats.truncnorm.rvs(low, high, mean, sd, random_state=rng)
        return dict(zip(self.population.names, theta.T, strict=True))

    def under_population(self, test: str, posterior: LogPosterior) -> LogPosterior:
        """Return a test's posterior with the inferred population as its prior.

        The prior is normal with the mean and 1.2 times the standard deviation of the
        prediction for that test, truncated at the same bounds. Parameters that are not
        pooled keep their priors. Sample it with ``run``, then pool again with this
        result's ``population``: :func:`.pool_tests` divides out the prior under which a
        test was sampled, whatever it is.

        Args:
            test: Its name.
            posterior: The posterior under which it was sampled.

        Raises:
            TypeError: If posterior is not a LogPosterior, or its prior is neither a
                GaussianPrior nor an IndependentPrior.
            ValueError: If there is no such test, or the posterior has other parameters.
        """
        self.draws(test)  # refuses another
        prior = checks.instance("posterior", posterior, LogPosterior).prior
        names: Sequence[str] = prior.names
        if missing := [name for name in self.population.names if name not in names]:
            raise ValueError(f"posterior: no parameter {missing}; there are {names}")
        cut = self.population.names if isinstance(prior, IndependentPrior) else names
        if not isinstance(prior, GaussianPrior | IndependentPrior):
            raise TypeError(
                "posterior: expected a GaussianPrior or an IndependentPrior, whose "
                f"marginals are known, got {type(prior).__name__}; sample the test "
                "again under a prior of your own like the population's, and pool again"
            )
        marginals = dict(prior.marginals)
        covariates = self.population.covariates.items()
        drawn = self.next_test(**{name: values[test] for name, values in covariates})
        for name, values in drawn.items():
            marginals[name] = stats.norm(values.mean(), WIDER_PRIOR * values.std())
        bounds = dict(zip(prior.names, prior.bounds.tolist(), strict=True))
        restated = IndependentPrior(marginals, {name: bounds[name] for name in cut})
        experiments = {e.name: (e.model, e.terms) for e in posterior.experiments}
        if "" in experiments:
            return LogPosterior(*experiments[""], restated, posterior.units)
        return LogPosterior.joint(experiments, restated, posterior.units)

    @property
    def table(self) -> Table:
        """Means, spreads and slopes of the population, and a next test."""
        sampled = {n: self.idata.posterior[n].values.ravel() for n in self.model.names}
        coming = {f"next test's {n}": values for n, values in self.next_test().items()}
        draws = [*(sampled | coming).values()]
        sd = np.array([x.std(ddof=1) for x in draws])
        low, high = np.array([np.quantile(x, INTERVAL) for x in draws]).T
        title = f"Population of {len(self.tests)} tests"
        averages = [f"{name} = {x:.4g}" for name, x in self.population.averages.items()]
        if averages:
            title += f"; means and the next test at {', '.join(averages)}"
        its = [
            ("mean", np.array([x.mean() for x in draws])),
            ("sd", sd),
            ("2.5 %", low),
            ("97.5 %", high),
        ]
        columns: list[Column] = [("parameter", "", [*(sampled | coming)])]
        columns += [(column, show(values, sd), values) for column, values in its]
        return Table.from_columns(title, columns)

    @property
    def test_table(self) -> Table:
        """Each test's parameters, alone and given all tests, and its weights."""
        columns: list[Column] = [("test", "", list(self.tests))]
        for i, name in enumerate(self.population.names):
            alone = [test.theta[:, i] for test in self.model.tests.values()]
            mean, sd = np.array([(x.mean(), x.std()) for x in alone]).T
            pooled = self.theta[:, :, i]
            its_mean, its_sd = pooled.mean(axis=0), pooled.std(axis=0)
            columns += [
                (f"{name} alone", show(mean, sd), mean),
                ("sd", show(sd, sd), sd),
                (f"{name} pooled", show(its_mean, its_sd), its_mean),
                ("sd ", show(its_sd, its_sd), its_sd),
            ]
        columns += [
            ("Pareto k", ".2f", self.pareto_k),
            ("effective draws", ".0f", self.effective),
            ("fit alone", "", [fit.status for fit in self.fits.values()]),
        ]
        return Table.from_columns("Tests, each alone and given all tests", columns)

    @property
    def conclusion(self) -> str:
        """What to do about tests that do not fit or are out of reach, and of chains."""
        worst = f"(Pareto k up to {self.pareto_k.max():.2f})"
        reach = f"The draws of every test reach where the population puts it {worst}."
        if self.unreached:
            first, more = self.unreached[0], len(self.unreached) - 5
            shown = ", ".join(self.unreached[:5]) + f" and {more} more" * (more > 0)
            reach = (
                f"{shown}: do not trust this result. The draws do not reach where the "
                f"population puts them {worst}. Sample these "
                f"tests again under the population, posteriors={{{first!r}: posterior}}"
                f" or run under_population({first!r}, posterior), and pool again."
            )
        if (error := self.monte_carlo.max()) > SMALL_SHIFT:
            name = self.model.names[int(self.monte_carlo.max(axis=0).argmax())]
            used = max(len(test.theta) for test in self.model.tests.values())
            reach += (
                f" There are too few of them: other draws would change {name!r} by "
                f"{error:.2g} posterior standard deviations; run the tests longer, and "
                f"give draws={int(np.ceil((error / SMALL_SHIFT) ** 2)) * used}."
            )
        doubted = [
            f"{test}, by itself: {fit.sentence}"
            for test, fit in self.fits.items()
            if fit.status != FITS
        ]
        return "\n".join([*doubted, reach, self.verdict])

    def _parts(self) -> Parts:
        return self.table, self.test_table, self.conclusion


def pool_tests(
    tests: Mapping[str, object],
    population: NormalPopulation,
    *,
    seed: int,
    steps: int = 300,
    ensembles: int = 4,
    draws: int = 1_000,
    posteriors: Mapping[str, LogPosterior] | None = None,
) -> PooledTests:
    r"""Infer how a structure's parameters vary between tests, from their posteriors.

    .. math:: p(\phi | D_1, \dots, D_T) \propto p(\phi)
        \prod_t \int L_t(\theta) N(\theta; \phi) \, d\theta

    Use it for repeated tests of one structure, or for tests at different temperatures.
    Each integral is a sum over the draws of the test's own posterior, from which its
    prior is divided out; no FE solve is needed. Parameters that are not pooled, such as
    errors, remain specific to each test, under its own prior. The population's
    parameters are sampled with ``run(..., "auto")``.

    Each test is judged by the Pareto k of the weights that lead from its own posterior
    to its posterior given all tests. If k is above 0.7 and fewer than 100 draws are
    effective, its draws hardly reach the region where the population puts it, and the
    result is not reliable. The test must then be sampled again under the population.
    This is done here if its posterior is given; to use pools and files of your own, run
    ``result.under_population(test, posterior)`` and pool again. A single test that
    shifts the population may put others out of reach too.

    Args:
        tests: At least two tests by name, each the result of :func:`run` or
            :func:`to_inference_data`. Their priors may differ, but not the bounds of
            the pooled parameters.
        population: The population's distribution, a :class:`.NormalPopulation`.
        seed: A whole number.
        steps: Stored steps of each ensemble.
        ensembles: Number of independent ensembles.
        draws: Number of draws used from each test, evenly spaced.
        posteriors: Posteriors by name of tests that may be sampled again, once, with as
            many FE solves as ``run(posterior, "auto", steps=1_000)`` takes.

    Returns:
        The run and its ArviZ object, each test's parameters given all tests, and
        tables; ``print`` it.

    Raises:
        TypeError: If an argument has the wrong type.
        ValueError: If a test, which the message names, does not match the others or
            the population; or covariates do not match the tests.

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
        ...     samplers = ef.run(posterior, ef.DEMCMove(), 16, 60, ensembles=1, seed=1)
        ...     tests[name] = ef.to_inference_data(samplers, posterior, discard=30)
        >>> population = ef.population.NormalPopulation(["k"])
        >>> pooled = ef.pool_tests(tests, population, seed=1, steps=50, ensembles=1,
        ...                        draws=100)
        >>> bool(abs(pooled.hyperdraws["mean k"].mean() - 9.0) < 0.2)
        True
        >>> len(pooled.next_test()["k"])  # draws of a test not yet made
        1000
    """
    checks.instance("population", population, NormalPopulation)
    number = checks.whole_number("draws", draws, 100)
    steps = checks.whole_number("steps", steps, 1)  # None would be as many as needed
    names = tuple(population.names)
    sources = {
        name: read_samples(test, argument=f"tests[{name!r}]", judged=True)[0]
        for name, test in checks.by_label("tests", tests, "runs").items()
    }
    by_test = read_tests(sources, names, number)
    for name, values in population.covariates.items():
        if {*values} != {*by_test}:
            raise ValueError(
                f"population: its covariate {name!r} is given for {list(values)}; "
                f"expected one number for each of {list(by_test)}"
            )
    again = {} if posteriors is None else posteriors
    again = checks.by_name("posteriors", again, [*by_test])
    for test, posterior in again.items():
        checks.instance(f"posteriors[{test!r}]", posterior, LogPosterior)
    mean, sd = np.transpose([test.prior for test in by_test.values()], (1, 0, 2))
    complete = population.complete(mean.mean(axis=0), np.sqrt((sd**2).mean(axis=0)))
    first = next(iter(sources.values()))
    pairs = [(name, unit_of(first, name)) for name in names if unit_of(first, name)]
    units = {f"{what} {name}": unit for name, unit in pairs for what in ("mean", "sd")}
    pooled = _pool(sources, by_test, complete, seed, steps, ensembles, units)
    renewed = [test for test in pooled.unreached if test in again]
    for test in renewed:
        under = pooled.under_population(test, again[test])
        sources[test] = to_inference_data(run(under, "auto", steps=1_000, seed=seed))
    if renewed:
        by_test = read_tests(sources, names, number)
        pooled = _pool(sources, by_test, complete, seed, steps, ensembles, units)
    return pooled


def _pool(
    sources: Mapping[str, InferenceData],
    tests: Mapping[str, Draws],
    population: NormalPopulation,
    seed: int,
    steps: int,
    ensembles: int,
    units: Mapping[str, str],
) -> PooledTests:
    """Sample the population, and each test's parameters given it.

    Given the population the tests are independent: of each a draw is taken by its
    weights. They are judged by their means over the population's draws, which lead
    from a test's own posterior to that given all tests. Those of a single draw would
    not do: a narrow population has few draws about it wherever it is.
    """
    model = PopulationModel(population, tests)
    term = PopulationTerm(model.variables)
    posterior = LogPosterior(model, term, population.prior, units)
    sampled = run(posterior, steps=steps, ensembles=ensembles, seed=seed)
    pooled = to_inference_data(sampled)
    names, chains = samples(pooled)
    flat = chains.reshape(-1, len(names))
    rng = np.random.default_rng(seed)
    few = len(flat) < POPULATION_DRAWS
    chosen = flat[rng.choice(len(flat), POPULATION_DRAWS, replace=few)]
    hyperdraws = dict(zip(names, chosen.T, strict=True))
    theta = np.empty((POPULATION_DRAWS, len(tests), len(population.names)))
    k, effective = np.empty((2, len(tests)))
    resampled = np.zeros((POPULATION_DRAWS, RESAMPLED))
    blocks = np.random.default_rng(seed)  # theta is drawn as it was without them
    pairs = zip(tests.values(), model.log_weights(hyperdraws), strict=True)
    for t, (test, log_weights) in enumerate(pairs):
        weights = np.array([special.softmax(row) for row in log_weights])
        cumulative = weights.cumsum(axis=1)
        level = rng.random((POPULATION_DRAWS, 1)) * cumulative[:, -1:]
        theta[:, t] = test.theta[(cumulative < level).sum(axis=1)]
        with np.errstate(divide="ignore"):  # far from the population there is none
            mean = np.log(weights.mean(axis=0))
        k[t] = pareto_k(mean)
        effective[t] = kish_share(mean) * len(test.theta)
        # Neighbours, which may be correlated, are drawn again together.
        starts = np.arange(BLOCKS) * len(test.theta) // BLOCKS
        counts = blocks.multinomial(BLOCKS, np.full(BLOCKS, 1 / BLOCKS), RESAMPLED)
        sums = np.add.reduceat(weights, starts, axis=1) @ counts.T
        resampled += np.log(np.maximum(sums, LEAST_DENSITY))
    again = [_moments(chosen, special.softmax(column)) for column in resampled.T]
    return PooledTests(
        population=population,
        model=model,
        run=sampled,
        idata=pooled,
        hyperdraws=hyperdraws,
        theta=theta,
        pareto_k=k,
        effective=effective,
        monte_carlo=np.std(again, axis=0) / flat.std(axis=0),
        verdict=f"Chains: {diagnose(pooled).chains.sentence}",
        fits={test: diagnose(idata).fit for test, idata in sources.items()},
    )


def _moments(draws: Floats, weights: Floats) -> Floats:
    """Return means and standard deviations of weighted draws, ``(2, p)``."""
    mean = weights @ draws
    return np.stack([mean, np.sqrt(weights @ (draws - mean) ** 2)])
