"""Parameters over decades, by their logarithms."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats, Prior

DRAWS = 20_000  # of the prior, for its quantiles
DECADES = 30.0  # ratio of the quantiles .95 and .05, from which logarithms are natural
LARGEST = 700.0  # logarithm that is finite


@dataclass(frozen=True, eq=False)
class LogScale:
    """A prior whose coordinates are logarithms of the parameters that span decades.

    The stiffness of a support between 1e3 and 1e9, say: what a model makes of it bends
    within a small part of the range, and no process of one length follows that.

    Attributes:
        prior: The prior.
        logs: Whether a parameter is seen by its logarithm, ``(d,)``.
    """

    prior: Prior
    logs: NDArray[np.bool_]

    @classmethod
    def of(cls, prior: Prior) -> Self:
        """Return the scale on which a prior is nearer to symmetric."""
        theta = prior.sample(np.random.default_rng(0), DRAWS)
        low, middle, high = np.quantile(theta, [0.05, 0.5, 0.95], axis=0)
        logs = (theta.min(axis=0) > 0) & (prior.bounds[:, 0] >= 0)
        logs &= high > DECADES * low
        ends = np.log(np.where(logs, [low, middle, high], 1.0))
        skew = np.abs(low + high - 2 * middle) / (high - low)
        bent = np.abs(ends[0] + ends[2] - 2 * ends[1])
        return cls(prior, logs & (bent < skew * (ends[2] - ends[0])))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters."""
        return self.prior.names

    def coordinates(self, theta: Floats) -> Floats:
        """Return the coordinates ``(n, d)`` of parameters above zero."""
        found = theta.copy()
        found[:, self.logs] = np.log(theta[:, self.logs])
        return found

    def parameters(self, x: Floats) -> Floats:
        """Return the parameters ``(n, d)`` that have these coordinates."""
        theta = x.copy()
        theta[:, self.logs] = np.exp(np.minimum(x[:, self.logs], LARGEST))
        return theta

    def log_volume(self, x: Floats) -> Floats:
        """Return what the density of the coordinates has more, ``(n,)``."""
        volume: Floats = x[:, self.logs].sum(axis=1)
        return volume

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` coordinates from the prior."""
        return self.coordinates(self.prior.sample(rng, n))
