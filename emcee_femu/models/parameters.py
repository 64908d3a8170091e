"""What models of named parameters share: reading a batch, and the DOFs of shapes."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Floats, Parameters


def check_mapping(argument: str, value: Any, form: str) -> None:
    """Raise TypeError unless ``value`` is a mapping of the given form."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{argument}: expected {form}, got {type(value).__name__}")


def read_batch(
    parameters: Parameters, required: Sequence[str]
) -> tuple[Parameters, int]:
    """Return the values, each ``(n,)``, and n; every required name must be there."""
    values, n = checks.batch(parameters)
    missing = [name for name in required if name not in values]
    if missing:
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


def columns(values: Parameters, names: Iterable[str], n: int) -> Floats:
    """Return the values of ``names`` side by side, ``(n, n_names)``."""
    rows = [values[name] for name in names]
    return np.array(rows).reshape(len(rows), n).T


def describe(values: Parameters, names: Iterable[str], row: int) -> str:
    """Return one parameter set by name, for a message."""
    return str({name: float(values[name][row]) for name in names})


def check_positive(values: Parameters, names: Iterable[str], kind: str) -> None:
    """Raise ValueError unless all values of ``names`` are above zero."""
    for name in names:
        if not (values[name] > 0).all():
            raise ValueError(
                f"parameters: the {kind} {name!r} must be above zero, got "
                f"{values[name].min():g}; give its prior a lower bound"
            )


def choose_dofs(shapes: Any, dofs: Sequence[Hashable]) -> tuple[Any, ...]:
    """Return those of the model's DOFs at which ``shapes=`` asks for mode shapes.

    Args:
        shapes: False for none, True for all, or a sequence of DOFs in any order.
        dofs: All DOFs of the model, by number or by label.

    Raises:
        TypeError: If shapes is neither True, False nor a sequence.
        ValueError: If a DOF does not exist or is repeated, or the sequence is empty.
    """
    if isinstance(shapes, bool | np.bool_):
        return tuple(dofs) if shapes else ()
    if np.ndim(shapes) != 1:
        raise TypeError(f"shapes: expected True, False or DOFs, got {shapes!r}")
    chosen = tuple(shapes)
    if isinstance(dofs, range):
        chosen = tuple(checks.whole_number("shapes", dof) for dof in chosen)
    for dof in chosen:
        if dof not in dofs:
            raise ValueError(f"shapes: no DOF {dof}; DOFs are {dofs[0]} to {dofs[-1]}")
    if not chosen:
        raise ValueError("shapes: expected at least one DOF, got none; write False")
    if len(set(chosen)) < len(chosen):
        raise ValueError(f"shapes: each DOF once, got {chosen}")
    return chosen
