"""Nastran DMIG entries, as in a punch file: matrices with grid points and components.

Fields are 8 columns wide, 16 on entries with an asterisk, or separated by commas.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .numbers import AGAIN, read_lines
from .part import Part, build_labelled, name_parts

REAL = (1, 2)  # TIN: single or double precision; 3 and 4 are complex
SQUARE = (1, 6)  # IFO: square and symmetric; 2 and 9 are rectangular, loads
BARE_EXPONENT = re.compile(r"(?<=[\d.])([-+]\d+)$")  # 1.5+7 for 1.5E+7


class Line(NamedTuple):
    """A line of a DMIG entry, its number, and its fields without the first."""

    number: int
    fields: list[str]


def read_dmig(path: Path) -> list[Part]:
    """Return the real square matrices of the DMIG entries in a file.

    Raises:
        ValueError: If a line is no such entry, or there is no square matrix.
    """
    forms: dict[str, tuple[int, int]] = {}
    entries: dict[str, list[tuple[int, int, int, int, float]]] = {}
    for entry in _read_entries(path):
        head = entry[0]
        name = head.fields[0]
        try:
            if head.fields[1:2] == ["0"]:
                form, kind = (int(field) for field in head.fields[2:4])
                forms[name] = form, kind
            else:
                column = int(head.fields[1]), int(head.fields[2] or 0)
                entries.setdefault(name, []).extend(_read_column(column, entry))
        except (ValueError, IndexError):
            raise ValueError(
                f"{path}, line {head.number} or below: expected a DMIG entry of "
                f"{name!r} with grid points, components and values, got {head.fields}; "
                f"{AGAIN}"
            ) from None
    parts = []
    for name, found in entries.items():
        form, kind = forms.get(name, (0, 0))
        if name not in forms:
            raise ValueError(
                f"{path}: no DMIG entry with the form of {name!r} before its columns; "
                f"{AGAIN}"
            )
        if form in SQUARE and kind in REAL:
            table = np.array(found)
            labels = table[:, :4].astype(np.int64).reshape(-1, 2, 2)
            parts.append(
                build_labelled(name, path, labels[:, 1], labels[:, 0], table[:, 4])
            )
    if not parts:
        raise ValueError(
            f"{path}: no real square DMIG matrix; ask for stiffness and mass, such as "
            "by PARAM,EXTOUT,DMIGPCH or EXTSEOUT(STIFFNESS,MASS,DMIGPCH)"
        )
    return name_parts(parts)


def _read_entries(path: Path) -> Iterator[list[Line]]:
    """Yield DMIG entries with their continuation lines; others are passed over."""
    entry: list[Line] = []
    own = False
    for number, line in enumerate(read_lines(path), 1):
        if not line.strip() or line.startswith("$"):
            continue
        first, fields = _split(line)
        if first[:1] not in ("", "*", "+"):  # begins an entry
            if entry:
                yield entry
            own = first.rstrip("*").upper() == "DMIG"
            entry = []
        if own:
            entry.append(Line(number, fields))
    if entry:
        yield entry


def _split(line: str) -> tuple[str, list[str]]:
    """Return the first field of a line, and the others without the last."""
    if "," in line:
        first, *fields = (field.strip() for field in line.split(","))
        return first, fields
    first = line[:8].strip()
    width = 16 if "*" in first else 8
    fields = [line[i : i + width].strip() for i in range(8, 72, width)]
    return first, fields


def _read_column(
    column: tuple[int, int], entry: list[Line]
) -> Iterator[tuple[int, int, int, int, float]]:
    """Yield column point and component, row point and component, and the value."""
    head, *others = entry
    groups = [head.fields[4:]] + [line.fields for line in others]
    for fields in groups:
        for i in range(0, len(fields), 4):
            point, component, value = (fields[i : i + 3] + ["", "", ""])[:3]
            if point or value:
                number = float(
                    BARE_EXPONENT.sub(r"E\1", value.upper().replace("D", "E"))
                )
                if not np.isfinite(number):
                    raise ValueError
                yield *column, int(point), int(component or 0), number
