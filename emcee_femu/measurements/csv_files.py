"""The CSV file of measured modes, which a person can fill in."""

import csv
from collections.abc import Iterable, Iterator, Mapping
from os import PathLike
from typing import Any, NamedTuple

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
    "damping ratio": "damping",
    "damping sd": "damping_sd",
    "shape": "shapes",
    "shape sd": "shape_sd",
}
PER_SENSOR = ("shapes", "shape_sd")
ONE_ROW = ("frequencies", "sd", "phase_collinearity", "damping", "damping_sd")


class Row(NamedTuple):
    """One row, and the file and line where it is."""

    place: str
    field: str
    sensor: str
    dof: str
    numbers: list[float]


def write_csv(path: Path, fields: Mapping[str, Any]) -> None:
    """Write the fields of :class:`Measurements` with all digits."""
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
                sensor = sensors[i] if field in PER_SENSOR else ""
                dof = dofs[i] if field == "shapes" and dofs is not None else ""
                writer.writerow([quantity, sensor, dof, *map(repr, values)])


def read_csv(path: Path) -> dict[str, Any]:
    """Return the arguments of :class:`Measurements` that the file holds."""
    checks.file_name("path", path)
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:  # Excel's BOM
            rows = [*_read_rows(path, file)]
    except (csv.Error, UnicodeError) as error:
        raise ValueError(f"{path}: expected a CSV file in UTF-8 ({error})") from None
    own = {f: [row for row in rows if row.field == f] for f in QUANTITIES.values()}
    if not own["frequencies"]:
        raise ValueError(f"{path}: no row 'frequency [Hz]'")
    found: dict[str, Any] = {f: [r.numbers for r in rs] for f, rs in own.items() if rs}
    for field in ONE_ROW:
        for second in own[field][1:]:
            raise ValueError(f"{second.place}: a second row of {field}")
        if own[field]:
            found[field] = own[field][0].numbers
    sensors, of_sd = ([row.sensor for row in own[field]] for field in PER_SENSOR)
    if of_sd and of_sd != sensors:
        raise ValueError(
            f"{path}: expected the rows 'shape sd' for the same sensors as the rows "
            f"'shape', in the same order, {sensors}, got {of_sd}"
        )
    dofs = [row.dof for row in own["shapes"]]
    if any(dofs) and not all(dofs):
        raise ValueError(
            f"{path}, column 'dof': expected a DOF for each sensor or for none, but "
            f"{sensors[dofs.index('')]!r} has none"
        )
    numbers = [int(dof) if dof.isdigit() else dof for dof in dofs]
    return found | {"sensors": sensors or None, "dofs": numbers if any(dofs) else None}


def _read_rows(path: Path, file: Iterable[str]) -> Iterator[Row]:
    reader = csv.reader(file)
    titles = _trim(next(reader, []))
    if titles[:3] != HEADER or len(titles) < 4 or not all(titles):
        raise ValueError(
            f"{path}, line 1: expected the titles {','.join(HEADER)},mode 1,.. "
            f"separated by commas, got {','.join(titles)!r}"
        )
    for row in reader:
        if cells := _trim(row):
            cells[1:2] = row[1:2]  # a label is read as it was written
            yield _read_row(f"{path}, line {reader.line_num}", titles, cells)


def _read_row(place: str, titles: list[str], cells: list[str]) -> Row:
    field = QUANTITIES.get(cells[0])
    if field is None:
        raise ValueError(
            f"{place}, column 'quantity': expected one of {[*QUANTITIES]}, got "
            f"{cells[0]!r}"
        )
    if len(cells) > len(titles):
        raise ValueError(
            f"{place}: {len(cells)} cells under {len(titles)} titles; write numbers "
            "with a decimal point, not a comma"
        )
    _, sensor, dof, *numbers = cells + [""] * (len(titles) - len(cells))
    if bool(sensor.strip()) != (field in PER_SENSOR) or (dof and field != "shapes"):
        raise ValueError(
            f"{place}, columns 'sensor' and 'dof': expected a sensor only in rows of "
            f"shapes, a DOF only in rows 'shape', got {sensor!r} and {dof!r}"
        )
    values = []
    for title, cell in zip(titles[3:], numbers, strict=True):
        try:
            values.append(float(cell))
        except ValueError:
            raise ValueError(
                f"{place}, column {title!r}: expected a number, got {cell!r}"
            ) from None
    return Row(place, field, sensor, dof, values)


def _trim(row: list[str]) -> list[str]:
    """Return the cells without surrounding blanks and without empty ones at the end."""
    cells = [cell.strip() for cell in row]
    while cells and not cells[-1]:
        cells.pop()
    return cells
