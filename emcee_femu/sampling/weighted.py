"""Moves with weights, as emcee takes them, and the walkers that they need."""

from collections.abc import Sequence
from typing import Any, TypeAlias

from .. import checks
from ..contracts import Move
from ..moves import DEMCMove, HamiltonianMove
from ..moves.proposing import ladder_of
from ..posterior.log_posterior import LogPosterior

Moves: TypeAlias = Move | Sequence[Move] | Sequence[tuple[Move, float]]


def weigh_moves(moves: object, argument: str = "moves") -> list[tuple[Move, float]]:
    """Return moves with weights: of one, of a list of them, or of weighted pairs."""
    listed: list[Any] = list(moves) if isinstance(moves, list | tuple) else [moves]
    if not listed:
        raise ValueError(f"{argument}: expected at least one move, got none")
    pairs = [item for item in listed if isinstance(item, list | tuple)]
    if pairs and (len(pairs) < len(listed) or any(len(pair) != 2 for pair in pairs)):
        raise TypeError(f"{argument}: expected (move, weight) pairs, got {moves!r}")
    weighted = [(item, 1.0) for item in listed]
    if pairs:
        label = f"{argument} (their weights)"
        weighted = [(m, checks.real_number(label, w, 0.0)) for m, w in pairs]
    for move, _ in weighted:
        if isinstance(move, type) or not hasattr(move, "propose"):
            raise TypeError(
                f"{argument}: expected an emcee move, a list of moves or of (move, "
                f"weight), or 'auto', got {move!r}"
                + (f"; write {move.__name__}()" if isinstance(move, type) else "")
            )
    if not sum(weight for _, weight in weighted) > 0:
        raise ValueError(f"{argument}: expected a weight above zero, got {moves!r}")
    return weighted


def check_walkers(
    nwalkers: int | None,
    weighted: list[tuple[Move, float]] | None,
    posterior: LogPosterior,
    few: bool = False,
) -> int:
    """Return the walkers per ensemble, by default what is usual for the moves.

    Few serve a run that ends by its verdict, for which it takes many steps of each.
    """
    ndim = posterior.ndim
    moves = [DEMCMove()] if weighted is None else [move for move, _ in weighted]
    usual = max(8, 2 * ndim) if few else max(16, 4 * ndim)
    usual *= len(ladder_of(moves))
    number = checks.whole_number("nwalkers", usual if nwalkers is None else nwalkers, 1)
    for move in moves:
        if check := getattr(move, "check", None):
            check(number, ndim)
        if isinstance(move, HamiltonianMove):
            move.leapfrog(posterior)  # refuses one without gradients
    return number
