"""Matrices of Nastran: OUTPUT4 files in ASCII, and DMIG entries as in a punch file."""

import re
import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array

from .entries import (
    AGAIN,
    NOTHING,
    Part,
    build_labelled,
    check,
    read_cells,
    read_lines,
    read_number,
    try_part,
)

# Columns, rows (negative: BIGMAT; both may be 16 wide), form, type, name, and the
# Fortran format of values, such as 1P,3E23.16 or 3D23.16.
OP4_HEADER = re.compile(
    r"([ \d-]{32}(?:[ \d-]{16})?)((?=\d*[A-Z])\w{1,8})\s*"
    r"(?:(?:1P,?\s*\d*|\d+)[ED](\d+)\.\d.*)?",
    re.I,
)
OP4_WIDTH = 16  # of a value where the header has no format: 5E16.9
OP4_WORDS = (1, 2)  # of a value, which are its types: single and double precision
# A string begins with row + STRING_ROWS * (words + 1), or words + 1 and row.
STRING_ROWS = 65536
REAL = (1, 2)  # TIN: single or double precision; 3 and 4 are complex
SQUARE, SYMMETRIC = 1, 6  # IFO; 2 and 9 are rectangular, such as loads
IS_COMPLEX = "is complex; write the real matrix, without structural damping"


def read_op4(path: Path) -> list[Part]:
    """Return the square matrices of a file that OUTPUT4 wrote FORMATTED.

    Raises:
        ValueError: If there is none, or a name is there twice.
    """
    lines, parts = read_lines(path), []
    headers = [(i, OP4_HEADER.fullmatch(line)) for i, line in enumerate(lines)]
    found = [(i, header) for i, header in headers if header]
    ends = [*(i for i, _ in found[1:]), len(lines)]
    for (start, header), end in zip(found, ends, strict=True):
        wide = len(header[1]) // 2 - 8
        size, rows = int(header[1][:wide]), abs(int(header[1][wide:-16]))
        if size == rows:  # no load
            read = partial(_read_op4_part, path, lines, header, start, end)
            parts.append(try_part(header[2], path, read))
    if not parts:
        raise ValueError(f"{path}: no square matrix; write K and M by OUTPUT4")
    check_once(path, [part.name for part in parts])
    return name_parts(parts)


