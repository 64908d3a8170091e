"""emcee's own moves as moves that only propose, for what accepts in another way."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from emcee.moves import MHMove, RedBlueMove
from numpy.random import RandomState
from numpy.typing import NDArray

from ..interfaces import Floats
from .acceptance import Batch, Propose, ProposingMove
from .red_blue import VectorizedRedBlueMove


def only_propose(inner: Any) -> ProposingMove:
    """Return a move that leaves the acceptance to others.

    Raises:
        TypeError: If inner is not a move, or accepts in its own way.
    """
    propose = getattr(type(inner), "propose", None)
    if isinstance(inner, ProposingMove) and propose is ProposingMove.propose:
        return inner
    if isinstance(inner, RedBlueMove) and propose is RedBlueMove.propose:
        return RedBlueProposal(inner)
    if isinstance(inner, MHMove) and propose is MHMove.propose:
        return MetropolisProposal(inner)
    raise TypeError(
        "inner: expected an untempered move of this package that needs no gradient, or "
        f"an emcee RedBlueMove or MHMove with emcee's own propose, got {inner!r}"
    )


class RedBlueProposal(VectorizedRedBlueMove):
    """The proposals of an emcee ``RedBlueMove``, such as ``DEMove``.

    Args:
        move: The move whose ``get_proposal`` is used.
    """

    guides = 1

    def __init__(self, move: RedBlueMove) -> None:
        super().__init__(move.nsplits, move.randomize_split, move.live_dangerously)
        self.move = move

    def get_proposal(
        self, s: Floats, c: list[Floats], random: RandomState
    ) -> tuple[Floats, Floats]:
        """Return what the wrapped move proposes."""
        proposed, log_factors = self.move.get_proposal(s, c, random)
        return proposed, np.asarray(log_factors, dtype=float)

    def parts(
        self, coords: Floats, random: RandomState
    ) -> Iterator[tuple[NDArray[np.intp], Propose]]:
        """Yield the walkers of each part, and what proposes by the guides at rest."""
        self.move.setup(coords)
        return super().parts(coords, random)


class MetropolisProposal(ProposingMove):
    """The proposals of an emcee ``MHMove``, such as ``GaussianMove``.

    Args:
        move: The move whose ``get_proposal`` is used.
    """

    def __init__(self, move: MHMove) -> None:
        self.move = move

    def batches(self, coords: Floats, random: RandomState) -> Iterator[Batch]:
        """Yield one step of all walkers."""
        # A copy, since emcee hands proposal functions the state itself.
        proposed, log_factors = self.move.get_proposal(coords.copy(), random)
        n = len(coords)
        log_factors = np.broadcast_to(np.asarray(log_factors, dtype=float), n)
        yield np.arange(n), proposed, log_factors
