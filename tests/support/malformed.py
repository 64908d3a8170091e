"""What a caller may get wrong: a value that worked, bent in one of many ways.

``bent_values(valid)`` lists them all, each once: hypothesis then throws no value twice.
Some are valid still (the same numbers as integers, a stretched array, a DataFrame):
``kinds.py`` knows which.
"""

from collections import UserList
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.sparse import csc_array, issparse

from support.junk import DTYPES, HOLDERS, JUNK, MAPPINGS, NUMBERS, TELLING


class Bent(NamedTuple):
    """How a valid value is bent; called, it builds the malformed one.

    It is built anew on each call, since a generator can be read once. What is
    ``telling`` is thrown always, the others at random.
    """

    label: str
    build: Callable[[], Any]
    telling: bool = False

    def __call__(self) -> Any:
        return self.build()

    def __repr__(self) -> str:
        return self.label


def bent_values(valid: Any) -> list[list[Bent]]:
    """Return groups of bent values for an argument whose valid value is given."""
    groups = [
        [_bent(label, build) for label, build in JUNK.items()],
        [_bent(_said(x), lambda x=x: x) for x in NUMBERS],
    ]
    if issparse(valid):
        groups += [
            [_inside("sparse", inner, _sparse) for inner in group]
            for group in _arrays(valid.toarray())
        ]
    elif isinstance(valid, Mapping):
        groups += _mappings(valid)
    elif _is_numeric(valid) and not is_record(valid):
        groups += _arrays(np.asarray(valid))
        if isinstance(valid, list | tuple):  # an array may be refused as such
            groups += [
                [_inside("listed", x, lambda v: v) for x in _sequences([*valid])[0]]
            ]
    elif isinstance(valid, list | tuple) and len(valid):
        groups += _sequences(list(valid))
    return groups


def _bent(label: str, build: Callable[[], Any]) -> Bent:
    return Bent(label, build, label in TELLING)


def _said(value: Any) -> str:
    return f"{type(value).__name__} {value!r}"


def _inside(where: str, inner: Bent, build: Callable[[Any], Any]) -> Bent:
    """Return a bent part of a larger value."""
    return Bent(f"{where}: {inner}", lambda: build(inner()), inner.telling)


def _is_numeric(valid: Any) -> bool:
    kind = np.asarray(valid).dtype.kind if _rectangular(valid) else "O"
    return not isinstance(valid, bool | str) and kind in "fiuc"


def is_record(valid: Any) -> bool:
    """Return whether things of several types stand side by side."""
    return isinstance(valid, list | tuple) and len({*map(type, valid)}) > 1


def _rectangular(valid: Any) -> bool:
    try:
        np.asarray(valid)
    except ValueError:
        return False
    return not callable(valid)


