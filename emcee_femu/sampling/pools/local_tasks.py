"""Tasks of executors and pools in Python: processes, threads, MPI."""

from concurrent.futures import BrokenExecutor, Executor, Future
from queue import SimpleQueue
from typing import Any

from .process_watch import ProcessWatch
from .tasks import worker_lost
from .worker import Outcome, evaluate, evaluate_task


class ExecutorTasks:
    """Of a ``concurrent.futures.Executor``."""

    def __init__(self, executor: Executor) -> None:
        """See the class."""
        self._executor = executor
        self._futures: list[Future[Outcome]] = []
        self._done: SimpleQueue[tuple[int, Future[Outcome]]] = SimpleQueue()

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        """See :class:`tasks.Tasks`."""
        try:
            future = self._executor.submit(evaluate, digest, points, payload)
        except BrokenExecutor as error:
            raise worker_lost("the executor") from error
        except RuntimeError as error:
            raise RuntimeError(
                f"pool: the executor takes no tasks ({error}); make a new one"
            ) from error
        self._futures.append(future)
        future.add_done_callback(lambda done: self._done.put((number, done)))

    def wait(self) -> tuple[int, Outcome]:
        """See :class:`tasks.Tasks`."""
        number, future = self._done.get()
        try:
            return number, future.result()
        except BrokenExecutor as error:
            raise worker_lost("the executor") from error

    def abandon(self) -> None:
        """See :class:`tasks.Tasks`."""
        for future in self._futures:
            future.cancel()


class PoolTasks:
    """Of a ``multiprocessing.pool.Pool`` and its likes (schwimmbad, ray)."""

    def __init__(self, pool: Any, watch: ProcessWatch) -> None:
        """See the class."""
        watch.check()
        self._pool, self._watch = pool, watch
        self._done: SimpleQueue[tuple[int, Any]] = SimpleQueue()

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        """See :class:`tasks.Tasks`."""

        def done(result: Any) -> None:
            self._done.put((number, result))

        self._pool.apply_async(
            evaluate, (digest, points, payload), callback=done, error_callback=done
        )

    def wait(self) -> tuple[int, Outcome]:
        """See :class:`tasks.Tasks`."""
        number, result = self._watch.get(self._done)
        if isinstance(result, BaseException):
            raise result
        return number, result

    def abandon(self) -> None:
        """Nothing: such a pool cannot take a task back."""


class MapTasks:
    """Of anything with a blocking ``map``, such as schwimmbad's MPIPool."""

    def __init__(self, pool: Any) -> None:
        """See the class."""
        self._pool = pool
        self._waiting: list[tuple[int, tuple[Any, ...]]] = []
        self._done: list[tuple[int, Outcome]] = []

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        """See :class:`tasks.Tasks`."""
        self._waiting.append((number, (digest, points, payload)))

    def wait(self) -> tuple[int, Outcome]:
        """See :class:`tasks.Tasks`."""
        if not self._done:
            numbers, tasks = zip(*self._waiting, strict=True)
            self._waiting = []
            outcomes = self._pool.map(evaluate_task, list(tasks))
            self._done = list(zip(numbers, outcomes, strict=True))
        return self._done.pop()

    def abandon(self) -> None:
        """Nothing: the tasks of a blocking map are done."""
