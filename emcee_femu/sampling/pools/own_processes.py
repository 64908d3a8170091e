"""The processes of ``run(..., workers=8)``: they begin and end with the run."""

import multiprocessing
import os
import sys
import traceback
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from ... import checks
from .evaluation_pool import EvaluationPool
from .executors import check_executor
from .worker import begin, functions


@contextmanager
def open_pool(pool: Any, workers: Any, one_by_one: bool) -> Iterator[Any]:
    """Yield what evaluates for a run: None, a pool, or processes of its own.

    These end with the block; after an error at once, even in the middle of a solve.
    They get one task per walker if a batch is no quicker than that (``one_by_one``).

    Raises:
        TypeError, ValueError: If workers is not a whole number >= 1, or both are given.
        RuntimeError: If a worker process imports the script that calls ``run``.
    """
    _refuse_import()
    if workers is None:
        if pool is not None and not isinstance(pool, EvaluationPool):
            check_executor("pool", pool)
            pool = EvaluationPool(pool, chunksize=1)
        yield pool
        return
    workers = checks.whole_number("workers", workers, 1)
    if pool is not None:
        raise ValueError("workers: expected no pool beside it; give one of the two")
    method = multiprocessing.get_start_method(allow_none=True)
    if method is None and sys.platform == "linux":
        method = "fork"
    context = multiprocessing.get_context(method)
    forks = context.get_start_method() == "fork"
    kind = ForkedPool if forks else EvaluationPool
    reader, writer = context.Pipe(duplex=False)
    executor = OwnProcesses(workers, context, begin, (reader, writer))
    with reader, writer, executor:
        try:
            yield kind(executor, chunksize=1 if one_by_one else None)
        except BaseException:
            writer.send_bytes(b"end")
            raise


class OwnProcesses(ProcessPoolExecutor):
    """Processes whose tasks are never cancelled.

    Python before 3.13 leaves processes behind if they end while tasks are cancelled.
    """

    argument = "workers"  # which asked for them

    def map(self, fn: Any, *iterables: Any, **options: Any) -> Iterator[Any]:
        """Yield results in order; after an error the other tasks end with the run."""
        futures = [self.submit(fn, *task) for task in zip(*iterables, strict=True)]
        return (future.result() for future in futures)


class ForkedPool(EvaluationPool):
    """A pool whose processes are forked at the first evaluation, and inherit it all."""

    def _pickle(self, function: Any) -> tuple[str, bytes]:
        if self._pickles:
            return super()._pickle(function)
        digest = f"inherited from {os.getpid()}"
        self._pickles = [(function, digest, b"")]
        functions[digest] = function
        with warnings.catch_warnings():
            # Python warns of locks that other threads may hold: workers need none.
            warnings.filterwarnings("ignore", ".*fork", DeprecationWarning)
            self._executor.submit(int)  # forks all processes
        del functions[digest]
        return digest, b""


def _refuse_import() -> None:
    """Raise where a spawned process imports a script without a guard."""
    for frame, _ in traceback.walk_stack(None):
        module = frame.f_globals.get("__name__")
        if module == "__mp_main__" and frame.f_code.co_name == "<module>":
            raise RuntimeError(
                "run: a worker process is importing this script and came to its run; "
                'put what the script does under `if __name__ == "__main__":`'
            )
