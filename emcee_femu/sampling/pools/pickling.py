"""Pickle a function for the workers, or say which part of it cannot be pickled."""

import pickle
from collections.abc import Callable, Iterator, Mapping
from typing import Any


def pickled(function: Any, dumps: Callable[[Any], bytes] = pickle.dumps) -> bytes:
    """Return the pickled function.

    Args:
        function: What the workers shall call.
        dumps: The pickler of the back end.

    Raises:
        TypeError: If it cannot be pickled, naming the innermost part to blame.
    """
    try:
        return dumps(function)
    except Exception as refusal:  # a pickler raises what it likes
        error = refusal
    path, culprit = _culprit(type(function).__name__, function, dumps, set())
    raise TypeError(
        f"pool: {path} cannot be pickled, so that no worker process can have it: "
        f"{_described(culprit)} ({error}); write a function at the top level of a "
        "module, or a class with such attributes, and open files, locks and programs "
        "inside the call; threads (ThreadPoolExecutor) need no pickling"
    ) from error


def _error(value: Any, dumps: Callable[[Any], bytes]) -> Exception | None:
    try:
        dumps(value)
    except Exception as error:
        return error
    return None


def _culprit(
    path: str, value: Any, dumps: Callable[[Any], bytes], seen: set[int]
) -> tuple[str, Any]:
    seen.add(id(value))
    for name, part in _parts(value):
        if id(part) not in seen and _error(part, dumps) is not None:
            return _culprit(path + name, part, dumps, seen)
    return path, value


def _parts(value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        yield from ((f"[{key!r}]", part) for key, part in value.items())
    elif isinstance(value, list | tuple):
        yield from ((f"[{i}]", part) for i, part in enumerate(value))
    else:
        owner = getattr(value, "__self__", None)  # of a bound method
        if owner is not None:
            yield ".__self__", owner
        for name, part in getattr(value, "__dict__", {}).items():
            yield f".{name}", part


def _described(value: Any) -> str:
    name = getattr(value, "__qualname__", None)
    if name is None:
        return f"a {type(value).__name__}"
    kind = "a lambda" if name.endswith("<lambda>") else f"a {type(value).__name__}"
    code = getattr(value, "__code__", None)
    where = f", line {code.co_firstlineno}" if code is not None else ""
    return f"{kind}, {getattr(value, '__module__', '')}.{name}{where}"
