"""Matrices affine in the parameters, from what a program exports at their values."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_array, diags_array, issparse

from .. import checks
from .eigen.symmetric import sparse_symmetric
from .exports.record import Matrices
from .parameters import check_mapping

# Entries are compared with sqrt(d_i d_j), d the diagonal: units and stiff parts of a
# model do not matter then. Programs print 9 to 16 digits.
NOISE = 1e-12  # what is left of entries that did not change, and is dropped
UNCHANGED = 1e-9  # a matrix that differs by less is the same
CURVED = 1e-6  # share of a change by which it may be off the straight line


class Pair(NamedTuple):
    """Stiffness and mass of one export; None where it is not given."""

    K: csc_array | None
    M: csc_array | None


def affine_parts(
    base: Any, changes: Mapping[str, Mapping[float, Any]], at: Mapping[str, float]
) -> tuple[list[Any], list[dict[str, Any]]]:
    """Return constant parts and units ``{parameter: matrix}``, of K and of M.

    The arguments are those of :meth:`MatrixModel.from_differences`.
    """
    dense = not issparse(_give(base, 0))
    first = _read("base", base, None, None)
    if first.K is None or first.M is None:
        raise ValueError("base: expected stiffness and mass, Matrices or (K0, M0)")
    check_mapping("changes", changes, "{parameter: {value: matrices}}")
    names = checks.parameter_names("changes", changes)
    for name in names:
        check_mapping(f"changes[{name!r}]", changes[name], "{value: matrices}")
    start = dict.fromkeys(names, 1.0) | {
        name: checks.real_number(f"at[{name!r}]", value)
        for name, value in checks.by_name("at", at, names).items()
    }
    constants = [first.K, first.M]
    units: list[dict[str, Any]] = [{}, {}]
    for name in names:
        slopes = _find_slopes(name, base, first, changes[name], start[name])
        for part, slope in enumerate(slopes):
            if slope is not None:
                units[part][name] = slope
                constants[part] = constants[part] - start[name] * slope
    kept = [
        _drop(constant, matrix, NOISE)
        for constant, matrix in zip(constants, first, strict=True)
    ]
    if dense:
        units = [{k: unit.toarray() for k, unit in own.items()} for own in units]
        kept = [constant.toarray() for constant in kept]
    return kept, units


def _find_slopes(
    name: str, base: Any, first: Pair, exports: Mapping[float, Any], start: float
) -> list[csc_array | None]:
    """Return the units of K and M, by the export that is farthest from the base."""
    argument = f"changes[{name!r}]"
    steps = {}
    for value, given in exports.items():
        step = checks.real_number(f"{argument}, a value", value) - start
        if step == 0:
            raise ValueError(
                f"{argument}: expected values other than {start:g}, the one at the "
                f"base; where that is not its value, give at={{{name!r}: value}}"
            )
        steps[step] = _read(f"{argument}[{value!r}]", given, base, first)
    if not steps:
        raise ValueError(f"{argument}: expected matrices at one value or more")
    farthest = max(steps, key=abs)
    slopes = [
        None
        if old is None or new is None or _size(new - old, old, new) < UNCHANGED
        else _drop(new - old, abs(old) + abs(new), NOISE) / farthest
        for old, new in zip(first, steps[farthest], strict=True)
    ]
    if not any(slope is not None for slope in slopes):
        raise ValueError(
            f"{argument}: K and M are those of the base, to {UNCHANGED:g} of their "
            "diagonal; was the parameter changed, and the right file read? If it has "
            "little to do with them, change it more"
        )
    for step, pair in steps.items():
        for label, slope, old, new in zip("KM", slopes, first, pair, strict=True):
            if new is not None:
                line = old if slope is None else old + step * slope
                _check_line(f"{argument}: {label}", start + step, line, old, new)
    return slopes


def _check_line(
    what: str, value: float, line: csc_array, old: csc_array, new: csc_array
) -> None:
    """Raise ValueError unless the matrix at a value is on the straight line."""
    gap, change = _size(new - line, old, new), _size(new - old, old, new)
    if gap > CURVED * change + UNCHANGED:
        raise ValueError(
            f"{what} is not affine in this parameter: at {value:g} it is off the "
            f"straight line by {gap / change:.1%} of its change; take a parameter in "
            "which it is, such as E or I for a thickness, or a power of it"
        )


def _read(argument: str, given: Any, base: Any, first: Pair | None) -> Pair:
    """Return one export: Matrices, ``(K, M)`` or K alone."""
    if isinstance(given, Matrices) and isinstance(base, Matrices):
        if given.labels != base.labels:
            raise ValueError(
                f"{argument}: expected the nodes and directions of the base, in its "
                "order; was the mesh or a support changed, or the program numbers anew?"
            )
    found = []
    for part, label in enumerate("KM"):
        matrix = _give(given, part)
        size = None if first is None else first.K.shape[0]  # type: ignore[union-attr]
        found.append(
            None
            if matrix is None
            else sparse_symmetric(f"{argument}, {label}", matrix, size)
        )
    if found == [None, None]:
        raise ValueError(f"{argument}: expected K, (K, M) or Matrices, got none")
    return Pair(*found)


def _give(given: Any, part: int) -> Any:
    """Return K (0) or M (1) of what a user gives for an export, or None."""
    if isinstance(given, Matrices):
        return given.matrices.get("KM"[part])
    if isinstance(given, tuple):
        return given[part] if part < len(given) else None
    return None if part else given


def _scale(matrix: csc_array) -> Any:
    """Return the diagonal matrix that brings the diagonal of another to one."""
    diagonal = np.abs(matrix.diagonal())
    return diags_array(1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)))


def _size(matrix: csc_array, *references: csc_array) -> float:
    """Return the largest entry by the diagonals of the references."""
    scale = _scale(sum(abs(reference) for reference in references))
    return float(abs(scale @ matrix @ scale).max())


def _drop(matrix: csc_array, reference: csc_array, share: float) -> csc_array:
    """Return a matrix without entries below a share of the reference's diagonal."""
    scale = _scale(reference)
    kept = abs(scale @ matrix @ scale) > share
    return csc_array(matrix.multiply(kept))
