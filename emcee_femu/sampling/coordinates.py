"""One map of coordinates: positive parameters by their logarithms."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Evaluator, Floats, Prior

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

    def rows(self, evaluator: Evaluator, x: Floats) -> Floats:
        """Return rows at coordinates ``(n, d)``, with the densities of these."""
        rows = evaluator.rows(self.parameters(x)).copy()
        rows[:, :2] += self.log_volume(x)[:, None]
        return rows

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` coordinates from the prior."""
        return self.coordinates(self.prior.sample(rng, n))
