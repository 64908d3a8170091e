"""Renew an annealed population at one power, by moves that its other half fitted."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.random import RandomState
from numpy.typing import NDArray

from ..interfaces import Floats
from ..moves import IndependenceMove
from ..moves.acceptance import accept_or_reject, subtract_log_prior
from ..moves.component_walk import ComponentWalk

RENEWED = 0.8  # of the members are to be independent of their ancestors
MOST_SWEEPS = 20  # at one power
MOST_COMPONENTS = 6
PER_COMPONENT = 10  # members of a half for each parameter and component


def fewest_members(ndim: int) -> int:
    """Return the smallest population that a mixture can be fitted to, in halves."""
    return 2 * PER_COMPONENT * ndim


def _fit(draws: Floats, others: Floats, last: IndependenceMove) -> IndependenceMove:
    """Return a mixture with as many components as make the others more likely.

    Where a thin part of the prior holds nearly all of the likelihood, a half may become
    copies of one member, which have no covariance: then the last fit serves again.
    """
    most = min(MOST_COMPONENTS, len(draws) // (PER_COMPONENT * draws.shape[1]))
    try:
        best = IndependenceMove.fit(draws)
    except ValueError:
        return last
    score = best.log_density(others).mean()
    for components in range(2, most + 1):
        try:
            fitted = IndependenceMove.fit(draws, components)
        except ValueError:  # a component died
            break
        if (new := fitted.log_density(others).mean()) <= score:
            break
        best, score = fitted, new
    return best


def renew(
    evaluation: Any,
    theta: Floats,
    rows: Floats,
    halves: list[NDArray[np.intp]],
    power: float,
    random: RandomState,
    fits: list[IndependenceMove],
) -> tuple[float, int, Floats]:
    """Move all members, in place, until they are far from where they were.

    Sweeps of independence proposals alternate with a random walk, whichever renews
    more members having three quarters of them. The fits to the halves at the last
    power, in the order of the halves that they move, give way to those at this one.

    Returns:
        The share of accepted proposals, the number of sweeps, and ln(p / q) of all
        independence proposals.
    """
    n, ndim = theta.shape
    one, other = (theta[half] for half in halves)
    fits[:] = [_fit(other, one, fits[0]), _fit(one, other, fits[1])]
    walks = [ComponentWalk(fit) for fit in fits]
    moves: Any = fits
    log_weights: list[Floats] = []

    def compute(proposed: Floats) -> tuple[Floats, Floats]:
        new = evaluation.rows(proposed)
        if moves is fits:
            log_weights.append(_weigh(proposed, new, power, fits, halves))
        return new[:, 0], new[:, 1:]

    model = SimpleNamespace(compute_log_prob_fn=compute, random=random)
    state = SimpleNamespace(coords=theta, log_prob=rows[:, 0], blobs=rows[:, 1:])
    renewed, betas, accepted = np.zeros(n), np.full(n, power), []
    # An accepted step of the walk is worth 2.38**2 / (2 ndim) independent draws.
    worth = min(1.0, 2.8 / ndim)
    rates = [1.0, 0.25 * worth]
    for sweep in range(MOST_SWEEPS):
        better = rates[1] > rates[0]
        walking = better if sweep % 4 < 3 and sweep else not better and sweep > 0
        moves = walks if walking else fits
        batches = [
            next(move.batches(theta[half], random))
            for move, half in zip(moves, halves, strict=True)
        ]
        proposed, factors = (
            np.concatenate(parts) for parts in list(zip(*batches, strict=True))[1:]
        )
        moved = accept_or_reject(model, state, np.arange(n), proposed, factors, betas)
        accepted.append(len(moved) / n)
        rates[walking] = accepted[-1] * (worth if walking else 1.0)
        renewed[moved] += worth if walking else 1.0
        if walking:
            for walk in walks:
                walk.scale *= np.exp(accepted[-1] - 0.25)
        if np.minimum(renewed, 1).mean() > RENEWED:
            break
    return float(np.mean(accepted)), len(accepted), np.concatenate(log_weights)


def _weigh(
    proposed: Floats,
    rows: Floats,
    power: float,
    fits: list[IndependenceMove],
    halves: list[NDArray[np.intp]],
) -> Floats:
    """Return ln(p / q) of proposals for both halves, p with a power of the likelihood.

    It is -inf where the posterior is zero.
    """
    tempered = rows[:, 1] + power * subtract_log_prior(rows[:, 0], rows[:, 1])
    log_p = np.where(rows[:, 0] > -np.inf, tempered, -np.inf)
    log_q = [
        fit.log_density(proposed[half]) for fit, half in zip(fits, halves, strict=True)
    ]
    result: Floats = log_p - np.concatenate(log_q)
    return result
