"""The maxima that a search has found, and who found them."""

import numpy as np
from scipy.special import logsumexp

from ..moves.mixture import Mixture
from .climbing import Maximum, distinct

# Log evidence below the largest, from which a maximum gets no component.
NEGLIGIBLE = 12.0
# Degrees of freedom of the components at the maxima.
FIRST_DF = 8.0


class Maxima:
    """The distinct maxima of a posterior.

    Args:
        ensembles: How many ensembles search.

    Attributes:
        found: The maxima, in the order in which they were found.
        found_by: Climbs of each ensemble that ended at each maximum.
        climbs: How many climbs there were.
        from_prior: How many of them began at a draw of the prior, whatever its height.
    """

    def __init__(self, ensembles: int) -> None:
        self.found: list[Maximum] = []
        self.found_by: list[list[int]] = []
        self.climbs = self.from_prior = 0
        self._ensembles = ensembles

    @property
    def log_evidence(self) -> float:
        """What Laplace's approximations at all of them add up to."""
        return float(logsumexp([maximum.log_evidence for maximum in self.found]))

    def mixture(self) -> Mixture:
        """Return a Student-t component for each maximum, weighted by its evidence."""
        evidences = np.array([maximum.log_evidence for maximum in self.found])
        kept = np.flatnonzero(evidences > evidences.max() - NEGLIGIBLE)
        return Mixture(
            np.exp(evidences[kept] - logsumexp(evidences[kept])),
            np.array([self.found[i].theta for i in kept]),
            np.array([self.found[i].covariance for i in kept]),
            FIRST_DF,
        )

    def add(self, maximum: Maximum, ensemble: int) -> bool:
        """Take in where a climb of an ensemble ended; return whether that is new."""
        if not np.isfinite(maximum.log_evidence):
            return False
        last = len(self.found)
        groups = distinct([*self.found, maximum])
        same = next(group for group in groups if last in group)
        if len(same) > 1:
            self.found_by[min(same)][ensemble] += 1
            return False
        self.found.append(maximum)
        self.found_by.append([int(i == ensemble) for i in range(self._ensembles)])
        return True
