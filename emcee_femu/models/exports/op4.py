"""Nastran OUTPUT4 files in ASCII: matrices without labels, dense or by strings."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array

from .numbers import AGAIN, read_lines
from .part import Part, check, name_parts

# Columns, rows (negative: BIGMAT), form, type, name, and the Fortran format of values.
HEADER = re.compile(r"((?:[ \d-]{8}){4})(.{8})\s*1P,\s*\d+E(\d+)\.\d+.*", re.I)
WORDS = {1: 1, 2: 2}  # of a value, by type: real in single and double precision
ROWS = 65536  # a string begins with row + ROWS * (words + 1), or words + 1 and row

Entry = tuple[int, int, float]


class Cursor:
    """The lines of a file, read one after the other."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines = read_lines(path)
        self.at = 0

    @property
    def line(self) -> str:
        """The line that is next; empty at the end."""
        return self.lines[self.at] if self.at < len(self.lines) else ""

    def integers(self, *counts: int) -> list[int]:
        """Return the numbers of the next line, as many as expected."""
        cells = self.line.split()
        if len(cells) not in counts or not all(
            cell.lstrip("-").isdecimal() for cell in cells
        ):
            raise self.error(f"{' or '.join(map(str, counts))} whole numbers")
        self.at += 1
        return [int(cell) for cell in cells]

    def values(self, width: int, counts: tuple[int, int]) -> list[float]:
        """Return the values of the next lines, one of two numbers of them."""
        found: list[float] = []
        while "." in self.line and HEADER.fullmatch(self.line) is None:
            line = self.line.rstrip()
            cells = [line[i : i + width] for i in range(0, len(line), width)]
            try:
                found += [float(cell.upper().replace("D", "E")) for cell in cells]
            except ValueError:
                raise self.error("numbers") from None
            self.at += 1
        if len(found) not in counts or not np.isfinite(found).all():
            raise self.error(f"{counts[0]} finite values before it, not {len(found)}")
        return found

    def error(self, expected: str) -> ValueError:
        """Return the error that says what was expected in the next line."""
        return ValueError(
            f"{self.path}, line {self.at + 1}: expected {expected}, got "
            f"{self.line[:60]!r}; {AGAIN}"
        )


def read_op4(path: Path) -> list[Part]:
    """Return the real square matrices of a file that OUTPUT4 wrote FORMATTED.

    Raises:
        ValueError: If the file is cut or damaged, or has no such matrix.
    """
    cursor, parts = Cursor(path), []
    while cursor.line:
        found = HEADER.fullmatch(cursor.line)
        if found is None:
            raise cursor.error("the header of a matrix")
        size, rows, _, kind = (int(found[1][i : i + 8]) for i in range(0, 32, 8))
        cursor.at += 1
        if kind not in WORDS or size != abs(rows):  # complex, or a load
            while cursor.line and HEADER.fullmatch(cursor.line) is None:
                cursor.at += 1
            continue
        entries = [*_read_columns(cursor, size, int(found[3]), WORDS[kind])]
        table = np.array(entries).reshape(-1, 3)
        i, j = table[:, :2].astype(np.int64).T - 1
        if i.max(initial=0) >= size:
            raise ValueError(f"{path}: {found[2].strip()} has rows beyond {size}")
        matrix = coo_array((table[:, 2], (i, j)), shape=(size, size))
        parts.append(Part(found[2].strip(), path, check(path, matrix)))
    if not parts:
        raise ValueError(f"{path}: no real square matrix; write K and M by OUTPUT4")
    return name_parts(parts)


def _read_columns(cursor: Cursor, size: int, width: int, words: int) -> Iterator[Entry]:
    """Yield row and column from 1 and value, up to the column that closes a matrix."""
    while True:
        column, row, length = cursor.integers(3)
        if column > size:
            cursor.values(width, (1, 1))
            return
        while row or length > 0:
            start, count = row, length
            if row == 0:  # a string
                head = cursor.integers(1, 2)
                count, start = head if len(head) == 2 else divmod(head[0], ROWS)
                length -= count + len(head) - 1
                count -= 1
            values = cursor.values(width, (count // words, count))
            yield from ((start + i, column, value) for i, value in enumerate(values))
            if row:
                break
