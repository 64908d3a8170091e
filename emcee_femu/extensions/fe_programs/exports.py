"""The matrices that an FE program hands over, and how their rows are named."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from ... import checks
from ...measurements.directions import along_axis
from ...models.geometry import Geometry
from ...table import Parts, Report

DOF_DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")  # 1 to 6 in FE programs
DOF_WORDS = (*DOF_DIRECTIONS, "x", "y", "z", "rotx", "roty", "rotz")
NAMES = {word: number % 6 + 1 for number, word in enumerate(DOF_WORDS)}
FORM = re.compile(r"\s*(?:node)?\s*(-?\d+)\s*[:, ]\s*(\w+)\s*", re.I)


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
        >>> from emcee_femu.extensions.fe_programs.exports import Matrices
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
