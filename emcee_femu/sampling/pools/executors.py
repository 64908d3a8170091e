"""What executors and pools are asked: none of their libraries is imported here."""

import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from multiprocessing.pool import ThreadPool
from typing import Any

# Their workers do not have the user's script: what is defined there goes by value.
BY_VALUE = ("distributed", "ray", "loky")
THREADS = (ThreadPoolExecutor, ThreadPool)  # they share memory: nothing is pickled
HANGING = ("multiprocessing.pool.Pool", "multiprocess.pool.Pool")


def check_executor(argument: str, given: Any) -> None:
    """Refuse what can evaluate nothing, or may wait for ever."""
    classes = [f"{base.__module__}.{base.__name__}" for base in type(given).__mro__]
    if any(name in HANGING for name in classes) and not isinstance(given, THREADS):
        # It forgets the task of the dead; nor does it end if they held a lock.
        raise TypeError(
            f"{argument}: {classes[0]} waits for ever for a worker that died; give "
            "run(..., workers=8), or a concurrent.futures.ProcessPoolExecutor"
        )
    if getattr(given, "asynchronous", False):
        raise TypeError(f"{argument}: expected a dask Client with asynchronous=False")
    if isinstance(given, type) or not hasattr(given, "map"):
        raise TypeError(
            f"{argument}: expected a concurrent.futures executor, a dask Client or a "
            f"pool with a map, got {given!r}"
        )


def count_workers(executor: Any) -> int:
    """Return how many evaluations run at once; 0 where that is unknown."""
    if hasattr(executor, "nthreads"):  # a dask Client
        return sum(executor.nthreads().values())
    # The standard library and loky; mpi4py; schwimmbad.
    names = ("_max_workers", "num_workers", "size")
    return max(getattr(executor, name, 0) for name in names)


def dump(executor: Any, value: Any) -> bytes:
    """Pickle for the workers of an executor; pickle's message names what it cannot.

    What they cannot import goes by value: functions within functions, and what a
    notebook or a prompt defines, where a name may also stand for another thing by now.
    """
    if type(executor).__module__.partition(".")[0] in BY_VALUE:
        return _dump_by_value(executor, value, "its workers do not have this script")
    try:
        payload = pickle.dumps(value)
    except Exception as error:  # a pickler raises what it likes
        return _dump_by_value(executor, value, str(error))
    if b"__main__" in payload and not hasattr(sys.modules["__main__"], "__file__"):
        why = "workers cannot import what a notebook defines"
        return _dump_by_value(executor, value, why)
    return payload


def _dump_by_value(executor: Any, value: Any, why: str) -> bytes:
    try:
        pickler = import_module("cloudpickle")
    except ImportError as error:
        install = "pip install 'emcee-femu[notebooks]', for its cloudpickle, or "
        raise _refusal(executor, why, install) from error
    try:
        return bytes(pickler.dumps(value))
    except Exception as error:
        raise _refusal(executor, str(error)) from error


def _refusal(executor: Any, why: str, remedy: str = "") -> TypeError:
    argument = getattr(type(executor), "argument", "pool")
    other = (
        "run(..., workers=8), which pickles nothing on Linux unless a start method was "
        "set, or a ThreadPoolExecutor"
    )
    if argument == "workers":  # which were not forked, then
        other = (
            "pool=ThreadPoolExecutor(8), which pickles nothing; nor do forked workers, "
            'on Linux: multiprocessing.set_start_method("fork", force=True)'
        )
    return TypeError(
        f"{argument}: the function cannot be pickled for the workers ({why}); {remedy}"
        "write functions at the top level of a module, and open files, locks and "
        f"programs inside the call; or give {other}"
    )
