"""A pool that ships the posterior once, and then only coordinates."""

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from importlib import import_module
from itertools import count
from multiprocessing.connection import Connection, wait
from multiprocessing.pool import ThreadPool
from typing import Any, NamedTuple, TypeAlias

from emcee.ensemble import _FunctionWrapper

from .. import checks

# Functions a worker keeps; an older one is sent again when it is needed.
KEPT_FUNCTIONS = 8
functions: dict[str, "Function"] = {}  # of this process, by key

NOT_LOADED = (
    "The worker could not load the function: it must be in a module that workers can"
    " import, or need only such modules"
)
_watched: set[int] = set()  # processes (forks inherit it) that end with their run

# Key of a function; points; its pickle for a worker that does not have it, else None;
# process id of the run. Threads get no key, but the function itself.
Task: TypeAlias = tuple[str | None, Sequence[object], Any, int]
# Their workers do not have the user's script: what is defined there goes by value.
BY_VALUE = ("distributed", "ray", "loky")
# Of the standard library and loky; mpi4py; schwimmbad.
NUMBERS_OF_WORKERS = ("_max_workers", "num_workers", "size")
HANGING = {"multiprocessing.pool.Pool", "multiprocess.pool.Pool"}
Function: TypeAlias = Callable[[Any], Any]  # of a point
Results: TypeAlias = Iterator[tuple[int, Any]]  # numbers of points, as they come

_keys = count()


class Outcome(NamedTuple):
    """What a worker returns; it raises nothing, since that would end an MPI job."""

    values: Sequence[object] = ()  # one result per point
    missing: bool = False  # the worker does not have the function
    error: BaseException | None = None  # raised by the function
    note: str = ""  # at which point, and the worker's traceback


