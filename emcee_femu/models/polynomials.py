"""Matrices as polynomials of parameters, from exports at several of their values."""

from collections.abc import Iterable, Mapping
from itertools import combinations
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from scipy.sparse import csc_array, diags_array, issparse

from .. import checks
from .coefficients import Product, Unit
from .geometry import Geometry
from .matrices import Matrix, read_matrix

# Entries of exports are compared with sqrt(d_i d_j), d the diagonal: units and stiff
# parts of a model do not matter then.
LEFT_OVER = 1e-12  # residue of unchanged entries, which is dropped
UNCHANGED = 1e-9  # a matrix that differs by less is the same
CURVED = 1e-6  # deviation from a polynomial that is allowed, relative to the change
POWERS = 1, 2, 3  # of a parameter
FEW_DOFS = 200  # DOFs up to which dense matrices are solved faster, in batches

OfParts: TypeAlias = Mapping[str, csc_array]  # "K" and "M"


@runtime_checkable
class Named(Protocol):
    """Matrices of one FE model by name, such as :func:`read_matrices` returns."""

    @property
    def matrices(self) -> Mapping[str, csc_array]:
        """``{name: matrix (N, N)}``, with ``"K"`` and ``"M"`` among the names."""

    @property
    def labels(self) -> tuple[str, ...]:
        """The names of all rows; empty if unknown."""

    @property
    def geometry(self) -> Geometry | None:
        """Nodes and lines for drawings; None without."""


# K alone, (K, M), or all with their names.
Export: TypeAlias = Matrix | tuple[Matrix | None, ...] | Named


def fit_polynomials(
    base: Export, changes: Mapping[str, Mapping[float, Export]], at: Mapping[str, float]
) -> tuple[dict[str, Matrix], dict[str, dict[str, Unit]]]:
    """Return constant parts and units, of "K" and of "M".

    The arguments are those of :meth:`MatrixModel.from_differences`.
    """
    first = _read_export("base", base, base)
    if len(first) < 2:
        raise ValueError("base: expected stiffness and mass, Matrices or (K0, M0)")
    checks.mapping("changes", changes, "{parameter: {value: matrices}}")
    names = checks.parameter_names("changes", changes)
    values = dict.fromkeys(names, 1.0) | checks.by_name("at", at, names)
    few = isinstance(base, Named) and first["M"].shape[0] <= FEW_DOFS
    dense = few and first["M"].diagonal().min() > 0 or not issparse(_split(base)["K"])
    keep = csc_array.toarray if dense else csc_array
    constants = dict(first)
    units: dict[str, dict[str, Unit]] = {"K": {}, "M": {}}
    for name in names:
        label, start = f"changes[{name!r}]", checks.real_number("at", values[name])
        checks.mapping(label, changes[name], "{value: matrices}")
        exports = {
            checks.real_number(label, value): _read_export(
                f"{label}[{value!r}]", export, base
            )
            for value, export in changes[name].items()
        }
        if not exports or start in exports:
            raise ValueError(
                f"{label}: expected matrices at values other than {start:g}, the one "
                f"at the base; where that is not its value, give at={{{name!r}: value}}"
            )
        for part, terms in _fit_powers(label, first, exports, start).items():
            for power, matrix in terms.items():
                constants[part] = constants[part] - start**power * matrix
                unit: Unit = keep(matrix)
                if power == 1:
                    units[part][name] = unit
                else:
                    units[part][f"{name}^{power}"] = unit, Product((name,) * power)
    return {part: keep(_drop(constants[part], first[part])) for part in first}, units


def _split(export: Export) -> dict[str, Matrix]:
    """Return stiffness and mass of an export, those that there are."""
    if isinstance(export, Named):
        matrices = export.matrices
    else:
        pair = export if isinstance(export, tuple) else (export,)
        matrices = dict(zip("KM", pair, strict=False))
    return {part: matrices[part] for part in "KM" if matrices.get(part) is not None}


