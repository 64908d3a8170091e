"""One way to hand tasks to executors, pools, dask and ray; none is imported here.

Each back end is what its owner made, and stays with its owner: nothing is started or
shut down here. Tasks are handed out with ``submit``, and ``wait`` returns the number
and the outcome of the next one that is done.
"""

import inspect
import pickle
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from multiprocessing.pool import ThreadPool
from queue import SimpleQueue
from typing import Any, Protocol

from .process_watch import ProcessWatch
from .worker import Outcome, evaluate, evaluate_task

MOST_LOSSES = 10  # tasks that dask may lose in one map, before it is given up


class Tasks(Protocol):
    """The tasks of one ``map``."""

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        """Hand out ``evaluate(digest, points, payload)``."""

    def wait(self) -> tuple[int, Outcome]:
        """Wait for a task that is done, and return its number and its outcome."""

    def abandon(self) -> None:
        """Drop what is still waiting."""


@dataclass(frozen=True)
class BackEnd:
    """How to use an executor, pool or client.

    Attributes:
        tasks: Opens the tasks of one ``map``.
        workers: Counts the workers; None where that is unknown.
        dumps: Pickles the function; None where the workers share the memory.
    """

    tasks: Callable[[], Tasks]
    workers: Callable[[], int | None]
    dumps: Callable[[Any], bytes] | None = pickle.dumps


def back_end(executor: Any) -> BackEnd:
    """Recognise an executor, pool or client by what it has.

    Raises:
        TypeError: If it is none of them.
        ValueError: If ray was not started.
    """
    if isinstance(executor, Executor):
        dumps = None if isinstance(executor, ThreadPoolExecutor) else pickle.dumps
        return BackEnd(
            partial(_ExecutorTasks, executor), partial(_executor_size, executor), dumps
        )
    if inspect.ismodule(executor) and executor.__name__ == "ray":
        if not executor.is_initialized():
            raise ValueError("executor: ray was not started; call ray.init() first")
        return BackEnd(
            partial(_RayTasks, executor, executor.remote(evaluate)),
            lambda: int(executor.cluster_resources().get("CPU", 1)),
            _cloudpickle,
        )
    if all(hasattr(executor, name) for name in ("scatter", "submit", "nthreads")):
        if executor.asynchronous:
            raise TypeError("executor: expected a dask Client with asynchronous=False")
        return BackEnd(
            partial(_DaskTasks, executor),
            lambda: sum(executor.nthreads().values()),
            _cloudpickle,
        )
    if hasattr(executor, "apply_async"):
        watch = ProcessWatch(executor)
        return BackEnd(
            partial(_PoolTasks, executor, watch),
            lambda: getattr(executor, "_processes", None),
            None if isinstance(executor, ThreadPool) else pickle.dumps,
        )
    if hasattr(executor, "map") and not inspect.isclass(executor):
        return BackEnd(partial(_MapTasks, executor), partial(_map_size, executor))
    raise TypeError(
        "executor: expected a concurrent.futures executor, a multiprocessing or "
        "schwimmbad pool, a dask.distributed Client or the module ray, got "
        f"{executor!r}"
    )


def _executor_size(executor: Any) -> int | None:
    for name in ("_max_workers", "num_workers"):  # the standard library; mpi4py
        if hasattr(executor, name):
            return int(getattr(executor, name))
    return None


def _map_size(pool: Any) -> int | None:
    size = getattr(pool, "size", None)
    return None if size is None else max(1, size)  # schwimmbad's SerialPool has 0


def _cloudpickle(value: Any) -> bytes:
    """Pickle as dask and ray do: what stands in the user's script goes by value."""
    result: bytes = import_module("cloudpickle").dumps(value)
    return result


