"""Checks of user input at the border: each names the argument and the remedy."""

import math
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = NDArray[np.float64]
T = TypeVar("T")
K = TypeVar("K")
LISTED = 12  # labels in a message, so that it stays readable


def listed(labels: Iterable[object]) -> str:
    """Return labels with commas between them, of many only the first."""
    shown = [*map(str, labels)]
    more = f" and {len(shown) - LISTED} more" if len(shown) > LISTED else ""
    return ", ".join(shown[:LISTED]) + more


def set_fields(record: object, **fields: object) -> None:
    """Set the fields of a frozen record, from its own ``__init__``."""
    for name, value in fields.items():
        object.__setattr__(record, name, value)


def real_array(argument: str, value: ArrayLike, ndim: int | None = None) -> Floats:
    """Return ``value`` as a new float64 array of finite numbers."""
    array = numeric_array(argument, value)
    if ndim is not None and array.ndim != ndim:
        raise ValueError(f"{argument}: expected {ndim} dimension(s), got {array.shape}")
    _refuse(argument, array, ~np.isfinite(array), "finite numbers")
    return array


def shaped_array(argument: str, value: ArrayLike, *shapes: tuple[int, ...]) -> Floats:
    """Return ``value`` as a new array of finite numbers, of one of these shapes."""
    array = real_array(argument, value)
    shaped(argument, array.shape, *shapes)
    return array


def sequence(argument: str, value: Iterable[T], form: str) -> list[T]:
    """Return what a sequence holds, refusing text and mappings; ``form`` names it."""
    if not isinstance(value, Iterable) or isinstance(value, str | Mapping):
        raise TypeError(f"{argument}: expected a sequence of {form}, got {value!r}")
    return list(value)


def one_or_several(value: T | Sequence[T]) -> list[T]:
    """Return what a sequence holds, or the one thing that is no sequence."""
    return list(value) if isinstance(value, Sequence) else [value]


def function(argument: str, value: object) -> None:
    """Refuse what cannot be called."""
    if not callable(value):
        simple = isinstance(value, str | int | float)
        got = repr(value) if simple else type(value).__name__
        raise TypeError(f"{argument}: expected a callable, got {got}")


def numeric_array(argument: str, value: ArrayLike) -> Floats:
    """Return ``value`` as a new float64 array; NaN and infinity are allowed."""
    return np.array(_numbers(argument, value, "fiu", "real"), dtype=np.float64)


def complex_array(argument: str, value: ArrayLike) -> Floats | NDArray[np.complex128]:
    """Return ``value`` as a new float64 or complex128 array; NaN is allowed."""
    raw = _numbers(argument, value, "fiuc", "real or complex")
    kind = np.complex128 if raw.dtype.kind == "c" else np.float64
    return np.asarray(raw.astype(kind))


def positive_array(argument: str, value: ArrayLike, ndim: int | None = None) -> Floats:
    """Return ``value`` as a new float64 array of finite numbers above zero."""
    array = real_array(argument, value, ndim)
    _refuse(argument, array, array <= 0, "numbers above zero")
    return array


def shaped(
    argument: str, got: tuple[int, ...], *shapes: tuple[int, ...], remedy: str = ""
) -> None:
    """Refuse an array of another shape than one of these; ``()`` is one number."""
    if got not in shapes:
        expected = " or ".join(f"shape {s}" if s else "one number" for s in shapes)
        words = f"{argument}: expected {expected}, got {got}"
        raise ValueError(f"{words}; {remedy}" if remedy else words)


def chosen_numbers(argument: str, values: ArrayLike | None, count: int) -> list[int]:
    """Return some of the numbers from 1 to ``count``, each once; all for None."""
    some = range(1, count + 1) if values is None else np.atleast_1d(values)
    numbers = [whole_number(argument, number, 1) for number in some]
    if not numbers or len({*numbers}) < len(numbers) or max(numbers) > count:
        expected = f"numbers from 1 to {count}, each once"
        raise ValueError(f"{argument}: expected {expected}, got {values!r}")
    return numbers