def _read_op4_part(
    path: Path, lines: list[str], header: re.Match[str], start: int, end: int
) -> Part:
    """Return the matrix of the lines from its header to the next."""
    name, width, kind = header[2], int(header[3] or OP4_WIDTH), int(header[1][-8:])
    size = int(header[1][: len(header[1]) // 2 - 8])
    if kind not in OP4_WORDS:
        raise ValueError(f"{path}, line {start + 1}: {name} {IS_COMPLEX}")
    try:
        entries = [*_read_strings(lines, start + 1, end, size, width, kind)]
    except ValueError as error:
        raise ValueError(f"{path}, {error}; {AGAIN}") from None
    i, j, values = np.array(entries).reshape(-1, 3).T
    places = i.astype(np.int64) - 1, j.astype(np.int64) - 1
    matrix = coo_array((values, places), shape=(size, size))
    return Part(name, path, check(f"{path}, {name}", matrix))


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
                values += read_cells(lines[at], width)
            at += 1
            if left:  # a string
                count, row = (
                    numbers if len(numbers) == 2 else divmod(numbers[0], STRING_ROWS)
                )
                left -= count + len(numbers) - 1
                count -= 1
            else:
                column, row, count = numbers
                if row == 0:
                    left, count = count, 0
            closing = column > size  # by a number in any format
            whole = values if closing else len(values) in (count, count // words)
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
    if any(line.strip() for line in lines[at:end]):
        raise ValueError(f"line {at + 1}: expected another matrix, got {lines[at]!r}")


def read_dmig(path: Path) -> list[Part]:
    """Return the square matrices of the DMIG entries in a file.

    Fields are 8 columns wide, 16 on entries with an asterisk, or separated by commas.

    Raises:
        ValueError: If an entry's form is not there, there is no square matrix, or a
            name is there twice.

    Warns:
        UserWarning: If the last grid point of the stiffness has no mass.
    """
    forms: dict[str, tuple[int, int]] = {}
    entries: dict[str, list[tuple[int, int, int, int, float]]] = {}
    faults: dict[str, str] = {}
    square: list[str] = []  # by their forms
    name, column = "", None  # of the entry that goes on
    for number, text in enumerate(read_lines(path), 1):
        line = text.partition("$")[0]
        if not line.strip():
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
                    square += [name] * (forms[name][0] in (SQUARE, SYMMETRIC))
                    continue
                entries.setdefault(name, [])
                column = int(point), int(fields[2] or 0)
                fields = fields[4:]
            if column is not None:
                entries[name].extend(_read_groups(column, fields))
        except (ValueError, IndexError):
            fault = (
                f"{path}, line {number}: expected a DMIG entry of {name!r} with grid "
                f"points, components and values, got {line[:72]!r}; {AGAIN}"
            )
            if name not in entries:  # it may belong to any
                raise ValueError(fault) from None
            faults.setdefault(name, fault)
    if unknown := [name for name in entries if name not in forms]:
        what = f"no DMIG entry with the form of {unknown[0]!r} before its columns"
        raise ValueError(f"{path}: {what}; {AGAIN}")
    check_once(path, square)
    parts = []
    for name, rows in entries.items():
        form, kind = forms[name]
        if form not in (SQUARE, SYMMETRIC):
            continue
        if kind not in REAL:
            faults[name] = f"{path}: {name} {IS_COMPLEX}"
        elif not rows:
            faults.setdefault(name, f"{path}: no entry in a column of {name}; {AGAIN}")
        table = np.array(rows).reshape(-1, 5)
        pairs = table[:, :4].astype(np.int64).reshape(-1, 2, 2)[:, ::-1]  # row, column
        entries_of = name, path, pairs, table[:, 4]
        read = partial(build_labelled, *entries_of, mirror=form == SYMMETRIC)
        part = Part(name, path, NOTHING, fault=faults.get(name, ""))
        parts.append(part if part.fault else try_part(name, path, read))
    if not parts:
        raise ValueError(
            f"{path}: no square DMIG matrix; ask for stiffness and mass, such as "
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
            number = read_number(value)
            if not np.isfinite(number):
                raise ValueError
            yield *column, int(point), int(component or 0), number


def _split(line: str) -> tuple[str, list[str]]:
    """Return the first field of a line, and the others without the last."""
    width = 16 if "*" in line[:8] else 8
    if "," in line:
        first, *fields = (field.strip() for field in line.split(","))
        return first, fields[: 64 // width]
    first = line[:8].strip()
    fields = [line[i : i + width].strip() for i in range(8, 72, width)]
    return first, fields


def check_once(path: Path, names: list[str]) -> None:
    """Raise ValueError where two matrices of a file have the same name."""
    for name in names:
        if names.count(name) > 1:
            raise ValueError(
                f"{path}: {names.count(name)} matrices are called {name}; export the "
                "one that is meant, or each to a file of its own"
            )


def name_parts(parts: list[Part]) -> list[Part]:
    """Return the parts with K and M for the only names that begin like that.

    Nastran calls them KAAX, KGG, .. by a set of DOFs (K4, with a number, is damping),
    and a superelement has KASMX, MES1, .. beside them.
    """
    names = [part.name for part in parts]
    renamed = {}
    for letter in "KM":
        alike = [x for x in names if re.match(rf"{letter}(?!\d)", x, re.I)]
        of_sets = [x for x in alike if re.fullmatch(r"\w(\w)\1X?", x, re.I)]
        alike = of_sets or alike
        if len(alike) == 1:
            renamed[alike[0]] = letter
    return [part._replace(name=renamed.get(part.name, part.name)) for part in parts]
