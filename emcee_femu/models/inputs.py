"""What models share at their border: parameter sets, DOFs, and matrices.

Matrices come as they are, or as what a program exports at several values of parameters
in which they are affine.
"""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_array, diags_array, issparse

from .. import checks
from ..interfaces import Derivatives, Floats, Parameters

Matrix: TypeAlias = Floats | csc_array
# Of K and of M, (n, n_k) and (n, n_m), and what names a parameter set in a message.
Coefficients: TypeAlias = tuple[Floats, Floats, Callable[[int], str]]
Dofs: TypeAlias = Sequence[Hashable] | Mapping[Hashable, Hashable] | NDArray[np.intp]


@runtime_checkable
class Matrices(Protocol):
    """What a file holds, as read_matrices returns it."""

    @property
    def matrices(self) -> Mapping[str, csc_array]:
        """``"K"``, ``"M"`` and others."""

    @property
    def labels(self) -> tuple[str, ...]:
        """The names of all DOFs; none if they are not known."""


# K alone, (K, M), or what a file holds.
Export: TypeAlias = Matrix | tuple[Matrix | None, ...] | Matrices

ASYMMETRY = 1e-8  # share of the largest entry; FE programs print 9 to 16 digits
# Entries of exports are compared with sqrt(d_i d_j), d the diagonal: units and stiff
# parts of a model do not matter then.
NOISE = 1e-12  # what is left of entries that did not change, and is dropped
UNCHANGED = 1e-9  # a matrix that differs by less is the same
CURVED = 1e-6  # share of a change by which it may be off the straight line


def read_batch(parameters: Parameters, names: Sequence[str]) -> tuple[Parameters, int]:
    """Return the values, each ``(n,)``, and n; every name must be there."""
    values, n = checks.batch(parameters)
    missing = [name for name in names if name not in values]
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


def check_positive(values: Floats, names: Sequence[str], kind: str) -> None:
    """Raise ValueError unless all ``values (n, n_names)`` are above zero."""
    if values.size and not values.min() > 0:
        column = int(np.argmin((values > 0).all(axis=0)))
        raise ValueError(
            f"parameters: the {kind} {names[column]!r} must be above zero, got "
            f"{values[:, column].min():g}; give its prior a lower bound"
        )


def derive_along(
    function: Callable[..., Mapping[str, Floats]],
    values: Sequence[Floats],
    tangents: Sequence[Floats],
    steps: Floats,
    names: Iterable[str],
) -> Derivatives:
    """Return derivatives of what a function returns, by central differences.

    They cost calls of the function, and no solve.

    Args:
        function: From arrays to ``{variable: (n, *shape)}``.
        values: The arrays, each ``(n, ...)``.
        tangents: How each array changes along d directions, ``(d, n, ...)``.
        steps: How far along each direction, ``(d, n)``.
        names: What the directions are called.
    """

    def widen(step: Floats, value: Floats) -> Floats:
        return step.reshape(-1, *[1] * (value.ndim - 1))

    slopes: Derivatives = {}
    for j, (name, step) in enumerate(zip(names, steps, strict=True)):
        moves = [widen(step, v) * t[j] for v, t in zip(values, tangents, strict=True)]
        ahead = function(*map(np.add, values, moves))
        behind = function(*map(np.subtract, values, moves))
        for variable, value in ahead.items():
            slope = (value - behind[variable]) / widen(2 * step, value)
            slopes.setdefault(variable, {})[name] = slope
    return slopes