def _arrays(valid: Any) -> list[list[Bent]]:
    """Bend an array: a number in it, its dtype, its shape, its order, its holder."""
    size = valid.size
    entries = [
        Bent(
            f"entry {place} = {_said(x)}",
            lambda place=place, x=x: _with(valid, place, x),
            place == size - 1 and f"entry {_said(x)}" in TELLING,
        )
        for place in sorted({0, min(1, size - 1), size // 2, size - 1})
        for x in NUMBERS
        if valid.ndim
    ]
    return [
        *([entries] if entries else []),
        [_bent(f"as {dtype}", lambda d=dtype: _cast(valid, d)) for dtype in DTYPES],
        [_bent(f"as {k}", lambda h=h: _held(valid, h)) for k, h in HOLDERS.items()],
        [_bent(label, lambda b=b: b(valid)) for label, b in SHAPES.items()],
        [_bent(f"times {x}", lambda x=x: _times(valid, x)) for x in FACTORS],
    ]


FACTORS = [0.0, -1.0, 1e-320, 1e-200, 1e200, 1e308, 0.5]


def _sparse(value: Any) -> Any:
    try:
        return csc_array(np.asarray(value))
    except (TypeError, ValueError, UserWarning):  # of masked entries
        return value


SHAPES = {
    "without the last": lambda a: np.array(a)[:-1] if a.ndim else np.empty((0, 1)),
    "the first alone": lambda a: a[:1] if a.ndim else a.reshape(1),
    "the first item": lambda a: a[0] if a.ndim else a.reshape(1, 1),
    "none": lambda a: a[:0] if a.ndim else np.empty(0),
    "the last twice": lambda a: np.concatenate([a, a[-1:]]) if a.ndim else np.ones(2),
    "in another axis": lambda a: a[None],
    "in a last axis": lambda a: a[..., None],
    "without the last column": lambda a: a[..., :-1] if a.ndim else a,
    "flat": np.ravel,
    "transposed": np.transpose,
    "backwards": lambda a: a[::-1] if a.ndim else a,
    "columns backwards": lambda a: a[..., ::-1] if a.ndim else a,
    "sorted": lambda a: np.sort(a, axis=-1) if a.ndim else a,
    "all alike": lambda a: np.full_like(a, a.flat[0]) if a.size else a,
    "a row and a column less": lambda a: a[(slice(-1),) * a.ndim],
    "ragged": lambda a: [*a.tolist(), [1.0, 2.0]] if a.ndim else [1.0, [2.0]],
    "in a list": lambda a: [a, a],
}


def _with(valid: Any, place: int, number: Any) -> Any:
    flat = [x for x in np.asarray(valid).ravel().tolist()]
    flat[place] = number
    for length in reversed(np.shape(valid)[1:]):
        flat = [flat[i : i + length] for i in range(0, len(flat), length)]
    return flat if np.ndim(valid) else flat[0]


def _cast(valid: Any, dtype: str) -> Any:
    with np.errstate(all="ignore"):
        if dtype.startswith("datetime"):
            return np.zeros(np.shape(valid), dtype=dtype)
        return np.asarray(valid).real.astype(dtype)


def _held(valid: Any, holder: Any) -> Any:
    try:
        return holder(np.array(valid))
    except (TypeError, ValueError, IndexError):  # not of this dimension
        return holder(np.atleast_1d(np.ravel(valid)).astype(float))


def _times(valid: Any, factor: float) -> Any:
    with np.errstate(all="ignore"):
        return np.asarray(valid) * factor


def _sequences(valid: list[Any]) -> list[list[Bent]]:
    """Bend a sequence of names, terms or records, and what is in it."""
    whole = {
        "without the last": lambda: valid[:-1],
        "the last twice": lambda: [*valid, valid[-1]],
        "the first again": lambda: [*valid[:-1], valid[0]],
        "backwards": lambda: valid[::-1],
        "a tuple": lambda: tuple(valid),
        "a UserList": lambda: UserList(valid),
        "a list's generator": lambda: (item for item in valid),
        "an array of objects": lambda: np.array([*valid, None], dtype=object)[:-1],
        "in a list": lambda: [valid],
        "its first": lambda: valid[0],
        "a dict": lambda: dict(enumerate(valid)),
        "a set": lambda: set(map(str, valid)),
        "its text": lambda: str(valid),
        "an Index": lambda: pd.Index(valid, dtype=object, tupleize_cols=False),
    }
    more = ["x", ("x",), [], {}]
    others = [_bent(f"item {_said(x)}", lambda x=x: x) for x in [*NUMBERS, *more]]
    places = sorted({0, len(valid) - 1})
    items = [
        _inside(f"item {i}", item, lambda x, i=i: [*valid[:i], x, *valid[i + 1 :]])
        for i in places
        for item in others
    ]
    added = [_inside("one more", item, lambda x: [*valid, x]) for item in others]
    deeper = [
        _inside(f"in {i}", item, lambda x, i=i: [*valid[:i], x, *valid[i + 1 :]])
        for i in places
        if isinstance(valid[i], list | tuple)
        for group in bent_values(valid[i])[2:]
        for item in group
    ]
    own = [_bent(label, build) for label, build in whole.items()]
    return [own, items, added, *([deeper] if deeper else [])]


def _mappings(valid: Mapping[Any, Any]) -> list[list[Bent]]:
    """Bend a mapping: its kind, a key, or the value under a key."""
    kinds = [_bent(f"as {k}", lambda b=b: b(valid)) for k, b in MAPPINGS.items()]
    fewer = [
        Bent(f"without {key!r}", lambda k=key: _without(valid, k), True)
        for key in valid
    ]
    if not isinstance(valid, dict):  # inference data: its groups are not bent
        return [kinds, fewer]
    keys = ["", "x", 0, -1, None, 1.5, ("a",), b"k1", True]
    first = next(iter(valid.values()))
    renamed = [
        Bent(
            f"{key!r} named {new!r}",
            lambda key=key, new=new: {**_without(valid, key), new: valid[key]},
            new == "x",
        )
        for key in valid
        for new in keys
    ]
    added = [
        Bent(f"{new!r} added", lambda new=new: {**valid, new: first}, new == "x")
        for new in keys
    ]
    inside = [
        _inside(repr(key), inner, lambda x, key=key: {**valid, key: x})
        for key in valid
        for group in bent_values(valid[key])
        for inner in group
    ]
    return [kinds, [*fewer, *renamed, *added], inside]


def _without(valid: Mapping[Any, Any], key: Any) -> dict[Any, Any]:
    return {k: v for k, v in valid.items() if k != key}
