"""Matrices of an FE program, what their rows are, and polynomials through several."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array, issparse

from .. import checks
from ..measurements.directions import along_axis
from ..table import Parts, Report
from .coefficients import Product, Unit
from .geometry import Geometry
from .matrices import Matrix, read_matrix

DOF_DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")  # 1 to 6 in FE programs
DOF_WORDS = (*DOF_DIRECTIONS, "x", "y", "z", "rotx", "roty", "rotz")
NAMES = {word: number % 6 + 1 for number, word in enumerate(DOF_WORDS)}
FORM = re.compile(r"\s*(?:node)?\s*(-?\d+)\s*[:, ]\s*(\w+)\s*", re.I)
# Entries of exports are compared with sqrt(d_i d_j), d the diagonal: units and stiff
# parts of a model do not matter then.
LEFT_OVER = 1e-12  # residue of unchanged entries, which is dropped
UNCHANGED = 1e-9  # a matrix that differs by less is the same
CURVED = 1e-6  # deviation from a polynomial that is allowed, relative to the change
POWERS = 1, 2, 3  # of a parameter
FEW_DOFS = 200  # DOFs of Matrices up to which dense ones are solved faster, in batches


@dataclass(frozen=True, eq=False, repr=False)
class Matrices(Report):
    """Symmetric matrices of one FE model, with the DOF of each row.

    :func:`read_matrices`, :func:`from_opensees`, :func:`from_pynite` and
    :func:`from_skfem` return it. Pass its K and M to a :class:`MatrixModel`.

    Attributes:
        matrices: ``{name: csc_array (N, N)}``: ``"K"``, ``"M"``, and others with the
            names used in the files.
        nodes: Node and direction of each row, ``(N, 2)``: numbers (directions 1 to 6),
            or text if the program names them; None if the format has no labels.
        source: The file that was given, or the program.
        geometry: Nodes and lines for drawings, if the program provides them; None for
            files.

    Examples:
        >>> import numpy as np
        >>> from scipy.sparse import csc_array
        >>> from emcee_femu.extensions.fe_files.matrices import Matrices
        >>> K = csc_array([[3.0, -1.0], [-1.0, 1.0]])
        >>> nodes = np.array([[12, 1], [12, 3]])  # node, direction
        >>> exported = Matrices({"K": K, "M": csc_array(np.eye(2))}, nodes, "beam.mtx")
        >>> exported.labels, exported.dofs("12:uz")
        (('12:ux', '12:uz'), 1)
    """

    matrices: Mapping[str, csc_array]
    nodes: NDArray[np.int64] | NDArray[np.str_] | None
    source: str
    geometry: Geometry | None = None

    @property
    def K(self) -> csc_array:
        """The stiffness, ``(N, N)``."""
        return self._get("K")

    @property
    def M(self) -> csc_array:
        """The mass, ``(N, N)``."""
        return self._get("M")

    @property
    def size(self) -> int:
        """The number of DOFs, N."""
        return int(next(iter(self.matrices.values())).shape[0])

    @property
    def labels(self) -> tuple[str, ...]:
        """The names of all DOFs, such as ``"12:uz"``; empty if unknown."""
        rows = [] if self.nodes is None else self.nodes.tolist()
        return tuple(write_name(*dof) for dof in rows)

    @property
    def moving_mass(self) -> dict[str, float]:
        """The mass that moves with all nodes along ux, uy and uz, without the supports.

        It is ``r^T M r`` with r = 1 at the DOFs of one direction. Compare it with the
        mass that you expect.
        """
        axes = [label.rpartition(":")[2] for label in self.labels]
        moves = {x: np.equal(axes, x) * 1.0 for x in DOF_DIRECTIONS[:3] if x in axes}
        return {axis: float(r @ self.M @ r) for axis, r in moves.items()}

    def dofs(self, names: str | Sequence[str] | NDArray[np.str_]) -> Any:
        """Return the row of a DOF, or the rows of several as an array, in their order.

        Args:
            names: ``"node 12 z"`` or ``"12:uz"``, with directions x y z, ux uy uz,
                rx ry rz or a number from 1 to 6; one of the ``labels``, such as
                ``"roof A:ux"``; or a sequence of such names.

        Raises:
            TypeError: If a name is not a string.
            ValueError: If there is no such DOF, or the file has no labels.
        """
        listed = [names] if isinstance(names, str) else names
        wanted = checks.parameter_names("names", listed)
        if self.nodes is None:
            raise ValueError(
                f"names: {self.source} does not say what its rows are; number them "
                'from 0 yourself, or give a file of labels: read_matrices({"K": ..., '
                '"M": ..., "dofs": path}) with a line such as 12.3 (node.direction) '
                "for each row"
            )
        rows = find_rows(self.labels, wanted)
        return rows if listed is names else int(rows[0])

    def sensors(self, names: Sequence[str] | NDArray[np.str_]) -> dict[str, int]:
        """Return ``{name: row}``, for ``MatrixModel(..., shapes=...)``.

        The model then names its rows as the test does. :class:`Measurements` with these
        names as ``dofs`` are matched in any order.
        """
        wanted = [along_axis(x)[0] for x in checks.parameter_names("names", names)]
        return dict(zip(wanted, self.dofs(wanted).tolist(), strict=True))

    def _parts(self) -> Parts:
        rows = f"{self.size} DOFs"
        if self.nodes is not None:
            rows += f" at {len(np.unique(self.nodes[:, 0]))} nodes"
        entries = ", ".join(f"{name} ({m.nnz})" for name, m in self.matrices.items())
        yield f"{self.source}: {rows}; entries: {entries}"
        if "M" in self.matrices and self.moving_mass:
            masses = (f"{mass:.6g} along {at}" for at, mass in self.moving_mass.items())
            yield f"moving mass: {', '.join(masses)}"

    def _get(self, name: str) -> csc_array:
        if name not in self.matrices:
            raise AttributeError(
                f"{self.source} holds {[*self.matrices]}, no {name}; give each file by "
                'its matrix: read_matrices({"K": ..., "M": ...})'
            )
        return self.matrices[name]


OfParts: TypeAlias = Mapping[str, csc_array]  # "K" and "M"
# K alone, (K, M), or what a file holds.
Export: TypeAlias = Matrix | tuple[Matrix | None, ...] | Matrices


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
    few = isinstance(base, Matrices) and first["M"].shape[0] <= FEW_DOFS
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


def read_name(name: str) -> str:
    """Return the label of ``"node 12 z"``, ``"12:uz"`` or ``"12 3"``: ``"12:uz"``."""
    match = FORM.fullmatch(name)
    word = match[2].lower() if match else ""
    if match and (word in NAMES or word.isdecimal()):
        return write_name(int(match[1]), NAMES.get(word) or int(word))
    raise ValueError(
        f"names: expected a node and a direction such as 'node 12 z' or '12:uz' (out "
        f"of {' '.join(NAMES)}, or a number), or a label as it stands, got {name!r}"
    )


def write_name(node: int | str, direction: int | str) -> str:
    """Return the name of a DOF, such as ``"12:uz"``; from 7 on the number is kept."""
    named: dict[int | str, str] = dict(enumerate(DOF_DIRECTIONS, 1))
    return f"{node}:{named.get(direction, direction)}"


def find_rows(labels: Sequence[str], names: Sequence[str]) -> NDArray[np.intp]:
    """Return the row of each name among the labels of all rows.

    Raises:
        ValueError: If there is no such node, no such direction at it, or several.
    """
    rows = []
    places: dict[str, list[int]] = {}
    for row, label in enumerate(labels):
        places.setdefault(label, []).append(row)
    for name in names:
        label = name if name in places else read_name(name)
        at = places.get(label, [])
        if not at:
            nodes = [x.rpartition(":")[0] for x in places]
            node = label.rpartition(":")[0]
            there = [x for x, y in zip(places, nodes, strict=True) if y == node]
            found = f"node {node} has {there}" if there else f"no node {node}"
            raise ValueError(
                f"names: no DOF {name!r}: {found} among {len({*nodes})} nodes, "
                f"{nodes[0]} to {nodes[-1]}; others are held or tied, or the program "
                "gives none"
            )
        if len(at) > 1:
            raise ValueError(
                f"names: {name!r} is rows {at}: CalculiX makes bricks of "
                "beams and shells, with several nodes for one; choose one by its row, "
                f"such as shapes={{{name!r}: {at[0]}}}"
            )
        rows.append(at[0])
    return np.array(rows, dtype=np.intp)
