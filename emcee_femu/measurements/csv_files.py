"""The CSV file of measured modes, which a person can fill in."""

import csv
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np

from .. import checks

Path = str | PathLike[str]
HEADER = ["quantity", "sensor", "dof"]
# Rows of the CSV, in the order in which they are written: row -> field.
QUANTITIES = {
    "frequency [Hz]": "frequencies",
    "sd [Hz]": "sd",
    "covariance [Hz2]": "covariance",
    "phase collinearity": "phase_collinearity",
    "shape": "shapes",
    "shape sd": "shape_sd",
}
OF_SENSORS = ("shapes", "shape_sd")


def write_csv(path: Path, fields: Mapping[str, Any]) -> None:
    """Write the fields of :class:`Measurements` with all digits, a column a mode."""
    checks.file_name("path", path)
    sensors, dofs = fields["sensors"], fields["dofs"]
    labels = [f"mode {i + 1}" for i in range(len(fields["frequencies"]))]
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*HEADER, *labels])
        for quantity, field in QUANTITIES.items():
            if fields[field] is None:
                continue
            for i, values in enumerate(np.atleast_2d(fields[field]).tolist()):
                sensor = sensors[i] if field in OF_SENSORS else ""
                dof = dofs[i] if field == "shapes" and dofs is not None else ""
                writer.writerow([quantity, sensor, dof, *map(repr, values)])


def read_csv(path: Path) -> dict[str, Any]:
    """Return the arguments of :class:`Measurements` that the file holds.

    Raises:
        ValueError: If a cell cannot be read; the message names line and column.
    """
    checks.file_name("path", path)
    try:
        return _read(path)
    except (csv.Error, UnicodeError) as error:
        raise ValueError(f"{path}: expected a CSV file in UTF-8 ({error})") from None


def _read(path: Path) -> dict[str, Any]:
    rows: dict[str, list[list[float]]] = {field: [] for field in QUANTITIES.values()}
    sensors: dict[str, list[str]] = {field: [] for field in OF_SENSORS}
    dofs: list[int | None] = []
    with open(path, encoding="utf-8-sig", newline="") as file:  # Excel writes a BOM
        reader = csv.reader(file)
        titles = _trimmed(next(reader, []))
        if titles[:3] != HEADER or len(titles) < 4 or not all(titles):
            raise ValueError(
                f"{path}, line 1: expected the titles {','.join(HEADER)},mode 1,.. "
                f"separated by commas, got {','.join(titles)!r}"
            )
        for row in reader:
            here = f"{path}, line {reader.line_num}"
            cells = _trimmed(row)
            if not cells:
                continue
            field = QUANTITIES.get(cells[0])
            if field is None:
                raise ValueError(
                    f"{here}, column 'quantity': expected one of {[*QUANTITIES]}, got "
                    f"{cells[0]!r}"
                )
            if len(cells) > len(titles):
                raise ValueError(
                    f"{here}: {len(cells)} cells under {len(titles)} titles; write "
                    "numbers with a decimal point, not a comma"
                )
            cells += [""] * (len(titles) - len(cells))
            _expect(here, "sensor", cells[1], field in OF_SENSORS)
            if field != "shapes":
                _expect(here, "dof", cells[2], False)
            if rows[field] and field not in (*OF_SENSORS, "covariance"):
                raise ValueError(f"{here}: a second row {cells[0]!r}")
            if field in OF_SENSORS:
                sensors[field].append(row[1])  # not trimmed: a label comes back as is
            if field == "shapes":
                dofs.append(_dof(here, cells[2]))
            rows[field].append(
                [
                    _number(here, title, cell)
                    for title, cell in zip(titles[3:], cells[3:], strict=True)
                ]
            )
    if not rows["frequencies"]:
        raise ValueError(f"{path}: no row 'frequency [Hz]'")
    if rows["shape_sd"] and sensors["shape_sd"] != sensors["shapes"]:
        raise ValueError(
            f"{path}: expected the rows 'shape sd' to be of the sensors of the rows "
            f"'shape' and in their order, {sensors['shapes']}, got "
            f"{sensors['shape_sd']}"
        )
    if None in dofs and dofs != [None] * len(dofs):
        raise ValueError(
            f"{path}, column 'dof': expected a DOF for each sensor or for none, but "
            f"{sensors['shapes'][dofs.index(None)]!r} has none"
        )
    found: dict[str, Any] = {field: values for field, values in rows.items() if values}
    for field in ("frequencies", "sd", "phase_collinearity"):
        if field in found:
            found[field] = found[field][0]
    if found.get("shapes"):
        found["sensors"] = sensors["shapes"]
        found["dofs"] = None if None in dofs else dofs
    return found


def _trimmed(row: list[str]) -> list[str]:
    """Return the cells without surrounding blanks and without empty ones at the end."""
    cells = [cell.strip() for cell in row]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _expect(here: str, column: str, cell: str, filled: bool) -> None:
    if bool(cell) != filled:
        expected = "a label" if filled else "an empty cell in this row"
        raise ValueError(
            f"{here}, column {column!r}: expected {expected}, got {cell!r}"
        )


def _dof(here: str, cell: str) -> int | None:
    try:
        return int(cell) if cell else None
    except ValueError:
        raise ValueError(
            f"{here}, column 'dof': expected a whole number, got {cell!r}"
        ) from None


def _number(here: str, title: str, cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise ValueError(
            f"{here}, column {title!r}: expected a number, got {cell!r}"
        ) from None