def choose_dofs(
    argument: str, chosen: bool | Dofs, dofs: Sequence[Hashable]
) -> dict[Hashable, int]:
    """Return ``{label: place}`` of those of the model's DOFs that a user asks for.

    Args:
        argument: Its name, for messages.
        chosen: False for none, True for all, a sequence of DOFs in any order, or
            ``{label: DOF}``.
        dofs: All DOFs of the model, by number or by label.

    Raises:
        TypeError: If chosen is of another type.
        ValueError: If a DOF does not exist or is repeated, or there are none.
    """
    if isinstance(chosen, bool | np.bool_):
        return {dof: i for i, dof in enumerate(dofs)} if chosen else {}
    if isinstance(chosen, Mapping):
        labels, wanted = list(chosen), list(chosen.values())
    elif np.ndim(np.asarray(chosen, dtype=object)) == 1:
        labels = wanted = list(chosen)
    else:
        raise TypeError(f"{argument}: expected True, False or DOFs, got {chosen!r}")
    if isinstance(dofs, range):
        wanted = [checks.whole_number(argument, dof) for dof in wanted]
    for dof in wanted:
        if dof not in dofs:
            raise ValueError(
                f"{argument}: no DOF {dof}; DOFs are {dofs[0]} to {dofs[-1]}"
            )
    if not wanted or len(set(wanted)) < len(wanted):
        raise ValueError(f"{argument}: expected DOFs, each once, got {wanted}")
    places = [dofs.index(dof) for dof in wanted]
    return dict(zip(labels, places, strict=True))


def read_matrix(
    argument: str, value: ArrayLike | Matrix, size: int | None = None, *, sparse: bool
) -> Matrix:
    """Return a finite, symmetric ``(N, N)`` matrix; a tiny asymmetry is averaged out.

    Args:
        argument: Its name, for messages.
        value: Dense, or of scipy.sparse, which is never made dense.
        size: N, where it is known.
        sparse: Whether to return a float64 ``csc_array`` without stored zeros.

    Raises:
        TypeError: If the matrix is sparse where a dense one is expected.
        ValueError: If the matrix is not square, not of ``size`` where that is given, or
            differs from its transpose by more than 1e-8 of its largest entry.
    """
    if issparse(value) and not sparse:
        raise TypeError(
            f"{argument}: a sparse matrix beside a dense K0; give K0 as a scipy.sparse "
            f"matrix too (an empty one is csc_array((N, N))), or {argument}.toarray()"
        )
    if issparse(value):
        matrix = csc_array(value)
        matrix.data = checks.real_array(f"{argument} (as stored)", matrix.data)
    else:
        matrix = checks.real_array(argument, value, 2)
    N = matrix.shape[0]
    if matrix.shape != (N, N) or not N:
        raise ValueError(f"{argument}: expected a square matrix, got {matrix.shape}")
    if size not in (None, N):
        raise ValueError(
            f"{argument}: expected the shape of K0, {(size, size)}, got {(N, N)}"
        )
    gap, largest = abs(matrix - matrix.T).max(), abs(matrix).max()
    if gap > ASYMMETRY * largest:
        raise ValueError(
            f"{argument}: expected a symmetric matrix, but entries differ from the "
            f"transpose by up to {gap:.3g} (largest entry {largest:.3g})"
        )
    mean = 0.5 * (matrix + matrix.T)
    if not sparse:
        return mean
    result = csc_array(mean)
    result.eliminate_zeros()
    result.sort_indices()
    return result


def read_units(
    label: str, units: Mapping[str, Matrix], size: int, sparse: bool
) -> dict[str, Matrix]:
    """Return the matrices that parameters multiply, checked."""
    checks.mapping(label, units, "{parameter: matrix}")
    return {
        name: read_matrix(f"{label}[{name!r}]", matrix, size, sparse=sparse)
        for name, matrix in units.items()
    }


