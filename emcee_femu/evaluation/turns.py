"""Ensembles that advance together: while one waits for the pool, others compute.

One thread each, of which one at a time is at work here: emcee, counts and files need
no locks of their own. Only waiting for the workers is done by all at once.
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from threading import Lock
from typing import Any

from .evaluator import Evaluation
from .pools import EvaluationPool, Function


class Turn(EvaluationPool):
    """A pool, during whose work others have their turn.

    Args:
        pool: The pool.
    """

    def __init__(self, pool: EvaluationPool) -> None:
        self.pool, self.lock, self.ended = pool, Lock(), False

    def map(self, function: Function, iterable: Iterable[object]) -> list[Any]:
        """Return what the pool does."""
        self.lock.release()
        try:
            return self.pool.map(function, iterable)
        finally:
            self.lock.acquire()
            self.check()

    def check(self) -> None:
        """End a thread if another one has failed."""
        if self.ended:
            raise RuntimeError("another ensemble failed, or the run was interrupted")


def take_turns(
    evaluations: Sequence[Evaluation], advance: Callable[[int], None]
) -> None:
    """Advance all ensembles, so that their evaluations are on the pool together.

    Args:
        evaluations: What evaluates each of them, on one pool.
        advance: Runs one ensemble, of that number, to its end.

    Raises:
        BaseException: What the first that failed raised.
    """
    pool, ensembles = evaluations[0].pool, range(len(evaluations))
    assert pool is not None
    turn = Turn(pool)
    for evaluation in evaluations:
        evaluation.pool = turn

    def work(number: int) -> None:
        with turn.lock:
            turn.check()
            advance(number)

    threads = ThreadPoolExecutor(len(ensembles))
    try:
        for future in as_completed([threads.submit(work, i) for i in ensembles]):
            future.result()
    except BaseException:  # also of the keyboard: the others stop where they wait
        with turn.lock:
            turn.ended = True
        raise
    finally:
        threads.shutdown(wait=False)
        for evaluation in evaluations:
            evaluation.pool = pool