def covariance_factor(argument: str, covariance: Floats) -> Floats:
    """Return L with ``L L^T = covariance``, exact for scales that differ by 1e11.

    Raises:
        ValueError: If covariance is not square, symmetric and positive definite.
    """
    if covariance.ndim != 2 or covariance.shape[0] != covariance.shape[1]:
        raise ValueError(f"{argument}: expected (n, n), got shape {covariance.shape}")
    variances = np.diag(covariance)
    scale = np.sqrt(np.where(variances > 0, variances, 1.0))
    correlation = covariance / np.outer(scale, scale)
    try:
        factor = np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        factor = None
    if factor is None or np.abs(correlation - correlation.T).max() > 1e-8:
        what = "a symmetric, positive definite matrix"
        raise ValueError(f"{argument}: expected {what}, got {covariance.tolist()}")
    return np.asarray(scale[:, None] * factor)


def _numbers(argument: str, value: ArrayLike, kinds: str, described: str) -> Any:
    """Return ``value`` as an array of one of NumPy's ``kinds`` of numbers."""
    if np.ma.is_masked(value):  # NumPy would drop the mask and keep what it hides
        raise ValueError(f"{argument}: expected numbers, got masked entries")
    try:
        raw = np.asarray(value)
    except (TypeError, ValueError) as why:  # ragged nesting, a Dataset
        raise ValueError(
            f"{argument}: expected a rectangular array, as many numbers in each row "
            f"({why})"
        ) from None
    if raw.dtype.kind not in kinds:
        got, cure = f"{type(value).__name__} of dtype {raw.dtype}", ""
        words = [each for each in raw.flat if isinstance(each, str)]
        if words:
            got = f"text, {str(words[0])!r}"
            cure = "; write numbers, with a decimal point and without quotes"
        elif raw.dtype.kind == "O" and None in raw.ravel().tolist():
            got, cure = "None", "; leave out what is not known"
        elif raw.dtype.kind == "c":
            cure = "; give its real part, .real, if that is what is meant"
        raise TypeError(f"{argument}: expected {described} numbers, got {got}{cure}")
    return raw


def _refuse(
    argument: str, array: Floats, wrong: NDArray[np.bool_], expected: str
) -> None:
    """Refuse an array that is wrong somewhere, with the first such number."""
    if wrong.any():
        where = tuple(int(i) for i in np.argwhere(wrong)[0])
        at = f" at index {where}" if where else ""
        raise ValueError(f"{argument}: expected {expected}, got {array[where]}{at}")


def real_number(
    argument: str, value: ArrayLike, low: float = -math.inf, high: float = math.inf
) -> float:
    """Return ``value`` as a finite float from ``low`` to ``high``."""
    number = real_array(argument, value, 0).item()
    if number < low:
        raise ValueError(f"{argument}: expected at least {low:g}, got {number:g}")
    if number > high:
        raise ValueError(f"{argument}: expected at most {high:g}, got {number:g}")
    return number


def whole_number(argument: str, value: object, low: int = 0) -> int:
    """Return ``value`` as an int that is at least ``low``; floats are refused."""
    if type(value) is bool or not isinstance(value, int | np.integer):
        raise TypeError(f"{argument}: expected a whole number, got {value!r}")
    if value < low:
        raise ValueError(f"{argument}: expected at least {low}, got {value}")
    return int(value)


def flag(argument: str, value: object) -> bool:
    """Return True or False; nothing else will do, not even 0 or "no"."""
    if type(value) not in (bool, np.bool_):
        raise TypeError(f"{argument}: expected True or False, got {value!r}")
    return bool(value)


def instance(argument: str, value: object, kind: type[T]) -> T:
    """Return an object of a class, refusing others."""
    if not isinstance(value, kind):
        got = type(value).__name__
        held = isinstance(getattr(value, argument, None), kind)  # as of an emulated one
        cure = f"; it has one: pass its .{argument}" if held else ""
        if callable(value) and not held and hasattr(kind, "from_function"):
            cure = (
                f"; of a bare log-probability make one: {kind.__name__}.from_function("
                'log_probability, {"a": (low, high), ...})'
            )
        raise TypeError(f"{argument}: expected a {kind.__name__}, got {got}{cure}")
    return value


