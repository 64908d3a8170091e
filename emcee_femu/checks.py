"""Checks of user input at the border: each names the argument and the remedy."""

import math
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .interfaces import Floats, Parameters

LEAST, MOST = 1e-100, 1e100  # of numbers that are squared


def set_fields(record: Any, **fields: Any) -> None:
    """Set the fields of a frozen record, from its own ``__init__``."""
    for name, value in fields.items():
        object.__setattr__(record, name, value)


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
    return _double(argument, _raw(argument, value, "fiu", "real"))


def complex_array(argument: str, value: ArrayLike) -> Floats | NDArray[np.complex128]:
    """Return ``value`` as a new array of finite float64 or complex128 numbers."""
    raw = _raw(argument, value, "fiuc", "real or complex")
    if raw.dtype.kind == "c":
        parts = [_double(argument, part) for part in (raw.real, raw.imag)]
        array = np.empty(raw.shape, dtype=np.complex128)
        array.real, array.imag = parts
        return array
    return _double(argument, raw)


def _raw(argument: str, value: ArrayLike, kinds: str, described: str) -> Any:
    """Return ``value`` as an array of numbers of the given kinds."""
    refuse_masked(argument, value)
    try:
        raw = np.asarray(value)
    except ValueError as error:  # ragged nesting
        raise ValueError(
            f"{argument}: expected a rectangular array ({error})"
        ) from None
    except TypeError as error:  # a container that refuses to be an array
        raise TypeError(
            f"{argument}: expected {described} numbers, got {type(value).__name__} "
            f"({error})"
        ) from None
    if raw.dtype.kind not in kinds:
        raise TypeError(
            f"{argument}: expected {described} numbers, got "
            f"{type(value).__name__} of dtype {raw.dtype}"
        )
    return raw


def refuse_masked(argument: str, value: Any) -> None:
    """Refuse masked entries: NumPy would drop the mask and keep what it hides."""
    if _masked(value):
        raise ValueError(
            f"{argument}: expected numbers, got an array with masked entries; leave "
            "them out, or fill them"
        )


def _masked(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return any(
            _masked(item)
            for item in value
            if isinstance(item, list | tuple | np.ma.MaskedArray)
        )
    return bool(np.ma.is_masked(value))


def _double(argument: str, raw: NDArray[Any]) -> Floats:
    with np.errstate(over="ignore", under="ignore"):  # of long doubles; error below
        array = np.array(raw, dtype=np.float64)
    if raw.dtype.itemsize > array.dtype.itemsize and np.any(
        np.isinf(array) & np.isfinite(raw)
    ):
        raise ValueError(
            f"{argument}: expected numbers that fit in a float, below 1.8e308"
        )
    return array


def check_range(argument: str, array: Floats) -> None:
    """Refuse numbers whose squares and quotients a float cannot hold; zero passes.

    Raises:
        ValueError: If the magnitude of a number is not from 1e-100 to 1e100.
    """
    size = np.abs(array)
    extreme = (size > MOST) | ((size < LEAST) & (size > 0))
    if extreme.any():
        raise ValueError(
            f"{argument}: expected magnitudes from {LEAST:g} to {MOST:g}, got "
            f"{array[extreme][0]:g}; use other units"
        )


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
    if isinstance(value, bool | np.timedelta64) or not isinstance(
        value, int | np.integer
    ):  # NumPy's spans of time count as integers
        raise TypeError(
            f"{argument}: expected a whole number, got {value!r} "
            f"({type(value).__name__})"
        )
    if value < low:
        raise ValueError(f"{argument}: expected at least {low}, got {value}")
    return int(value)


def flag(argument: str, value: Any) -> bool:
    """Return True or False; nothing else stands for them, least of all "no"."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{argument}: expected True or False, got {value!r}")
    return bool(value)


def file_name(argument: str, value: Any) -> str | PathLike[str]:
    """Return the name of a file; a number would be an open file, such as stdin."""
    if not isinstance(value, str | PathLike) or not str(value):
        raise TypeError(f"{argument}: expected the name of a file, got {value!r}")
    return value


def by_name(
    argument: str, values: Mapping[str, Any], names: Sequence[str]
) -> dict[str, Any]:
    """Return ``values`` as a dict, refusing names that are not among ``names``."""
    if not isinstance(values, Mapping):
        raise TypeError(
            f"{argument}: expected values by parameter name, got "
            f"{type(values).__name__}"
        )
    unknown = [name for name in values if name not in names]
    if unknown:
        raise ValueError(f"{argument}: no parameter {unknown}; there are {list(names)}")
    return dict(values)


def batch(parameters: Parameters) -> tuple[Parameters, int]:
    """Return the values of parameter sets, each ``(n,)`` floats, and n.

    What a :class:`LogPosterior` passes, arrays of floats, is passed on as it is;
    whether such numbers are finite is seen by what is computed of them.

    Raises:
        TypeError: If parameters is no mapping, or a value is not of real numbers.
        ValueError: If a value is not one-dimensional or not finite, or lengths differ.
    """
    if type(parameters) is dict:
        sizes = set()
        for value in parameters.values():
            if type(value) is not np.ndarray or value.dtype != np.float64:
                break
            sizes.add(value.shape)
        else:
            if not sizes:
                return parameters, 1
            (first, *others) = sizes
            if not others and len(first) == 1:
                return parameters, first[0]
    if not isinstance(parameters, Mapping):
        raise TypeError(
            "parameters: expected {name: values (n,)}, got "
            f"{type(parameters).__name__}"
        )
    values = {
        name: real_array(f"parameters[{name!r}]", value, 1)
        for name, value in parameters.items()
    }
    lengths = {name: len(value) for name, value in values.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"parameters: expected one length, got {lengths}")
    return values, next(iter(lengths.values()), 1)


def parameter_names(argument: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return ``names`` as a tuple of distinct, non-empty strings."""
    if isinstance(names, str):
        raise TypeError(
            f"{argument}: expected a sequence of names, got the string {names!r}; "
            f"write [{names!r}]"
        )
    if isinstance(names, set | frozenset):
        raise TypeError(
            f"{argument}: expected a sequence of names, got a set, which has no order"
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
