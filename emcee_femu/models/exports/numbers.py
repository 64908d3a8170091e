"""Columns of numbers in a text file, and the line of one that is wrong."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...interfaces import Floats

AGAIN = "let the program export it again"


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
            f"{path}, line {len(lines) + 1}: the file ends within a line; {AGAIN}"
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
    try:
        found = np.loadtxt(lines, delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        found = np.empty((0, 0))
    good = found.shape[1] == width and np.isfinite(found).all()
    if good and (found[:, :whole] == np.rint(found[:, :whole])).all():
        return found[:, :whole].astype(np.int64), found[:, whole:]
    for line in lines:
        if not _fits(line.split(delimiter), width, whole):
            raise ValueError(
                f"{path}, line {every.index(line, skip) + 1}: expected {form!r}, got "
                f"{line[:60]!r}; {AGAIN}"
            )
    raise ValueError(f"{path}: expected lines {form!r}, got none; {AGAIN}")


def _fits(cells: list[str], width: int, whole: int) -> bool:
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        return False
    fine = len(numbers) == width and bool(np.isfinite(numbers).all())
    return fine and all(number.is_integer() for number in numbers[:whole])
