"""Check the arguments of a run before the first solve."""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from emcee.backends import Backend
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats, Move
from ..moves import DEMCMove, HamiltonianMove
from ..moves.proposing import ladder_of
from ..posterior.log_posterior import LogPosterior

Moves: TypeAlias = Move | Sequence[Move] | Sequence[tuple[Move, float]]


def weigh_moves(moves: object, argument: str = "moves") -> list[tuple[Move, float]]:
    """Return moves with weights, given one move, a list of them, or weighted pairs."""
    listed: list[Any] = list(moves) if isinstance(moves, list | tuple) else [moves]
    pairs = [item for item in listed if isinstance(item, list | tuple)]
    if pairs and (len(pairs) < len(listed) or any(len(pair) != 2 for pair in pairs)):
        raise TypeError(f"{argument}: expected (move, weight) pairs, got {moves!r}")
    if isinstance(moves, np.ndarray):
        raise TypeError(
            f"{argument}: expected emcee moves, or 'auto', got an array of shape "
            f"{moves.shape}; positions of walkers are starts="
        )
    weighted = [(item, 1.0) for item in listed]
    if pairs:
        label = f"{argument} (their weights)"
        weighted = [(m, checks.real_number(label, w, 0.0)) for m, w in pairs]
    for move, _ in weighted:
        remedy = f"; write {move.__name__}()" if isinstance(move, type) else ""
        if isinstance(moves, tuple) and len(moves) == 2 and move is moves[1]:
            remedy = "; write [(move, weight)]"
        if remedy or not hasattr(move, "propose"):
            raise TypeError(
                f"{argument}: expected an emcee move, a list of moves or of (move, "
                f"weight), or 'auto', got {move!r}{remedy}"
            )
    if not sum(weight for _, weight in weighted) > 0:
        expected = "at least one move of a weight above zero"
        raise ValueError(f"{argument}: expected {expected}, got {moves!r}")
    return weighted


def check_walkers(
    nwalkers: int | None,
    weighted: list[tuple[Move, float]] | None,
    posterior: LogPosterior,
    few: bool = False,
) -> int:
    """Return the walkers per ensemble, by default what is usual for the moves.

    A run that ends by its verdict (``few``) needs fewer walkers, because it takes many
    steps.
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


def check_starts(
    starts: ArrayLike | None, posterior: LogPosterior, ensembles: int, nwalkers: int
) -> Floats | None:
    """Return starts ``(ensembles, nwalkers, ndim)``, all inside the bounds."""
    if starts is None:
        return None
    # A copy in double precision: emcee would truncate steps from integer starts.
    points = checks.real_array("starts", starts)
    if points.ndim == 2 and ensembles == 1:
        points = points[None]
    expected = (ensembles, nwalkers, posterior.ndim)
    remedy = "they are (ensembles, nwalkers, ndim)"
    checks.shaped("starts", points.shape, expected, remedy=remedy)
    posterior.check_inside("starts", points.reshape(-1, posterior.ndim))
    together = (points == points[:, :1]).all(axis=(1, 2))
    if nwalkers > 1 and together.any():
        raise ValueError(
            f"starts: all walkers of ensemble {np.argmax(together)} start at one "
            "point, from which few moves get away; scatter them a little"
        )
    return points


def check_backends(
    backend: Backend | Sequence[Backend] | None, ensembles: int
) -> list[Backend | None]:
    """Return one empty emcee backend per ensemble, or None for each."""
    if backend is None:
        return [None] * ensembles
    backends: list[Backend] = checks.one_or_several(backend)
    if len(backends) != ensembles:
        raise ValueError(
            f"backend: expected one for each of {ensembles} ensembles, "
            f"got {len(backends)}"
        )
    for chain in backends:
        if not hasattr(chain, "initialized"):
            raise TypeError(
                "backend: expected None, the name of a file, or emcee backends, got "
                f"{chain!r}"
            )
        if chain.initialized and chain.iteration:
            raise ValueError(
                f"backend: {chain!r} already holds {chain.iteration} steps of another "
                "run; give a new file name, or call its reset()"
            )
    return backends
