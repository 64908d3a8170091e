"""Faults of emcee's own moves, found by what the installed release does."""

from copy import deepcopy
from typing import Any

import emcee
import numpy as np
from emcee.model import Model

from ..interfaces import Floats


def find_stock_fault(move: Any, ndim: int) -> str:
    """Return what is wrong with a move of emcee's own, or an empty string.

    The two doubtful ones are tried out, so that a release or a subclass that mends them
    passes.

    Source: emcee's pull requests 571 (GaussianMove) and 531 (DESnookerMove).
    """
    if isinstance(move, emcee.moves.GaussianMove) and _moves_rigidly(move, ndim):
        return (
            "GaussianMove with a full covariance adds the same step to all walkers, "
            "which overstates their ESS; use emcee_femu.MetropolisMove(cov=...)"
        )
    if isinstance(move, emcee.moves.DESnookerMove) and not _snooker_is_balanced(move):
        return (
            "DESnookerMove has a wrong Hastings factor in this release of emcee, so "
            "that it samples another law; use emcee_femu.SnookerMove()"
        )
    return ""


def refuse_sequential(argument: str, move: Any) -> None:
    """Refuse a stock move, or one inside a move, that counts its own steps.

    A second run with it, or a resumed one, would not be that of the same seed.
    """
    while hasattr(move, "inner"):
        move = move.inner
    if getattr(getattr(move, "get_proposal", None), "mode", "") == "sequential":
        raise ValueError(
            f"{argument}: GaussianMove(mode='sequential') goes on from where its last "
            "run ended, so that the same seed gives another chain; use mode='random'"
        )


def _moves_rigidly(move: Any, ndim: int) -> bool:
    """Return whether two walkers at one place are sent to one and the same place."""

    def flat(theta: Floats) -> tuple[Floats, None]:  # everything is accepted
        return np.zeros(len(theta)), None

    model = Model(None, flat, map, np.random.RandomState(1))
    state = emcee.State(np.zeros((2, ndim)), log_prob=np.zeros(2))
    state, _ = deepcopy(move).propose(model, state)  # it may count its calls
    first, second = state.coords
    return bool(first.any() and (first == second).all())


def _snooker_is_balanced(move: Any) -> bool:
    r"""Return whether a 3-D proposal is on a line through a guide, with its factor.

    .. math:: q = z + t (x - z), \qquad \ln F = (d - 1) \ln \frac{|q - z|}{|x - z|}

    Source: ter Braak and Vrugt (2008), doi:10.1007/s11222-008-9104-9, Eq. 4.
    """
    x = np.array([0.3, -1.1, 2.0])
    guides = np.array([[1.0, 0.2, -0.4], [-0.7, 1.9, 0.6], [2.2, -0.3, 1.3]])
    proposed, factor = deepcopy(move).get_proposal(
        x[None], [guide[None] for guide in guides], np.random.RandomState(1)
    )
    for z in guides:  # which of them is drawn as z is the move's own business
        before, after = x - z, proposed[0] - z
        lengths = np.linalg.norm(before), np.linalg.norm(after)
        off_line = np.linalg.norm(np.cross(before, after)) / (lengths[0] * lengths[1])
        expected = 2 * np.log(lengths[1] / lengths[0])
        if off_line < 1e-9 and np.isclose(factor[0], expected, rtol=1e-9):
            return True
    return False