def _read_export(argument: str, export: Export, base: Export) -> dict[str, csc_array]:
    """Return the matrices of one export, checked, on the DOFs of the base."""
    if isinstance(export, Named) and isinstance(base, Named):
        if export.labels != base.labels:
            raise ValueError(
                f"{argument}: expected the nodes and directions of the base, in its "
                "order; was the mesh or a support changed, or were nodes renumbered?"
            )
    matrices, size = _split(export), np.shape(next(iter(_split(base).values()), ()))
    if not matrices or not size:
        raise ValueError(f"{argument}: expected K, (K, M) or Matrices, got none")
    return {
        part: read_matrix(f"{argument}, {part}", matrix, size[0], sparse=True)
        for part, matrix in matrices.items()
    }


def _fit_powers(
    argument: str, first: OfParts, exports: Mapping[float, OfParts], start: float
) -> dict[str, dict[int, csc_array]]:
    """Return what powers of a parameter multiply in K and M, the fewest that fit.

    One export shows a line; others are taken where there is an export more than powers.
    """
    fitted = {}
    for part in ("K", "M"):
        given = {x: parts[part] for x, parts in exports.items() if part in parts}
        changes = [new - first[part] for new in given.values()]
        sizes = [abs(first[part]) + abs(new) for new in given.values()]
        wholes = [_scale(*pair).max() for pair in zip(changes, sizes, strict=True)]
        if max(wholes, default=0.0) < UNCHANGED:
            continue
        misfits, whole = [], sizes[int(np.argmax(wholes))]
        for count in range(1, max(1, min(len(given) - 1, len(POWERS))) + 1):
            for powers in combinations(POWERS if len(given) > 1 else POWERS[:1], count):
                steps = [[x**p - start**p for p in powers] for x in given]
                scale = np.abs(steps).max(axis=0)  # powers of 2e11, beside others
                weights = np.linalg.pinv(steps / scale)
                parts = [_add(row, changes) for row in weights]
                terms = [_drop(A, whole) / s for A, s in zip(parts, scale, strict=True)]
                off = [
                    _scale(_add([1.0, *-np.array(row)], [change, *terms]), size).max()
                    for row, change, size in zip(steps, changes, sizes, strict=True)
                ]
                misfit = (np.array(off) - UNCHANGED) / np.maximum(wholes, UNCHANGED)
                misfits.append((float(misfit.max()), powers, terms))
        # The fewest powers that fit, or what is nearest.
        worst, powers, terms = min(misfits, key=lambda fit: max(fit[0], CURVED))
        if worst > CURVED:
            nearest = " + ".join(f"c{p} x^{p}" for p in powers)
            raise ValueError(
                f"{argument}: {part} is not a polynomial in this parameter, up to its "
                f"cube, judging by {len(given)} exports besides the base: the "
                f"nearest, c0 + {nearest}, is off by {worst:.1%} of a change; give "
                "more exports, or take another parameter, such as E or I"
            )
        fitted[part] = dict(zip(powers, terms, strict=True))
    if not fitted:
        raise ValueError(
            f"{argument}: K and M are those of the base, to {UNCHANGED:g} of their "
            "diagonal; was the parameter changed, and the right file read? If they "
            "hardly depend on it, change it more"
        )
    return fitted


def _add(weights: Iterable[float], matrices: Iterable[csc_array]) -> csc_array:
    """Return the weighted sum of matrices."""
    return csc_array(sum(w * A for w, A in zip(weights, matrices, strict=True)))


def _scale(matrix: csc_array, reference: csc_array) -> csc_array:
    """Return ``|a_ij| / sqrt(d_i d_j)``, d the diagonal of a reference."""
    diagonal = np.abs(reference.diagonal())
    scale = diags_array(1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)))
    return abs(scale @ matrix @ scale)


def _drop(matrix: csc_array, reference: csc_array) -> csc_array:
    """Return a matrix without entries that are noise beside a reference's diagonal."""
    return csc_array(matrix.multiply(_scale(matrix, reference) > LEFT_OVER))
