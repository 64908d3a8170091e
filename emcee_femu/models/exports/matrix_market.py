"""Matrix Market files, as ``scipy.io.mmwrite`` and APDL's ``*EXPORT,,MMF`` write."""

from pathlib import Path

import numpy as np
from scipy.sparse import coo_array

from .numbers import AGAIN, read_columns, read_lines
from .part import Part, build_matrix, check

FORMS = "coordinate", "array"
FIELDS = "real", "double", "integer"
SYMMETRIES = "general", "symmetric"


def read_matrix_market(path: Path) -> list[Part]:
    """Return the matrix of a Matrix Market file, general or symmetric.

    Raises:
        ValueError: If it is complex or a pattern, or has other entries than it says.
            (``scipy.io.mmread`` of version 1.17 crashes the interpreter on such files.)
    """
    lines = read_lines(path)
    words = lines[0].lower().split()[1:]
    given = [*words, "", "", "", ""][:4]
    known = zip(given, (("matrix",), FORMS, FIELDS, SYMMETRIES), strict=True)
    if not all(word in choices for word, choices in known):
        raise ValueError(
            f"{path}, line 1: expected a matrix of real numbers, general or symmetric, "
            f"got {lines[0]!r}"
        )
    skip = next((i for i, x in enumerate(lines) if x[:1] != "%" and x.strip()), 0)
    sizes = lines[skip].split()
    coordinate = given[1] == "coordinate"
    if len(sizes) != 2 + coordinate or not all(map(str.isdecimal, sizes)):
        raise ValueError(
            f"{path}, line {skip + 1}: expected the numbers of rows, columns"
            f"{' and entries' if coordinate else ''}, got {lines[skip]!r}; {AGAIN}"
        )
    rows, columns = map(int, sizes[:2])
    if rows != columns:
        raise ValueError(f"{path}: expected a square matrix, got {rows} by {columns}")
    symmetric = given[3] == "symmetric"
    if coordinate:
        count = int(sizes[2])
        places, values = read_columns(path, "row column value", 2, skip=skip + 1)
        i, j = places.T - 1
    else:
        count = rows * (rows + 1) // 2 if symmetric else rows**2
        _, values = read_columns(path, "value", 0, skip=skip + 1)
        j, i = np.triu_indices(rows) if symmetric else np.divmod(np.arange(count), rows)
    if len(values) != count or max(i.max(initial=0), j.max(initial=0)) >= rows:
        raise ValueError(
            f"{path}: expected {count} entries of {rows} rows, as line {skip + 1} "
            f"says, got {len(values)}, up to row {i.max(initial=0) + 1}; {AGAIN}"
        )
    if symmetric:
        return [Part("", path, build_matrix(path, i, j, values[:, 0], rows))]
    matrix = coo_array((values[:, 0], (i, j)), shape=(rows, rows))
    return [Part("", path, check(path, matrix))]
