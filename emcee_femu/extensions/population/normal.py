r"""The normal distribution of a structure's parameters from test to test.

Its likelihood is computed from the draws of each test's own posterior.

.. math:: p(D_t | \phi) \propto
    \frac1S \sum_s \frac{N(\theta_{ts}; \phi)}{\pi_t(\theta_{ts})}

with draws theta_ts under the prior pi_t. As a model, its response is the logarithm of
this for each test, and no FE solve is needed. It is consistent: its error falls with
the number of draws, whatever the likelihood.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np
from scipy import stats
from scipy.special import ndtr

from ... import checks
from ...contracts import Floats, Parameters, Response, Variable
from ...likelihoods.term import Term
from ...posterior.priors import IndependentPrior, describe_marginal
from ...results.arviz_objects import InferenceData, dataset, samples
from ...table import Parts, Report, Table
from ...verdict.statistics import spread_out

FEWEST_OF_A_TEST = 100  # draws of a test
RESOLVED = 20  # draws needed inside the narrowest population that can be resolved
LEAST_DENSITY = 1e-300
# The share of each parameter's population that lies inside the bounds, at least: what
# is left of less would hang on the bound.
LEAST_INSIDE = 0.1
STEEP = 1_000.0


@dataclass(frozen=True, eq=False, repr=False)
class NormalPopulation(Report):
    r"""Parameters that vary between tests by normal distributions, truncated at bounds.

    .. math:: \theta_t \sim N(\mu + B (x_t - \bar x), \mathrm{diag}(s^2)) \quad
        \text{inside the bounds}

    Pass it to :func:`pool_tests`, which infers its parameters: ``mean k1``, the mean at
    the average of the covariates; ``sd k1``, the spread from test to test; and ``k1 per
    T``, the slope for each covariate. Mean and sd are those before truncation. At least
    a tenth of each parameter's distribution must lie inside the bounds at every test.

    Hyperpriors are proper. The defaults use the mean m and the standard deviation s of
    the prior under which the tests were sampled (averaged over the tests):

    =============== =================================================================
    ``mean k1``     normal(m, s): the prior belief about the structure
    ``sd k1``       half-normal(s): the tests differ by less than that
    ``k1 per T``    normal(0, s / sd of T over the tests)
    =============== =================================================================

    Args:
        names: The parameters that have a population; each test may have others.
        covariates: ``{"T": {"test 1": 12.0, ...}}``, by covariate and test.
        hyperpriors: ``{"sd k1": a frozen scipy.stats distribution}``, or a pair
            ``(low, high)`` for a uniform one. Parameters that are not named keep the
            defaults.

    Raises:
        TypeError: If an argument has the wrong type, such as a distribution that is not
            frozen.
        ValueError: If names are repeated, a hyperprior belongs to no parameter, or that
            of a spread admits negative values.

    Examples:
        >>> from emcee_femu.extensions.population import NormalPopulation
        >>> NormalPopulation(["k1", "k2"]).parameters
        ('mean k1', 'mean k2', 'sd k1', 'sd k2')
    """

    names: Sequence[str]
    _: KW_ONLY
    covariates: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    hyperpriors: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the arguments."""
        checks.set_fields(
            self,
            names=checks.parameter_names("names", self.names),
            covariates=_check_covariates(self.covariates),
        )
        argument = f"hyperpriors of the names {list(self.names)}"
        hyperpriors = checks.by_name(argument, self.hyperpriors, self.parameters)
        if hyperpriors:
            try:
                prior = IndependentPrior(hyperpriors)
            except (TypeError, ValueError) as error:
                raise type(error)(f"hyperpriors: {error}") from None
            hyperpriors = dict(prior.marginals)
            spreads = {f"sd {name}" for name in self.names}
            for name, (low, _) in zip(prior.names, prior.bounds.tolist(), strict=True):
                if name in spreads and low < 0:
                    raise ValueError(
                        f"hyperpriors[{name!r}]: expected a spread from zero on, got "
                        f"one from {low:g}; take halfnorm or lognorm"
                    )
        checks.set_fields(self, hyperpriors=hyperpriors)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the population's own parameters."""
        slopes = [f"{name} per {x}" for x in self.covariates for name in self.names]
        means = [f"mean {name}" for name in self.names]
        return (*means, *(f"sd {name}" for name in self.names), *slopes)

    @property
    def averages(self) -> dict[str, float]:
        """The average of each covariate over the tests."""
        return {x: float(np.mean([*v.values()])) for x, v in self.covariates.items()}

    def complete(self, mean: Floats, sd: Floats) -> Self:
        """Return the population with all its hyperpriors.

        Args:
            mean: Means of the priors under which the tests were sampled, ``(d,)``.
            sd: Their standard deviations, ``(d,)``.
        """
        defaults: dict[str, Any] = {}
        for name, m, s in zip(self.names, mean, sd, strict=True):
            defaults[f"mean {name}"] = stats.norm(m, s)
            defaults[f"sd {name}"] = stats.halfnorm(scale=s)
            for covariate, values in self.covariates.items():
                unit = np.std([*values.values()])
                defaults[f"{name} per {covariate}"] = stats.norm(0.0, s / unit)
        return replace(self, hyperpriors=defaults | dict(self.hyperpriors))

    @property
    def prior(self) -> IndependentPrior:
        """The prior of the population's parameters, once all hyperpriors are known.

        Raises:
            ValueError: If a hyperprior is missing.
        """
        missing = [name for name in self.parameters if name not in self.hyperpriors]
        if missing:
            raise ValueError(
                f"hyperpriors: those of {missing} follow from the tests; see "
                "pool_tests(...).population"
            )
        return IndependentPrior({n: self.hyperpriors[n] for n in self.parameters})

    def locate(self, parameters: Parameters, covariates: Parameters) -> Floats:
        """Return the means ``(n, m, d)`` at covariates ``{name: (m,)}``; m = 1 without.

        Args:
            parameters: The population's own, each ``(n,)``.
            covariates: The values at which the means are computed.
        """
        location = self._gather("mean {}", parameters)[:, None]
        for covariate, average in self.averages.items():
            slope = self._gather(f"{{}} per {covariate}", parameters)
            away = np.atleast_1d(covariates[covariate]) - average
            location = location + away[:, None] * slope[:, None]
        return location

    def spread(self, parameters: Parameters) -> Floats:
        """Return the standard deviations, ``(n, d)``."""
        return self._gather("sd {}", parameters)

    def _gather(self, form: str, parameters: Parameters) -> Floats:
        columns = [parameters[form.format(name)] for name in self.names]
        return np.stack(columns, axis=-1)

    def _parts(self) -> Parts:
        return (self.table,)

    @property
    def table(self) -> Table:
        """The hyperpriors, with the 95 % intervals that they state."""
        rows = [(name, "by the tests", np.nan, np.nan) for name in self.parameters]
        for i, name in enumerate(self.parameters):
            if hyperprior := self.hyperpriors.get(name):
                ends = hyperprior.ppf([0.025, 0.975]).tolist()
                rows[i] = (name, describe_marginal(hyperprior), *ends)
        title = f"Population of {', '.join(self.names)}: hyperpriors"
        columns = ("parameter", "distribution", "2.5 %", "97.5 %")
        return Table(title, columns, ("", "", ".4g", ".4g"), tuple(rows))


