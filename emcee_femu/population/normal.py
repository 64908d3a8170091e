"""The normal law from which the parameters of a structure come, test after test."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy import stats

from .. import checks
from ..interfaces import Floats, Parameters
from ..posterior.prior_table import say
from ..posterior.priors import IndependentPrior
from ..table import Parts, Report, Table

TINY = 1e-300
FLOOR = 1e-8  # of a standard deviation's scale: a spread of exactly zero has no density


@dataclass(frozen=True, eq=False, init=False)
class NormalPopulation(Report):
    r"""Parameters that differ from test to test by a normal law, cut at their bounds.

    .. math:: \theta_t \sim N(\mu + B (x_t - \bar x), \Sigma) \quad
        \text{inside the bounds}, \qquad
        \Sigma = \mathrm{diag}(s) \, R \, \mathrm{diag}(s)

    Its own parameters, which :func:`pool_tests` infers, are ``mean k1``, the mean at
    the average of the covariates; ``sd k1``, the spread from test to test; ``k1 per T``
    for each covariate; and, where asked for, ``correlation k1, k2``. Of three
    parameters and more the last of these are partial ones, ``correlation k2, k3 | k1``,
    given all parameters before, so that they are free of each other; the correlations
    themselves go into the results. Where the bounds cut, mean and sd are those of the
    law before the cut; of each parameter a tenth of it is inside, at every test.

    Hyperpriors are proper. Where none is given, with m and s the mean and standard
    deviation of the prior under which the tests were sampled (its average over them):

    =============== =================================================================
    ``mean k1``     normal(m, s): what was believed of the structure
    ``sd k1``       half-normal(s): the tests differ by less than that
    ``k1 per T``    normal(0, s / sd of T over the tests)
    ``correlation`` all correlation matrices are equally probable
    =============== =================================================================

    Args:
        names: The parameters that have a population; each test may have others.
        correlated: Whether their correlations are inferred, ``d (d - 1) / 2`` numbers.
        covariates: ``{"T": {"test 1": 12.0, ...}}``, by covariate and test.
        hyperpriors: ``{"sd k1": a frozen scipy.stats distribution}``, in place of the
            defaults; parameters of the population that are not named keep those.

    Raises:
        TypeError: If an argument is of another type, such as a distribution that is
            not frozen.
        ValueError: If names are repeated, a hyperprior is of no parameter, one of a
            spread admits negative values, or correlations are asked of one parameter.

    Source: Lewandowski, Kurowicka and Joe (2009), doi:10.1016/j.jmva.2009.04.008, on
    correlation matrices by partial correlations.

    Examples:
        >>> from emcee_femu import NormalPopulation
        >>> NormalPopulation(["k1", "k2"], correlated=True).parameters
        ('mean k1', 'mean k2', 'sd k1', 'sd k2', 'correlation k1, k2')
    """

    names: tuple[str, ...]
    correlated: bool
    covariates: Mapping[str, Mapping[str, float]]
    hyperpriors: Mapping[str, Any]

    def __init__(
        self,
        names: Sequence[str],
        *,
        correlated: bool = False,
        covariates: Mapping[str, Mapping[str, float]] | None = None,
        hyperpriors: Mapping[str, Any] | None = None,
    ) -> None:
        names = checks.parameter_names("names", names)
        correlated = checks.flag("correlated", correlated)
        if correlated and len(names) < 2:
            raise ValueError(
                f"correlated: of the names there is but {names[0]!r}, which has no "
                "correlation; omit it"
            )
        checks.set_fields(self, names=names, correlated=correlated)
        checks.set_fields(self, covariates=_check_covariates(covariates))
        given = {} if hyperpriors is None else hyperpriors
        given = checks.by_name("hyperpriors", given, self.parameters)
        for name, law in given.items():
            proper = not isinstance(law, stats.rv_continuous) and hasattr(law, "rvs")
            if not (proper and hasattr(law, "logpdf") and hasattr(law, "support")):
                raise TypeError(
                    f"hyperpriors[{name!r}]: expected a frozen continuous distribution "
                    f"such as scipy.stats.halfnorm(scale=1.0), got {law!r}"
                )
            low, high = law.support()
            if name in self._block("sd") and low < 0:
                raise ValueError(
                    f"hyperpriors[{name!r}]: a spread is not negative, but this law "
                    f"begins at {low:g}; take halfnorm or lognorm"
                )
            if name in self.pairs.values() and not -1 <= low < high <= 1:
                raise ValueError(
                    f"hyperpriors[{name!r}]: a correlation lies between -1 and 1, but "
                    f"this law between {low:g} and {high:g}"
                )
        checks.set_fields(self, hyperpriors=given)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the population's own parameters."""
        slopes = [name for cov in self.covariates for name in self._block("per", cov)]
        blocks = (*self._block("mean"), *self._block("sd"), *slopes)
        return (*blocks, *self.pairs.values())

    @property
    def pairs(self) -> dict[tuple[int, int], str]:
        """The names of the partial correlations, by the numbers of the parameters."""
        d = len(self.names) if self.correlated else 0
        found = {}
        for i in range(d):
            given = f" | {', '.join(self.names[:i])}" if i else ""
            for j in range(i + 1, d):
                found[i, j] = f"correlation {self.names[i]}, {self.names[j]}{given}"
        return found

    def _block(self, what: str, covariate: str = "") -> list[str]:
        if covariate:
            return [f"{name} per {covariate}" for name in self.names]
        return [f"{what} {name}" for name in self.names]

    def complete(self, mean: Floats, sd: Floats) -> Self:
        """Return the population with all its hyperpriors.

        Args:
            mean: Of the priors under which the tests were sampled, ``(d,)``.
            sd: Their standard deviations, ``(d,)``.
        """
        laws = dict(zip(self._block("mean"), map(stats.norm, mean, sd), strict=True))
        for name, scale in zip(self._block("sd"), sd, strict=True):
            laws[name] = stats.halfnorm(scale=scale)
        for covariate, values in self.covariates.items():
            unit = float(np.std([*values.values()]))
            for name, scale in zip(self._block("per", covariate), sd, strict=True):
                laws[name] = stats.norm(0.0, scale / unit)
        for (i, _), name in self.pairs.items():
            shape = 1 + (len(self.names) - 2 - i) / 2
            laws[name] = stats.beta(shape, shape, loc=-1, scale=2)
        laws = {name: self.hyperpriors.get(name, laws[name]) for name in laws}
        return type(self)(
            self.names,
            correlated=self.correlated,
            covariates=self.covariates,
            hyperpriors=laws,
        )

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

    def centre(self, values: Mapping[str, Any]) -> Floats:
        """Return covariates less their averages, ``(m, q)``, of ``{name: (m,)}``."""
        average = [np.mean([*own.values()]) for own in self.covariates.values()]
        columns = [np.atleast_1d(values[name]) for name in self.covariates]
        if not columns:
            return np.zeros((1, 0))
        centred: Floats = np.column_stack(columns) - average
        return centred

    def locate(self, parameters: Parameters, centred: Floats) -> Floats:
        """Return the means ``(n, m, d)`` at covariates ``(m, q)``; m is 1 for none."""
        mean = np.stack([parameters[name] for name in self._block("mean")], axis=-1)
        location = mean[:, None]
        for column, covariate in zip(centred.T, self.covariates, strict=True):
            block = self._block("per", covariate)
            slope = np.stack([parameters[name] for name in block], axis=-1)
            location = location + column[:, None] * slope[:, None]
        return location

    def spread(self, parameters: Parameters) -> Floats:
        """Return the standard deviations, ``(n, d)``."""
        sd = np.stack([parameters[name] for name in self._block("sd")], axis=-1)
        result: Floats = np.maximum(sd, TINY)
        return result

    def factor(self, parameters: Parameters) -> Floats:
        """Return the Cholesky factors of the covariance, ``(n, d, d)``."""
        return self.spread(parameters)[:, :, None] * self.correlation_factor(parameters)

    def correlation_factor(self, parameters: Parameters) -> Floats:
        """Return the Cholesky factors of the correlations, ``(n, d, d)``."""
        n, d = len(parameters[self._block("sd")[0]]), len(self.names)
        factor = np.tile(np.eye(d), (n, 1, 1))
        if not self.correlated:
            return factor
        left = np.ones((n, d))  # of each row's squared length
        for (i, j), name in self.pairs.items():
            factor[:, j, i] = parameters[name] * np.sqrt(left[:, j])
            left[:, j] -= factor[:, j, i] ** 2
            left[:, j] = np.maximum(left[:, j], FLOOR**2)
        diagonal = np.arange(d)
        factor[:, diagonal, diagonal] = np.sqrt(left)
        return factor

    def _parts(self) -> Parts:
        return (self.table,)

    @property
    def table(self) -> Table:
        """The hyperpriors, with the 95 % intervals that they state."""
        rows = []
        for name in self.parameters:
            law = self.hyperpriors.get(name)
            ends = (np.nan, np.nan) if law is None else _interval(law)
            rows.append((name, "by the tests" if law is None else say(law), *ends))
        title = f"Population of {', '.join(self.names)}: hyperpriors"
        columns = ("parameter", "law", "2.5 %", "97.5 %")
        return Table(title, columns, ("", "", ".4g", ".4g"), tuple(rows))


