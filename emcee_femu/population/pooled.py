"""What pooling many tests has found."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np

from .. import checks
from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import inside
from ..results.tables import INTERVAL
from ..sampling.importance import GOOD_K
from ..table import Parts, Report, Table
from .marginal import PopulationModel
from .normal import NormalPopulation
from .restate import restate

TRIES = 1_000  # draws of a population whose bounds cut nearly all of it


@dataclass(frozen=True, eq=False)
class PooledTests(Report):
    """What :func:`.pool_tests` found; ``print`` it for tables and what to do.

    Attributes:
        population: The population with all its hyperpriors.
        posterior: The posterior of its parameters, which was sampled.
        samplers: emcee's own, for :func:`.diagnose`.
        idata: The ArviZ object of the run, for :func:`.parameter_table` and others; its
            ``log_likelihood`` holds that of each test (``arviz.loo`` leaves one out).
        model: The likelihood of each test given the population.
        hyperdraws: 1,000 draws of the population's parameters, ``{name: (1000,)}``.
        theta: With each of them a draw of every test's parameters, ``(1000, T, d)``.
        pareto_k: Of each test's weights under the population, ``(T,)``.
        effective: Its effective draws, ``(T,)``.
        verdict: Of :func:`.diagnose`, on the chains.
    """

    population: NormalPopulation
    posterior: LogPosterior
    samplers: list[emcee.EnsembleSampler]
    idata: Any
    model: PopulationModel
    hyperdraws: Mapping[str, Floats]
    theta: Floats
    pareto_k: Floats
    effective: Floats
    verdict: str

    @property
    def tests(self) -> tuple[str, ...]:
        """The names of the tests."""
        return self.model.tests

    @property
    def by_law(self) -> tuple[str, ...]:
        """Tests whose draws do not reach, but for which a normal law stands in."""
        return self._out_of_reach(good=True)

    @property
    def unreached(self) -> tuple[str, ...]:
        """Tests that have to be sampled again under the population."""
        return self._out_of_reach(good=False)

    def _out_of_reach(self, good: bool) -> tuple[str, ...]:
        judged = zip(self.tests, self.pareto_k, self.model.laws, strict=True)
        return tuple(t for t, k, law in judged if k > GOOD_K and law.good == good)

    def draws(self, test: str) -> dict[str, Floats]:
        """Return the parameters of a test in the light of all, ``{name: (1000,)}``.

        Args:
            test: Its name.

        Raises:
            ValueError: If there is no such test.
        """
        return dict(zip(self.population.names, self._of(test).T, strict=True))

    def _of(self, test: Any) -> Floats:
        if test not in self.tests:
            raise ValueError(f"test: expected one of {list(self.tests)}, got {test!r}")
        own: Floats = self.theta[:, self.tests.index(test)]
        return own

    def next_test(self, **covariates: float) -> dict[str, Floats]:
        """Return the parameters of a test not yet made, ``{name: (1000,)}``.

        Args:
            covariates: Their values there, ``T=25.0``; the average where one is left
                out.

        Returns:
            Draws of the parameters of that test.

        Raises:
            ValueError: If there is no such covariate, or hardly anything of the
                population lies inside the bounds.
        """
        known = self.population.covariates
        given = checks.by_name("covariates", covariates, [*known])
        at = {
            name: float(np.mean([*values.values()])) for name, values in known.items()
        }
        for name, value in given.items():
            at[name] = checks.real_number(name, value)
        return dict(zip(self.population.names, self._predict(at).T, strict=True))

    def _predict(self, at: Mapping[str, float]) -> Floats:
        rng = np.random.default_rng(0)
        location = self.population.locate(self.hyperdraws, self.population.centre(at))
        factor = self.population.factor(self.hyperdraws)
        theta = np.full((len(factor), factor.shape[1]), np.nan)
        left = np.arange(len(theta))
        for _ in range(TRIES):
            normal = rng.standard_normal((len(left), theta.shape[1], 1))
            drawn = location[left, 0] + (factor[left] @ normal)[..., 0]
            within = inside(drawn, self.model.bounds_of)
            theta[left[within]] = drawn[within]
            left = left[~within]
            if not len(left):
                return theta
        raise ValueError(
            f"covariates: at {dict(at)} hardly any of the population lies inside the "
            f"bounds {self.model.bounds_of.tolist()}"
        )

    def under_population(self, test: str, posterior: LogPosterior) -> LogPosterior:
        """Return a test's posterior with the population as it is known for its prior.

        A normal law with the mean and 1.2 times the standard deviation of the
        prediction there, cut at the same bounds; parameters that are not pooled keep
        their priors. ``run`` it, and pool again, with this result's ``population``:
        :func:`.pool_tests` divides out whatever prior a test was sampled under.

        Args:
            test: Its name.
            posterior: Under which it was sampled.

        Raises:
            TypeError: If posterior is no LogPosterior, or its prior neither a
                GaussianPrior nor an IndependentPrior.
            ValueError: If there is no such test, or the posterior has other parameters.
        """
        self._of(test)
        known = self.population.covariates
        drawn = self._predict({name: values[test] for name, values in known.items()})
        return restate(posterior, self.population.names, drawn)

    @property
    def table(self) -> Table:
        """Means, spreads, slopes, correlations of the population, and a next test."""
        rows = [
            (name, *_describe(self.idata.posterior[name].values.reshape(-1)))
            for name in self.posterior.names
        ]
        if self.population.correlated and len(self.population.names) > 2:
            found = self.idata.response["correlation"].values
            pairs = self.posterior.variables["correlation"].coords["pair"]
            rows += [
                (f"correlation of {pair}", *_describe(found[..., i].reshape(-1)))
                for i, pair in enumerate(pairs)
            ]
        rows += [
            (f"next test's {name}", *_describe(values))
            for name, values in self.next_test().items()
        ]
        title = f"Population of {len(self.tests)} tests"
        if self.population.covariates:
            averages = [
                f"{name} = {np.mean([*values.values()]):.4g}"
                for name, values in self.population.covariates.items()
            ]
            title += f"; means and the next test at {', '.join(averages)}"
        columns = ("parameter", "mean", "sd", "2.5 %", "97.5 %")
        return Table(title, columns, ("", ".5g", ".3g", ".5g", ".5g"), tuple(rows))

    @property
    def test_table(self) -> Table:
        """Each test's parameters, alone and in the light of all, and its weights."""
        names, model = self.population.names, self.model
        columns: list[tuple[str, str, Any]] = [("test", "", list(self.tests))]
        for i, name in enumerate(names):
            alone = [own.theta[:, i] for own in model.draws]
            columns += [
                (f"{name} alone", ".5g", [float(x.mean()) for x in alone]),
                ("sd", ".3g", [float(x.std()) for x in alone]),
                (f"{name} pooled", ".5g", self.theta[:, :, i].mean(axis=0)),
                ("sd ", ".3g", self.theta[:, :, i].std(axis=0)),
            ]
        columns += [
            ("Pareto k", ".2f", self.pareto_k),
            ("effective draws", ".0f", self.effective),
        ]
        return Table.from_columns("Tests, each alone and in the light of all", columns)

    @property
    def conclusion(self) -> str:
        """What to do about tests out of reach, and about the chains."""
        lines = []
        if self.by_law:
            misfit = max(
                float(law.log_ratio.std())
                for test, law in zip(self.tests, self.model.laws, strict=True)
                if test in self.by_law
            )
            lines.append(
                f"{_list(self.by_law)}: too few of the draws lie where the population "
                f"puts them (Pareto k above {GOOD_K}); normal laws fitted to them "
                f"stand in, whose logarithms are within {misfit:.2g} (one sd) of the "
                "draws' own. To be sure sample these tests again under the population: "
                f"posteriors={{{self.by_law[0]!r}: posterior}}, or under_population."
            )
        if self.unreached:
            worst = self.pareto_k[np.isin(self.tests, self.unreached)].max()
            first = self.unreached[0]
            lines.append(
                f"{_list(self.unreached)}: do not trust this result. The draws do not "
                f"reach where the population puts them (Pareto k up to {worst:.2f}), "
                "and no normal law resembles them. Sample these tests again under the "
                f"current population: posteriors={{{first!r}: posterior}}, or run "
                f"under_population({first!r}, posterior), and pool again."
            )
        if not lines:
            lines.append(
                "The draws of every test reach where the population puts it (Pareto k "
                f"at most {self.pareto_k.max():.2f})."
            )
        return "\n".join([*lines, self.verdict])

    def _parts(self) -> Parts:
        return self.table, self.test_table, self.conclusion


def _describe(values: Floats) -> tuple[float, ...]:
    low, high = np.quantile(values, INTERVAL)
    return float(values.mean()), float(values.std(ddof=1)), float(low), float(high)


def _list(tests: tuple[str, ...]) -> str:
    shown = ", ".join(tests[:5])
    return shown if len(tests) <= 5 else f"{shown} and {len(tests) - 5} more"
