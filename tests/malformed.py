"""What a caller may get wrong: a value that worked, bent in one of many ways.

``malformed(valid)`` is a strategy of :class:`Bent`, which builds its value anew on each
call, since a generator can be read once. Some of them are valid still (the same numbers
as integers, a stretched array, a DataFrame): ``kinds.py`` knows which.
"""

from collections import UserList
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from hypothesis import strategies as st
from junk import DTYPES, HOLDERS, JUNK, MAPPINGS, NUMBERS


class Bent(NamedTuple):
    """How a valid value is bent; called, it builds the malformed one."""

    label: str
    build: Any

    def __call__(self) -> Any:
        return self.build()

    def __repr__(self) -> str:
        return self.label


def malformed(valid: Any) -> Any:
    """Return the strategy of bent values for an argument whose valid value is given."""
    junk = st.sampled_from([Bent(label, build) for label, build in JUNK.items()])
    number = st.sampled_from([Bent(repr(x), lambda x=x: x) for x in NUMBERS])
    kinds = [junk, number]
    if isinstance(valid, Mapping):
        kinds += 4 * [_mappings(valid)]
    elif _is_numeric(valid):
        kinds += 6 * [_arrays(np.asarray(valid))]
    elif isinstance(valid, list | tuple) and valid:
        kinds += 4 * [_sequences(list(valid))]
    return st.one_of(kinds)


def _is_numeric(valid: Any) -> bool:
    kind = np.asarray(valid).dtype.kind if _rectangular(valid) else "O"
    return not isinstance(valid, bool | str) and kind in "fiuc"


def _rectangular(valid: Any) -> bool:
    try:
        np.asarray(valid)
    except ValueError:
        return False
    return not callable(valid)


@st.composite
def _arrays(draw: Any, valid: Any) -> Bent:
    """Bend an array: a number in it, its dtype, its shape, its order, its holder."""
    how = draw(st.sampled_from(["entry", "entry", "dtype", "shape", "holder", "scale"]))
    if how == "entry" and valid.size:
        place = draw(st.integers(0, valid.size - 1))
        number = draw(st.sampled_from(NUMBERS))
        return Bent(f"entry {place} = {number!r}", lambda: _with(valid, place, number))
    if how == "dtype":
        dtype = draw(st.sampled_from(DTYPES))
        return Bent(f"as {dtype}", lambda: _cast(valid, dtype))
    if how == "holder":
        label = draw(st.sampled_from([*HOLDERS]))
        return Bent(f"as {label}", lambda: _held(valid, HOLDERS[label]))
    if how == "scale":
        factor = draw(st.sampled_from([0.0, -1.0, 1e-320, 1e-200, 1e200, 1e308, 0.5]))
        return Bent(f"times {factor}", lambda: _times(valid, factor))
    label, build = draw(st.sampled_from([*SHAPES.items()]))
    return Bent(label, lambda: build(valid))


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


@st.composite
def _sequences(draw: Any, valid: list[Any]) -> Bent:
    """Bend a sequence of names, terms or records."""
    place = draw(st.integers(0, len(valid) - 1))
    other = draw(st.sampled_from([*NUMBERS, "", "x", ("x",), [], {}, object()]))
    replaced = [other if i == place else item for i, item in enumerate(valid)]
    built = {
        f"item {place} = {other!r}": lambda: replaced,
        "without the last": lambda: valid[:-1],
        "the last twice": lambda: [*valid, valid[-1]],
        "one more": lambda: [*valid, other],
        "backwards": lambda: valid[::-1],
        "a tuple": lambda: tuple(valid),
        "a UserList": lambda: UserList(valid),
        "a generator": lambda: (item for item in valid),
        "an object array": lambda: np.array([*valid, None], dtype=object)[:-1],
        "in a list": lambda: [valid],
        "its first": lambda: valid[0],
        "a dict": lambda: dict(enumerate(valid)),
        "a set": lambda: set(map(str, valid)),
        "its text": lambda: str(valid),
        "an Index": lambda: pd.Index(valid, dtype=object, tupleize_cols=False),
    }
    label = draw(st.sampled_from([*built]))
    return Bent(label, built[label])


@st.composite
def _mappings(draw: Any, valid: Mapping[Any, Any]) -> Bent:
    """Bend a mapping: its kind, a key, or the value under a key."""
    how = draw(st.sampled_from(["kind", "key", "more", "less", "value", "value"]))
    key = draw(st.sampled_from([*valid]))
    rest = {k: v for k, v in valid.items() if k != key}
    if how == "kind":
        label = draw(st.sampled_from([*MAPPINGS]))
        return Bent(f"as {label}", lambda: MAPPINGS[label](valid))
    if how == "less":
        return Bent(f"without {key!r}", lambda: rest)
    if how == "value":
        inner = draw(malformed(valid[key]))
        return Bent(f"{key!r}: {inner!r}", lambda: {**valid, key: inner()})
    other = draw(st.sampled_from(["", "x", 0, -1, None, 1.5, ("a",), b"k1", True]))
    if how == "key":
        return Bent(f"{key!r} named {other!r}", lambda: {**rest, other: valid[key]})
    return Bent(f"{other!r} added", lambda: {**valid, other: valid[key]})