def _check_covariates(covariates: Any) -> dict[str, dict[str, float]]:
    """Return ``{covariate: {test: number}}``; the tests are compared by pool_tests."""
    if covariates is None:
        return {}
    if not isinstance(covariates, Mapping):
        raise TypeError(
            f"covariates: expected {{name: {{test: number}}}}, got {covariates!r}"
        )
    found = {}
    for name, values in covariates.items():
        if not isinstance(name, str) or not name:
            raise TypeError(f"covariates: expected names, got {name!r}")
        if not isinstance(values, Mapping):
            raise TypeError(
                f"covariates[{name!r}]: expected {{test: number}}, got {values!r}; "
                "write dict(zip(tests, values))"
            )
        for test in values:
            if not isinstance(test, str):
                raise TypeError(
                    f"covariates[{name!r}]: expected names of tests, got {test!r}"
                )
        own = {
            test: checks.real_number(f"covariates[{name!r}][{test!r}]", value)
            for test, value in values.items()
        }
        if len({*own.values()}) < 2:
            raise ValueError(
                f"covariates: {name!r} must differ between the tests, got {own}"
            )
        found[name] = own
    return found


def _interval(law: Any) -> tuple[float, float]:
    low, high = law.ppf([0.025, 0.975])
    return float(low), float(high)
