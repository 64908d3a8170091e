"""Parallel tempering: hot walkers cross between modes and hand them to the cold ones.

Why nothing is hidden in the move: the state holds the posterior's own log-probability
and blobs for the walkers of every temperature. What an inner move sees is computed from
them anew each generation, so that a run resumed from a file goes on to the bit.
"""

from collections.abc import Iterable
from typing import Any

import emcee
import numpy as np
from emcee.moves import Move
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..interfaces import Floats
from .acceptance import check_floats


class TemperedMove(Move):
    r"""Move blocks of walkers at powers of the likelihood, and exchange between them.

    .. math:: p_t(\theta) \propto p(\theta) L(\theta)^{\beta_t}, \qquad
        r = \min\left\{1, \left(L(\theta_{t+1}) / L(\theta_t)\right)
        ^{\beta_t - \beta_{t+1}}\right\}

    Walkers ``t * block .. (t + 1) * block - 1`` sample ``p_t``, with ``block = nwalkers
    / len(betas)``. Each generation moves every block by the inner move, then offers
    each walker an exchange of places with one of the next block, the even and the odd
    pairs of neighbouring blocks in random order. The log-probability must be a
    LogPosterior, or return the log-prior as first blob; the log-probabilities and blobs
    stored are the posterior's, whatever the beta.

    Only the first block samples the posterior; conversion, tables and ``diagnose`` use
    it alone. They know it from the sampler's moves: to read a chain from a file, make
    a sampler with the same moves and that backend.

    Args:
        inner: An emcee move, of this package or stock, for the walkers of a block.
        betas: Powers of the likelihood, descending from 1, at least two. Choose them
            denser near zero: ``numpy.linspace(1, 0, 8) ** 4``. Down to 0 (the prior)
            they allow :func:`log_evidence`, and hot walkers roam the prior.

    Raises:
        TypeError: If inner is not a move, or betas are not real numbers.
        ValueError: If betas do not descend from 1 to at least 0. When it proposes: if
            nwalkers is not a multiple of len(betas), or there are no blobs.

    Source: Swendsen and Wang (1986), doi:10.1103/PhysRevLett.57.2607; Earl and Deem
    (2005), doi:10.1039/B509983H.

    Example:
        >>> from emcee_femu.moves import DEMCMove
        >>> move = TemperedMove(DEMCMove(mode_jump=0.1), betas=[1.0, 0.3, 0.0])
        >>> move.cold(nwalkers=36)
        slice(0, 12, None)
    """

    def __init__(self, inner: Any, betas: ArrayLike) -> None:
        """See the class."""
        if not hasattr(inner, "propose") or isinstance(inner, type | TemperedMove):
            raise TypeError(
                "inner: expected an emcee move that is not itself tempered, such as "
                f"DEMCMove(), got {inner!r}"
            )
        self.inner = inner
        self.betas = checks.real_array("betas", betas, 1)
        if (
            len(self.betas) < 2
            or self.betas[0] != 1
            or self.betas[-1] < 0
            or not (np.diff(self.betas) < 0).all()
        ):
            raise ValueError(
                "betas: expected at least two powers that descend from 1 to no less "
                f"than 0, such as [1.0, 0.3, 0.0], got {self.betas.tolist()}"
            )

    def __repr__(self) -> str:
        """Return the call that makes an equal move."""
        return f"TemperedMove({self.inner!r}, betas={self.betas.tolist()})"

    def cold(self, nwalkers: int) -> slice:
        """Return which of ``nwalkers`` walkers sample the posterior itself."""
        return slice(0, nwalkers // len(self.betas))

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse an ensemble that does not divide, or whose blocks inner refuses.

        Raises:
            ValueError: If nwalkers is not a multiple of len(betas).
        """
        block, rest = divmod(nwalkers, len(self.betas))
        if rest or not block:
            raise ValueError(
                f"nwalkers: expected a multiple of {len(self.betas)}, the number of "
                f"betas, got {nwalkers}; {len(self.betas)} * {max(16, 4 * ndim)} = "
                f"{len(self.betas) * max(16, 4 * ndim)} would be usual"
            )
        if hasattr(self.inner, "check"):
            self.inner.check(block, ndim)

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Move every block, then exchange; return the state and whom inner accepted."""
        nwalkers, ndim = state.coords.shape
        self.check(nwalkers, ndim)
        check_floats(state.coords)
        blobs = state.blobs
        if blobs is None or blobs.ndim != 2 or blobs.dtype.kind != "f":
            raise ValueError(
                "log_prob_fn: TemperedMove needs the log-prior as the first of at "
                "least two floating-point blobs, as LogPosterior returns them, got "
                + ("no blobs" if blobs is None else f"{blobs.dtype} {blobs.shape}")
            )
        accepted = np.zeros(nwalkers, dtype=bool)
        block = nwalkers // len(self.betas)
        for t, beta in enumerate(self.betas.tolist()):
            own = slice(t * block, (t + 1) * block)
            accepted[own] = self._move(model, state, own, beta)
        for first in model.random.permutation(2):  # both: an exchange needs no solve
            self._exchange(model.random, state, block, first)
        return state, accepted

    def _move(self, model: Any, state: Any, own: slice, beta: float) -> Any:
        """Move the block ``own`` of the state in place by the inner move."""

        def tempered_model(theta: Floats) -> tuple[Floats, Floats]:
            return _tempered(beta, *model.compute_log_prob_fn(theta))

        log_prob, blobs = _tempered(beta, state.log_prob[own], state.blobs[own])
        moved, accepted = self.inner.propose(
            # Without log_prob_fn: a move that called it would miss the temperature.
            model._replace(compute_log_prob_fn=tempered_model, log_prob_fn=None),
            emcee.State(state.coords[own].copy(), log_prob, blobs),
        )
        state.coords[own] = moved.coords
        state.log_prob[own] = moved.blobs[:, -1]
        state.blobs[own] = moved.blobs[:, :-1]
        return accepted

    def _exchange(self, random: Any, state: Any, block: int, first: int) -> None:
        """Offer walkers of every second pair of neighbouring blocks an exchange."""
        colder = np.arange(first, len(self.betas) - 1, 2)
        shape = (len(colder), block)
        order = random.random_sample(shape).argsort(axis=1)  # a permutation a row
        threshold = -random.standard_exponential(shape)  # log of a uniform number
        cold = colder[:, None] * block + np.arange(block)
        hot = (colder[:, None] + 1) * block + order
        gaps = (self.betas[colder] - self.betas[colder + 1])[:, None]
        log_likelihood = log_likelihoods(state.log_prob, state.blobs[:, 0])
        log_ratio = gaps * (log_likelihood[hot] - log_likelihood[cold])
        possible = (state.log_prob[hot] > -np.inf) & (state.log_prob[cold] > -np.inf)
        swap = possible & (log_ratio > threshold)
        there, back = np.r_[cold[swap], hot[swap]], np.r_[hot[swap], cold[swap]]
        for values in (state.coords, state.log_prob, state.blobs):
            values[there] = values[back]


def log_likelihoods(log_prob: Floats, log_prior: Floats) -> Floats:
    """Return the log-likelihoods of walkers, and 0 where the posterior is zero."""
    result = np.zeros_like(log_prob)
    return np.subtract(log_prob, log_prior, out=result, where=log_prob > -np.inf)


def ladder(moves: Iterable[Any]) -> TemperedMove | None:
    """Return the tempered move whose blocks all ``moves`` share, None if untempered.

    Raises:
        ValueError: If tempered moves are mixed with others, or their betas differ.
    """
    given = list(moves)
    tempered = [move for move in given if isinstance(move, TemperedMove)]
    if not tempered:
        return None
    first = tempered[0]
    if len(tempered) < len(given) or not all(
        np.array_equal(move.betas, first.betas) for move in tempered
    ):
        raise ValueError(
            "moves: expected every move of a list to be a TemperedMove with the same "
            "betas, since each walker has one temperature, got "
            f"{given}; write [(TemperedMove(a, betas), 0.9), (TemperedMove(b, betas), "
            "0.1)]"
        )
    return first


def _tempered(beta: float, log_prob: Floats, blobs: Floats) -> tuple[Floats, Floats]:
    """Return ``log_prior + beta * log_likelihood``, and blobs with log_prob last."""
    # Written so that -inf stays -inf for every beta, and beta = 1 changes no bit.
    lowered = log_prob - (1 - beta) * log_likelihoods(log_prob, blobs[:, 0])
    return lowered, np.concatenate((blobs, log_prob[:, None]), axis=1)
