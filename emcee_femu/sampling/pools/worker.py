"""What runs on a worker: it keeps the functions it was sent, and evaluates points."""

import pickle
import threading
import traceback
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

KEPT = 8  # functions a worker keeps; an older one is sent again when it is needed
_functions: dict[str, Any] = {}  # of this process, by digest
_lock = threading.Lock()  # a dask worker may have several threads


class Outcome(NamedTuple):
    """What a worker returns; it raises nothing, since that would end an MPI job.

    Attributes:
        values: One result a point, or None.
        missing: Whether the worker does not have the function.
        error: What the function raised, or None.
        note: Where it was raised: parameters by name, and the worker's traceback.
    """

    values: Any = ()
    missing: bool = False
    error: BaseException | None = None
    note: str = ""


def evaluate(digest: str | None, points: Sequence[Any], payload: Any = None) -> Outcome:
    """Evaluate the function of that digest at every point.

    Args:
        digest: Of the pickled function; None if payload is the function itself.
        points: Parameter sets ``(n, d)``, or a list of whatever emcee passes.
        payload: The pickled function, for a worker that does not have it.
    """
    if digest is None:
        return _evaluated(payload, points)
    with _lock:
        function = _functions.get(digest)
    if function is None:
        if payload is None:
            return Outcome(missing=True)
        try:
            function = pickle.loads(payload)
        except Exception as error:
            return _failed(error, "The worker could not load the function: is all of "
                           "it importable there, and of the same version?")  # fmt: skip
        with _lock:
            _functions[digest] = function
            while len(_functions) > KEPT:
                del _functions[next(iter(_functions))]
    return _evaluated(function, points)


def evaluate_task(task: tuple[Any, ...]) -> Outcome:
    """Evaluate a task ``(digest, points, payload)``."""
    return evaluate(*task)


def _evaluated(function: Any, points: Sequence[Any]) -> Outcome:
    # A model that solves one set at a time gains nothing from a batch, and then the
    # error of a row would be looked for by solving the others again.
    single = getattr(function, "one_by_one", False)
    if single or not getattr(function, "takes_batches", False):
        return _one_by_one(function, points)
    try:
        return Outcome(function(np.asarray(points)))
    except (Exception, SystemExit) as error:
        located = _one_by_one(function, points)  # which row of the batch was it?
        if located.error is not None:
            return located
        return _failed(error, _places(function, points))


def _one_by_one(function: Any, points: Sequence[Any]) -> Outcome:
    values = []
    for point in points:
        try:
            values.append(function(point))
        except (Exception, SystemExit) as error:  # a script may end with sys.exit
            return _failed(error, _places(function, [point]))
    return Outcome(values)


def _places(function: Any, points: Sequence[Any]) -> str:
    # What emcee calls with ``args`` is wrapped once more.
    names = getattr(getattr(function, "f", function), "names", None)
    places = [point.tolist() if hasattr(point, "tolist") else point for point in points]
    if names is not None:
        places = [dict(zip(names, place, strict=False)) for place in places]
    return f"Raised on a worker at {places[0] if len(places) == 1 else places}"


def _failed(error: BaseException, note: str) -> Outcome:
    trace = "".join(traceback.format_exception(error)).rstrip()
    if isinstance(error, SystemExit):
        error = RuntimeError(f"the function called sys.exit({error.code!r})")
    try:  # not every exception survives the journey, and mp.Pool hangs on such a one
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    return Outcome(error=error, note=f"{note}\n{trace}")
