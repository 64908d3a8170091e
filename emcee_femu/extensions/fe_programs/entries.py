"""Numbers in a text file, and the matrix that they are the entries of."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array

from ...contracts import Floats
from ...models.matrices import read_matrix

EMPTY = 1_000  # rows per entry; no matrix of a structure is as empty
AGAIN = "let the program export it again"
BARE_EXPONENT = re.compile(r"(?<=[\d.])([-+]\d+)$")  # 1.5+7 for 1.5E+7
NOTHING = csc_array((0, 0), dtype=float)

# Node and direction of each row of a matrix, (N, 2).
Dofs = NDArray[np.int64]


class Part(NamedTuple):
    """A symmetric matrix.

    Attributes:
        name: What the file calls it; ``"K"`` and ``"M"`` where that is known, empty
            where the file does not say.
        path: The file.
        matrix: ``(N, N)``.
        dofs: Node and direction of each row, ``(N, 2)``, or None.
        fault: Why it cannot be read, which matters where it is asked for; else empty.
    """

    name: str
    path: Path
    matrix: csc_array
    dofs: Dofs | None = None
    fault: str = ""


def try_part(name: str, path: Path, read: Callable[[], Part]) -> Part:
    """Return the part that is read, or its fault: other parts may be good."""
    try:
        return read()._replace(name=name)
    except ValueError as error:
        return Part(name, path, NOTHING, fault=str(error))


def read_number(text: str) -> float:
    """Return a number as Fortran writes it: 1.5E+7, 1.5D+7 or 1.5+7.

    Raises:
        ValueError: If it is none.
    """
    return float(BARE_EXPONENT.sub(r"E\1", text.strip().upper().replace("D", "E")))


def read_cells(line: str, width: int) -> list[float]:
    """Return the numbers of a line, in cells of the width or between blanks.

    ``scipy.io.hb_write`` writes its values in 24 columns and says that they have 25.
    """
    line = line.rstrip()
    try:
        cells = [line[i : i + width] for i in range(0, len(line), width)]
        return [read_number(cell) for cell in cells]
    except ValueError:
        return [read_number(cell) for cell in line.split()]


def build_matrix(
    label: Path | str,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    values: Floats,
    size: int | None = None,
    *,
    mirror: bool = True,
) -> csc_array:
    """Return the symmetric matrix of entries on one side of the diagonal, or on both.

    Args:
        label: The file, and the matrix if it has several, for messages.
        rows: Row numbers from 0, ``(n,)``.
        columns: Column numbers from 0, ``(n,)``.
        values: The entries, ``(n,)``.
        size: The number of rows; None for as many as there are numbers.
        mirror: Whether one side may stand for both.

    Raises:
        ValueError: If a number is below 0, a place is listed twice, or both sides are
            there and differ.
    """
    least = np.append(rows, columns).min(initial=0 if len(rows) or size else -1)
    if least < 0:
        raise ValueError(
            f"{label}: expected rows and columns from 1 on; a program that numbers "
            "inner nodes below zero exports their labels too: of Abaqus take FORMAT="
            "MATRIX INPUT, not COORDINATE"
        )
    if size is None:
        size = int(max(rows.max(), columns.max())) + 1
    places = rows * size + columns
    _, first, count = np.unique(places, return_index=True, return_counts=True)
    if (count > 1).any():
        at = first[count > 1].min()
        raise ValueError(
            f"{label}: row {rows[at] + 1}, column {columns[at] + 1} is listed twice; "
            "are these the matrices of elements? Export the assembled ones"
        )
    off = rows != columns
    pairs = np.minimum(rows, columns)[off] * size + np.maximum(rows, columns)[off]
    if mirror and len(np.unique(pairs)) == len(pairs):  # each pair is there once
        values = np.append(values, values[off])
        rows, columns = np.append(rows, columns[off]), np.append(columns, rows[off])
    return check(label, coo_array((values, (rows, columns)), shape=(size, size)))


def build_labelled(
    name: str, path: Path, pairs: Dofs, values: Floats, *, mirror: bool = True
) -> Part:
    """Return the matrix of entries at pairs of DOFs ``(n, 2, 2)``, sorted."""
    label = f"{path}, {name}" if name else path
    dofs, at = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    i, j = at.reshape(-1, 2).T
    matrix = build_matrix(label, i, j, values, len(dofs), mirror=mirror)
    return Part(name, path, matrix, dofs)


def check(label: Path | str, matrix: coo_array | csc_array) -> csc_array:
    """Return a symmetric matrix as :class:`MatrixModel` takes it.

    Raises:
        ValueError: If it is not square, finite and symmetric, or nearly all of its rows
            are empty, with the file's name.
    """
    if matrix.shape[0] > EMPTY * (matrix.nnz + 1):
        announced = f"{matrix.shape[0]} rows are announced, and {matrix.nnz} entries"
        raise ValueError(f"{label}: {announced} are there; {AGAIN}")
    return csc_array(read_matrix(str(label), csc_array(matrix), sparse=True))


def read_lines(path: Path) -> list[str]:
    """Return the lines of a text file without their ends.

    Raises:
        ValueError: If there are bytes that are not text, or the last line has no end.
    """
    text = path.read_bytes().decode("latin-1")
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise ValueError(f"{path}, line {line}: binary bytes in a text file; {AGAIN}")
    lines = text.replace("\r\n", "\n").split("\n")
    if lines.pop():
        raise ValueError(
            f"{path}, line {len(lines) + 1}: the line has no end; is the file cut off? "
            f"If not, add a line break, else {AGAIN}"
        )
    return lines


def read_columns(
    path: Path, form: str, whole: int, delimiter: str | None = None, skip: int = 0
) -> tuple[NDArray[np.int64], Floats]:
    """Return the numbers of a file in which each line has the same columns.

    Args:
        path: The file; empty lines, and those that begin with ``*``, are skipped.
        form: The columns as a person would say them, such as ``"row column value"``.
        whole: How many columns, the first ones, are whole numbers.
        delimiter: What separates the columns; None for blanks.
        skip: How many lines at the beginning say something else.

    Returns:
        The whole numbers ``(n, whole)`` and the others ``(n, rest)``.

    Raises:
        ValueError: If a line does not have finite numbers in these columns, or the
            last line has no end.
    """
    every = read_lines(path)
    lines = [x for x in every[skip:] if x.strip() and not x.startswith("*")]
    width = len(form.split(delimiter))

    def parse(some: list[str]) -> Floats | None:
        """Return the numbers of some lines, None where they are others."""
        try:
            table = np.loadtxt(some, delimiter=delimiter, comments=None, ndmin=2)
        except ValueError:
            return None
        good = table.shape[1] == width and np.isfinite(table).all()
        return table if good and not (table[:, :whole] % 1).any() else None

    table = parse(lines) if lines else None
    if table is not None:
        return table[:, :whole].astype(np.int64), table[:, whole:]
    for line in lines:
        if parse([line]) is None:
            raise ValueError(
                f"{path}, line {every.index(line, skip) + 1}: expected {form!r}, got "
                f"{line[:60]!r}; {AGAIN}"
            )
    raise ValueError(f"{path}: expected lines {form!r}, got none; {AGAIN}")
