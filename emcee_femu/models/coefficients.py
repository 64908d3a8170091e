"""What multiplies the matrices of a model: parameters, or functions of them."""

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats, Parameters
from .matrices import Matrix, read_matrix
from .parameter_sets import Where, describe, read_batch

# Of a parameter's value: the differences are exact up to fourth powers.
COEFFICIENT_STEP = 1e-3
# At two and at one steps on either side of a value, by the step.
STENCIL = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}

Function: TypeAlias = Callable[..., ArrayLike]  # of parameters, by their names
Unit: TypeAlias = Matrix | tuple[Matrix, Function]
# The parameters that a function takes, and it; None for the parameter itself.
Coefficient: TypeAlias = tuple[tuple[str, ...], Function | None]


@dataclass(frozen=True)
class Product:
    """A product of parameters, one as often as its power says."""

    names: tuple[str, ...]

    def __call__(self, **values: Floats) -> Floats:
        """Return the product."""
        return np.asarray(math.prod(values[name] for name in self.names))


@dataclass(frozen=True)
class Coefficients:
    """What multiplies the matrices of one or two sums, K and M.

    Attributes:
        parts: For each sum ``{label: (arguments, function)}``; without a function the
            label is the parameter.
        positive: What all parameters are that must be above zero, "" for any.
    """

    parts: tuple[Mapping[str, Coefficient], ...]
    positive: str = ""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The parameters, each once."""
        every = (named for part in self.parts for named, _ in part.values())
        return tuple(dict.fromkeys(name for named in every for name in named))

    def __call__(self, parameters: Parameters) -> tuple[list[Floats], Where]:
        """Return the coefficients ``(n, n_units)`` of each sum; what names a set.

        Raises:
            ValueError: If a parameter is missing, or not above zero where it must be,
                or a function does not return n finite numbers.
        """
        values, n = read_batch(parameters, self.names)
        every = [values[name] for name in self.names] if self.positive else []
        if not np.min(every, initial=np.inf) > 0:
            least = {name: values[name].min() for name in self.names}
            name = min(least, key=least.__getitem__)
            raise ValueError(
                f"parameters: the {self.positive} {name!r} must be above zero, got "
                f"{least[name]:g}; give its prior a lower bound"
            )
        rows = [
            np.array([_evaluate(label, part[label], values, n) for label in part])
            for part in self.parts
        ]
        where = partial(describe, values, self.names)
        return [each.reshape(-1, n).T for each in rows], where

    def slopes(self, parameters: Parameters) -> dict[str, tuple[Floats, ...]]:
        """Return how they change with each parameter, ``(n, n_units)`` of each sum."""
        values, n = read_batch(parameters, self.names)
        shapes = [(n, len(part)) for part in self.parts]
        slopes = {name: tuple(map(np.zeros, shapes)) for name in self.names}
        for sum_, part in enumerate(self.parts):
            for unit, (label, coefficient) in enumerate(part.items()):
                for name in coefficient[0]:
                    slope = _differentiate(label, coefficient, name, values, n)
                    slopes[name][sum_][:, unit] = slope
        return slopes


def read_units(
    argument: str, units: Mapping[str, Unit], size: int, sparse: bool
) -> tuple[dict[str, Matrix], dict[str, Coefficient]]:
    """Return matrices by label, checked, and what multiplies each.

    Args:
        argument: Its name, for messages.
        units: ``{parameter: matrix}``, or ``{label: (matrix, function)}``.
        size: Rows of all matrices.
        sparse: Whether they are made sparse.
    """
    expected = "{parameter: matrix} or {label: (matrix, function)}"
    checks.mapping(argument, units, expected)
    if units:
        checks.parameter_names(argument, units)
    matrices: dict[str, Matrix] = {}
    coefficients: dict[str, Coefficient] = {}
    for label, unit in units.items():
        where = f"{argument}[{label!r}]"
        pair = unit if isinstance(unit, tuple) else (unit, None)
        matrix, function = checks.group(where, pair, "(matrix, function)", 2)
        matrices[label] = read_matrix(where, matrix, size, sparse=sparse)
        named = (label,) if function is None else _read_arguments(where, function)
        coefficients[label] = named, function
    return matrices, coefficients


def _differentiate(
    label: str, coefficient: Coefficient, name: str, values: Parameters, n: int
) -> Floats:
    if coefficient[1] is None:
        return np.ones(n)
    value = values[name]
    step = COEFFICIENT_STEP * np.where(value != 0, np.abs(value), 1.0)
    change = np.zeros(n)
    for steps, weight in STENCIL.items():
        moved = {**values, name: value + steps * step}
        change += weight * _evaluate(label, coefficient, moved, n)
    return change / step


def _evaluate(label: str, factor: Coefficient, values: Parameters, n: int) -> Floats:
    named, function = factor
    if function is None:
        return values[label]
    result = function(**{name: values[name] for name in named})
    numbers = checks.numeric_array(f"function of {label!r}", result)
    remedy = f"it is given arrays ({n},)"
    checks.shaped(f"function of {label!r}", numbers.shape, (n,), remedy=remedy)
    if not np.isfinite(numbers).all():
        row = int(np.argmin(np.isfinite(numbers)))
        raise ValueError(
            f"function of {label!r}: expected finite numbers, got {numbers[row]} at "
            f"{describe(values, named, row)}; give its parameters bounds"
        )
    return numbers


def _read_arguments(where: str, function: Function) -> tuple[str, ...]:
    """Return the parameters of a function: its arguments without a default."""
    if isinstance(function, Product):
        return tuple(dict.fromkeys(function.names))
    try:
        arguments = [*inspect.signature(function).parameters.values()]
    except (TypeError, ValueError):  # no function, or one of C that tells none
        arguments = []
    named = {inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY}
    free = [each for each in arguments if each.default is inspect.Parameter.empty]
    if not free or any(each.kind not in named for each in free):
        raise TypeError(
            f"{where}: expected (matrix, function) with a function whose arguments "
            f"are parameters, such as lambda t: t**3, got {function!r}"
        )
    return tuple(each.name for each in free)
