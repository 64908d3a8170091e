"""One map of coordinates: positive parameters by their logarithms."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Evaluator, Floats, Linearization, Prior
from ..posterior.log_posterior import LogPosterior

DRAWS = 20_000  # of the prior, for its quantiles
DECADES = 30.0  # ratio of the quantiles .95 and .05, from which logarithms are natural
LARGEST = 700.0  # logarithm that is finite


@dataclass(frozen=True, eq=False)
class Coordinates:
    """A prior in coordinates that are logarithms of some of the parameters.

    The stiffness of a support between 1e3 and 1e9, say: what a model makes of it bends
    within a small part of the range, and no process of one length follows that.

    Attributes:
        prior: The prior.
        logs: Whether a parameter is seen by its logarithm, ``(d,)``.
    """

    prior: Prior
    logs: NDArray[np.bool_]

    @classmethod
    def plain(cls, prior: Prior) -> Self:
        """Return the parameters themselves as coordinates."""
        return cls(prior, np.zeros(len(prior.names), dtype=bool))

    @classmethod
    def of(cls, prior: Prior) -> Self:
        """Return logarithms of parameters over decades if these are symmetric so."""
        theta = prior.sample(np.random.default_rng(0), DRAWS)
        low, middle, high = np.quantile(theta, [0.05, 0.5, 0.95], axis=0)
        logs = (theta.min(axis=0) > 0) & (prior.bounds[:, 0] >= 0)
        logs &= high > DECADES * low
        ends = np.log(np.where(logs, [low, middle, high], 1.0))
        skew = np.abs(low + high - 2 * middle) / (high - low)
        bend = np.abs(ends[0] + ends[2] - 2 * ends[1])
        return cls(prior, logs & (bend < skew * (ends[2] - ends[0])))

    def coordinates(self, theta: Floats) -> Floats:
        """Return the coordinates ``(n, d)`` of parameters above zero."""
        x = theta.copy()
        x[:, self.logs] = np.log(theta[:, self.logs])
        return x

    def parameters(self, x: Floats) -> Floats:
        """Return the parameters ``(n, d)`` that have these coordinates."""
        theta = x.copy()
        theta[:, self.logs] = np.exp(np.minimum(x[:, self.logs], LARGEST))
        return theta

    def log_volume(self, x: Floats) -> Floats:
        """Return by what the log-density of coordinates exceeds that of parameters."""
        volume: Floats = x[:, self.logs].sum(axis=1)
        return volume

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` coordinates from the prior."""
        return self.coordinates(self.prior.sample(rng, n))


@dataclass(frozen=True, eq=False)
class MappedEvaluation:
    """An evaluator of points in other coordinates: rows have their densities."""

    evaluator: Evaluator
    coordinates: Coordinates

    @property
    def posterior(self) -> LogPosterior:
        """What is evaluated."""
        return self.evaluator.posterior

    @property
    def solves(self) -> int:
        """Solves so far."""
        return self.evaluator.solves

    def rows(self, theta: Floats) -> Floats:
        """Return rows with the densities of coordinates ``(n, d)``."""
        return self._densities(theta, self.evaluator.rows(self._parameters(theta)))

    @property
    def failed(self) -> int:
        """How many of them failed."""
        return self.evaluator.failed

    def gradient(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return rows and gradients by the coordinates ``(n, d)``."""
        rows, gradient, _ = self.linearize(theta)
        return rows, gradient

    def linearize(self, theta: Floats) -> Linearization:
        """Return rows, gradients and information by the coordinates ``(n, d)``."""
        parameters = self._parameters(theta)
        rows, gradient, information = self.evaluator.linearize(parameters)
        slopes = np.where(self.coordinates.logs, parameters, 1.0)
        if information is not None:
            information = information * slopes[:, :, None] * slopes[:, None]
        gradient = gradient * slopes + self.coordinates.logs
        return Linearization(self._densities(theta, rows), gradient, information)

    def each(self, theta: Floats) -> Iterator[tuple[int, Floats]]:
        """Yield number and row of each of the coordinates as it is solved."""
        for number, row in self.evaluator.each(self._parameters(theta)):
            yield number, self._densities(theta[[number]], row[None])[0]

    def _parameters(self, x: Floats) -> Floats:
        return self.coordinates.parameters(x)

    def _densities(self, x: Floats, rows: Floats) -> Floats:
        rows = rows.copy()
        rows[:, :2] += self.coordinates.log_volume(x)[:, None]
        return rows
