"""Stiffness and mass of an FE program, what their rows are, and files of them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from .. import checks
from ..models.geometry import Geometry
from ..table import Parts, Report
from .entries import Part
from .formats import read_file, read_labels

FilePath = str | PathLike[str]
HELD = 1e35  # Abaqus puts 1e36 on the diagonal of DOFs that a boundary holds
LABELS = "dofs"  # what names the file of labels among those of matrices
DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")  # 1 to 6 in FE programs
NAMES = {name: number for number, name in enumerate(DIRECTIONS, 1)} | {
    name: number
    for number, name in enumerate(("x", "y", "z", "rotx", "roty", "rotz"), 1)
}
FORM = re.compile(r"\s*(?:node)?\s*(-?\d+)\s*[:, ]\s*(\w+)\s*", re.I)


@dataclass(frozen=True, eq=False, repr=False)
class Matrices(Report):
    """Symmetric matrices of one FE model, and what their rows are.

    :func:`read_matrices` makes it, and so do :func:`from_opensees`,
    :func:`from_pynite` and :func:`from_skfem`. K and M go to a :class:`MatrixModel` as
    they are.

    Attributes:
        matrices: ``{name: csc_array (N, N)}``; ``"K"`` and ``"M"``, and others by the
            names that they have in the files.
        nodes: Node and direction of each row, ``(N, 2)``: numbers (directions 1 to 6),
            or text where a program has names for them; None where the format has no
            labels.
        source: The file that was given, or the program.
        geometry: Nodes and lines for pictures, where a program tells; None of files.

    Examples:
        >>> import numpy as np
        >>> from scipy.sparse import csc_array
        >>> from emcee_femu.fe_files.matrices import Matrices
        >>> K = csc_array([[3.0, -1.0], [-1.0, 1.0]])
        >>> nodes = np.array([[12, 1], [12, 3]])  # node, direction
        >>> exported = Matrices({"K": K, "M": csc_array(np.eye(2))}, nodes, "beam.mtx")
        >>> exported.labels, exported.dofs("12:uz")
        (('12:ux', '12:uz'), 1)
    """

    matrices: Mapping[str, csc_array]
    nodes: NDArray[Any] | None
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
        """The names of all DOFs, such as ``"12:uz"``; none if they are not known."""
        rows = [] if self.nodes is None else self.nodes.tolist()
        return tuple(write_name(*dof) for dof in rows)

    @property
    def moving_mass(self) -> dict[str, float]:
        """The mass that moves with all nodes along ux, uy and uz, without the supports.

        ``r^T M r`` with 1 at the DOFs of one direction; compare it with what you know.
        """
        axes = [label.rpartition(":")[2] for label in self.labels]
        there = [axis for axis in DIRECTIONS[:3] if axis in axes]
        moves = {axis: np.equal(axes, axis).astype(float) for axis in there}
        return {axis: float(x @ self.M @ x) for axis, x in moves.items()}

    def dofs(self, names: str | Sequence[str] | NDArray[Any]) -> Any:
        """Return the row of a DOF, or those of several as an array, in the order given.

        Args:
            names: ``"node 12 z"`` or ``"12:uz"``, with directions x y z, ux uy uz,
                rx ry rz or a number, 1 to 6; one of the ``labels`` as it stands, such
                as ``"roof A:ux"``; or a sequence of such names.

        Raises:
            TypeError: If a name is not a string.
            ValueError: If there is no such DOF, or the file has no labels.
        """
        single = isinstance(names, str)
        listed: Any = [names] if single else names
        wanted = checks.parameter_names("names", listed)
        if self.nodes is None:
            raise ValueError(
                f"names: {self.source} does not say what its rows are; number them "
                'from 0 yourself, or give a file of labels: read_matrices({"K": ..., '
                '"M": ..., "dofs": path}) with a line such as 12.3 (node.direction) '
                "for each row"
            )
        rows = find_rows(self.labels, wanted)
        return int(rows[0]) if single else rows

    def sensors(self, names: Sequence[str] | NDArray[Any]) -> dict[str, int]:
        """Return ``{name: row}``, for ``MatrixModel(..., shapes=...)``.

        The model then names its rows as the test does, and :class:`Measurements` with
        these names as ``dofs`` are matched in any order.
        """
        wanted = checks.parameter_names("names", names)
        return dict(zip(wanted, self.dofs(wanted).tolist(), strict=True))

    def _parts(self) -> Parts:
        rows = f"{self.size} DOFs"
        if self.nodes is not None:
            rows += f" at {len(np.unique(self.nodes[:, 0]))} nodes"
        entries = ", ".join(f"{name} ({m.nnz})" for name, m in self.matrices.items())
        parts = [f"{self.source}: {rows}; entries: {entries}"]
        if "M" in self.matrices and self.moving_mass:
            masses = (f"{mass:.6g} along {at}" for at, mass in self.moving_mass.items())
            parts.append(f"moving mass: {', '.join(masses)}")
        return tuple(parts)

    def _get(self, name: str) -> csc_array:
        if name not in self.matrices:
            raise AttributeError(
                f"{self.source} holds {[*self.matrices]}, no {name}; give each file by "
                'its matrix: read_matrices({"K": ..., "M": ...})'
            )
        return self.matrices[name]


def read_matrices(path: FilePath | Mapping[str, FilePath]) -> Matrices:
    """Read stiffness and mass that an FE program exported, and what their rows are.

    The format is told by the content: Matrix Market, ``scipy.sparse.save_npz``, Abaqus
    ``*MATRIX OUTPUT``, CalculiX ``.sti .mas .dof``, Nastran DMIG and ASCII OP4, ANSYS
    ``.full``. Rows keep the order of the program; a mass that it wrote without the DOFs
    that have none gets rows of zeros there.

    Args:
        path: One file: of CalculiX and Abaqus the others of the job are found beside
            it. Or ``{"K": path, "M": path}`` where each file holds one matrix and does
            not say which; ``"dofs"`` among them is a file of labels, with a line such
            as ``12.3`` (node.direction, 1 to 6) for each row.

    Returns:
        K, M and others that the files hold, sparse, and the names of the DOFs.

    Raises:
        TypeError: If path is neither a file name nor ``{name: file name}``.
        FileNotFoundError: If there is no such file.
        ValueError: If a file is damaged, in another format, or not of this model; the
            message names the file, the line and what to do.
        ImportError: If the format needs a package that is not installed.

    Examples:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from scipy.io import mmwrite
        >>> from emcee_femu import read_matrices
        >>> with TemporaryDirectory() as folder:
        ...     files = {"K": Path(folder, "K.mtx"), "M": Path(folder, "M.mtx")}
        ...     for path in files.values():
        ...         mmwrite(path, [[3.0, -1.0], [-1.0, 1.0]])
        ...     read_matrices(files).K.toarray().tolist()
        [[3.0, -1.0], [-1.0, 1.0]]
    """
    if isinstance(path, Mapping):
        for name, given in path.items():
            checks.file_name(f"path[{name!r}]", given)
        files = {name: Path(given) for name, given in path.items()}
        labels = files.pop(LABELS, None)
        if not files or not all(isinstance(name, str) and name for name in files):
            raise ValueError(
                "path: expected files by the names of their matrices, such as "
                f"{{'K': path, 'M': path}}, got {path!r}"
            )
        parts = []
        for name, file in files.items():
            held = read_file(file)
            chosen = [part for part in held if len(held) == 1 or part.name == name]
            if len(chosen) != 1:
                raise ValueError(
                    f"{file}: expected one matrix, or one named {name}, got "
                    f"{[part.name for part in held]}"
                )
            parts.append(chosen[0]._replace(name=name))
        if labels is not None:
            parts = _label(parts, labels)
        source = ", ".join(file.name for file in files.values())
    else:
        file = Path(checks.file_name("path", path))
        parts, source = read_file(file), file.name
        if "" in (part.name for part in parts):
            raise ValueError(
                f"{file}: this format does not say which matrix it holds; write "
                "read_matrices({'K': path, 'M': path})"
            )
    return _join(parts, source)


def _label(parts: list[Part], path: Path) -> list[Part]:
    """Return the parts with the labels of a file."""
    dofs = read_labels(path)
    for part in parts:
        if part.dofs is not None and not np.array_equal(part.dofs, dofs):
            raise ValueError(
                f"path['{LABELS}']: {part.path} says itself what its rows are, and "
                f"{path} says otherwise; leave it out"
            )
    return [part._replace(dofs=dofs) for part in parts]


def _join(parts: list[Part], source: str) -> Matrices:
    """Return matrices of the same rows: those of K, or of the largest."""
    for part in parts:
        if part.dofs is not None and len(part.dofs) != part.matrix.shape[0]:
            raise ValueError(
                f"{part.path}: a matrix of {part.matrix.shape[0]} rows, but "
                f"{len(part.dofs)} labels; are they of the same job?"
            )
    first = max(parts, key=lambda part: (part.name == "K", part.matrix.shape[0]))
    matrices = {part.name: _at_rows(part, first) for part in parts}
    free = np.flatnonzero(first.matrix.diagonal() < HELD)
    if len(free) == first.matrix.shape[0]:
        return Matrices(matrices, first.dofs, source)
    if first.dofs is None:
        raise ValueError(
            f"{first.path}: {first.matrix.shape[0] - len(free)} rows are held by a "
            f"stiffness above {HELD:g}; export with labels (FORMAT=MATRIX INPUT), so "
            "that they can be left out"
        )
    kept = {name: csc_array(matrix[free][:, free]) for name, matrix in matrices.items()}
    return Matrices(kept, first.dofs[free], source)


def _at_rows(part: Part, first: Part) -> csc_array:
    """Return a matrix with the rows of another, zero for those that it has not.

    Programs leave out DOFs without mass.
    """
    size = first.matrix.shape[0]
    if part.dofs is None or first.dofs is None:
        if part.matrix.shape[0] != size:
            raise ValueError(
                f"{part.path}: a matrix of {part.matrix.shape[0]} rows, but "
                f"{first.path} has {size}; are they of the same job?"
            )
        return part.matrix
    if np.array_equal(part.dofs, first.dofs):
        return part.matrix
    place = {tuple(dof): i for i, dof in enumerate(first.dofs.tolist())}
    dofs = [tuple(dof) for dof in part.dofs.tolist()]
    unknown = [write_name(*dof) for dof in dofs if dof not in place]
    if unknown:
        raise ValueError(
            f"{part.path}: {len(unknown)} DOFs, {unknown[0]} the first, which "
            f"{first.name} of {first.path} has not; are they of the same job?"
        )
    rows = [place[dof] for dof in dofs]
    there = (np.ones(len(dofs)), (rows, range(len(dofs))))
    selection = csc_array(there, shape=(size, len(dofs)))
    return csc_array(selection @ part.matrix @ selection.T)


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
    named: dict[int | str, str] = dict(enumerate(DIRECTIONS, 1))
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
            node = label.rpartition(":")[0]
            nodes = [other.rpartition(":")[0] for other in places]
            there = [x for x, y in zip(places, nodes, strict=True) if y == node]
            raise ValueError(
                f"names: no DOF {name!r}: "
                + (
                    f"node {node} has {there}; the others are held or tied, or the "
                    "program gives it none"
                    if there
                    else f"no node {node} among {len(set(nodes))} nodes, {nodes[0]} to "
                    f"{nodes[-1]}"
                )
            )
        if len(at) > 1:
            raise ValueError(
                f"names: {name!r} is rows {at}: CalculiX makes bricks of "
                "beams and shells, with several nodes for one; choose one by its row, "
                f"such as shapes={{{name!r}: {at[0]}}}"
            )
        rows.append(at[0])
    return np.array(rows, dtype=np.intp)
