"""Steps as wide as the part of the target in which the walker is."""

from collections.abc import Iterator

import numpy as np
from numpy.random import RandomState

from ..interfaces import Floats
from .acceptance import Batch, ProposingMove
from .independence import IndependenceMove


class ComponentWalk(ProposingMove):
    r"""Random walk by the covariance of the mixture component a walker belongs to.

    .. math:: \theta^* = \theta_i + s\, L_k z, \quad z \sim N(0, I), \quad
        P(k) = r_k(\theta_i), \qquad
        F = \ln \frac{\sum_k r_k(\theta^*) N(\theta^* - \theta_i; 0, s^2 S_k)}
        {\sum_k r_k(\theta_i) N(\theta^* - \theta_i; 0, s^2 S_k)}

    r are the responsibilities of the components, S = L L^T their scale matrices and F
    the log-factor of the step. A narrow mode gets narrow steps, a wide one wide ones.

    Args:
        mixture: The components.
        scale: The factor s, times :math:`2.38 / \sqrt{ndim}`.
    """

    def __init__(self, mixture: IndependenceMove, scale: float = 1.0) -> None:
        self.mixture, self.scale = mixture, scale
        self._factors, self._inverses = mixture.factors, mixture.inverses
        diagonals = np.diagonal(self._factors, axis1=1, axis2=2)
        self._log_dets = np.log(diagonals).sum(axis=1)[:, None]

    def batches(self, coords: Floats, random: RandomState) -> Iterator[Batch]:
        """Yield one step of all walkers."""
        n, ndim = coords.shape
        here = self._log_shares(coords)
        below = np.cumsum(np.exp(here), axis=0)[:-1] < random.random_sample(n)
        component = below.sum(axis=0)
        steps = random.standard_normal((n, ndim)) * (2.38 / np.sqrt(ndim) * self.scale)
        jumps = np.einsum("nij,nj->ni", self._factors[component], steps)
        proposed = coords + jumps
        there = self._log_shares(proposed)
        standard = jumps @ self._inverses.transpose(0, 2, 1)  # (k, n, ndim)
        standard /= 2.38 / np.sqrt(ndim) * self.scale
        log_steps = -0.5 * np.einsum("knd,knd->kn", standard, standard) - self._log_dets
        factors = np.logaddexp.reduce(there + log_steps, axis=0)
        factors -= np.logaddexp.reduce(here + log_steps, axis=0)
        yield np.arange(n), proposed, factors

    def _log_shares(self, theta: Floats) -> Floats:
        """Return the log of the responsibilities ``(k, n)``."""
        log_parts = self.mixture.log_parts(theta)
        shares: Floats = log_parts - np.logaddexp.reduce(log_parts, axis=0)
        return shares
