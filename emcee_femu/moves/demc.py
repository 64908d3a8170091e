"""Differential evolution Markov chain (DE-MC), the paper's proposal."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats
from .proposing import Indices, Part, Proposal, ProposingMove

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
            If you expect several modes, 0.1 is usual.

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
        if self.sigma is not None and self.sigma.shape not in ((), (ndim,)):
            raise ValueError(
                f"sigma: expected one number or shape ({ndim},) for {ndim} parameters, "
                f"got shape {self.sigma.shape}"
            )

    def parts(self, coords: Floats, random: RandomState) -> Iterator[Part]:
        """Yield the walkers of each part, and the proposal guided by those at rest."""
        nwalkers = len(coords)
        if self.randomize_split:
            order = random.random_sample(nwalkers).argsort()
        else:
            order = np.argsort(np.arange(nwalkers) % self.nsplits, kind="stable")
        ring = np.concatenate((order, order))
        size, larger = divmod(nwalkers, self.nsplits)
        end = 0
        for split in range(self.nsplits):
            start, end = end, end + size + (split < larger)
            guides = [coords.take(ring[end : start + nwalkers], axis=0)]
            yield order[start:end], self._guided(guides, random)

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
