"""Parallel tempering: hot walkers cross between maxima and pass them to the cold ones.

The state holds the posterior's own log-probability and blobs for the walkers of all
temperatures. The move has no hidden state, so a resumed run is identical bit for bit.
"""

import numpy as np
from emcee import State
from emcee.model import Model
from emcee.moves import Move
from numpy.random import RandomState
from numpy.typing import ArrayLike, NDArray

from ..moves.proposing import (
    ProposingMove,
    accept_or_reject,
    check_state,
    only_propose,
    read_betas,
    subtract_log_prior,
)


class TemperedMove(Move):
    r"""Parallel tempering: walkers at several temperatures that exchange their states.

    .. math:: p_t(\theta) \propto p(\theta) L(\theta)^{\beta_t}, \qquad
        r = \min\left\{1, \left(L(\theta_{t+1}) / L(\theta_t)\right)
        ^{\beta_t - \beta_{t+1}}\right\}

    Use it for posteriors with separate maxima, or to compute the evidence with
    :func:`log_evidence`. Walkers ``t * block .. (t + 1) * block - 1`` sample ``p_t``,
    where ``block = nwalkers / len(betas)``. In each generation the inner move updates
    every block, guided by the block's own walkers, in one batch of ``nwalkers``
    evaluations. Each walker is then offered an exchange with one in the next block, for
    even and odd pairs of neighbouring blocks in random order. The log-probability must
    be a LogPosterior, or return the log-prior as its first blob. The stored
    log-probabilities and blobs are those of the posterior at every beta.

    Only the first block samples the posterior. Conversion, tables and ``diagnose`` use
    it alone; they find it from the sampler's moves or from the file of a run. To read a
    chain from another backend, make a sampler with the same moves and that backend.

    Args:
        inner: The move within each block, one of this package.
        betas: Powers of the likelihood, descending from 1, at least two. Space them
            more closely near zero: ``numpy.linspace(1, 0, 8) ** 4``. If they end at 0
            (the prior), :func:`log_evidence` can use them, and the hottest walkers
            cover the whole prior.

    Raises:
        TypeError: If inner is another kind of move, or betas are not real numbers.
        ValueError: If betas do not descend from 1 to at least 0. When it proposes: if
            nwalkers is not a multiple of len(betas), or there are no blobs.

    Source: Swendsen and Wang (1986), doi:10.1103/PhysRevLett.57.2607; Earl and Deem
    (2005), doi:10.1039/B509983H.

    Examples:
        >>> from emcee_femu import DEMCMove
        >>> from emcee_femu.moves import TemperedMove
        >>> move = TemperedMove(DEMCMove(mode_jump=0.1), betas=[1.0, 0.3, 0.0])
        >>> move.cold(nwalkers=36)
        slice(0, 12, None)
    """

    __repr__ = ProposingMove.__repr__

    def __init__(self, inner: Move, betas: ArrayLike) -> None:
        self.inner = only_propose(inner)
        self.betas = read_betas(betas)

    def cold(self, nwalkers: int) -> slice:
        """Return which of ``nwalkers`` walkers sample the posterior itself."""
        return slice(0, nwalkers // len(self.betas))

    def default_walkers(self, ndim: int) -> int:
        """Return the usual number of walkers over all temperatures."""
        return len(self.betas) * max(16, 4 * ndim)

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse an ensemble that does not divide, or whose blocks inner refuses.

        Raises:
            ValueError: If nwalkers is not a multiple of len(betas).
            Exception: Whatever inner raises for a block; a number of walkers that is
                too small is given for all blocks.
        """
        rungs, usual = len(self.betas), self.default_walkers(ndim)
        block, rest = divmod(nwalkers, rungs)
        if rest or not block:
            raise ValueError(
                f"nwalkers: expected a multiple of {rungs}, the number of betas, got "
                f"{nwalkers}; {usual} would be usual"
            )
        try:
            self.inner.check(block, ndim)
        except (ValueError, RuntimeError) as error:
            raise type(error)(
                f"nwalkers: expected more than {nwalkers}, which leaves {block} for "
                f"each of {rungs} betas; {usual} would be usual ({error})"
            ) from error

    def propose(self, model: Model, state: State) -> tuple[State, NDArray[np.bool_]]:
        """Move every block, then exchange; return the state and what inner accepted."""
        nwalkers, ndim = state.coords.shape
        self.check(nwalkers, ndim)
        check_state(state)
        blobs = state.blobs
        if blobs is None or blobs.ndim != 2 or blobs.dtype.kind != "f":
            raise ValueError(
                "log_prob_fn: TemperedMove needs the log-prior as the first of at "
                "least two floating-point blobs, as LogPosterior returns them, got "
                + ("no blobs" if blobs is None else f"{blobs.dtype} {blobs.shape}")
            )
        block = nwalkers // len(self.betas)
        accepted = self._move(model, state, block)
        for first in model.random.permutation(2):  # both: an exchange needs no solve
            self._swap(model.random, state, block, first)
        return state, accepted

    def _move(self, model: Model, state: State, block: int) -> NDArray[np.bool_]:
        """Move all blocks in place, with one call for the same half of each."""
        accepted = np.zeros(len(state.coords), dtype=bool)
        starts, betas = range(0, len(accepted), block), self.betas.repeat(block)
        # Slices, not copies: each stream sees what was accepted in its block.
        blocks = [state.coords[start : start + block] for start in starts]
        streams = [self.inner.batches(coords, model.random) for coords in blocks]
        for batches in zip(*streams, strict=True):
            numbers, proposed, factors = zip(*batches, strict=True)
            pairs = zip(numbers, starts, strict=True)
            walkers = np.concatenate([number + start for number, start in pairs])
            proposal = np.concatenate(proposed)
            factor = None if factors[0] is None else np.concatenate(factors)
            step = walkers, proposal, factor
            accepted[accept_or_reject(model, state, step, betas[walkers])] = True
        return accepted

    def _swap(self, random: RandomState, state: State, block: int, first: int) -> None:
        """Offer walkers of every second pair of neighbouring blocks an exchange."""
        colder = np.arange(first, len(self.betas) - 1, 2)
        shape = (len(colder), block)
        order = random.random_sample(shape).argsort(axis=1)  # a permutation per row
        threshold = -random.standard_exponential(shape)  # log of a uniform number
        cold = colder[:, None] * block + np.arange(block)
        hot = (colder[:, None] + 1) * block + order
        gaps = (self.betas[colder] - self.betas[colder + 1])[:, None]
        log_likelihood = subtract_log_prior(state.log_prob, state.blobs[:, 0])
        log_ratio = gaps * (log_likelihood[hot] - log_likelihood[cold])
        possible = (state.log_prob[hot] > -np.inf) & (state.log_prob[cold] > -np.inf)
        swap = possible & (log_ratio > threshold)
        there, back = np.r_[cold[swap], hot[swap]], np.r_[hot[swap], cold[swap]]
        for values in (state.coords, state.log_prob, state.blobs):
            values[there] = values[back]
