"""Lines ``row column value``: CalculiX ``.sti`` and ``.mas``, Abaqus COORDINATE."""

from pathlib import Path

import numpy as np

from .labels import Dofs
from .numbers import AGAIN, read_columns, read_lines
from .part import Part, build_matrix

# Of *FREQUENCY, SOLVER=MATRIXSTORAGE: jobname.sti, jobname.mas and jobname.dof.
CALCULIX = {"K": ".sti", "M": ".mas"}


def read_triplets(
    path: Path, delimiter: str | None = None, size: int | None = None
) -> Part:
    """Return the matrix of a file, the lower or upper triangle of it or both.

    Raises:
        ValueError: If the matrix is not of ``size``, or the last of its entries is not
            in the last row and column, where CalculiX always ends.
    """
    form = "row column value".replace(" ", delimiter or " ")
    places, values = read_columns(path, form, 2, delimiter)
    if size is not None and places[-1].tolist() != [size, size]:
        raise ValueError(
            f"{path}: expected the last line to be row {size}, column {size}, as there "
            f"are {size} labels in the .dof file, got {places[-1].tolist()}; {AGAIN}"
        )
    rows, columns = places.T - 1
    return Part("", path, build_matrix(path, rows, columns, values[:, 0]))


def read_labels(path: Path) -> Dofs:
    """Return node and direction of each row from lines ``node.direction``.

    Raises:
        ValueError: If a line is no label.
    """
    found = []
    for number, line in enumerate(read_lines(path), 1):
        node, point, direction = line.strip().partition(".")
        if not (point and node.isdecimal() and direction.isdecimal()):
            raise ValueError(
                f"{path}, line {number}: expected node.direction, such as 12.3, got "
                f"{line[:60]!r}; {AGAIN}"
            )
        found.append((int(node), int(direction)))
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def read_calculix(path: Path) -> list[Part]:
    """Return K and M of a job, given any of its three files.

    Raises:
        ValueError: If one of the files is missing or damaged, or they differ in size,
            as those of a cyclic symmetry do (its matrices are complex).
    """
    files = {name: path.with_suffix(end) for name, end in CALCULIX.items()}
    labels = path.with_suffix(".dof")
    for file in (*files.values(), labels):
        if not file.exists():
            raise ValueError(
                f"{path}: {file.name} is missing beside it, which CalculiX writes "
                "with it; give the files by their matrix: read_matrices({'K': ..., "
                "'M': ..., 'dofs': ...})"
            )
    dofs = read_labels(labels)
    return [
        read_triplets(file, size=len(dofs))._replace(name=name, dofs=dofs)
        for name, file in files.items()
    ]
