"""What an FE program exported: matrices, and the node and direction of each row."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from ... import checks
from ...table import Parts, Report
from .labels import Dofs, find_rows, write_name


@dataclass(frozen=True, eq=False)
class Matrices(Report):
    """Symmetric matrices of one FE model, and what their rows are.

    :func:`read_matrices` makes it. K and M go to a :class:`MatrixModel` as they are.

    Attributes:
        matrices: ``{name: csc_array (N, N)}``; ``"K"`` and ``"M"``, and others by the
            names that they have in the files.
        nodes: Node and direction (1 to 6) of each row, ``(N, 2)``; None where the
            format has no labels.
        source: The file that was given.

    Examples:
        >>> import numpy as np
        >>> from scipy.sparse import csc_array
        >>> from emcee_femu import Matrices
        >>> K = csc_array([[3.0, -1.0], [-1.0, 1.0]])
        >>> nodes = np.array([[12, 1], [12, 3]])  # node, direction
        >>> exported = Matrices({"K": K, "M": csc_array(np.eye(2))}, nodes, "beam.mtx")
        >>> exported.labels, exported.dofs("12:uz")
        (('12:ux', '12:uz'), 1)
    """

    matrices: Mapping[str, csc_array] = field(repr=False)
    nodes: Dofs | None = field(repr=False)
    source: str

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
        known = [] if self.nodes is None else self.nodes.tolist()
        return tuple(write_name(*dof) for dof in known)

    def dofs(self, names: str | Sequence[str] | NDArray[Any]) -> Any:
        """Return the row of a DOF, or those of several as an array, in the order given.

        Args:
            names: ``"node 12 z"`` or ``"12:uz"``, with directions x y z, ux uy uz,
                rx ry rz or a number, 1 to 6; or a sequence of such names.

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
        rows = find_rows(self.nodes, wanted)
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
        return (f"{self.source}: {rows}; entries: {entries}",)

    def _get(self, name: str) -> csc_array:
        if name not in self.matrices:
            raise AttributeError(
                f"{self.source} holds {[*self.matrices]}, no {name}; give each file by "
                'its matrix: read_matrices({"K": ..., "M": ...})'
            )
        return self.matrices[name]