class EvaluationPool:
    """Evaluate walkers on many processes or machines; pass it as ``pool=``.

    Use it with executors that :func:`run` does not start itself (dask, MPI, ray), to
    share one executor between calls, or in emcee. An ordinary pool receives the
    posterior with every task. Here each worker receives it once: tasks refer to it by a
    key, and a worker that does not have it yet, such as a new one in a growing cluster,
    asks for it. Points are evaluated one at a time, so the results do not depend on the
    number of workers. If a worker dies, an error is raised (dask tries other workers
    first).

    An ensemble can keep at most ``nwalkers / nsplits`` workers busy, where nsplits is
    that of its moves (2 by default); the ensembles of a run use the pool together.
    ``examples/benchmarks/cluster_scaling.py`` shows how time falls with workers. The
    function must not change between calls. Start workers with one thread each for
    linear algebra (``OMP_NUM_THREADS=1``). Close the executor yourself; the worker
    processes of a ``ProcessPoolExecutor`` end by themselves if the run is killed.

    Args:
        executor: A ``concurrent.futures`` executor: processes, threads, loky,
            ``mpi4py.futures.MPIPoolExecutor``, or a ``dask.distributed`` ``Client``
            (wait for its workers first); or any object with a ``map``, such as
            schwimmbad's ``MPIPool`` or ``ray.util.multiprocessing.Pool``.
        chunksize: Parameter sets per task. By default each worker gets an equal share
            (or 1 if their number is unknown), which is best if all solves take the same
            time. Use 1 if the solve time varies, or if the cluster grows on demand.

    Raises:
        TypeError, ValueError: If executor is none of these (``multiprocessing.Pool`` is
            not accepted because it waits forever if a worker dies), chunksize is not a
            whole number >= 1, or, from ``map``, the function cannot be pickled.
        RuntimeError: From ``map``, if a worker died or the executor was closed.

    Examples:
        >>> from concurrent.futures import ThreadPoolExecutor
        >>> import numpy as np
        >>> from emcee_femu import EvaluationPool
        >>> with ThreadPoolExecutor(2) as executor:
        ...     EvaluationPool(executor).map(lambda x: float(x @ x), 2 * np.eye(2))
        [4.0, 4.0]
    """

    argument = "pool"  # by which a user gave it

    def __init__(self, executor: Any, chunksize: int | None = None) -> None:
        kinds = [
            f"{base.__module__}.{base.__name__}" for base in type(executor).__mro__
        ]
        # Threads share memory: nothing is pickled.
        self.threads = isinstance(executor, ThreadPoolExecutor | ThreadPool)
        if not self.threads and {*kinds} & HANGING:
            # It forgets the task of the dead; nor does it end if they held a lock.
            raise TypeError(
                f"pool, executor: {kinds[0]} waits for ever for a worker that died; "
                "give run(..., workers=8), or a concurrent.futures.ProcessPoolExecutor"
            )
        if isinstance(executor, type) or not hasattr(executor, "map"):
            raise TypeError(
                "pool, executor: expected a concurrent.futures executor, a dask Client "
                f"or a pool with a map, got {executor!r}"
            )
        if chunksize is not None:
            chunksize = checks.whole_number("chunksize", chunksize, 1)
        self.chunksize = chunksize
        # How many evaluations run at once; 0 where that is unknown.
        self.n_workers = max(getattr(executor, name, 0) for name in NUMBERS_OF_WORKERS)
        if hasattr(executor, "get_executor"):  # a dask Client
            if executor.asynchronous:
                raise TypeError(
                    "pool, executor: expected a Client with asynchronous=False"
                )
            if executor.status != "closed":  # which its first task says
                self.n_workers = sum(executor.nthreads().values())
            executor = executor.get_executor(pure=False)
        self._executor = executor
        # Whether several threads may use it at once.
        self.takes_turns = hasattr(self._executor, "submit")
        self.shipped: list[tuple[Function, str, bytes]] = []

    def map(self, function: Function, iterable: Iterable[object]) -> list[Any]:
        """Return ``[function(point) for point in iterable]``, evaluated by the workers.

        An exception in the function is raised here, with a note that contains the
        point and the worker's traceback.
        """
        points = list(iterable)
        share = -(-len(points) // self.n_workers) if self.n_workers else 1
        size = self.chunksize or max(1, share)
        parts = [points[i : i + size] for i in range(0, len(points), size)]
        results = dict(self._evaluate(function, parts))
        return [value for i in range(len(parts)) for value in results[i]]

    def each(self, function: Function, points: Sequence[object]) -> Results:
        """Yield the number and result of each point as soon as it is evaluated.

        If the executor only has a ``map``, they come in order.
        """
        for number, values in self._evaluate(function, [[p] for p in points]):
            yield number, values[0]

    def _evaluate(
        self, function: Function, parts: Sequence[Sequence[object]]
    ) -> Results:
        """Yield number and results of each part, as they come."""
        function = unwrap(function)
        key, payload = (None, function) if self.threads else self.ship(function)
        waiting, sent = list(range(len(parts))), payload if self.threads else None
        while waiting:
            tasks = [(key, parts[i], sent, os.getpid()) for i in waiting]
            numbers, waiting, sent = waiting, [], payload
            for place, outcome in self._completed(tasks, payload):
                if outcome.error is not None:
                    outcome.error.add_note(outcome.note)
                    raise outcome.error
                if outcome.missing:
                    waiting.append(numbers[place])
                else:
                    yield numbers[place], outcome.values

    def _completed(self, tasks: list[Task], payload: object) -> Results:
        """Yield number and outcome of each task as it ends.

        A task that a worker without the function returns is submitted again with it at
        once, while the other workers are at theirs.
        """
        try:
            if not self.takes_turns:
                yield from enumerate(self._executor.map(evaluate, tasks))
                return
            submit = self._executor.submit
            running = {submit(evaluate, task): i for i, task in enumerate(tasks)}
            while running:
                again = {}
                for future in as_completed(running):
                    place, outcome = running[future], future.result()
                    if outcome.missing:
                        key, points, _, home = tasks[place]
                        again[submit(evaluate, (key, points, payload, home))] = place
                    else:
                        yield place, outcome
                running = again
        except Exception as error:  # of the executor: an outcome carries the function's
            raise RuntimeError(
                f"pool: {type(self._executor).__name__} could not do its work: a "
                "worker died (out of memory, killed, a crash in the solver's own code) "
                "or could not start (its output says why; where processes are not "
                'forked, put what the script does under `if __name__ == "__main__":`), '
                "or the pool was closed. "
                "What was sampled so far is kept in the backend, if there is one, and "
                "in error.run of what run raises; to go on make a new pool, or let run "
                f"start new workers. {type(error).__name__}: {error}"
            ) from error

    def ship(self, function: Function) -> tuple[str, bytes]:
        """Return the key of a function and the bytes that a worker needs."""
        for known, key, payload in self.shipped:
            if known is function:
                return key, payload
        key = f"{os.getpid()}-{next(_keys)}-{id(self)}"
        payload = _dump(self.argument, self._executor, function)
        self.shipped = [(function, key, payload), *self.shipped][:KEPT_FUNCTIONS]
        return key, payload


@contextmanager
def open_pool(
    pool: object, workers: int | None, function: Function
) -> Iterator[EvaluationPool | None]:
    """Yield the pool of a run: None, the given one, or new processes.

    Args:
        pool: What :class:`EvaluationPool` takes, or one; None for none.
        workers: The number of processes that begin now and end with the run.
        function: What will be evaluated, which forked processes inherit.
    """
    if workers is None:
        if pool is not None and not isinstance(pool, EvaluationPool):
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
    reader, writer = context.Pipe(duplex=False)
    executor = ProcessPoolExecutor(workers, context, begin, (reader, writer))
    opened = EvaluationPool(executor, chunksize=1)
    opened.argument = "workers"
    with reader, writer, executor:
        try:
            if context.get_start_method() == "fork":
                key = f"inherited from {os.getpid()}-{next(_keys)}"
                opened.shipped, functions[key] = [(function, key, b"")], function
                with warnings.catch_warnings():
                    # Python warns of locks that other threads may hold: none is needed.
                    warnings.filterwarnings("ignore", ".*fork", DeprecationWarning)
                    executor.submit(int).result()  # forks all processes
                del functions[key]
            yield opened
        except BaseException:
            writer.send_bytes(b"end")  # whatever they are at
            raise


def count_workers(pool: object, workers: int | None) -> int:
    """Return how many evaluations :func:`open_pool` runs at once; 1 if unknown."""
    if workers is not None:
        return checks.whole_number("workers", workers, 1)
    with open_pool(pool, None, len) as opened:  # which evaluates nothing
        return 1 if opened is None else max(1, opened.n_workers)


def _dump(argument: str, executor: object, function: Function) -> bytes:
    """Pickle for the workers of an executor; pickle's message names what it cannot."""
    by_value = type(executor).__module__.partition(".")[0] in BY_VALUE
    by_value |= not hasattr(sys.modules["__main__"], "__file__")  # of a notebook
    why, remedy = "workers cannot import what a script or a notebook defines", ""
    try:
        payload = pickle.dumps(function)
        if not by_value or b"__main__" not in payload:
            return payload
    except Exception as error:  # a pickler raises what it likes
        why = str(error)
    try:
        return bytes(import_module("cloudpickle").dumps(function))
    except ImportError:
        remedy = "pip install cloudpickle, or "
    except Exception as error:
        why = str(error)
    raise TypeError(
        f"{argument}: the function cannot be pickled for the workers ({why}); {remedy}"
        "write functions at the top level of a module, and open files, locks and "
        "programs inside the call; or give pool=ThreadPoolExecutor(8), which pickles "
        "nothing, or workers=8, which on Linux does not either unless a start method "
        "other than fork was set"
    )


def evaluate(task: Task) -> Outcome:
    """Evaluate a function at every point, one after another."""
    key, points, payload, home = task
    _end_with_run(home)
    function = payload if key is None else functions.get(key)
    if function is None:
        if payload is None:
            return Outcome(missing=True)
        try:
            function = pickle.loads(payload)
        except Exception as error:
            return _fail(error, NOT_LOADED)
        functions[str(key)] = function
        for old in list(functions)[:-KEPT_FUNCTIONS]:
            functions.pop(old, None)  # another thread may have done so
    values = []
    for point in points:
        try:
            values.append(function(point))
        except (Exception, SystemExit) as error:  # a script may end with sys.exit
            return _fail(error, "Raised on a worker", f" at {point}")
    return Outcome(values)


def begin(reader: Connection, writer: Connection) -> None:
    """Begin a worker process, which ends when its run says so or dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the run's business
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # whatever the run's handler does
    writer.close()  # only the run holds it
    _watched.add(os.getpid())
    _end_after(lambda: wait([reader]))


def _end_with_run(home: int) -> None:
    """Let a worker end with the run ``home`` that started it, not wait for ever."""
    if os.getpid() not in _watched:
        _watched.add(os.getpid())
        parent = multiprocessing.parent_process()
        if parent is not None and parent.pid == home:
            _end_after(parent.join)


def _end_after(event: Callable[[], object]) -> None:
    def watch() -> None:
        event()
        os._exit(1)  # the main thread may be in the solver

    threading.Thread(target=watch, daemon=True).start()


def _fail(error: BaseException, note: str, where: str = "") -> Outcome:
    trace = "".join(traceback.format_exception(error)).rstrip()
    notes = getattr(error, "__notes__", ())  # they may say where
    if isinstance(error, SystemExit):
        error = RuntimeError(f"the function called sys.exit({error.code!r})")
    try:  # not every exception survives the journey
        pickle.loads(pickle.dumps(error))
    except Exception:
        survivor = RuntimeError(f"{type(error).__name__}: {error}")
        for line in notes:
            survivor.add_note(line)
        error = survivor
    return Outcome(error=error, note=f"{note}{'' if notes else where}\n{trace}")


def unwrap(function: Function) -> Function:
    """Return what emcee wraps, anew for every sampler, if it wraps nothing else."""
    bare = isinstance(function, _FunctionWrapper)
    if bare and not (function.args or function.kwargs):  # type: ignore[attr-defined]
        return function.f  # type: ignore[attr-defined, no-any-return]
    return function