def fit_affine(
    base: Export, changes: Mapping[str, Mapping[float, Export]], at: Mapping[str, float]
) -> tuple[dict[str, Matrix], dict[str, dict[str, Matrix]]]:
    """Return constant parts and units ``{parameter: matrix}``, of "K" and of "M".

    The arguments are those of :meth:`MatrixModel.from_differences`.
    """
    first = _read_export("base", base, base)
    if len(first) < 2:
        raise ValueError("base: expected stiffness and mass, Matrices or (K0, M0)")
    checks.mapping("changes", changes, "{parameter: {value: matrices}}")
    names = checks.parameter_names("changes", changes)
    values = dict.fromkeys(names, 1.0) | checks.by_name("at", at, names)
    constants = dict(first)
    units: dict[str, dict[str, Matrix]] = {"K": {}, "M": {}}
    for name in names:
        label, start = f"changes[{name!r}]", checks.real_number("at", values[name])
        checks.mapping(label, changes[name], "{value: matrices}")
        steps = {
            checks.real_number(label, value) - start: _read_export(
                f"{label}[{value!r}]", export, base
            )
            for value, export in changes[name].items()
        }
        if not steps or 0.0 in steps:
            raise ValueError(
                f"{label}: expected matrices at values other than {start:g}, the one "
                f"at the base; where that is not its value, give at={{{name!r}: value}}"
            )
        for part, slope in _fit_line(label, first, steps, start).items():
            units[part][name] = slope
            constants[part] = constants[part] - start * slope
    keep = csc_array if issparse(_split(base)["K"]) else csc_array.toarray
    fitted = {
        part: {name: keep(A) for name, A in by_name.items()}
        for part, by_name in units.items()
    }
    return {part: keep(_drop(constants[part], first[part])) for part in first}, fitted


def _split(export: Export) -> dict[str, Matrix]:
    """Return stiffness and mass of an export, those that there are."""
    if isinstance(export, Matrices):
        matrices = export.matrices
    else:
        pair = export if isinstance(export, tuple) else (export,)
        matrices = dict(zip("KM", pair, strict=False))
    return {part: matrices[part] for part in "KM" if matrices.get(part) is not None}


def _read_export(argument: str, export: Export, base: Export) -> dict[str, csc_array]:
    """Return the matrices of one export, checked, on the DOFs of the base."""
    if isinstance(export, Matrices) and isinstance(base, Matrices):
        if export.labels != base.labels:
            raise ValueError(
                f"{argument}: expected the nodes and directions of the base, in its "
                "order; was the mesh or a support changed, or the program numbers anew?"
            )
    matrices, size = _split(export), np.shape(next(iter(_split(base).values()), ()))
    if not matrices or not size:
        raise ValueError(f"{argument}: expected K, (K, M) or Matrices, got none")
    return {
        part: read_matrix(f"{argument}, {part}", matrix, size[0], sparse=True)
        for part, matrix in matrices.items()
    }


def _fit_line(
    argument: str,
    first: Mapping[str, csc_array],
    steps: Mapping[float, Mapping[str, csc_array]],
    start: float,
) -> dict[str, csc_array]:
    """Return the units of K and M, by the export that is farthest from the base."""
    farthest = max(steps, key=abs)
    slopes = {}
    for part, new in steps[farthest].items():
        change, size = new - first[part], abs(first[part]) + abs(new)
        if _scale(change, size).max() >= UNCHANGED:
            slopes[part] = _drop(change, size) / farthest
    if not slopes:
        raise ValueError(
            f"{argument}: K and M are those of the base, to {UNCHANGED:g} of their "
            "diagonal; was the parameter changed, and the right file read? If it has "
            "little to do with them, change it more"
        )
    for step, parts in steps.items():
        for part, new in parts.items():
            change, size = new - first[part], abs(first[part]) + abs(new)
            off = change - step * slopes[part] if part in slopes else change
            gap, whole = _scale(off, size).max(), _scale(change, size).max()
            if gap > CURVED * whole + UNCHANGED:
                raise ValueError(
                    f"{argument}: {part} is not affine in this parameter: at "
                    f"{start + step:g} it is off the straight line by "
                    f"{gap / whole:.1%} of its change; take a parameter in which it "
                    "is, such as E or I for a thickness, or a power of it"
                )
    return slopes


def _scale(matrix: csc_array, reference: csc_array) -> csc_array:
    """Return ``|a_ij| / sqrt(d_i d_j)``, d the diagonal of a reference."""
    diagonal = np.abs(reference.diagonal())
    scale = diags_array(1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)))
    return abs(scale @ matrix @ scale)


def _drop(matrix: csc_array, reference: csc_array) -> csc_array:
    """Return a matrix without entries that are noise beside a reference's diagonal."""
    return csc_array(matrix.multiply(_scale(matrix, reference) > NOISE))
