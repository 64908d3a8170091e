"""Cheap densities that are wrong, and the moves that delayed acceptance may hold."""

import emcee
import numpy as np

from emcee_femu.moves import (
    CrossoverMove,
    DEMCMove,
    IndependenceMove,
    MetropolisMove,
    SnookerMove,
)
from emcee_femu.moves.component_walk import ComponentWalk
from support.checks import Gaussian


def wrong(target, bounded=False):
    """Return a cheap log-density that is shifted, too wide and skew.

    That of a Gaussian falls off as it does; another has the target's bounds if asked.
    """

    def cheap(theta):
        x = theta / target.scale
        core = 0.6 * target(theta) if bounded or isinstance(target, Gaussian) else 0.0
        pair = x[:, 1] * x[:, 2] if x.shape[1] > 1 else 0.0
        return core + 0.7 * x[:, 0] - 0.4 * pair - 0.1 * x[:, -1] ** 2

    return cheap


def independence(target):
    draws = target.sample(np.random.default_rng(5), (400,))
    return IndependenceMove.fit(draws)


def walk(target):
    return ComponentWalk(independence(target), 0.7)


def correlated(target):
    spread = 0.4 * target.scale
    shape = 0.5 + 0.5 * np.eye(target.ndim)
    return MetropolisMove(cov=np.outer(spread, spread) * shape)


INNER = {
    "demc": lambda target: DEMCMove(live_dangerously=True),
    "demc, four splits": lambda target: DEMCMove(nsplits=4),
    "metropolis": lambda target: MetropolisMove(sd=0.5 * target.scale),
    "independence": independence,
    "snooker": lambda target: SnookerMove(live_dangerously=True),
    "crossover": lambda target: CrossoverMove(),
    "emcee StretchMove": lambda target: emcee.moves.StretchMove(),
    "emcee DEMove": lambda target: emcee.moves.DEMove(),
    "emcee GaussianMove": lambda target: emcee.moves.GaussianMove(0.2),
}
MORE = {  # which one step at a time does not treat in another way
    "demc, in order": lambda target: DEMCMove(randomize_split=False, mode_jump=0.3),
    "correlated": correlated,
    "component walk": walk,
    "emcee WalkMove": lambda target: emcee.moves.WalkMove(4),
    "emcee KDEMove": lambda target: emcee.moves.KDEMove(),
    "emcee GaussianMove, random": lambda target: emcee.moves.GaussianMove(
        0.3, mode="random"
    ),
}
