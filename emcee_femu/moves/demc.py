"""The paper's two proposals: differential evolution (DE-MC), and its baseline."""

import math
from typing import Self

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats
from .proposing import Indices, Proposal, ProposingMove

DEFAULT_NOISE = 1e-2  # of the standard deviation of the walkers at rest


class DEMCMove(ProposingMove):
    r"""Differential evolution MCMC: step along the difference of two walkers.

    .. math:: \theta^* = \theta_i + \gamma (\theta_a - \theta_b) + \varepsilon,
        \qquad \varepsilon \sim N(0, \mathrm{diag}(\sigma^2)),
        \qquad r = \min\{1, p(\theta^*) / p(\theta_i)\}

    a and b are distinct walkers among those at rest. This is the paper's sampler (Eq.
    3.2). It replaces ``emcee.moves.DEMove``, with the paper's additive noise instead of
    a relative jitter of gamma. A proposal costs one solve.

    Args:
        sigma: Standard deviation of the noise **in parameter units**, one number or
            ``(ndim,)``. By default it is one hundredth of the standard deviation of the
            walkers at rest, which suits stiffnesses of 1e3 as well as areas of 1e-4.
        gamma0: The factor gamma; :math:`2.38 / \sqrt{2\,ndim}` by default.
        nsplits: Number of parts of the ensemble that move in turn. With
            ``nsplits=nwalkers`` the chains are updated one after another, as in the
            paper.
        randomize_split: Whether to assign the walkers to new parts in each step.
        live_dangerously: Whether to allow fewer than ``2 * ndim`` walkers.
        mode_jump: Probability of gamma = 1, with which a walker can jump between modes.
            If you expect several maxima, 0.1 is usual.

    Raises:
        TypeError: If an argument does not hold real numbers, or whole ones.
        ValueError: If sigma or gamma0 is negative or not finite, mode_jump is not in
            [0, 1], or nsplits < 2. When it proposes: if sigma does not match ndim or
            fewer than 2 walkers are at rest.

    Source: Eqs. 3.2 and 3.3 of Sherri, Boulkaibet, Marwala and Friswell; ter Braak
    (2006), doi:10.1007/s11222-006-8769-1.

    Examples:
        >>> import emcee
        >>> import numpy as np
        >>> from emcee_femu import DEMCMove
        >>> move = DEMCMove()
        >>> sampler = emcee.EnsembleSampler(8, 3, lambda x: -0.5 * x @ x, moves=move)
        >>> start = np.random.default_rng(1).normal(size=(8, 3))
        >>> sampler.run_mcmc(start, 10).coords.shape
        (8, 3)
    """

    def __init__(
        self,
        sigma: ArrayLike | None = None,
        gamma0: float | None = None,
        *,
        nsplits: int = 2,
        randomize_split: bool = True,
        live_dangerously: bool = False,
        mode_jump: float = 0.0,
    ) -> None:
        self.nsplits = checks.whole_number("nsplits", nsplits, 2)
        self.randomize_split = checks.flag("randomize_split", randomize_split)
        self.live_dangerously = checks.flag("live_dangerously", live_dangerously)
        self.sigma = None if sigma is None else checks.real_array("sigma", sigma)
        if self.sigma is not None:
            if self.sigma.ndim > 1 or not self.sigma.size or (self.sigma < 0).any():
                raise ValueError(
                    "sigma: expected a number or (ndim,) numbers not below zero, got "
                    f"{sigma!r}"
                )
        self.gamma0 = (
            None if gamma0 is None else checks.real_number("gamma0", gamma0, 0)
        )
        self.mode_jump = checks.real_number("mode_jump", mode_jump, 0.0, 1.0)

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse an ensemble that is too small or does not match sigma.

        Raises:
            ValueError: If there are fewer walkers than splits, fewer than 2 at rest, or
                sigma has another dimension.
            RuntimeError: As in emcee's moves, if there are fewer walkers than twice the
                dimension and live_dangerously is not set.
        """
        if nwalkers < self.nsplits:
            raise ValueError(f"nsplits: expected up to {nwalkers}, got {self.nsplits}")
        at_rest = nwalkers - -(-nwalkers // self.nsplits)
        if at_rest < 2:
            raise ValueError(
                f"nwalkers: a proposal needs 2 walkers at rest, but {nwalkers} in "
                f"{self.nsplits} splits leave {at_rest}; use at least "
                f"{max(2 * ndim, 4)} walkers, better twice as many"
            )
        if nwalkers < 2 * ndim and not self.live_dangerously:
            raise RuntimeError(
                f"nwalkers: expected at least 2 * ndim = {2 * ndim}, got {nwalkers}; "
                "fewer may stay in a subspace (live_dangerously=True of the move "
                "allows it)"
            )
        if self.sigma is not None:
            checks.shaped("sigma", self.sigma.shape, (), (ndim,))

    def get_proposal(self, s: Floats, c: list[Floats], random: RandomState) -> Proposal:
        """Propose for walkers ``s (k, ndim)`` with guides ``c[0]`` (emcee's interface).

        The proposal is symmetric, so there is no Hastings factor.
        """
        (guides,) = c
        moving, ndim = s.shape
        n = len(guides)
        # One of the n (n - 1) ordered pairs: a, and b among the others.
        pair: Indices = (random.random_sample((moving,)) * (n * (n - 1))).astype(int)
        a, b = np.divmod(pair, n - 1)
        b += b >= a
        gamma: float | Floats
        gamma = 2.38 / math.sqrt(2 * ndim) if self.gamma0 is None else self.gamma0
        if self.mode_jump:
            jumps = random.random_sample((moving, 1)) < self.mode_jump
            gamma = np.where(jumps, 1.0, gamma)
        step: Floats = guides.take(a, axis=0)
        step -= guides.take(b, axis=0)
        step *= gamma
        noise = random.standard_normal((moving, ndim))
        noise *= DEFAULT_NOISE * spread(guides) if self.sigma is None else self.sigma
        step += noise
        step += s
        return step, None


def spread(walkers: Floats) -> Floats:
    """Return the standard deviations of ``walkers (n, ndim)``, to 1e-8 of the means.

    The difference of moments takes a third of the time of ``walkers.std``. Its rounding
    only matters for a scale of 1e-8 of the parameter's value.
    """
    weights = np.full(len(walkers), 1 / len(walkers))
    mean = weights.dot(walkers)
    variance = weights.dot(walkers * walkers)
    variance -= mean * mean
    return np.asarray(np.sqrt(np.maximum(variance, 0.0, out=variance), out=variance))


class MetropolisMove(ProposingMove):
    r"""Metropolis-Hastings with a Gaussian random walk, separately for each walker.

    .. math:: \theta^* = \theta_i + L z, \quad z \sim N(0, I), \quad L L^T = C, \qquad
        \alpha = \min\{1, p(\theta^*) / p(\theta_i)\}

    This is Eq. 3.1 with a symmetric proposal, the paper's baseline. Walkers do not
    interact, so one walker is enough. A proposal costs one solve. Give the size of the
    steps as either sd or cov.

    Args:
        sd: Standard deviations of the steps in parameter units, one number or
            ``(ndim,)``.
        cov: Variances, one number or ``(ndim,)``, or the covariance matrix C,
            ``(ndim, ndim)``, as in ``emcee.moves.GaussianMove``.

    Raises:
        TypeError: If both or neither are given, or they do not hold real numbers.
        ValueError: If a standard deviation or variance is not positive, a covariance is
            not symmetric and positive definite, or (when it proposes) the shape does
            not match ndim.

    Source: Eq. 3.1 of Sherri, Boulkaibet, Marwala and Friswell.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> move = ef.MetropolisMove(sd=[20.0, 20.0, 20.0, 30.0, 20.0])  # N/m
        >>> (run,) = ef.run(posterior, move, nwalkers=4, steps=50, seed=1, ensembles=1)
        >>> run.get_chain().shape
        (50, 4, 5)
    """

    def __init__(
        self, sd: ArrayLike | None = None, *, cov: ArrayLike | None = None
    ) -> None:
        if (sd is None) == (cov is None):
            raise TypeError(
                "sd, cov: expected one of the two, standard deviations or covariance "
                f"of the steps, got {'neither' if sd is None else 'both'}"
            )
        self.sd = None if sd is None else checks.numeric_array("sd", sd)
        self.cov = None if cov is None else checks.real_array("cov", cov)
        if self.sd is not None and self.sd.ndim > 1:
            raise ValueError(
                "sd: expected a number or (ndim,) standard deviations, got shape "
                f"{self.sd.shape}; a covariance is given as cov="
            )
        if self.sd is not None:
            self._factor = checks.positive_array("sd", self.sd)
        elif self.cov is not None and self.cov.ndim < 2:
            self._factor = np.sqrt(checks.positive_array("cov", self.cov))
        elif self.cov is not None:
            self._factor = checks.covariance_factor("cov", self.cov)

    @classmethod
    def tuned(cls, samples: ArrayLike) -> Self:
        """Return the move with the samples' covariance times :math:`2.38^2 / d`.

        Args:
            samples: Draws ``(n, ndim)`` of the target or a similar one, from a run
                that is not used for estimates.

        Returns:
            The move, with fixed steps.

        Raises:
            ValueError: If there are not more samples than dimensions, or their
                covariance is singular.

        Source: Roberts, Gelman and Gilks (1997), doi:10.1214/aoap/1034625254.

        Examples:
            >>> import numpy as np
            >>> from emcee_femu import MetropolisMove
            >>> draws = [[1.0, 0.0], [-1.0, 0.0], [0.0, 2.0], [0.0, -2.0]]
            >>> move = MetropolisMove.tuned(draws)
            >>> move.cov.round(2).tolist()  # 2.83 times theirs
            [[1.89, 0.0], [0.0, 7.55]]
        """
        draws = checks.real_array("samples", samples, 2)
        n, ndim = draws.shape
        if n <= ndim or not ndim:
            raise ValueError(f"samples: expected more than {ndim} draws, got {n}")
        covariance = np.atleast_2d(np.cov(draws, rowvar=False))
        checks.covariance_factor("samples (their covariance)", covariance)
        return cls(cov=2.38**2 / ndim * covariance)

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse a dimension that does not match the steps."""
        name = "cov" if self.sd is None else "sd"
        checks.shaped(name, self._factor.shape, (), (ndim,), (ndim, ndim))

    def get_proposal(self, s: Floats, c: list[Floats], random: RandomState) -> Proposal:
        """Propose a step of each walker ``s (k, ndim)`` (emcee's interface)."""
        steps = random.standard_normal(s.shape)
        wide = self._factor.ndim == 2
        return s + (steps @ self._factor.T if wide else steps * self._factor), None