def _check_covariates(
    covariates: Mapping[str, Mapping[str, float]],
) -> dict[str, dict[str, float]]:
    """Return ``{covariate: {test: number}}``; the tests are compared by pool_tests."""
    if covariates == {}:
        return {}
    checked = {}
    tables = checks.by_label("covariates", covariates, "{test: number}")
    for name, values in tables.items():
        argument = f"covariates[{name!r}]"
        tests = [*checks.by_label(argument, values, "numbers")]
        numbers = checks.numbers_by_name(argument, values, tests).tolist()
        if len(set(numbers)) < 2:
            raise ValueError(
                f"covariates: {name!r} must differ between the tests, got {values!r}"
            )
        checked[name] = dict(zip(tests, numbers, strict=True))
    return checked


class Draws(NamedTuple):
    """The draws of one test's pooled parameters.

    Attributes:
        theta: The draws, ``(S, d)``.
        log_prior: Of these parameters alone, ``(S,)``.
        bounds: Theirs, ``(d, 2)``.
        prior: Their mean and standard deviation under the prior, ``(2, d)``.
    """

    theta: Floats
    log_prior: Floats
    bounds: Floats
    prior: Floats

    @property
    def resolved(self) -> Floats:
        """The spread below which some few draws alone would decide, ``(d,)``.

        A narrower population counts as one of this spread: a small part of what the
        test itself leaves open, the smaller the more draws there are.
        """
        number, d = self.theta.shape
        share = min(1.0, RESOLVED / number) ** (1 / d)
        return np.asarray(self.theta.std(axis=0) * share)


