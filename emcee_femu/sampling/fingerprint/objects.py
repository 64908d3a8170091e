"""Any Python object as text, and the parts that it consists of."""

import enum
import functools
import hashlib
import inspect
import pathlib
import types
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import sparse, stats

from .code import Parts, class_parts, function_parts, in_library, qualified

MOST_NUMBERS, MOST_CHARACTERS = 16, 200  # that are shown; beyond, a checksum
SCALARS = (type(None), bool, int, float, complex, str, bytes)
NUMPY_SCALARS = (np.float64, np.int64, np.bool_, np.str_)  # as those of Python
SEQUENCES = (tuple, list, set, frozenset)
STREAMS = (np.random.RandomState, np.random.Generator, np.random.BitGenerator)
NAMED = (np.ufunc, types.ModuleType)
# What every distribution of scipy.stats has and what does not tell two apart.
COMMON = set(vars(stats.rv_continuous())) - {"a", "b", "name"}


def leaf(value: Any) -> str | None:
    """Return the text of a value that has no parts, None of others."""
    kind = type(value)
    if _plain(value):
        return shortened(_plain_text(value))
    if isinstance(value, NUMPY_SCALARS):
        return shortened(repr(value.item()))
    if isinstance(value, np.generic):
        return f"{value.dtype} {value!r}"
    if isinstance(value, np.ndarray) and not isinstance(value, np.ma.MaskedArray):
        if not value.dtype.hasobject and value.dtype.names is None:
            return _array_text(value)
    if isinstance(value, enum.Enum):
        return f"{qualified(kind)}.{value.name}"
    if sparse.issparse(value):
        rows = value.tocsr(copy=True)
        rows.sum_duplicates()  # and sort
        numbers = [_array_text(a) for a in (rows.data, rows.indices, rows.indptr)]
        return f"{qualified(kind)} {value.shape}: {checksum(str(numbers).encode())}"
    if isinstance(value, STREAMS):
        return f"{qualified(kind)} (its state is not compared)"
    if isinstance(value, NAMED):
        return f"{kind.__name__} {value.__name__}"
    if isinstance(value, np.dtype | pathlib.PurePath):
        return repr(str(value))
    if isinstance(value, type) and in_library(value):
        return qualified(value)
    return None


def _plain(value: Any) -> bool:
    """Return whether a value is of Python's scalars, or a nest of them."""
    kind = type(value)
    return kind in SCALARS or (kind in SEQUENCES and all(map(_plain, value)))


def _plain_text(value: Any) -> str:
    kind = type(value)
    if kind in SCALARS:
        return repr(value)
    texts = [_plain_text(item) for item in value]
    if kind in (set, frozenset):
        texts.sort()
    return f"{kind.__name__} of {len(texts)}: {', '.join(texts)}"


def _array_text(array: Any) -> str:
    head = f"{array.dtype} {array.shape}"
    if array.size <= MOST_NUMBERS:
        numbers = ", ".join(map(repr, array.ravel().tolist()))
        return f"{head}: {shortened(numbers)}"
    if array.dtype.char in "gG":  # longdouble, whose padding bytes hold anything
        return f"{head}: {checksum(repr(array.tolist()).encode())}"
    flat = np.ascontiguousarray(array).reshape(-1)
    return f"{head}: {checksum(flat.view(np.uint8))}"


def checksum(content: Any) -> str:
    """Return a short SHA-256, the quickest of its kind where processors have it."""
    return f"sha256:{hashlib.sha256(content).hexdigest()[:16]}"


