"""The maxima that a search has found, and who found them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..contracts import Floats
from ..moves.mixture import GAUSSIAN, Mixture
from .climbing import Maximum, distinct

# A maximum gets no component if its log evidence is below the largest by this.
NEGLIGIBLE = 12.0
# If 3 hits are expected, there is none with probability e^-3 = 0.05.
HITS = 3
# A part that holds at least this share of the evidence is worth solves of its own.
WORTH_SOLVES = 0.03


class Gaussian(Protocol):
    """A Gaussian with its evidence, which stands for a maximum or a shoulder."""

    @property
    def theta(self) -> Floats:
        """Its centre, ``(d,)``."""

    @property
    def covariance(self) -> Floats:
        """``(d, d)``."""

    @property
    def log_evidence(self) -> float:
        """The log evidence inside the bounds."""


class Maxima:
    """The distinct maxima of a posterior.

    Args:
        ensembles: How many ensembles search.
        coordinates: The coordinates in which the Gaussians may be: for each of them,
            which parameters are replaced by their logarithms, ``(d,)``, or None.

    Attributes:
        found: The maxima, in the order in which they were found.
        shoulders: Mass beside them that their Gaussians do not hold.
        found_by: Climbs of each ensemble that ended at each maximum.
        climbs: How many climbs there were.
        from_prior: How many of them began at a draw of the prior, whatever its height.
    """

    def __init__(
        self,
        ensembles: int,
        coordinates: Sequence[NDArray[np.bool_] | None] = (None,),
    ) -> None:
        self.found: list[Maximum] = []
        self.found_by: list[list[int]] = []
        self.shoulders: list[Gaussian] = []
        self.climbs = self.from_prior = 0
        self._ensembles, self._coordinates = ensembles, coordinates

    @property
    def log_evidence(self) -> float:
        """The logarithm of the sum of Laplace's evidences of all parts."""
        return float(logsumexp([part.log_evidence for part in self.parts]))

    @property
    def parts(self) -> list[Gaussian]:
        """The Gaussians at the maxima and their shoulders."""
        return [*self.found, *self.shoulders]

    def mixture(self) -> Mixture:
        """Return a Student-t component for each part, weighted by its evidence."""
        parts = self.parts
        evidences = np.array([part.log_evidence for part in parts])
        kept = np.flatnonzero(evidences > evidences.max() - NEGLIGIBLE)
        return Mixture(
            np.exp(evidences[kept] - logsumexp(evidences[kept])),
            np.array([parts[i].theta for i in kept]),
            np.array([parts[i].covariance for i in kept]),
        )

    def excess(self, theta: Floats, heights: Floats) -> Floats:
        """Return the log-posteriors ``(n,)`` beyond those of Gaussians at the parts.

        The Gaussians are taken in whichever coordinates explain more.
        """
        gaussians = replace(self.mixture(), df=GAUSSIAN)
        explained = [
            gaussians.seen_in(logs).log_density(theta) for logs in self._coordinates
        ]
        return np.asarray(heights - self.log_evidence - np.max(explained, axis=0))

    def nearest(self, theta: Floats) -> Floats:
        """Return the scale matrix of the component that a point is nearest to."""
        mixture = self.mixture()
        nearest = mixture.squared_distances(theta[None])[0].argmin()
        return np.asarray(mixture.matrices[nearest])

    def add(self, maximum: Maximum, ensemble: int) -> bool:
        """Add the maximum where a climb ended; return whether it is new."""
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