def read_tests(
    tests: Mapping[str, InferenceData], names: tuple[str, ...], number: int
) -> dict[str, Draws]:
    """Return the draws of each test, thinned evenly to a number.

    Raises:
        TypeError: If tests is no mapping of ArviZ objects.
        ValueError: If there are fewer than two, or one does not fit; with its name.
    """
    tests = checks.by_label("tests", tests, "what to_inference_data returns")
    if len(tests) < 2:
        raise ValueError(f"tests: expected at least two, got {[*tests]}")
    draws: dict[str, Draws] = {}
    for test, idata in tests.items():
        try:
            draws[test] = _read_test(idata, names, number)
        except (TypeError, ValueError) as error:
            raise type(error)(f"tests[{test!r}]: {error}") from None
        bounds = next(iter(draws.values())).bounds
        if not np.array_equal(draws[test].bounds, bounds):
            raise ValueError(
                f"tests[{test!r}]: its parameters {list(names)} have the bounds "
                f"{draws[test].bounds.tolist()}, but others have {bounds.tolist()}; "
                "sample all within the same bounds, since they share one population"
            )
    return draws


def _read_test(idata: InferenceData, names: tuple[str, ...], number: int) -> Draws:
    sampled, chains = samples(idata)
    missing = [name for name in names if name not in sampled]
    if missing:
        raise ValueError(f"it has no parameter {missing}; there are {sampled}")
    flat = chains.reshape(-1, len(sampled))
    if (different := len(np.unique(flat, axis=0))) < FEWEST_OF_A_TEST:
        least = f"at least {FEWEST_OF_A_TEST} different draws"
        raise ValueError(f"expected {least}, got {different}; run it longer")
    kept = spread_out(len(flat), number)
    # Of parameters that are not pooled the prior stays, and must not be divided out.
    whole = len(names) == len(sampled)
    group, parts = ("sample_stats", ["log_prior"]) if whole else ("log_prior", names)
    try:
        stored = dataset(idata, group)[list(parts)].transpose("chain", "draw")
    except (KeyError, ValueError):
        raise ValueError(
            "it lacks the log-prior of its draws, in sample_stats, or by parameter, in "
            "the group log_prior, where some parameters are not pooled; convert its "
            "run with to_inference_data, from a GaussianPrior or IndependentPrior"
        ) from None
    log_prior = sum(stored[name].values.ravel()[kept] for name in parts)
    constant = dataset(idata, "constant_data").reindex(parameter=list(names))
    return Draws(
        theta=flat[kept][:, [sampled.index(name) for name in names]],
        log_prior=np.asarray(log_prior),
        bounds=constant[["lower", "upper"]].to_array().values.T,
        prior=constant[["prior_mean", "prior_sd"]].to_array().values,
    )


