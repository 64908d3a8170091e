"""The proposals of emcee's own moves, for moves that accept in another way.

emcee's moves propose and accept in one method; here they only propose.
"""

from typing import Any

import numpy as np
from emcee.moves import MHMove, Move, RedBlueMove
from numpy.typing import NDArray

from ..interfaces import Floats
from .acceptance import check_floats, metropolis_step
from .red_blue import VectorizedRedBlueMove


class RedBlueProposal(VectorizedRedBlueMove):
    """The proposals of an emcee ``RedBlueMove``, such as ``DEMove``.

    Args:
        move: The move whose ``get_proposal`` is used.
    """

    guides = 1

    def __init__(self, move: RedBlueMove) -> None:
        """See the class."""
        super().__init__(move.nsplits, move.randomize_split, move.live_dangerously)
        self.move = move

    def get_proposal(
        self, s: Floats, c: list[Floats], random: Any
    ) -> tuple[Floats, Floats]:
        """Return what the wrapped move proposes."""
        proposed, log_factors = self.move.get_proposal(s, c, random)
        return proposed, np.asarray(log_factors, dtype=float)

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Move every walker once; return the state and who was accepted."""
        self.move.setup(state.coords)
        return super().propose(model, state)


class MetropolisProposal(Move):
    """The proposals of an emcee ``MHMove``, such as ``GaussianMove``.

    Args:
        move: The move whose ``get_proposal`` is used.
    """

    def __init__(self, move: MHMove) -> None:
        """See the class."""
        self.move = move

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Move every walker once; return the state and who was accepted."""
        check_floats(state.coords)
        # A copy, since emcee hands proposal functions the state itself.
        proposed, log_factors = self.move.get_proposal(
            state.coords.copy(), model.random
        )
        nwalkers = len(state.coords)
        accepted = np.zeros(nwalkers, dtype=bool)
        log_factors = np.broadcast_to(np.asarray(log_factors, dtype=float), nwalkers)
        walkers = np.arange(nwalkers)
        accepted[metropolis_step(model, state, walkers, proposed, log_factors)] = True
        return state, accepted
