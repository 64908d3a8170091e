"""The hyperprior: independent laws, where the population is not out of bounds."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from ..posterior.priors import IndependentPrior
from .box import log_between
from .normal import NormalPopulation

LEAST_INSIDE = 0.1  # of each parameter's population, at every test
TRIES = 10_000


@dataclass(frozen=True, eq=False)
class PopulationPrior:
    """The prior of a population's own parameters.

    A law of which less than a tenth lies inside the bounds, at the covariates of any
    test, is impossible: what is left of it would hang on the bound.

    Args:
        population: With all hyperpriors.
        bounds_of: Of the pooled parameters, ``(d, 2)``.
        centred: Covariates of the tests, ``(T, q)``.
    """

    population: NormalPopulation
    bounds_of: Floats
    centred: Floats

    @property
    def laws(self) -> IndependentPrior:
        """The independent laws."""
        return self.population.prior

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the population's parameters."""
        return self.population.parameters

    @property
    def bounds(self) -> Floats:
        """Their own bounds, ``(k, 2)``."""
        return self.laws.bounds

    def logpdf(self, theta: Floats) -> Floats:
        """Return the log density ``(n,)``, but for a constant; -inf out of bounds."""
        log_density = self.laws.logpdf(theta)
        log_density[self._outside(theta).any(axis=1)] = -np.inf
        return log_density

    def gradient(self, theta: Floats) -> Floats:
        """Return the gradient ``(n, k)`` of the log density."""
        return self.laws.gradient(theta)

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, k)``; parameter by parameter, for each is cut by itself.

        Raises:
            ValueError: If the hyperpriors leave hardly anything inside the bounds.
        """
        theta = self.laws.sample(rng, n)
        d = len(self.population.names)
        first = len(theta[0]) - len(self.population.pairs)  # of the correlations
        for _ in range(TRIES):
            outside = self._outside(theta)
            rows = np.flatnonzero(outside.any(axis=1))
            if not len(rows):
                return theta
            fresh = self.laws.sample(rng, len(rows))
            for column in range(first):
                again = outside[rows, column % d]
                theta[rows[again], column] = fresh[again, column]
        raise ValueError(
            "hyperpriors: they leave hardly any population inside the bounds "
            f"{self.bounds_of.tolist()} of {list(self.population.names)}"
        )

    def _outside(self, theta: Floats) -> NDArray[np.bool_]:
        """Return which parameters' populations are out of bounds, ``(n, d)``."""
        if np.isinf(self.bounds_of).all():
            return np.zeros((len(theta), len(self.bounds_of)), dtype=bool)
        parameters = dict(zip(self.names, theta.T, strict=True))
        location = self.population.locate(parameters, self.centred)
        sd = self.population.spread(parameters)[:, None]
        low, high = (self.bounds_of.T[:, None, None] - location) / sd
        result: NDArray[np.bool_] = (log_between(low, high) < np.log(LEAST_INSIDE)).any(
            axis=1
        )
        return result
