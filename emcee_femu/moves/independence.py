"""Proposals from a mixture fitted to earlier draws, and walks by its components."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats
from .mixture import Mixture
from .proposing import Proposal, ProposingMove


class IndependenceMove(ProposingMove):
    r"""Propose from a mixture of Student-t distributions, independent of the walker.

    .. math:: \theta^* \sim q = \sum_k w_k\, t_\nu(\mu_k, S_k), \qquad
        r = \min\left\{1, \frac{p(\theta^*)\, q(\theta_i)}
        {p(\theta_i)\, q(\theta^*)}\right\}

    Use it if you have draws of the posterior, or of a similar one, to fit it to
    (:meth:`fit`). Where q is close to the posterior, most proposals are accepted, and
    each is independent of the walker's past; no random walk is as efficient. Where q is
    too small, walkers stay for a long time, so mix the move with :class:`DEMCMove`. The
    mixture is fixed, so the chain is an exact Markov chain. A proposal costs one solve.

    Attributes:
        mixture: The proposal q, with ``log_density``, ``draw`` and more.

    Args:
        weights: Mixture weights, ``(k,)``, positive; they are normalised.
        means: Centres, ``(k, ndim)``.
        scale_matrices: Scale matrices S, ``(k, ndim, ndim)``; the covariance of a
            component is ``S df / (df - 2)``.
        df: Degrees of freedom; small values give heavy tails.
        logs: Which parameters ``(ndim,)`` the mixture sees by their logarithms, such as
            positive ones of which data know a product; None for none. Means and scale
            matrices are those of the logarithms then.

    Raises:
        TypeError: If an argument does not hold real numbers.
        ValueError: If shapes do not match, a weight or df is not positive, or a scale
            matrix is not positive definite. When it proposes: if ndim does not match.

    Source: Tierney (1994), doi:10.1214/aos/1176325750.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import IndependenceMove
        >>> move = IndependenceMove([1.0], [[0.0, 0.0]], [np.eye(2)])
        >>> move.log_density(np.zeros((1, 2))).round(4).tolist()  # -ln(2 pi)
        [-1.8379]
    """

    def __init__(
        self,
        weights: ArrayLike,
        means: ArrayLike,
        scale_matrices: ArrayLike,
        df: float = 8.0,
        logs: ArrayLike | None = None,
    ) -> None:
        self.weights = checks.positive_array("weights", weights, 1)
        self.means = checks.real_array("means", means, 2)
        self.df = checks.positive_array("df", df, 0).item()
        k, ndim = len(self.weights), self.means.shape[1]
        remedy = "a row for each of weights"
        checks.shaped("means", self.means.shape, (k, ndim), remedy=remedy)
        matrices = checks.shaped_array(
            "scale_matrices", scale_matrices, (k, ndim, ndim)
        )
        self.scale_matrices = matrices
        for matrix in self.scale_matrices:
            checks.covariance_factor("scale_matrices", matrix)
        total = self.weights.sum()
        if abs(total - 1) > 1e-12:  # repr and pickle give these weights again
            self.weights /= total
        self.logs = None if logs is None else np.array(logs, dtype=bool)
        if self.logs is not None:
            checks.shaped("logs", self.logs.shape, (ndim,), remedy="one by parameter")
        self.mixture = Mixture(
            self.weights, self.means, self.scale_matrices, self.df, self.logs
        )

    @classmethod
    def fit(
        cls, samples: ArrayLike, components: int | Literal["auto"] = 1, df: float = 8.0
    ) -> IndependenceMove:
        """Return a move fitted to draws by expectation-maximisation.

        If there are several components, one more, with a tenth of the weight, is fitted
        to all draws. It covers gaps between the others, where walkers would otherwise
        stay for a long time.

        Args:
            samples: Draws of the target ``(n, ndim)``, such as a burn-in, at least
                ``10 * ndim`` per component.
            components: Number of mixture components, or "auto" for the number from 1 to
                6 with the best Bayesian information criterion.
            df: Degrees of freedom of every component.

        Returns:
            The move with the fitted mixture.

        Raises:
            TypeError: If components is neither a whole number nor "auto".
            ValueError: If there are too few samples, or their covariance is singular.

        Source: Peel and McLachlan (2000), doi:10.1023/A:1008981510081.

        Examples:
            >>> import numpy as np
            >>> from emcee_femu import IndependenceMove
            >>> rng = np.random.default_rng(1)
            >>> burn_in = rng.normal([4e3, 2e3], [80, 40], (2000, 2))
            >>> move = IndependenceMove.fit(burn_in)
            >>> bool(np.allclose(move.means, [[4e3, 2e3]], rtol=0.01))
            True
        """
        draws = checks.real_array("samples", samples, 2)
        df = checks.positive_array("df", df, 0).item()
        if components != "auto":
            components = checks.whole_number("components", components, 1)
        fitted = Mixture.fit(draws, components, df)
        return cls(fitted.weights, fitted.means, fitted.matrices, df)

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse a dimension that differs from the mixture's."""
        checks.shaped("means", self.means.shape, (len(self.means), ndim))

    def log_density(self, theta: Floats) -> Floats:
        """Return the log density ``(n,)`` of q at ``theta (n, ndim)``."""
        return self.mixture.log_density(theta)

    def get_proposal(self, s: Floats, c: list[Floats], random: RandomState) -> Proposal:
        """Propose a draw of q for each walker ``s (k, ndim)`` (emcee's interface)."""
        n = len(s)
        proposed = self.mixture.draw(random, n)
        densities = self.log_density(np.concatenate([s, proposed]))
        return proposed, densities[:n] - densities[n:]


