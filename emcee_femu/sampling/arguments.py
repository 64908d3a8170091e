"""What ``run`` is given: moves, progress, pools and backends, checked."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.pool import Pool, ThreadPool
from typing import Any

import emcee

from .. import checks
from .pools.pickling import pickled


def check_moves(argument: str, moves: Any) -> None:
    """Refuse what emcee would take for a move, a list of moves or weighted pairs.

    Raises:
        TypeError: If something is no move, or pairs are mixed with moves.
        ValueError: If there is no move, or weights are negative or all zero.
    """
    given = listed(moves)
    if not given:
        raise ValueError(f"{argument}: expected at least one move, got none")
    for move in given:
        if isinstance(move, type) or not hasattr(move, "propose"):
            raise TypeError(
                f"{argument}: expected an emcee move, a list of moves or of (move, "
                f"weight), got {move!r}"
            )
    if not isinstance(moves, Sequence):
        return
    pairs = [item for item in moves if isinstance(item, Sequence)]
    if not pairs:
        return
    if len(pairs) < len(moves) or any(len(pair) != 2 for pair in pairs):
        raise TypeError(
            f"{argument}: expected (move, weight) throughout, got {moves!r}"
        )
    weights = [
        checks.real_number(f"{argument} (their weights)", weight, 0.0)
        for _, weight in pairs
    ]
    if not sum(weights) > 0:
        raise ValueError(f"{argument}: expected a weight above zero, got {weights}")


def check_progress(progress: Any) -> None:
    """Refuse what is neither True, False nor the name of a bar of tqdm."""
    if not isinstance(progress, str):
        checks.flag("progress", progress)
        return
    bars = emcee.pbar.tqdm
    if bars is not None and not hasattr(bars, f"tqdm_{progress}"):
        raise ValueError(
            f"progress: expected True, False or a bar of tqdm, such as 'notebook', got "
            f"{progress!r}"
        )


def check_picklable(pool: Any, function: Any) -> None:
    """Refuse, naming the part to blame, what processes cannot be sent."""
    of_processes = isinstance(pool, ProcessPoolExecutor | Pool)
    if of_processes and not isinstance(pool, ThreadPool):
        pickled(function)


def listed(moves: Any) -> list[Any]:
    """Return the moves of what emcee accepts: a move, a list, or weighted pairs."""
    if not isinstance(moves, Sequence):
        return [moves]
    return [
        item[0] if isinstance(item, Sequence) and len(item) else item for item in moves
    ]


def backend_list(backend: Any, ensembles: int) -> list[Any]:
    """Return one empty backend an ensemble, or None for emcee's own.

    Raises:
        TypeError: If one is no backend.
        ValueError: If there are too few or too many, or one holds steps.
    """
    if backend is None:
        return [None] * ensembles
    backends = list(backend) if isinstance(backend, Sequence) else [backend]
    if len(backends) != ensembles:
        raise ValueError(
            f"backend: expected one for each of {ensembles} ensembles, "
            f"got {len(backends)}"
        )
    for own in backends:
        if isinstance(own, type) or not hasattr(own, "initialized"):
            raise TypeError(
                "backend: expected None, the name of a file, or emcee backends, got "
                f"{own!r}"
            )
        if own.initialized and own.iteration:
            raise ValueError(
                f"backend: {own!r} already holds {own.iteration} steps of another "
                "run; give a new file name, or call its reset()"
            )
    return backends
