"""Checks of user input at the border: each names the argument and the remedy."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .interfaces import Floats


def real_array(argument: str, value: ArrayLike, ndim: int | None = None) -> Floats:
    """Return ``value`` as a new float64 array of finite numbers.

    Args:
        argument: Name of the checked argument, for the message.
        value: Anything that NumPy turns into real numbers.
        ndim: The required number of dimensions, or None for any.

    Raises:
        TypeError: If ``value`` does not hold real numbers.
        ValueError: If the dimension is wrong, or a number is NaN or infinite.
    """
    array = numeric_array(argument, value)
    if ndim is not None and array.ndim != ndim:
        raise ValueError(
            f"{argument}: expected {ndim} dimension(s), got shape {array.shape}"
        )
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(
            f"{argument}: expected finite numbers, got {array[where]} at index {where}"
        )
    return array


def numeric_array(argument: str, value: ArrayLike) -> Floats:
    """Return ``value`` as a new float64 array; NaN and infinity are allowed."""
    try:
        raw = np.asarray(value)
    except ValueError as error:  # ragged nesting
        raise ValueError(
            f"{argument}: expected a rectangular array ({error})"
        ) from None
    if raw.dtype.kind not in "fiu":
        raise TypeError(
            f"{argument}: expected real numbers, got "
            f"{type(value).__name__} of dtype {raw.dtype}"
        )
    return np.array(raw, dtype=np.float64)


def positive_array(argument: str, value: ArrayLike, ndim: int | None = None) -> Floats:
    """Return ``value`` as a new float64 array of finite numbers above zero."""
    array = real_array(argument, value, ndim)
    if not (array > 0).all():
        where = tuple(int(i) for i in np.argwhere(array <= 0)[0])
        at = f" at index {where}" if where else ""
        raise ValueError(
            f"{argument}: expected numbers above zero, got {array[where]}{at}"
        )
    return array


def real_number(argument: str, value: Any, low: float = -math.inf) -> float:
    """Return ``value`` as a finite float that is at least ``low``."""
    number = real_array(argument, value, 0).item()
    if number < low:
        raise ValueError(f"{argument}: expected at least {low:g}, got {number:g}")
    return number


def whole_number(argument: str, value: Any, low: int = 0) -> int:
    """Return ``value`` as an int that is at least ``low``; floats are refused."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise TypeError(
            f"{argument}: expected a whole number, got {value!r} "
            f"({type(value).__name__})"
        )
    if value < low:
        raise ValueError(f"{argument}: expected at least {low}, got {value}")
    return int(value)


def parameter_names(argument: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return ``names`` as a tuple of distinct, non-empty strings."""
    if isinstance(names, str):
        raise TypeError(
            f"{argument}: expected a sequence of names, got the string {names!r}; "
            f"write [{names!r}]"
        )
    try:
        result = tuple(names)
    except TypeError:
        raise TypeError(
            f"{argument}: expected a sequence of names, got {names!r}"
        ) from None
    for name in result:
        if not isinstance(name, str) or not name:
            raise TypeError(f"{argument}: expected non-empty strings, got {name!r}")
    repeated = sorted({name for name in result if result.count(name) > 1})
    if repeated:
        raise ValueError(f"{argument}: each name once, but {repeated} are repeated")
    if not result:
        raise ValueError(f"{argument}: expected at least one name, got none")
    return result