class ComponentWalk(ProposingMove):
    r"""Random walk by the covariance of the mixture component a walker belongs to.

    .. math:: \theta^* = \theta_i + s\, L_k z, \quad z \sim N(0, I), \quad
        P(k) = r_k(\theta_i), \qquad
        F = \ln \frac{\sum_k r_k(\theta^*) N(\theta^* - \theta_i; 0, s^2 S_k)}
        {\sum_k r_k(\theta_i) N(\theta^* - \theta_i; 0, s^2 S_k)}

    r are the responsibilities of the components, S = L L^T their scale matrices and F
    the log-factor of the step. Narrow maxima get narrow steps, wide ones wide steps.

    Args:
        mixture: The components.
        scale: The factor s, times :math:`2.38 / \sqrt{ndim}`.
    """

    def __init__(self, mixture: Mixture, scale: float = 1.0) -> None:
        self.mixture, self.scale = mixture, scale
        self._steps = replace(mixture, means=np.zeros_like(mixture.means))
        diagonals = np.diagonal(mixture.factors, axis1=1, axis2=2)
        self._log_dets = np.log(diagonals).sum(axis=1)

    def get_proposal(self, s: Floats, c: list[Floats], random: RandomState) -> Proposal:
        """Propose a step of each walker ``s (k, ndim)`` (emcee's contract)."""
        n, ndim = s.shape
        size = 2.38 / np.sqrt(ndim) * self.scale
        here = self._log_responsibilities(s)
        edges = np.cumsum(np.exp(here), axis=1)[:, :-1]
        component = (edges < random.random_sample((n, 1))).sum(axis=1)
        normal = size * random.standard_normal((n, ndim))
        jumps = np.einsum("nij,nj->ni", self.mixture.factors[component], normal)
        proposed = s + jumps
        there = self._log_responsibilities(proposed)
        log_steps = -0.5 * self._steps.squared_distances(jumps) / size**2
        log_steps -= self._log_dets
        factors = np.logaddexp.reduce(there + log_steps, axis=1)
        factors -= np.logaddexp.reduce(here + log_steps, axis=1)
        return proposed, factors

    def _log_responsibilities(self, theta: Floats) -> Floats:
        """Return the log of the responsibilities ``(n, k)``."""
        log_parts = self.mixture.log_parts(theta)
        log_parts -= np.logaddexp.reduce(log_parts, axis=1)[:, None]
        return log_parts