class PopulationModel:
    """The parameters of a population to the log-likelihood of each test.

    Args:
        population: With all hyperpriors.
        tests: The draws of each test, by its name.

    Attributes:
        population: With all hyperpriors.
        tests: The draws of each test, by its name.
        names: The population's own parameters.
        variables: The log-likelihood of each test, and the least share inside the
            bounds.
        bounds_of: The bounds of the pooled parameters, ``(d, 2)``.
    """

    def __init__(
        self, population: NormalPopulation, tests: Mapping[str, Draws]
    ) -> None:
        self.population, self.tests = population, tests
        self.names = population.parameters
        by_test = Variable({"test": tuple(tests)})
        self.variables = {"log_marginal": by_test, "inside": Variable({}, stored=False)}
        self.bounds_of = next(iter(tests.values())).bounds

    def __call__(self, parameters: Parameters) -> dict[str, Floats]:
        """Return ``log_marginal (n, T)``, each up to a constant."""
        location = self._locate(parameters)
        sd = np.maximum(self.population.spread(parameters), LEAST_DENSITY)[:, None]
        low, high = (self.bounds_of.T[:, None, None] - location) / sd
        mass = np.maximum(ndtr(high) - ndtr(low), LEAST_DENSITY)
        log_marginal = -np.log(mass).sum(axis=2)
        for t, weights in enumerate(self.log_weights(parameters)):
            top = weights.max(axis=1)
            weights -= top[:, None]
            np.exp(weights, out=weights)
            log_marginal[:, t] += top + np.log(weights.sum(axis=1))
        return {"log_marginal": log_marginal, "inside": mass.min(axis=(1, 2))}

    def log_weights(self, parameters: Parameters) -> Iterator[Floats]:
        """Yield the logarithm of density over prior at each test's draws ``(n, S)``."""
        location, spread = self._locate(parameters), self.population.spread(parameters)
        for t, test in enumerate(self.tests.values()):
            sd = np.maximum(spread, test.resolved)
            # About the draws' middle, where the squares hardly cancel.
            middle = test.theta.mean(axis=0)
            theta, away = test.theta - middle, location[:, t] - middle
            coefficients = np.hstack([away, np.full_like(sd, -0.5)]) / np.tile(sd**2, 2)
            log_density = coefficients @ np.hstack([theta, theta**2]).T
            log_density -= (np.log(sd) + (away / sd) ** 2 / 2).sum(axis=1)[:, None]
            log_density -= test.log_prior
            yield log_density

    def _locate(self, parameters: Parameters) -> Floats:
        """Return the population's means at every test, ``(n, T, d)``."""
        covariates = {
            name: np.array([values[test] for test in self.tests])
            for name, values in self.population.covariates.items()
        }
        location = self.population.locate(parameters, covariates)
        n, _, d = location.shape
        return np.broadcast_to(location, (n, len(self.tests), d))


@dataclass(frozen=True)
class PopulationTerm(Term):
    """The sum of what the tests say; the tests are its data, one by one.

    Next to nothing where less than a tenth of a parameter's population is inside the
    bounds, but by a slope that leads a search back.
    """

    statement = (
        "Each test has parameters of its own, drawn from the population; φ are the "
        "parameters of the population."
    )
    formula = (
        "ln <i>p</i> = Σ<sub><i>t</i></sub> ln ∫ <i>L<sub>t</sub></i>(θ) "
        "<i>p</i>(θ | φ) dθ"
    )
    reads: Mapping[str, Variable]
    name: str = "tests"
    names: tuple[str, ...] = ()

    def __call__(self, parameters: Parameters, response: Response) -> Floats:
        """Return the log-likelihood ``(n,)``."""
        outside = np.maximum(np.log(LEAST_INSIDE / response["inside"]), 0.0)
        return np.asarray(response["log_marginal"].sum(axis=1) - STEEP * outside)

    def pointwise(
        self, parameters: Parameters, stored: Mapping[str, Floats]
    ) -> Mapping[str, Floats]:
        """Return the log-likelihood of each test, so that one may be left out."""
        return {"log_marginal": stored["log_marginal"]}
