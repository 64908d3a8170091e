"""What runs on a worker: it keeps the functions it was sent, and evaluates points."""

import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

import numpy as np

KEPT = 8  # functions a worker keeps; an older one is sent again when it is needed
functions: dict[str, Any] = {}  # of this process, by digest
NOT_LOADED = (
    "The worker could not load the function: it must be in a module that workers can"
    " import, or need only such modules"
)
_watched: set[int] = set()  # processes (forks inherit it) that end with their run


class Outcome(NamedTuple):
    """What a worker returns; it raises nothing, since that would end an MPI job."""

    values: Any = ()  # one result per point
    missing: bool = False  # the worker does not have the function
    error: BaseException | None = None  # what the function raised
    note: str = ""  # where: parameters by name, and the worker's traceback


def evaluate(task: tuple[str | None, str, Sequence[Any], Any, int]) -> Outcome:
    """Evaluate a function at every point.

    Args:
        task: Digest of the function's pickle; which of its methods is called; points
            ``(n, d)``, or a list of whatever emcee passes; that pickle for a worker
            that does not have the function, else None; process id of the run. Threads
            get no digest, but the function itself.
    """
    digest, method, points, payload, home = task
    _end_with_run(home)
    function = payload if digest is None else functions.get(digest)
    if function is None:
        if payload is None:
            return Outcome(missing=True)
        try:
            function = pickle.loads(payload)
        except Exception as error:
            return _fail(error, NOT_LOADED)
        functions[str(digest)] = function
        for old in list(functions)[:-KEPT]:
            functions.pop(old, None)  # another thread may have done so
    # One set at a time is as quick, and no row is solved again to find an error.
    one_by_one = getattr(function, "one_by_one", False)
    takes_batches = getattr(function, "takes_batches", False)
    if method != "__call__":
        function = getattr(function, method)
    if one_by_one or not takes_batches:
        return _evaluate_rows(function, points)
    try:
        return Outcome(function(np.asarray(points)))
    except (Exception, SystemExit) as error:
        located = _evaluate_rows(function, points)  # which row of the batch was it?
        if located.error is not None:
            return located
        return _fail(error, _locate(function, points))


def begin(reader: Connection, writer: Connection) -> None:
    """Begin a worker process, which ends when its run says so or dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the run's business
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # whatever the run's handler does
    writer.close()  # only the run holds it
    _watched.add(os.getpid())
    _end_after(lambda: wait([reader]))


def _end_with_run(home: int) -> None:
    """Let a process that the run ``home`` started end with it, not wait for ever."""
    if os.getpid() not in _watched:
        _watched.add(os.getpid())
        parent = multiprocessing.parent_process()
        if parent is not None and parent.pid == home:
            _end_after(parent.join)


def _end_after(event: Callable[[], Any]) -> None:
    def watch() -> None:
        event()
        os._exit(1)  # the main thread may be in the solver

    threading.Thread(target=watch, daemon=True).start()


def _evaluate_rows(function: Any, points: Sequence[Any]) -> Outcome:
    values = []
    for point in points:
        try:
            values.append(function(point))
        except (Exception, SystemExit) as error:  # a script may end with sys.exit
            return _fail(error, _locate(function, [point]))
    return Outcome(values)


def _locate(function: Any, points: Sequence[Any]) -> str:
    # What emcee calls with ``args`` is wrapped once more.
    function = getattr(function, "__self__", function)
    names = getattr(getattr(function, "f", function), "names", None)
    places = [point.tolist() if hasattr(point, "tolist") else point for point in points]
    if names is not None:
        places = [dict(zip(names, place, strict=False)) for place in places]
    return f"Raised on a worker at {places[0] if len(places) == 1 else places}"


def _fail(error: BaseException, note: str) -> Outcome:
    trace = "".join(traceback.format_exception(error)).rstrip()
    if isinstance(error, SystemExit):
        error = RuntimeError(f"the function called sys.exit({error.code!r})")
    try:  # not every exception survives the journey
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    return Outcome(error=error, note=f"{note}\n{trace}")
