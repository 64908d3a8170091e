"""What moves remember: of each ensemble its own, kept in the file of a run.

A run that is resumed knows the walkers, the random stream, and what the moves say that
they remember. With a file, each step is therefore made again from what that holds.
"""

import json
from collections.abc import Iterator, Sequence
from copy import deepcopy
from typing import Any, TypeAlias

import numpy as np

from ..contracts import Floats, Move
from .evaluator import Evaluation
from .failures import FailureLog

PACKAGE = __name__.partition(".")[0]

Weighted: TypeAlias = Sequence[tuple[Move, float]]


def copy_moves(weighted: Weighted) -> list[tuple[Move, float]]:
    """Return moves for one ensemble, which share no memory with those of others.

    Raises:
        TypeError: If one cannot be copied.
    """
    try:
        return deepcopy([*weighted])
    except TypeError as error:
        raise TypeError(
            "moves: every ensemble has moves of its own, but "
            f"{name_moves(move for move, _ in weighted)} cannot be copied ({error}); "
            "a move that holds such an object needs __deepcopy__(memo)"
        ) from error


def foreign_moves(weighted: Weighted) -> Iterator[Any]:
    """Yield the moves, and those inside of others, that are not of this package.

    What its own ones keep, counts and what saves evaluations, changes no proposal.
    """
    move: Any
    for move, _ in weighted:
        while hasattr(move, "propose"):
            if type(move).__module__.partition(".")[0] != PACKAGE:
                yield move
            move = getattr(move, "inner", None)


def remember(weighted: Weighted) -> str:
    """Return what moves say that they remember, as JSON.

    Raises:
        TypeError: If JSON cannot hold it.
    """
    moves = [move for move in foreign_moves(weighted) if hasattr(move, "state")]
    try:
        return json.dumps([move.state() for move in moves])
    except TypeError as error:
        raise TypeError(
            f"moves: expected state() of {name_moves(moves)} to return what JSON can "
            f"hold, such as array.tolist() ({error})"
        ) from error


def restore(weighted: Weighted, remembered: str) -> None:
    """Let moves remember what :func:`remember` returned."""
    moves = [move for move in foreign_moves(weighted) if hasattr(move, "state")]
    for move, state in zip(moves, json.loads(remembered), strict=True):
        move.restore(state)


def name_moves(moves: Iterator[object] | Sequence[object]) -> str:
    """Return the classes of moves in words."""
    return ", ".join(dict.fromkeys(type(move).__name__ for move in moves))


class Replay:
    """An evaluator that gives again what was found, and refuses all else.

    Args:
        evaluation: What found it. Gradients are asked of it anew, and not counted.
        found: Points ``(n, d)`` and their rows, in the order of the calls.

    Attributes:
        left: What was not asked for again.
        strayed: Whether something else was asked for.
    """

    def __init__(
        self, evaluation: "Evaluation | Replay", found: list[tuple[Floats, Floats]]
    ) -> None:
        log = None if evaluation.failures is None else FailureLog(1.0)
        self._anew = Evaluation(evaluation.solver, evaluation.pool, log)
        self.left, self.strayed = found, False

    def __getattr__(self, name: str) -> Any:
        """Return what else an evaluator has."""
        return getattr(self._anew, name)

    def rows(self, theta: Floats) -> Floats:
        """Return the rows that were found at these points, or those of a zero."""
        if self.left and np.array_equal(self.left[0][0], theta):
            return self.left.pop(0)[1]
        self.strayed = True
        return np.tile(self._anew.posterior.rejected(), (len(theta), 1))
