"""The Metropolis step that all moves share, on arrays of walkers.

emcee's moves accept in a Python loop over walkers, which costs more than a cheap
proposal; here a whole set of walkers is accepted at once.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def metropolis_step(
    model: Any,
    state: Any,
    walkers: NDArray[np.intp],
    proposed: NDArray[np.floating[Any]],
    log_factors: NDArray[np.floating[Any]] | None = None,
) -> NDArray[np.intp]:
    r"""Evaluate proposals for ``walkers``, accept or reject each, update the state.

    .. math:: r = \min\left\{1, \frac{p(\theta^*)}{p(\theta_i)} e^{F}\right\}

    Args:
        model: emcee's ``Model``: log-probability function and random stream; or what
            decides itself, by a method ``accept`` with the other arguments.
        state: emcee's ``State``; the accepted walkers are overwritten in place.
        walkers: Indices ``(k,)`` of the walkers that may move.
        proposed: Proposals ``(k, ndim)``.
        log_factors: Logarithm F of the proposal's asymmetry, ``(k,)``, or
            None for a symmetric one.

    Returns:
        The indices of the walkers that moved.

    Source: Eqs. 3.1 and 3.3 of Sherri, Boulkaibet, Marwala and Friswell.
    """
    if hasattr(model, "accept"):  # delayed acceptance decides in two stages
        decided: NDArray[np.intp] = model.accept(state, walkers, proposed, log_factors)
        return decided
    log_prob, blobs = model.compute_log_prob_fn(proposed)
    # log U = -Exp(1). Written without a difference, so that -inf against -inf is a
    # rejection and not a NaN.
    threshold = state.log_prob.take(walkers)
    threshold -= model.random.standard_exponential(len(walkers))
    if log_factors is not None:
        threshold -= log_factors
    better = (log_prob > threshold).nonzero()[0]
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


def check_floats(coords: NDArray[Any]) -> None:
    """Refuse integer walkers, in which emcee would truncate what is accepted."""
    if coords.dtype.kind != "f":
        raise TypeError(
            f"initial_state: expected floating-point coordinates, got {coords.dtype}, "
            "which would truncate accepted proposals; pass numpy.asarray(p0, float)"
        )
