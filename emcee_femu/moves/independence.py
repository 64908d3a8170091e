"""Metropolized independence: proposals from a frozen fit to earlier draws."""

from collections.abc import Iterator

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike
from scipy.special import gammaln

from .. import checks
from ..interfaces import Floats
from .acceptance import Batch, ProposingMove
from .metropolis import factorize
from .mixture_em import invert_factors
from .mixture_fit import fit_mixture


class IndependenceMove(ProposingMove):
    r"""Propose from a mixture of multivariate Student-t laws, wherever the walker is.

    .. math:: \theta^* \sim q = \sum_k w_k\, t_\nu(\mu_k, S_k), \qquad
        r = \min\left\{1, \frac{p(\theta^*)\, q(\theta_i)}
        {p(\theta_i)\, q(\theta^*)}\right\}

    Where q is close to the posterior most proposals are accepted, and each of them is
    independent of the walker's past: no random walk can be as efficient. Where q lacks
    a region that the posterior has, walkers there stay long: mix the move with
    :class:`DEMCMove`. The settings are frozen, so the chain is an exact Markov chain.

    Args:
        weights: Mixture weights, ``(k,)``, above zero; they are normalised.
        means: Centres, ``(k, ndim)``.
        scale_matrices: Scale matrices S, ``(k, ndim, ndim)``; the covariance of a
            component is ``S df / (df - 2)``.
        df: Degrees of freedom; small ones give heavy tails.

    Raises:
        TypeError: If an argument does not hold real numbers.
        ValueError: If shapes disagree, a weight or df is not above zero, or a scale
            matrix is not positive definite. When it proposes: if ndim does not fit.

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
    ) -> None:
        self.weights = checks.positive_array("weights", weights, 1)
        self.means = checks.real_array("means", means, 2)
        self.scale_matrices = checks.real_array("scale_matrices", scale_matrices, 3)
        self.df = checks.positive_array("df", df, 0).item()
        k, ndim = self.means.shape
        if self.weights.shape != (k,) or self.scale_matrices.shape != (k, ndim, ndim):
            raise ValueError(
                f"weights, scale_matrices: expected shapes ({k},) and "
                f"({k}, {ndim}, {ndim}) for means of shape {self.means.shape}, got "
                f"{self.weights.shape} and {self.scale_matrices.shape}"
            )
        total = self.weights.sum()
        if abs(total - 1) > 1e-12:  # repr and pickle give these weights again
            self.weights /= total
        self.factors = np.array(
            [factorize("scale_matrices", S) for S in self.scale_matrices]
        )
        self.inverses = invert_factors(self.factors)
        diagonals = np.diagonal(self.factors, axis1=1, axis2=2)
        self._log_constants = (
            np.log(self.weights)
            - np.log(diagonals).sum(axis=1)
            + gammaln((self.df + ndim) / 2)
            - gammaln(self.df / 2)
            - 0.5 * ndim * np.log(self.df * np.pi)
        )
        self._edges = np.cumsum(self.weights)[:-1]

    @classmethod
    def fit(
        cls, samples: ArrayLike, components: int | str = 1, df: float = 8.0
    ) -> "IndependenceMove":
        """Return the move fitted to draws by expectation-maximisation, then frozen.

        With several components a tenth of the weight goes to one that is fitted to all
        draws: it covers gaps between the others, in which walkers would stay long.

        Args:
            samples: Draws of the target ``(n, ndim)``, such as a burn-in, at least
                ``10 * ndim`` per component.
            components: Number of mixture components, or "auto" for the number from 1
                to 6 that the Bayesian information criterion prefers.
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
        if not (isinstance(components, str) and components == "auto"):
            components = checks.whole_number("components", components, 1)
        weights, means, scale_matrices = fit_mixture(draws, components, df)
        return cls(weights, means, scale_matrices, df)

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse a dimension that the mixture does not have."""
        if self.means.shape[1] != ndim:
            raise ValueError(
                f"means: expected {ndim} columns for {ndim} parameters, got "
                f"{self.means.shape[1]}"
            )

    def log_density(self, theta: Floats) -> Floats:
        """Return the log density ``(n,)`` of q at ``theta (n, ndim)``."""
        # A hundred times as fast for few walkers as logsumexp of SciPy.
        total: Floats = np.logaddexp.reduce(self.log_parts(theta), axis=0)
        return total

    def log_parts(self, theta: Floats) -> Floats:
        """Return the log of each component's share of q at ``theta``, ``(k, n)``."""
        ndim = theta.shape[1]
        standard = (theta - self.means[:, None]) @ self.inverses.transpose(0, 2, 1)
        distance = np.einsum("knd,knd->kn", standard, standard)
        tails = np.log1p(distance / self.df)
        log_parts: Floats = (
            self._log_constants[:, None] - 0.5 * (self.df + ndim) * tails
        )
        return log_parts

    def batches(self, coords: Floats, random: RandomState) -> Iterator[Batch]:
        """Yield one draw of q for every walker."""
        n = len(coords)
        normal = random.standard_normal(coords.shape)
        normal *= np.sqrt(self.df / random.chisquare(self.df, n))[:, None]
        if len(self.weights) == 1:
            proposed = normal @ self.factors[0].T + self.means[0]
        else:
            component = np.searchsorted(self._edges, random.random_sample(n))
            proposed = np.einsum("nij,nj->ni", self.factors[component], normal)
            proposed += self.means[component]
        densities = self.log_density(np.concatenate([coords, proposed]))
        yield np.arange(n), proposed, densities[:n] - densities[n:]
