"""The parameter sets that a model is called with, and how messages name one of them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from .. import checks
from ..contracts import Parameters

Where: TypeAlias = Callable[[int], str]  # names a parameter set i in a message


def read_batch(parameters: Parameters, names: Sequence[str]) -> tuple[Parameters, int]:
    """Return the values, each ``(n,)``, and n; every name must be there."""
    values, n = checks.batch(parameters)
    if missing := [name for name in names if name not in values]:
        raise ValueError(f"parameters: no value for {missing}")
    return values, n


def read_inside(
    parameters: Parameters, bounds: Mapping[str, tuple[float, float]], verb: str
) -> tuple[Parameters, int]:
    """Return values and n for a model that holds within bounds.

    Args:
        parameters: ``{name: (n,)}``.
        bounds: ``{name: (low, high)}`` of all that it needs.
        verb: What made the model: "reduce" or "emulate".

    Raises:
        ValueError: If a parameter is missing or outside its bounds.
    """
    values, n = read_batch(parameters, tuple(bounds))
    for name, (low, high) in bounds.items():
        value = values[name]
        outside = ~((value >= low) & (value <= high))
        if outside.any():
            row = int(np.argmax(outside))
            raise ValueError(
                f"parameters: {name} = {value[row]:.10g} of row {row} is outside the "
                f"bounds [{low:g}, {high:g}] of the {verb.removesuffix('e')}ed model; "
                f"{verb} over wider bounds, or give its prior these bounds"
            )
    return values, n


def describe(values: Parameters, names: Iterable[str], row: int) -> str:
    """Return one parameter set by name, for a message."""
    return str({name: float(values[name][row]) for name in names})
