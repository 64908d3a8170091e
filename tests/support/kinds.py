"""What an argument accepts: predicates on any value, written anew for the tests.

Each returns True, False, or None where it cannot be said: then a value may be refused
by name or taken, but a result must be that of the same plain numbers.
"""

import array
import math
from collections import UserList
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

HUGE = 1e100  # beyond it, or below its inverse: a result or a refusal, no warning


def many(value: Any) -> bool:
    """Return whether a whole number is one of many steps or walkers."""
    return whole(21)(value)


def numbers(value: Any) -> Any:
    """Return what a value means as float64 array, None if it holds no real numbers.

    Entry by entry: nested sequences, and arrays of any library. A bool among numbers
    counts as a number, as in Python; bools alone do not.
    """
    found = _entries(value)
    return None if found is None or found.dtype == bool else found.astype(float)


def _entries(value: Any) -> Any:
    if isinstance(value, list | tuple | range | UserList):
        parts = [_entries(item) for item in value]
        if any(part is None for part in parts):
            return None
        if len({part.shape for part in parts}) > 1 or any(p.ndim > 40 for p in parts):
            return None
        return np.array(parts) if parts else np.empty(0)
    if isinstance(value, np.timedelta64) or np.ma.is_masked(value):
        return None
    if isinstance(value, int | float | np.integer | np.floating | np.bool_):
        if isinstance(value, int) and not -(2**63) <= value < 2**64:
            return None
        with np.errstate(over="ignore"):
            return np.array(
                bool(value) if isinstance(value, bool | np.bool_) else float(value)
            )
    if isinstance(value, np.generic) or not hasattr(value, "__array__"):
        if not isinstance(value, memoryview | array.array | bytearray):
            return None
    try:
        value = np.asarray(value)
    except TypeError:  # of a whole data set
        return None
    if value.dtype.kind == "b":
        return value
    if value.dtype.kind not in "fiu":
        return None
    with np.errstate(over="ignore"):
        flat = [float(x) for x in value.ravel()]
    return np.array(flat, dtype=float).reshape(value.shape)


def floats(
    *shapes: Any,
    low: float = -math.inf,
    above: float = -math.inf,
    high: float = math.inf,
    huge: float = HUGE,
) -> Callable[[Any], bool | None]:
    """Accept finite real numbers of one of the shapes; None in a shape is any."""

    def accepts(value: Any) -> bool | None:
        given = numbers(value)
        if given is None or not any(_fits(given.shape, shape) for shape in shapes):
            return False
        if not (np.isfinite(given) & (given >= low) & (given <= high)).all():
            return False
        if not (given > above).all():
            return False
        size = np.abs(given[given != 0])
        return None if (size > huge).any() or (size < 1 / huge).any() else True

    return accepts


def _fits(shape: tuple[int, ...], pattern: tuple[int | None, ...]) -> bool:
    return len(shape) == len(pattern) and all(
        want in (None, got) for got, want in zip(shape, pattern, strict=True)
    )


def whole(low: float = 0, high: float = math.inf) -> Callable[[Any], bool]:
    """Accept whole numbers from low to high, which no float and no bool is."""

    def accepts(value: Any) -> bool:
        number = isinstance(value, int | np.integer)
        number = number and not isinstance(value, bool | np.timedelta64)
        return bool(number and low <= value <= high)

    return accepts


def either(*kinds: Callable[[Any], bool | None]) -> Callable[[Any], bool | None]:
    """Accept what one of several kinds accepts."""

    def accepts(value: Any) -> bool | None:
        found = [kind(value) for kind in kinds]
        return True if True in found else None if None in found else False

    return accepts


def none(value: Any) -> bool:
    """Accept None."""
    return value is None


def unsaid(value: Any) -> None:
    """Say nothing: either is fine, as long as it is refused by name or the same."""


def text(value: Any) -> bool:
    """Accept a string that is not empty."""
    return isinstance(value, str) and bool(value)


def unless(kind: Callable[[Any], bool | None]) -> Callable[[Any], bool | None]:
    """Refuse what a kind refuses, and say nothing of the others."""
    return lambda value: False if kind(value) is False else None


def flag(value: Any) -> bool:
    """Accept True and False."""
    return isinstance(value, bool | np.bool_)


def one_of(*types: type) -> Callable[[Any], bool]:
    """Accept instances."""
    return lambda value: isinstance(value, types)


def moderate(kind: Callable[[Any], bool | None]) -> Callable[[Any], bool | None]:
    """Refuse numbers whose squares a float cannot hold; zero passes."""

    def accepts(value: Any) -> bool | None:
        given = numbers(value)
        if given is not None and given.size:
            size = np.abs(given[given != 0])
            if ((size > HUGE) | (size < 1 / HUGE)).any():
                return False
        return kind(value)

    return accepts


def shaped(*shapes: Any) -> Callable[[Any], bool | None]:
    """Refuse all but numbers of one of the shapes; NaN and infinity are not judged."""

    def accepts(value: Any) -> bool | None:
        given = numbers(value)
        fits = given is not None and any(_fits(given.shape, shape) for shape in shapes)
        return None if fits else False

    return accepts


def of_complex(value: Any) -> bool:
    """Return whether a value holds nothing but numbers, of which some are complex."""
    if isinstance(value, list | tuple):
        found = [of_complex(item) for item in value]
        others = [numbers(v) for v, own in zip(value, found, strict=True) if not own]
        return any(found) and all(other is not None for other in others)
    if isinstance(value, complex | np.complexfloating):
        return True
    return getattr(getattr(value, "dtype", None), "kind", "") == "c"


def by_name(
    kind: Callable[[Any], bool | None], names: Any = None, every: bool = False
) -> Callable[[Any], bool | None]:
    """Refuse all but mappings of (some) names to a kind."""

    def accepts(value: Any) -> bool | None:
        if not isinstance(value, Mapping):
            return False
        if not all(text(k) and (names is None or k in names) for k in value):
            return False
        if every and set(value) != set(names):
            return False
        return None if all(kind(v) is not False for v in value.values()) else False

    return accepts


def listed(
    kind: Callable[[Any], bool | None], least: int = 1
) -> Callable[[Any], bool | None]:
    """Refuse all but sequences of a kind."""

    def accepts(value: Any) -> bool | None:
        if not isinstance(value, Sequence) or isinstance(value, str | bytes):
            return False
        enough = len(value) >= least
        return None if enough and all(kind(v) is not False for v in value) else False

    return accepts


def ascending(high: int) -> Callable[[Any], bool | None]:
    """Refuse all but ascending whole numbers from 1 to high."""
    one = listed(whole(1, high))

    def accepts(value: Any) -> bool | None:
        return one(value) if one(value) is False or _ascends(value) else False

    return accepts


def _ascends(value: Any) -> bool:
    return all(a < b for a, b in zip(value, value[1:], strict=False))


def positive(*names: str) -> Callable[[Any], bool | None]:
    """Refuse all but equal lengths, and what is not above zero under a name."""

    def accepts(value: Any) -> bool | None:
        if equal_lengths(value) is False:
            return False
        right = all((numbers(value[name]) > 0).all() for name in names if name in value)
        return None if right else False

    return accepts


def equal_lengths(value: Any) -> bool | None:
    """Refuse all but mappings to finite numbers ``(n,)`` of one n."""
    if not isinstance(value, Mapping):
        return False
    kind = floats((None,))
    if any(kind(v) is False for v in value.values()):
        return False
    return None if len({len(numbers(v)) for v in value.values()}) < 2 else False
