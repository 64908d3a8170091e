"""The snooker update: jumps along the line through another walker."""

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats
from .guides import draw_guides, measure_spread
from .red_blue import VectorizedRedBlueMove

NEVER = -np.finfo(np.float64).max  # finite, because -inf less -inf is a NaN


class SnookerMove(VectorizedRedBlueMove):
    r"""Move along the line through a guide z, by the projection of two others on it.

    .. math:: \theta^* = \theta_i + \gamma\, u u^T (z_1 - z_2), \qquad
        u = \frac{\theta_i - z}{|\theta_i - z|}, \qquad
        \gamma \sim U(\gamma_{low}, \gamma_{high}), \qquad
        r = \min\left\{1, \frac{p(\theta^*)}{p(\theta_i)}
        \left(\frac{|\theta^* - z|}{|\theta_i - z|}\right)^{d - 1}\right\}

    z, z1 and z2 are distinct walkers among those at rest. Parameters are divided by the
    standard deviation of these walkers, so that units do not matter; a parameter that
    has one value in all of them has no weight.

    Not a move to use alone: on the mass-spring posterior of :mod:`emcee_femu.paper` it
    gave 20 effective samples per 1000 model evaluations, :class:`DEMCMove` 37, and
    ``moves=[(DEMCMove(), 0.9), (SnookerMove(), 0.1)]`` 39 (no real difference).

    Args:
        gamma: The interval of gamma, ``(low, high)``, drawn anew for each walker.
        nsplits: Parts of the ensemble that move in turn.
        randomize_split: Whether to deal the walkers to the parts anew each step.
        live_dangerously: Whether to allow fewer walkers than ``2 * ndim``.

    Raises:
        TypeError: If gamma does not hold real numbers, or nsplits is not whole.
        ValueError: If gamma is not an interval above zero, or nsplits < 2. When it
            proposes: if fewer than 3 walkers are at rest.

    Source: ter Braak and Vrugt (2008), doi:10.1007/s11222-008-9104-9.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> moves = [(ef.DEMCMove(), 0.9), (ef.SnookerMove(), 0.1)]
        >>> (sampler,) = ef.run(posterior, moves, nwalkers=20, nsteps=50, seed=1)
        >>> sampler.get_chain().shape
        (50, 20, 5)
    """

    guides = 3

    def __init__(
        self,
        gamma: ArrayLike = (1.2, 2.2),
        *,
        nsplits: int = 2,
        randomize_split: bool = True,
        live_dangerously: bool = False,
    ) -> None:
        super().__init__(nsplits, randomize_split, live_dangerously)
        ends = checks.positive_array("gamma", gamma, 1)
        if len(ends) != 2 or ends[0] > ends[1]:
            raise ValueError(
                "gamma: expected an interval (low, high) with low <= high, got "
                f"{gamma!r}"
            )
        self.gamma: tuple[float, float] = (float(ends[0]), float(ends[1]))

    def get_proposal(
        self, s: Floats, c: list[Floats], random: RandomState
    ) -> tuple[Floats, Floats]:
        """Propose for walkers ``s (k, ndim)`` with guides ``c[0]`` (emcee's contract).

        A walker that sits on its guide z has no line: it stays, and is not accepted.
        """
        guides = np.concatenate(c) if len(c) > 1 else c[0]
        moving, ndim = s.shape
        z, z1, z2 = guides.take(draw_guides(random, moving, len(guides), 3), axis=0)
        low, high = self.gamma
        gamma = low + (high - low) * random.random_sample((moving,))

        sd = measure_spread(guides)
        per_sd = np.divide(1.0, sd, out=np.zeros(ndim), where=sd > 0)
        line = s - z
        # With v = theta_i - z, the jump is a multiple of v: gamma (z1 - z2).v / v.v
        scaled = line * per_sd
        square = np.einsum("ij,ij->i", scaled, scaled)
        along = np.einsum("ij,ij->i", scaled, (z1 - z2) * per_sd)
        known = square > 0
        jump = np.divide(gamma * along, square, out=np.zeros(moving), where=known)
        stretch = np.abs(1.0 + jump)  # |theta* - z| / |theta_i - z|
        known &= stretch > 0
        log_factors = np.full(moving, NEVER)
        np.log(stretch, out=log_factors, where=known)
        np.multiply(log_factors, ndim - 1, out=log_factors, where=known)
        line *= jump[:, None]
        line += s
        return line, log_factors
