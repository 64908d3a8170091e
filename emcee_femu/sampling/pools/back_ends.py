"""One way to hand tasks to executors, pools, dask and ray; none is imported here.

Each back end is what its owner made, and stays with its owner: nothing is started or
shut down here. Tasks are handed out with ``submit``, and ``wait`` returns the number
and the outcome of the next one that is done.
"""

import inspect
import pickle
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from multiprocessing.pool import ThreadPool
from typing import Any

from .cluster_tasks import DaskTasks, RayTasks, dask_size, ray_size
from .local_tasks import ExecutorTasks, MapTasks, PoolTasks
from .process_watch import ProcessWatch
from .tasks import Tasks
from .worker import evaluate


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
            partial(ExecutorTasks, executor), partial(_executor_size, executor), dumps
        )
    if inspect.ismodule(executor) and executor.__name__ == "ray":
        if not executor.is_initialized():
            raise ValueError("executor: ray was not started; call ray.init() first")
        return BackEnd(
            partial(RayTasks, executor, executor.remote(evaluate)),
            partial(ray_size, executor),
            _cloudpickle,
        )
    if all(hasattr(executor, name) for name in ("scatter", "submit", "nthreads")):
        if executor.asynchronous:
            raise TypeError("executor: expected a dask Client with asynchronous=False")
        return BackEnd(
            partial(DaskTasks, executor),
            partial(dask_size, executor),
            _cloudpickle,
        )
    if hasattr(executor, "apply_async"):
        watch = ProcessWatch(executor)
        return BackEnd(
            partial(PoolTasks, executor, watch),
            lambda: getattr(executor, "_processes", None),
            None if isinstance(executor, ThreadPool) else pickle.dumps,
        )
    if hasattr(executor, "map") and not inspect.isclass(executor):
        return BackEnd(partial(MapTasks, executor), partial(_map_size, executor))
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