class _ExecutorTasks:
    """Of a ``concurrent.futures.Executor``."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._futures: list[Future[Outcome]] = []
        self._done: SimpleQueue[tuple[int, Future[Outcome]]] = SimpleQueue()

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        try:
            future = self._executor.submit(evaluate, digest, points, payload)
        except BrokenExecutor as error:
            raise _worker_lost("the executor") from error
        self._futures.append(future)
        future.add_done_callback(lambda done: self._done.put((number, done)))

    def wait(self) -> tuple[int, Outcome]:
        number, future = self._done.get()
        try:
            return number, future.result()
        except BrokenExecutor as error:
            raise _worker_lost("the executor") from error

    def abandon(self) -> None:
        for future in self._futures:
            future.cancel()


class _PoolTasks:
    """Of a ``multiprocessing.pool.Pool`` and its likes (schwimmbad, ray)."""

    def __init__(self, pool: Any, watch: ProcessWatch) -> None:
        watch.check()
        self._pool, self._watch = pool, watch
        self._done: SimpleQueue[tuple[int, Any]] = SimpleQueue()

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        def done(result: Any) -> None:
            self._done.put((number, result))

        self._pool.apply_async(
            evaluate, (digest, points, payload), callback=done, error_callback=done
        )

    def wait(self) -> tuple[int, Outcome]:
        number, result = self._watch.get(self._done)
        if isinstance(result, BaseException):
            raise result
        return number, result

    def abandon(self) -> None:
        """Nothing: such a pool cannot take a task back."""


class _DaskTasks:
    """Of a ``distributed.Client``."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._completed = import_module("distributed").as_completed(with_results=True)
        self._arguments: dict[str, tuple[int, str | None, Any, Any]] = {}
        self._carrier: Any = None  # the payload, which the workers pass on
        self._losses = 0

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        carrier = None
        if payload is not None:
            if self._carrier is None:
                self._carrier = self._client.scatter(payload, hash=False)
            carrier = self._carrier
        future = self._client.submit(evaluate, digest, points, carrier, pure=False)
        self._arguments[future.key] = (number, digest, points, payload)
        self._completed.add(future)

    def wait(self) -> tuple[int, Outcome]:
        distributed = import_module("distributed")
        while True:
            try:
                future, outcome = next(self._completed)
            except distributed.KilledWorker as error:
                raise _worker_lost("the dask cluster") from error
            if isinstance(outcome, Outcome):
                return self._arguments[future.key][0], outcome
            # What dask could not compute again: the payload was on the lost worker.
            self._losses += 1
            if self._losses > MOST_LOSSES:
                raise _worker_lost("the dask cluster") from outcome
            if not self._carrier_holds():
                self._carrier = None
            self.submit(*self._arguments[future.key])

    def _carrier_holds(self) -> bool:
        return self._carrier is not None and self._carrier.status == "finished"

    def abandon(self) -> None:
        self._completed.clear()  # dask forgets a future that nobody holds


class _RayTasks:
    """Of the module ray."""

    def __init__(self, ray: Any, remote: Any) -> None:
        self._ray, self._remote = ray, remote
        self._numbers: dict[Any, int] = {}
        self._carrier: Any = None  # the payload, in ray's store

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        if payload is not None:
            if self._carrier is None:
                self._carrier = self._ray.put(payload)
            payload = self._carrier
        self._numbers[self._remote.remote(digest, points, payload)] = number

    def wait(self) -> tuple[int, Outcome]:
        (done,), _ = self._ray.wait(list(self._numbers), num_returns=1)
        try:
            return self._numbers.pop(done), self._ray.get(done)
        except self._ray.exceptions.RayError as error:
            raise _worker_lost("ray") from error

    def abandon(self) -> None:
        for reference in self._numbers:
            self._ray.cancel(reference)


class _MapTasks:
    """Of anything with a blocking ``map``, such as schwimmbad's MPIPool."""

    def __init__(self, pool: Any) -> None:
        self._pool = pool
        self._waiting: list[tuple[int, tuple[Any, ...]]] = []
        self._done: list[tuple[int, Outcome]] = []

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        self._waiting.append((number, (digest, points, payload)))

    def wait(self) -> tuple[int, Outcome]:
        if not self._done:
            numbers, tasks = zip(*self._waiting, strict=True)
            self._waiting = []
            outcomes = self._pool.map(evaluate_task, list(tasks))
            self._done = list(zip(numbers, outcomes, strict=True))
        return self._done.pop()

    def abandon(self) -> None:
        """Nothing: the tasks of a blocking map are done."""


def _worker_lost(owner: str) -> RuntimeError:
    return RuntimeError(
        f"pool: a worker of {owner} died (out of memory, killed, or a crash in the "
        "solver's own code); what was sampled so far is kept in the backend: start the "
        "workers anew and resume"
    )
