"""What moves remember, of each ensemble by itself, kept in the file of a run.

A run that is resumed knows the walkers, the random stream, and what the moves say that
they remember. With a file, each step is therefore made again from what that holds.
"""

import json
from collections.abc import Iterator, Sequence
from copy import deepcopy
from typing import Any, TypeAlias

import numpy as np

from ..contracts import Floats, Move, read_declared
from .evaluator import Evaluation

PACKAGE = __name__.partition(".")[0]

Weighted: TypeAlias = Sequence[tuple[Move, float]]
Found: TypeAlias = tuple[Floats, Floats]  # points (n, d), and their rows


def copy_moves(weighted: Weighted) -> list[tuple[Move, float]]:
    """Copy moves for one ensemble, so that ensembles share no memory.

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


def foreign_moves(weighted: Weighted) -> Iterator[Move]:
    """Yield the moves, and those inside of others, that are not of this package.

    The package's own keep counts and caches, which change no proposal.
    """
    for outer, _ in weighted:
        move: Move | None = outer
        while move is not None:
            if type(move).__module__.partition(".")[0] != PACKAGE:
                yield move
            move = getattr(move, "inner", None)


def remember(weighted: Weighted) -> str:
    """Return the state of moves as JSON.

    Raises:
        TypeError: If JSON cannot hold it.
    """
    moves = _moves_with_state(weighted)
    try:
        return json.dumps([move.state() for move in moves])
    except TypeError as error:
        raise TypeError(
            f"moves: expected state() of {name_moves(moves)} to return what JSON can "
            f"hold, such as array.tolist() ({error})"
        ) from error


def restore(weighted: Weighted, remembered: str) -> None:
    """Let moves remember what :func:`remember` returned."""
    states = json.loads(remembered)
    for move, state in zip(_moves_with_state(weighted), states, strict=True):
        move.restore(state)


def _moves_with_state(weighted: Weighted) -> list[Any]:
    return [move for move in foreign_moves(weighted) if read_declared(move, "state")]


def name_moves(moves: Iterator[object] | Sequence[object]) -> str:
    """Return the classes of moves in words."""
    return ", ".join(dict.fromkeys(type(move).__name__ for move in moves))


class Replay(Evaluation):
    """An evaluation that gives again what was found, and refuses all else.

    Args:
        evaluation: What found it. Gradients are evaluated anew, and not counted there.
        found: Points ``(n, d)`` and their rows, in the order of the calls.

    Attributes:
        left: What was not asked for again.
        strayed: Whether something else was asked for.
    """

    def __init__(self, evaluation: Evaluation, found: list[Found]) -> None:
        part = evaluation.part()
        super().__init__(part.solver, part.pool, part.failures)
        self.left, self.strayed = found, False

    def rows(self, theta: Floats) -> Floats:
        """Return the stored rows of these points, or rows of zero density."""
        if self.left and np.array_equal(self.left[0][0], theta):
            return self.left.pop(0)[1]
        self.strayed = True
        return np.tile(self.posterior.rejected(), (len(theta), 1))
