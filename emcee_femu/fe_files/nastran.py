"""Matrices of Nastran: OUTPUT4 files in ASCII, and DMIG entries as in a punch file."""

import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array

from .entries import AGAIN, Part, build_labelled, check, read_lines

# Columns, rows (negative: BIGMAT), form, type, name, and the Fortran format of values.
HEADER = re.compile(r"((?:[ \d-]{8}){4})(.{8})\s*1P,\s*\d+E(\d+)\.\d+.*", re.I)
WORDS = (1, 2)  # of a value, which are its types: single and double precision
ROWS = 65536  # a string begins with row + ROWS * (words + 1), or words + 1 and row
REAL = (1, 2)  # TIN: single or double precision; 3 and 4 are complex
SQUARE = (1, 6)  # IFO: square and symmetric; 2 and 9 are rectangular, loads
BARE_EXPONENT = re.compile(r"(?<=[\d.])([-+]\d+)$")  # 1.5+7 for 1.5E+7


def read_op4(path: Path) -> list[Part]:
    """Return the real square matrices of a file that OUTPUT4 wrote FORMATTED.

    Raises:
        ValueError: If the file is cut or damaged, or has no such matrix.
    """
    lines, parts = read_lines(path), []
    starts = [i for i, line in enumerate(lines) if HEADER.fullmatch(line)]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        header = HEADER.fullmatch(lines[start])
        assert header is not None
        size, rows, _, kind = (int(header[1][i : i + 8]) for i in range(0, 32, 8))
        if kind in WORDS and size == abs(rows):  # neither complex nor a load
            try:
                width = int(header[3])
                entries = [*_read_strings(lines, start + 1, end, size, width, kind)]
            except ValueError as error:
                raise ValueError(f"{path}, {error}; {AGAIN}") from None
            i, j, values = (np.array(x) for x in zip(*entries, strict=True))
            matrix = coo_array((values, (i - 1, j - 1)), shape=(size, size))
            parts.append(Part(header[2].strip(), path, check(path, matrix)))
    if not parts:
        raise ValueError(f"{path}: no real square matrix; write K and M by OUTPUT4")
    return name_parts(parts)


def _read_strings(
    lines: list[str], at: int, end: int, size: int, width: int, words: int
) -> Iterator[tuple[int, int, float]]:
    """Yield row and column from 1 and value, up to the column that closes a matrix."""
    column, left = 0, 0  # words of the column that are still to come
    while column <= size:
        try:
            numbers = [int(cell) for cell in lines[at].split()] if at < end else []
            first, values = at, []
            while at + 1 < end and "." in lines[at + 1]:
                at += 1
                line = lines[at].rstrip().upper().replace("D", "E")
                starts = range(0, len(line), width)
                values += [float(line[i : i + width]) for i in starts]
            at += 1
            if left:  # a string
                count, row = numbers if len(numbers) == 2 else divmod(numbers[0], ROWS)
                left -= count + len(numbers) - 1
                count -= 1
            else:
                column, row, count = numbers
                if row == 0:
                    left, count = count, 0
            closing = column > size
            whole = len(values) in (count, count if closing else count // words)
            inside = closing or row + len(values) <= size + 1
            if left < 0 or not (whole and inside and np.isfinite(values).all()):
                raise ValueError
        except (ValueError, IndexError):
            raise ValueError(
                f"line {first + 1}: expected a column or string of {size} rows, with as"
                f" many finite values as it says, got {lines[min(first, end - 1)]!r}"
            ) from None
        if not closing:
            yield from ((row + i, column, value) for i, value in enumerate(values))


def read_dmig(path: Path) -> list[Part]:
    """Return the real square matrices of the DMIG entries in a file.

    Fields are 8 columns wide, 16 on entries with an asterisk, or separated by commas.

    Raises:
        ValueError: If a line is no such entry, or there is no square matrix.

    Warns:
        UserWarning: If the last grid point of the stiffness has no mass.
    """
    forms: dict[str, tuple[int, int]] = {}
    entries: dict[str, list[tuple[int, int, int, int, float]]] = {}
    name, column = "", None  # of the entry that goes on
    for number, line in enumerate(read_lines(path), 1):
        if not line.strip() or line.startswith("$"):
            continue
        first, fields = _split(line)
        try:
            if first[:1] not in ("", "*", "+"):  # begins an entry
                column = None
                if first.rstrip("*").upper() != "DMIG":
                    continue
                name, point = fields[:2]
                if point == "0":
                    forms[name] = int(fields[2]), int(fields[3])
                    continue
                column = int(point), int(fields[2] or 0)
                fields = fields[4:]
            if column is not None:
                entries.setdefault(name, []).extend(_read_groups(column, fields))
        except (ValueError, IndexError):
            raise ValueError(
                f"{path}, line {number}: expected a DMIG entry of {name!r} with grid "
                f"points, components and values, got {line[:72]!r}; {AGAIN}"
            ) from None
    if unknown := [name for name in entries if name not in forms]:
        raise ValueError(
            f"{path}: no DMIG entry with the form of {unknown[0]!r} before its "
            f"columns; {AGAIN}"
        )
    if empty := [name for name, rows in entries.items() if not rows]:
        raise ValueError(f"{path}: no entry in a column of {empty[0]!r}; {AGAIN}")
    parts = []
    for name, rows in entries.items():
        if forms[name][0] in SQUARE and forms[name][1] in REAL:
            table = np.array(rows)
            labels = table[:, :4].astype(np.int64).reshape(-1, 2, 2)
            parts.append(
                build_labelled(name, path, labels[:, 1], labels[:, 0], table[:, 4])
            )
    if not parts:
        raise ValueError(
            f"{path}: no real square DMIG matrix; ask for stiffness and mass, such as "
            "by PARAM,EXTOUT,DMIGPCH or EXTSEOUT(STIFFNESS,MASS,DMIGPCH)"
        )
    named = name_parts(parts)
    last = {p.name: int(p.dofs[-1, 0]) for p in named if p.dofs is not None}
    if last.get("M", np.inf) < last.get("K", 0):
        warnings.warn(
            f"{path}: the last grid point of K, {last['K']}, has no mass; such a file "
            "has no end mark: was it cut? Compare the total mass",
            stacklevel=5,
        )
    return named


def _read_groups(
    column: tuple[int, int], fields: list[str]
) -> Iterator[tuple[int, int, int, int, float]]:
    """Yield column point and component, row point and component, and the value."""
    for i in range(0, len(fields), 4):
        point, component, value = (fields[i : i + 3] + ["", "", ""])[:3]
        if point or value:
            text = BARE_EXPONENT.sub(r"E\1", value.upper().replace("D", "E"))
            if not np.isfinite(float(text)):
                raise ValueError
            yield *column, int(point), int(component or 0), float(text)


def _split(line: str) -> tuple[str, list[str]]:
    """Return the first field of a line, and the others without the last."""
    if "," in line:
        first, *fields = (field.strip() for field in line.split(","))
        return first, fields
    first = line[:8].strip()
    width = 16 if "*" in first else 8
    fields = [line[i : i + width].strip() for i in range(8, 72, width)]
    return first, fields


def name_parts(parts: list[Part]) -> list[Part]:
    """Return the parts with K and M for the only names that begin like that.

    Nastran calls them KAAX, KGG, .. (K4, with a number, is damping).
    """
    names = [part.name for part in parts]
    renamed = {}
    for letter in "KM":
        alike = [x for x in names if re.match(rf"{letter}(?!\d)", x, re.I)]
        if len(alike) == 1:
            renamed[alike[0]] = letter
    return [part._replace(name=renamed.get(part.name, part.name)) for part in parts]