def one_of(argument: str, value: object, choices: Iterable[T]) -> T:
    """Return which of the choices a value is, refusing others."""
    for choice in (known := list(choices)):
        if choice == value:
            return choice
    raise ValueError(f"{argument}: expected one of {known}, got {value!r}")


def mapping(argument: str, value: Mapping[K, T], form: str) -> Mapping[K, T]:
    """Return a mapping, refusing others; ``form`` is what was expected."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{argument}: expected {form}, got {type(value).__name__}")
    return value


def group(argument: str, value: object, form: str, *sizes: int) -> tuple[Any, ...]:
    """Return a sequence of as many things, refusing others; ``form`` names them."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        if len(value) in sizes:
            return tuple(value)
    raise TypeError(f"{argument}: expected {form}, got {value!r}")


def text(argument: str, value: object) -> str:
    """Return text that is not empty."""
    if not isinstance(value, str) or not value:
        raise TypeError(f"{argument}: expected a non-empty string, got {value!r}")
    return value


def units_by_name(
    argument: str, units: Mapping[str, str] | None, names: Sequence[str]
) -> dict[str, str]:
    """Return the units of some of ``names``: None is of none, ``""`` no unit."""
    by = {} if units is None else by_name(argument, units, names)
    return {
        name: "" if unit == "" else text(f"{argument}[{name!r}]", unit)
        for name, unit in by.items()
    }


def file_name(argument: str, value: object) -> str | PathLike[str]:
    """Return the name of a file; a number would be an open file, such as stdin."""
    if not isinstance(value, str | PathLike) or not str(value):
        raise TypeError(f"{argument}: expected the name of a file, got {value!r}")
    return value


def by_name(
    argument: str, values: Mapping[str, T], names: Sequence[str]
) -> dict[str, T]:
    """Return a mapping as a dict, refusing names that are not among ``names``."""
    given = dict(mapping(argument, values, "{name: value}"))
    if unknown := [name for name in given if name not in names]:
        raise ValueError(f"{argument}: no parameter {unknown}; there are {list(names)}")
    return given


def by_label(argument: str, values: Mapping[str, T], example: str) -> dict[str, T]:
    """Return a mapping with labels that are text as a dict."""
    by_name = mapping(argument, values, f"{example} by label")
    return dict(zip(parameter_names(argument, by_name), by_name.values(), strict=True))


def numbers_by_name(
    argument: str, values: Mapping[str, float], names: Sequence[str]
) -> Floats:
    """Return a number for each name, NaN where the mapping has none."""
    numbers = np.full(len(names), np.nan)
    for name, value in by_name(argument, values, names).items():
        numbers[names.index(name)] = real_number(f"{argument}[{name!r}]", value)
    return numbers


def batch(parameters: Mapping[str, Floats]) -> tuple[Mapping[str, Floats], int]:
    """Return the values of parameter sets, each ``(n,)`` floats, and n.

    The float arrays that a :class:`LogPosterior` passes are returned unchanged.
    """
    mapping("parameters", parameters, "{name: (n,)}")
    for name, value in parameters.items():
        if np.ndim(value) == 0:
            raise ValueError(
                f"parameters[{name!r}]: expected one number for each parameter set, "
                f"(n,), got {value!r}; of one set it is [{value!r}]"
            )
    values = {
        name: value
        if type(value) is np.ndarray and value.dtype == np.float64 and value.ndim == 1
        else real_array(f"parameters[{name!r}]", value, 1)
        for name, value in parameters.items()
    }
    lengths = {name: len(value) for name, value in values.items()}
    if len({*lengths.values()}) > 1:
        raise ValueError(f"parameters: expected one length, got {lengths}")
    return values, next(iter(lengths.values()), 1)


def parameter_names(argument: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return ``names`` as a tuple of distinct, non-empty strings."""
    if isinstance(names, str | set | frozenset) or not isinstance(names, Iterable):
        remedy = f"; write [{names!r}]" if type(names) is str else ""
        raise TypeError(f"{argument}: expected a sequence, got {names!r}{remedy}")
    result = tuple(names)
    for name in result:
        text(argument, name)
    if not result or len(set(result)) < len(result):
        raise ValueError(f"{argument}: expected names, each once, got {[*result]}")
    return tuple(map(str, result))  # NumPy's strings too
