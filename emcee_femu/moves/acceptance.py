"""Moves propose, and one Metropolis step accepts, on arrays of walkers.

emcee's moves propose and accept in one method, and accept in a Python loop over
walkers, which costs more than a cheap proposal. Here a move only yields proposals, so
that the same move also serves delayed acceptance, and all temperatures at once.
"""

from collections.abc import Iterator
from inspect import signature
from typing import Any, TypeAlias

import numpy as np
from emcee.moves import Move
from numpy.random import RandomState
from numpy.typing import NDArray

from ..interfaces import Floats

Batch: TypeAlias = tuple[NDArray[np.intp], Floats, Floats | None]


class ProposingMove(Move):
    """A move that proposes for one batch of walkers after the other.

    A subclass implements ``batches``, and ``check`` where it cannot move any ensemble.
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
        """Yield walkers ``(k,)``, their proposals ``(k, ndim)``, and log-factors.

        Each batch is accepted or rejected, and ``coords (nwalkers, ndim)`` changed in
        place, before the next one is asked for. The log-factors ``(k,)`` are the F of
        :func:`metropolis_step`, or None.
        """
        raise NotImplementedError

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Move every walker once; return the state and who was accepted."""
        self.check(*state.coords.shape)
        check_floats(state.coords)
        accepted = np.zeros(len(state.coords), dtype=bool)
        for batch in self.batches(state.coords, model.random):
            accepted[metropolis_step(model, state, *batch)] = True
        return state, accepted


def only_proposes(move: Any) -> bool:
    """Return whether ``batches`` is all that a move does; propose may be overridden."""
    return getattr(type(move), "propose", None) is ProposingMove.propose


def metropolis_step(
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
        log_factors: Logarithm F of the proposal's asymmetry, ``(k,)``, or None for a
            symmetric one.
        betas: Power of the likelihood per walker, ``(k,)``; None for 1.

    Returns:
        The indices of the walkers that moved.

    Source: Eqs. 3.1 and 3.3 of Sherri, Boulkaibet, Marwala and Friswell.
    """
    if not len(walkers):
        return walkers
    log_prob, blobs = model.compute_log_prob_fn(proposed)
    target, threshold = log_prob, state.log_prob.take(walkers)
    if betas is not None:
        target = temper(betas, log_prob, blobs[:, 0])
        threshold = temper(betas, threshold, state.blobs[walkers, 0])
    # log U = -Exp(1). Written without a difference, so that -inf against -inf is a
    # rejection and not a NaN.
    threshold -= model.random.standard_exponential(len(walkers))
    if log_factors is not None:
        threshold -= log_factors
    better = (target > threshold).nonzero()[0]
    moved: NDArray[np.intp] = walkers.take(better)
    state.coords[moved] = proposed.take(better, axis=0)
    state.log_prob[moved] = log_prob.take(better)
    if blobs is not None:
        if state.blobs is None:
            raise ValueError(
                "initial_state: it has log_prob but no blobs, and the log-probability "
                "returns blobs; pass State(coords, log_prob, blobs), or coords alone"
            )
        state.blobs[moved] = blobs[better]
    return moved


def temper(beta: float | Floats, log_prob: Floats, log_prior: Floats) -> Floats:
    """Return ``log_prior + beta * log_likelihood`` per walker."""
    # Written so that -inf stays -inf for every beta, and beta = 1 changes no bit.
    return log_prob - (1 - beta) * log_likelihoods(log_prob, log_prior)


def log_likelihoods(log_prob: Floats, log_prior: Floats) -> Floats:
    """Return the log-likelihoods of walkers, and 0 where the posterior is zero."""
    result = np.zeros_like(log_prob)
    return np.subtract(log_prob, log_prior, out=result, where=log_prob > -np.inf)


def check_floats(coords: NDArray[Any]) -> None:
    """Refuse integer walkers, in which emcee would truncate what is accepted."""
    if coords.dtype.kind != "f":
        raise TypeError(
            f"initial_state: expected floating-point coordinates, got {coords.dtype}, "
            "which would truncate accepted proposals; pass numpy.asarray(p0, float)"
        )
