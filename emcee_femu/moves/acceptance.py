"""Moves propose, and one Metropolis step accepts, on arrays of walkers.

emcee's moves do both in one method, with a Python loop over walkers that costs more
than a cheap proposal. Moves that only propose also serve delayed acceptance, and all
temperatures at once.
"""

from collections.abc import Callable, Iterator
from inspect import signature
from typing import Any, TypeAlias

import numpy as np
from emcee.moves import Move
from numpy.random import RandomState
from numpy.typing import NDArray

from ..interfaces import Floats

Batch: TypeAlias = tuple[NDArray[np.intp], Floats, Floats | None]
Propose: TypeAlias = Callable[[Floats], tuple[Floats, Floats | None]]


class ProposingMove(Move):
    """A move that proposes for one batch of walkers after the other.

    A subclass implements ``batches``, and ``check`` if it cannot move every ensemble.
    """

    def __repr__(self) -> str:
        """Return the call that makes an equal move."""
        names = signature(type(self)).parameters
        values = {name: getattr(self, name) for name in names if hasattr(self, name)}
        call = ", ".join(
            f"{name}={value.tolist() if isinstance(value, np.ndarray) else value!r}"
            for name, value in values.items()
        )
        return f"{type(self).__name__}({call})"

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse an ensemble for which the move is not valid."""

    def batches(self, coords: Floats, random: RandomState) -> Iterator[Batch]:
        """Yield walkers, proposals and log-factors, as accept_or_reject takes them.

        Each batch is accepted or rejected, and ``coords (nwalkers, ndim)`` changed in
        place, before the next one is asked for.
        """
        raise NotImplementedError

    def parts(
        self, coords: Floats, random: RandomState
    ) -> Iterator[tuple[NDArray[np.intp], Propose]]:
        """Yield walkers that move together, and what proposes for them.

        That takes where they are, ``(k, ndim)``, and may be asked any number of times:
        all other walkers stand still. Here they are all walkers, each on its own.
        """

        def propose(theta: Floats) -> tuple[Floats, Floats | None]:
            ((_, proposed, log_factors),) = self.batches(theta, random)
            return proposed, log_factors

        yield np.arange(len(coords)), propose

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Move every walker once; return the state and who was accepted."""
        self.check(*state.coords.shape)
        check_state(state)
        accepted = np.zeros(len(state.coords), dtype=bool)
        for batch in self.batches(state.coords, model.random):
            accepted[accept_or_reject(model, state, *batch)] = True
        return state, accepted


def accept_or_reject(
    model: Any,
    state: Any,
    walkers: NDArray[np.intp],
    proposed: Floats,
    log_factors: Floats | None = None,
    betas: Floats | None = None,
) -> NDArray[np.intp]:
    r"""Evaluate proposals for ``walkers``, accept or reject each, update the state.

    .. math:: r = \min\left\{1, \frac{p(\theta^*)}{p(\theta_i)} e^{F}\right\}

    Args:
        model: emcee's ``Model``: log-probability function and random stream.
        state: emcee's ``State``; the accepted walkers are overwritten in place.
        walkers: Indices ``(k,)`` of the walkers that may move.
        proposed: Proposals ``(k, ndim)``.
        log_factors: F of an asymmetric proposal, ``(k,)``.
        betas: Powers of the likelihood other than 1, ``(k,)``.

    Returns:
        The indices of the walkers that moved.

    Source: Eqs. 3.1 and 3.3 of Sherri, Boulkaibet, Marwala and Friswell.
    """
    if not len(walkers):
        return walkers
    log_prob, blobs = model.compute_log_prob_fn(proposed)
    target, threshold = log_prob, state.log_prob.take(walkers)
    if betas is not None:  # -inf stays -inf for every beta; beta = 1 changes no bit
        target = log_prob - (1 - betas) * subtract_log_prior(log_prob, blobs[:, 0])
        old = subtract_log_prior(threshold, state.blobs[walkers, 0])
        threshold -= (1 - betas) * old
    # log U = -Exp(1). Written without a difference, so that -inf against -inf is a
    # rejection and not a NaN.
    threshold -= model.random.standard_exponential(len(walkers))
    if log_factors is not None:
        threshold -= log_factors
    better = (target > threshold).nonzero()[0]
    moved: NDArray[np.intp] = walkers.take(better)
    new = proposed.take(better, axis=0), log_prob.take(better)
    overwrite(state, moved, *new, None if blobs is None else blobs[better])
    return moved


def overwrite(
    state: Any, moved: NDArray[np.intp], coords: Floats, log_prob: Floats, blobs: Any
) -> None:
    """Write where the walkers ``moved`` are now into the state."""
    state.coords[moved] = coords
    state.log_prob[moved] = log_prob
    if blobs is not None:
        if state.blobs is None:
            raise ValueError(
                "initial_state: it has log_prob but no blobs, and the log-probability "
                "returns blobs; pass State(coords, log_prob, blobs), or coords alone"
            )
        state.blobs[moved] = blobs


def subtract_log_prior(log_prob: Floats, log_prior: Floats) -> Floats:
    """Return the log-likelihoods of walkers, and 0 where the posterior is zero."""
    result = np.zeros_like(log_prob)
    return np.subtract(log_prob, log_prior, out=result, where=log_prob > -np.inf)


def check_state(state: Any) -> None:
    """Refuse walkers of whole numbers, and those that are all where nothing may be."""
    coords, log_prob = state.coords, state.log_prob
    if log_prob[0] == -np.inf and (log_prob == -np.inf).all():
        raise ValueError(
            "initial_state: all walkers have a log-probability of -inf, as outside of "
            "bounds; start where it is finite, such as at posterior.start(nwalkers, "
            "seed=1)"
        )
    # In an array of whole numbers emcee would truncate what is accepted.
    if coords.dtype.kind != "f":
        raise TypeError(
            f"initial_state: expected floating-point coordinates, got {coords.dtype}, "
            "which would truncate accepted proposals; pass numpy.asarray(p0, float)"
        )
