"""A pool for emcee that ships the posterior once, and then only coordinates."""

import hashlib
import inspect
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ... import checks
from .back_ends import back_end
from .pickling import pickled

REMEMBERED = 8  # functions whose pickles are kept here


class EvaluationPool:
    """Evaluate walkers on many processes or machines; for ``pool=`` of emcee and run.

    A pool that has a ``map`` works with emcee as it is, but gets the posterior again
    with every task, and may wait for ever for a worker that died. Here a worker gets it
    once: tasks name it by the digest of its pickle, and a worker that does not have it
    (at first, after a restart, or new in a growing cluster) says so and is sent it. A
    worker's share of the walkers is one call of a :class:`LogPosterior`; another
    function is called point by point. The chain is that of a serial run, to the bit,
    as far as the machines compute alike.

    A sampler can keep at most ``nwalkers / nsplits`` workers busy, nsplits being that
    of its moves (2 unless said otherwise);
    ``examples/benchmarks/cluster_scaling.py`` shows how the ensemble should grow.

    The function must not change between calls, since it is pickled once. Start the
    workers with one thread each for linear algebra (``OMP_NUM_THREADS=1``), and guard
    a script with ``if __name__ == "__main__":``. The owner of the executor closes it.

    Args:
        executor: A ``concurrent.futures`` executor; a ``multiprocessing`` pool; a
            schwimmbad pool (``MPIPool``); a ``dask.distributed`` ``Client`` (wait for
            its workers first); the module ``ray`` after ``ray.init()``, or a
            ``ray.util.multiprocessing.Pool``; or anything with a ``map``.
        chunksize: Parameter sets a task. None for an equal share a worker, which is
            best where all take the same time and a batch is quicker than its rows; 1
            for a solver whose time varies, or a cluster that grows on demand.

    Raises:
        TypeError: If executor is none of these or chunksize is no whole number. From
            ``map``: if the function cannot be pickled, naming the part to blame.
        ValueError: If chunksize < 1, it is None and the number of workers is unknown,
            or ray was not started.
        RuntimeError: From ``map``, if a worker died.

    Example:
        >>> from concurrent.futures import ThreadPoolExecutor
        >>> import emcee
        >>> with ThreadPoolExecutor(2) as executor:
        ...     pool = EvaluationPool(executor)
        ...     sampler = emcee.EnsembleSampler(8, 2, lambda x: -x @ x, pool=pool)
        ...     start = np.random.default_rng(1).normal(size=(8, 2))
        ...     sampler.run_mcmc(start, 10).coords.shape
        (8, 2)
    """

    def __init__(self, executor: Any, chunksize: int | None = None) -> None:
        """See the class."""
        self._back_end = back_end(executor)
        if chunksize is not None:
            chunksize = checks.whole_number("chunksize", chunksize, 1)
        elif self._back_end.workers() is None:
            raise ValueError(
                f"chunksize: {type(executor).__name__} does not say how many workers "
                "it has; give the number of parameter sets a task"
            )
        self.chunksize = chunksize
        self._executor = executor
        self._pickles: list[tuple[Any, str, bytes]] = []

    def __repr__(self) -> str:
        """Return the call that makes an equal pool."""
        return f"EvaluationPool({self._executor!r}, chunksize={self.chunksize})"

    def map(self, function: Any, iterable: Iterable[Any]) -> list[Any]:
        """Return ``[function(point) for point in iterable]``, evaluated by the workers.

        An exception of the function is raised here, with a note that holds the
        parameters by name and the traceback of the worker.
        """
        points = iterable if isinstance(iterable, np.ndarray) else list(iterable)
        parts = self._parts(points)
        function = _bare(function)
        digest, payload = self._pickled(function)
        # Workers that share the memory take the function itself.
        shared = None if digest is not None else payload
        values: list[Sequence[Any]] = [()] * len(parts)
        remaining = len(parts)
        tasks = self._back_end.tasks()
        try:
            for number, part in enumerate(parts):
                tasks.submit(number, digest, part, shared)
            while remaining:
                number, outcome = tasks.wait()
                if outcome.error is not None:
                    outcome.error.add_note(outcome.note)
                    raise outcome.error
                if outcome.missing:
                    tasks.submit(number, digest, parts[number], payload)
                else:
                    values[number] = outcome.values
                    remaining -= 1
        finally:
            tasks.abandon()
        return [value for part_values in values for value in part_values]

    def _parts(self, points: Any) -> list[Any]:
        n = len(points)
        if self.chunksize is not None:
            cuts = [*range(0, n, self.chunksize), n]
        else:
            count = max(1, min(n, self._back_end.workers() or 1))
            cuts = [n * i // count for i in range(count + 1)]
        pairs = zip(cuts[:-1], cuts[1:], strict=True)
        return [points[a:b] for a, b in pairs if b > a]

    def _pickled(self, function: Any) -> tuple[str | None, Any]:
        """Return digest and pickle; None and the function if memory is shared."""
        if self._back_end.dumps is None:
            return None, function
        for known, digest, payload in self._pickles:
            if known is function:
                return digest, payload
        payload = pickled(function, self._back_end.dumps)
        digest = hashlib.sha256(payload).hexdigest()
        self._pickles = [(function, digest, payload), *self._pickles][:REMEMBERED]
        return digest, payload


def _bare(function: Any) -> Any:
    """Return the log-probability that emcee wraps, where it wraps nothing else.

    emcee's wrapper is another object for every sampler of the same function, and
    prints at an exception, which then arrives anyway.
    """
    wrapped = getattr(function, "f", None)
    bare = type(function).__name__ == "_FunctionWrapper" and not (
        function.args or function.kwargs
    )
    return wrapped if bare else function


def usable(pool: Any) -> bool:
    """Return whether emcee can use what is given for a pool."""
    return hasattr(pool, "map") or _is_ray(pool)


def safe_pool(pool: Any) -> Any:
    """Return what keeps the promises of ``run`` for any pool: walker by walker.

    Left to emcee, ``multiprocessing.Pool`` and MPIPool wait for ever for a worker that
    died or called ``sys.exit``, an exception on a worker ends an MPI job with exit code
    0, the ``map`` of a dask client returns futures, and the module ray has none.
    """
    if pool is None or isinstance(pool, EvaluationPool):
        return pool
    try:
        return EvaluationPool(pool, chunksize=1)
    except (TypeError, ValueError) as error:  # of its own argument, executor
        raise type(error)(str(error).replace("executor:", "pool:", 1)) from None


def _is_ray(pool: Any) -> bool:
    return inspect.ismodule(pool) and pool.__name__ == "ray"
