"""Names of DOFs: a node and a direction, as the test names them."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")  # 1 to 6 in FE programs
NAMES = {name: number for number, name in enumerate(DIRECTIONS, 1)} | {
    name: number
    for number, name in enumerate(("x", "y", "z", "rotx", "roty", "rotz"), 1)
}
FORM = re.compile(r"\s*(?:node)?\s*(-?\d+)\s*[:, ]\s*(\w+)\s*", re.I)

# Node and direction of each row of a matrix, (N, 2).
Dofs = NDArray[np.int64]


def read_name(name: str) -> tuple[int, int]:
    """Return node and direction of ``"node 12 z"``, ``"12:uz"`` or ``"12 3"``."""
    found = FORM.fullmatch(name)
    word = found[2].lower() if found else ""
    if found and (word in NAMES or word.isdecimal()):
        return int(found[1]), NAMES.get(word) or int(word)
    raise ValueError(
        f"names: expected a node and a direction such as 'node 12 z' or '12:uz' (out "
        f"of {' '.join(NAMES)}, or a number), got {name!r}"
    )


def write_name(node: int, direction: int) -> str:
    """Return the name of a DOF, such as ``"12:uz"``; from 7 on the number is kept."""
    known = 1 <= direction <= len(DIRECTIONS)
    return f"{node}:{DIRECTIONS[direction - 1] if known else direction}"


def find_rows(dofs: Dofs, names: Sequence[str]) -> NDArray[np.intp]:
    """Return the row of each name among the DOFs.

    Raises:
        ValueError: If there is no such node, no such direction at it, or several.
    """
    found = []
    for name in names:
        node, direction = read_name(name)
        at_node = np.flatnonzero(dofs[:, 0] == node)
        row = at_node[dofs[at_node, 1] == direction]
        if not len(row):
            there = [write_name(node, int(d)) for d in dofs[at_node, 1]]
            raise ValueError(
                f"names: no DOF {name!r}: "
                + (
                    f"node {node} has {there}; the others are held, or the program "
                    "gives it none"
                    if there
                    else f"no node {node} among {len(np.unique(dofs[:, 0]))} nodes, "
                    f"{dofs[:, 0].min()} to {dofs[:, 0].max()}"
                )
            )
        if len(row) > 1:
            raise ValueError(
                f"names: {name!r} is rows {row.tolist()}: CalculiX makes bricks of "
                "beams and shells, with several nodes for one; choose one by its row, "
                f"such as shapes={{{name!r}: {row[0]}}}"
            )
        found.append(row[0])
    return np.array(found, dtype=np.intp)