def shortened(text: str) -> str:
    """Return the text, or of a long one the beginning and a checksum."""
    if len(text) <= MOST_CHARACTERS:
        return text
    begin = text[: MOST_CHARACTERS // 4]
    return f"{begin}... ({len(text)} characters, {checksum(text.encode())})"


def parts(value: Any) -> tuple[str, Parts]:
    """Return what an object is, and its parts."""
    if isinstance(value, types.FunctionType):
        return function_parts(value)
    if isinstance(value, type):
        return f"class {qualified(value)}", class_parts(value)
    if isinstance(value, types.MethodType):
        return "method", [("(self)", value.__self__), ("(function)", value.__func__)]
    if isinstance(value, functools.partial):
        given = (*enumerate(value.args), *value.keywords.items())
        parts_given = [(f"[{key}]", part) for key, part in given]
        return "partial", [("(function)", value.func), *parts_given]
    kind = type(value)
    text = qualified(kind)
    found: Parts = [] if in_library(kind) else [("(class)", kind)]
    contents = _contents(value)
    if contents is None:
        inside = _arguments(value) if hasattr(value, "propose") else None
        inside = _state(value) if inside is None else inside
        if inside is None:
            return f"{text} (not looked into)", found
        return text, found + inside
    if hasattr(value, "__dict__"):  # of a class derived from a container
        found += [(f".{name}", part) for name, part in vars(value).items()]
    if isinstance(value, Mapping):  # the order of parameters matters
        keys = shortened(", ".join(leaf(k) or type(k).__name__ for k in value))
        return f"{text} of {keys or 'nothing'}", contents + found
    return f"{text} of {len(value)}", contents + found


def _contents(value: Any) -> Parts | None:
    """Return the parts of a container."""
    if isinstance(value, np.ma.MaskedArray):
        return [(".data", value.data), (".mask", np.ma.getmaskarray(value))]
    if isinstance(value, np.ndarray):
        if value.dtype.names:
            return [(f"[{name}]", value[name]) for name in value.dtype.names]
        return [(".shape", value.shape), (".items", value.ravel().tolist())]
    if isinstance(value, Mapping):
        labels = [k if isinstance(k, str) else leaf(k) for k in value]
        pairs = zip(labels, value.values(), strict=True)
        return [(f"[{label}]", part) for label, part in pairs]
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        pairs = zip(value._fields, value, strict=True)
        return [(f".{name}", part) for name, part in pairs]
    if isinstance(value, tuple | list):
        return [(f"[{i}]", part) for i, part in enumerate(value)]
    return None


def _arguments(move: Any) -> Parts | None:
    """Return the constructor arguments of a move, if it keeps them by their names.

    What else it keeps, it derived from them, counted or remembered.
    """
    makers = [vars(cls).get("__init__") for cls in type(move).__mro__]
    names = {
        name: None
        for maker in makers
        if isinstance(maker, types.FunctionType)
        for name, parameter in [*inspect.signature(maker).parameters.items()][1:]
        if parameter.kind.name not in ("VAR_POSITIONAL", "VAR_KEYWORD")
    }
    if not all(hasattr(move, name) for name in names):
        return None
    return [(f".{name}", getattr(move, name)) for name in names]


def _state(value: Any) -> Parts | None:
    """Return what pickle would keep of an object, None if nothing can be known."""
    try:
        reduced = value.__reduce_ex__(4)
    except Exception:  # whatever a foreign class raises for what it cannot pickle
        if not hasattr(value, "__dict__"):
            return None
        reduced = (object.__new__, (), vars(value))
    if isinstance(reduced, str):  # the name of something global
        wrapped = getattr(value, "__wrapped__", None)  # as of functools.lru_cache
        return [("(name)", reduced), ("(wrapped)", wrapped)]
    make, arguments, state, items, pairs = (*reduced, None, None, None)[:5]
    if getattr(make, "__name__", None) in ("__new__", "__newobj__"):
        arguments = arguments[1:]  # all but the class
    else:
        arguments = (make, *arguments)
    given = (*arguments, *(items or ()), *(pairs or ()))
    found: Parts = [(f"({i})", part) for i, part in enumerate(given)]
    left_out = COMMON if isinstance(value, stats.rv_continuous) else set()
    left_out = left_out | _cached(type(value))
    with_slots = isinstance(state, tuple) and len(state) == 2
    for some in state if with_slots else (state,):
        if isinstance(some, dict):
            found += [(f".{k}", part) for k, part in some.items() if k not in left_out]
        elif some is not None:
            found.append(("(state)", some))
    return found


def _cached(cls: type) -> set[str]:
    """Return the attributes that appear only when they are first asked for."""
    return {
        name
        for base in cls.__mro__
        for name, member in vars(base).items()
        if isinstance(member, functools.cached_property)
    }
