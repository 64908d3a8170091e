"""The normal distribution of a structure's parameters, test after test."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, Self

import numpy as np
from scipy import stats

from ... import checks
from ...contracts import Floats, Parameters
from ...posterior.priors import IndependentPrior, describe_marginal
from ...table import Parts, Report, Table


@dataclass(frozen=True, eq=False, repr=False)
class NormalPopulation(Report):
    r"""Parameters that differ from test to test by normal distributions, cut at bounds.

    .. math:: \theta_t \sim N(\mu + B (x_t - \bar x), \mathrm{diag}(s^2)) \quad
        \text{inside the bounds}

    Its own parameters, which :func:`pool_tests` infers, are ``mean k1``, the mean at
    the average of the covariates; ``sd k1``, the spread from test to test; and
    ``k1 per T`` for each covariate. Where the bounds cut, mean and sd are those of the
    distribution before the cut; of each parameter a tenth of it is inside, at every
    test.

    Hyperpriors are proper. Where none is given, with m and s the mean and standard
    deviation of the prior under which the tests were sampled (its average over them):

    =============== =================================================================
    ``mean k1``     normal(m, s): what was believed of the structure
    ``sd k1``       half-normal(s): the tests differ by less than that
    ``k1 per T``    normal(0, s / sd of T over the tests)
    =============== =================================================================

    Args:
        names: The parameters that have a population; each test may have others.
        covariates: ``{"T": {"test 1": 12.0, ...}}``, by covariate and test.
        hyperpriors: ``{"sd k1": a frozen scipy.stats distribution}``, or a pair
            ``(low, high)`` for a uniform one, in place of the defaults; parameters of
            the population that are not named keep those.

    Raises:
        TypeError: If an argument is of another type, such as a distribution that is
            not frozen.
        ValueError: If names are repeated, a hyperprior is of no parameter, or one of a
            spread admits negative values.

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
        spreads = {f"sd {name}" for name in self.names}
        for name, hyperprior in hyperpriors.items():
            try:
                prior = IndependentPrior({name: hyperprior})
            except (TypeError, ValueError) as error:
                raise type(error)(f"hyperpriors: {error}") from None
            hyperpriors[name] = prior.marginals[name]
            if name in spreads and prior.bounds[0, 0] < 0:
                raise ValueError(
                    f"hyperpriors[{name!r}]: a spread is not negative, but this "
                    f"distribution begins at {prior.bounds[0, 0]:g}; take halfnorm or "
                    "lognorm"
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
            mean: Of the priors under which the tests were sampled, ``(d,)``.
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
        """The prior of its own parameters, once all hyperpriors are there.

        Raises:
            ValueError: If they are not.
        """
        missing = [name for name in self.parameters if name not in self.hyperpriors]
        if missing:
            raise ValueError(
                f"hyperpriors: those of {missing} follow from the tests; see "
                "pool_tests(...).population"
            )
        return IndependentPrior({n: self.hyperpriors[n] for n in self.parameters})

    def locate(self, parameters: Parameters, covariates: Parameters) -> Floats:
        """Return the means ``(n, m, d)`` at covariates ``{name: (m,)}``; m = 1 of none.

        Args:
            parameters: The population's own, each ``(n,)``.
            covariates: Where to find the means.
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


def _check_covariates(covariates: object) -> dict[str, dict[str, float]]:
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
