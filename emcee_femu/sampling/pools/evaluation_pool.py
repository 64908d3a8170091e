"""A pool for emcee that ships the posterior once, and then only coordinates."""

import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from contextlib import contextmanager
from typing import Any

import numpy as np
from emcee.ensemble import _FunctionWrapper

from ... import checks
from .executors import THREADS, check_executor, count_workers, dump
from .worker import KEPT, Outcome, evaluate


class EvaluationPool:
    """Evaluate walkers on many processes or machines; for ``pool=`` of emcee and run.

    Left to itself a pool gets the posterior again with every task. Here a worker gets
    it once: tasks name it by the digest of its pickle, and a worker that does not have
    it (at first, or new in a growing cluster) says so and is sent it. A worker's share
    of the walkers is one call of a :class:`LogPosterior`; another function is called
    point by point. The chain is that of a serial run, to the bit, as far as the
    machines compute alike. A worker that dies is an error (dask first tries others).

    A sampler can keep at most ``nwalkers / nsplits`` workers busy, nsplits being that
    of its moves (2 by default); ``examples/benchmarks/cluster_scaling.py`` shows how
    the ensemble should grow. The function must not change between calls. Start workers
    with one thread each for linear algebra (``OMP_NUM_THREADS=1``). The owner of the
    executor closes it; processes of a ``ProcessPoolExecutor`` that evaluated something
    also end if the run is killed.

    Args:
        executor: A ``concurrent.futures`` executor: processes, threads, loky,
            ``mpi4py.futures.MPIPoolExecutor``, or a ``dask.distributed`` ``Client``
            (wait for its workers first); or anything with a ``map``, such as
            schwimmbad's ``MPIPool`` or ``ray.util.multiprocessing.Pool``.
        chunksize: Parameter sets per task. None for an equal share per worker (1 where
            their number is unknown), which is best where all take the same time; 1
            for a solver whose time varies, or a cluster that grows on demand.

    Raises:
        TypeError, ValueError: If executor is none of these (``multiprocessing.Pool``
            is not: it waits for ever for a worker that died), chunksize is no whole
            number >= 1, or (from ``map``) the function cannot be pickled.
        RuntimeError: From ``map``, if a worker died or the executor was closed.

    Examples:
        >>> from concurrent.futures import ThreadPoolExecutor
        >>> import numpy as np
        >>> from emcee_femu import EvaluationPool
        >>> with ThreadPoolExecutor(2) as executor:
        ...     EvaluationPool(executor).map(lambda x: float(x @ x), 2 * np.eye(2))
        [4.0, 4.0]
    """

    def __init__(self, executor: Any, chunksize: int | None = None) -> None:
        check_executor("executor", executor)
        if chunksize is not None:
            chunksize = checks.whole_number("chunksize", chunksize, 1)
        self.chunksize = chunksize
        self._given = self._executor = executor
        if hasattr(executor, "get_executor"):  # a dask Client
            self._executor = executor.get_executor(pure=False)
        self._pickles: list[tuple[Any, str, bytes]] = []

    def map(self, function: Any, iterable: Iterable[Any]) -> list[Any]:
        """Return ``[function(point) for point in iterable]``, evaluated by the workers.

        An exception of the function is raised here, with a note that holds the
        parameters by name and the traceback of the worker.
        """
        points = iterable if isinstance(iterable, np.ndarray) else list(iterable)
        parts = self._cut(points)
        function, method = _split(_unwrap(function))
        digest, payload = None, None
        if not isinstance(self._executor, THREADS):
            digest, payload = self._pickle(function)
        sent = function if digest is None else None
        values: list[Sequence[Any]] = [()] * len(parts)
        waiting = list(range(len(parts)))
        while waiting:
            tasks = [(digest, method, parts[i], sent, os.getpid()) for i in waiting]
            missing = []
            for number, outcome in zip(waiting, self._outcomes(tasks), strict=True):
                if outcome.error is not None:
                    outcome.error.add_note(outcome.note)
                    raise outcome.error
                if outcome.missing:
                    missing.append(number)
                values[number] = outcome.values
            waiting, sent = missing, payload
        return [value for part_values in values for value in part_values]

    def each(self, function: Any, points: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """Yield number and result of each point as soon as a worker has it.

        A task holds one point. Where the executor has only a ``map`` they come in
        order.
        """
        function, method = _split(_unwrap(function))
        digest, payload = None, None
        if not isinstance(self._executor, THREADS):
            digest, payload = self._pickle(function)
        sent = function if digest is None else None
        waiting = list(range(len(points)))
        while waiting:
            home = os.getpid()
            tasks = [(digest, method, points[i : i + 1], sent, home) for i in waiting]
            missing = []
            for place, outcome in self._completed(tasks):
                if outcome.error is not None:
                    outcome.error.add_note(outcome.note)
                    raise outcome.error
                if outcome.missing:
                    missing.append(waiting[place])
                else:
                    yield waiting[place], outcome.values[0]
            waiting, sent = sorted(missing), payload

    def _completed(self, tasks: list[Any]) -> Iterator[tuple[int, Outcome]]:
        """Yield number and outcome of each task as it ends."""
        if not hasattr(self._executor, "submit"):
            yield from enumerate(self._outcomes(tasks))
            return
        with self._name_failure():
            futures = [self._executor.submit(evaluate, task) for task in tasks]
            places = {future: place for place, future in enumerate(futures)}
            for future in as_completed(places):
                yield places[future], future.result()

    def _outcomes(self, tasks: list[Any]) -> Iterator[Outcome]:
        with self._name_failure():
            yield from self._executor.map(evaluate, tasks)

    @contextmanager
    def _name_failure(self) -> Iterator[None]:
        """Say what it means if the executor itself fails."""
        try:
            yield
        except Exception as error:  # of the executor: an outcome carries the function's
            raise RuntimeError(
                f"pool: {type(self._executor).__name__} could not do its work: a "
                "worker died (out of memory, killed, a crash in the solver's own code) "
                "or could not start (its output says why), or the pool was closed. "
                "What was sampled so far is kept in the backend, if there is one, and "
                "in error.samplers of what run raises; to go on make a new pool, or "
                f"let run start new workers. {type(error).__name__}: {error}"
            ) from error

    def _cut(self, points: Any) -> list[Any]:
        size = self.chunksize or 1
        if self.chunksize is None and (workers := count_workers(self._given)):
            size = max(1, -(-len(points) // workers))
        return [points[i : i + size] for i in range(0, len(points), size)]

    def _pickle(self, function: Any) -> tuple[str, bytes]:
        for known, digest, payload in self._pickles:
            if known is function:
                return digest, payload
        payload = dump(self._executor, function)
        digest = hashlib.sha256(payload).hexdigest()
        self._pickles = [(function, digest, payload), *self._pickles][:KEPT]
        return digest, payload


def _unwrap(function: Any) -> Any:
    """Return what emcee wraps, anew for every sampler, if it wraps nothing else."""
    if not isinstance(function, _FunctionWrapper):
        return function
    return function if function.args or function.kwargs else function.f


def _split(function: Any) -> tuple[Any, str]:
    """Return what is sent, and which of its methods is called.

    A posterior that the workers have is not sent again for its gradient.
    """
    owner = getattr(function, "__self__", None)
    if getattr(owner, "takes_batches", False):
        return owner, function.__name__
    return function, "__call__"
