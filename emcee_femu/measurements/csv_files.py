"""The CSV file of measured modes, which a person can fill in."""

import csv
import re
from os import PathLike

import numpy as np

from .. import checks
from .modes import Fields

Path = str | PathLike[str]
CSV_HEADER = ["quantity", "sensor", "dof"]
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
# As people write them, in any case: word -> that of the row.
CSV_WORDS = {title.partition(" [")[0]: title for title in QUANTITIES}
CSV_WORDS |= dict.fromkeys(
    ("frequencies", "natural frequency", "freq", "f", "fn"), "frequency [Hz]"
)
CSV_WORDS |= dict.fromkeys(("std", "standard deviation", "frequency sd"), "sd [Hz]")
CSV_WORDS |= dict.fromkeys(("damping", "zeta", "xi"), "damping ratio")
CSV_WORDS |= {
    "damping std": "damping sd",
    "mode shape": "shape",
    "shape std": "shape sd",
}
# Units of rows in Hz that are converted, and their factors.
CSV_UNITS = {"rad/s": 0.5 / np.pi, "khz": 1e3}
CSV_TITLE = re.compile(r"(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])]|(%))?", re.S)  # word and unit
PER_SENSOR = ("shapes", "shape_sd")
PARTLY = (*PER_SENSOR, "sd", "damping", "damping_sd")  # a blank: not known


def write_csv(path: Path, fields: Fields) -> None:
    """Write the fields of :class:`Measurements` with all digits."""
    checks.file_name("path", path)
    sensors, dofs = fields["sensors"], fields["dofs"]
    labels = [f"mode {i + 1}" for i in range(len(fields["frequencies"]))]
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*CSV_HEADER, *labels])
        for quantity, field in QUANTITIES.items():
            if fields[field] is None:
                continue
            for i, values in enumerate(np.atleast_2d(fields[field]).tolist()):
                sensor = sensors[i] if field in PER_SENSOR else ""
                dof = dofs[i] if field == "shapes" and dofs is not None else ""
                if isinstance(dof, str) and dof != _read_dof(dof):
                    dof = f"'{dof}'"  # a label that looks like a number
                cells = ["" if x != x else repr(x) for x in values]  # NaN: missing
                writer.writerow([quantity, sensor, dof, *cells])


def read_csv(path: Path) -> Fields:
    """Return the arguments of :class:`Measurements` that the file holds."""
    checks.file_name("path", path)
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:  # Excel's BOM
            lines = file.readlines()
            delimiter = next((c for c in ";\t" if c in "".join(lines[:1])), ",")
            reader = csv.reader(lines, delimiter=delimiter)
            rows = [(f"{path}, line {reader.line_num}", row) for row in reader]
    except (csv.Error, UnicodeError) as error:
        raise ValueError(
            f"{path}: expected a CSV file in UTF-8; save it as 'CSV UTF-8' ({error})"
        ) from None
    titles = _trim(rows[0][1]) if rows else []
    named = [title.lower() for title in titles[:3]]
    if named != CSV_HEADER or len(titles) < 4 or not all(titles):
        raise ValueError(
            f"{path}, line 1: expected the titles {','.join(CSV_HEADER)},mode 1,.. "
            f"separated by commas, semicolons or tabs, got {','.join(titles)!r}; "
            "modes are columns, and Measurements.to_csv writes an example. Read "
            "a table of another layout by pandas, as the tutorial of the portal frame "
            "does: Measurements(table['f'], shapes=table[sensors].T, sensors=sensors)"
        )
    fields: Fields = {}
    converted, plain = False, list[str]()  # rows in Hz, and those that name no unit
    sensors: dict[str, list[str]] = {field: [] for field in PER_SENSOR}
    dofs = []
    for place, row in rows[1:]:
        if not (cells := _trim(row)):
            continue
        field, factor = _read_title(place, cells[0])
        cells += [""] * (len(titles) - len(cells))
        sensor, dof = row[1] if len(row) > 1 else "", cells[2]  # as it was written
        wrong_dof = dof and field != "shapes"
        if bool(sensor.strip()) != (field in PER_SENSOR) or wrong_dof:
            raise ValueError(
                f"{place}, columns 'sensor' and 'dof': expected a sensor only in rows "
                f"of shapes, a DOF only in rows 'shape', got {sensor!r} and {dof!r}"
            )
        comma = delimiter != ","  # decimal commas, perhaps
        if comma:
            dof = dof.replace(",", ".")
        # A blank is what is not known, unless the file was cut there.
        open_end = row is rows[-1][1] and lines[-1][-1] not in "\r\n"
        if len(row) < len(titles) and not open_end:
            raise ValueError(
                f"{place}: {len(row)} cells under {len(titles)} titles; what is not "
                "known is a blank cell"
            )
        if field in PARTLY and not open_end:
            cells[3:] = [cell or "nan" for cell in cells[3:]]
        numbers = _read_numbers(place, titles, cells, field, comma)
        fields.setdefault(field, []).append([number * factor for number in numbers])
        converted |= field == "frequencies" and factor != 1.0
        if field in ("sd", "covariance") and not {*cells[0]} & {*"[("}:
            plain.append(field)
        if field in PER_SENSOR:
            sensors[field].append(sensor)
        elif field != "covariance" and len(fields[field]) > 1:
            raise ValueError(f"{place}: a second row of {field}")
        if field == "shapes":
            dofs.append(_read_dof(dof))
    for field in fields.keys() - {"covariance", *PER_SENSOR}:
        (fields[field],) = fields[field]
    if "frequencies" not in fields:
        raise ValueError(f"{path}: no row 'frequency [Hz]'")
    if converted and plain:
        raise ValueError(
            f"{path}: the frequencies have another unit than Hz, and that of the row "
            f"{plain[0]!r} is not known; write it in its title, such as 'sd [rad/s]'"
        )
    of_shapes, of_sd = sensors.values()
    if of_sd and of_sd != of_shapes:
        raise ValueError(
            f"{path}: expected the rows 'shape sd' for the same sensors as the rows "
            f"'shape', in the same order, {of_shapes}, got {of_sd}"
        )
    if "" in dofs and {*dofs} != {""}:
        raise ValueError(
            f"{path}, column 'dof': expected a DOF for each sensor or for none, but "
            f"{of_shapes[dofs.index('')]!r} has none"
        )
    labels = None if "" in dofs or not dofs else dofs
    return fields | {"sensors": of_shapes or None, "dofs": labels}


def _read_dof(cell: str) -> int | str:
    """Return the number of a DOF, or its label, perhaps in single quotes."""
    if cell.isdecimal():
        return int(cell)
    return cell[1:-1] if cell[:1] == cell[-1:] == "'" else cell


def _read_title(place: str, title: str) -> tuple[str, float]:
    """Return the quantity of a row, and the factor of its unit."""
    match = CSV_TITLE.fullmatch(title.lower())
    word, unit, sign = ("", "", "") if match is None else match.groups("")
    known = CSV_WORDS.get(word, "")
    field, percent = QUANTITIES.get(known), "%" in (unit, sign)
    if percent:
        fits = field in ("damping", "damping_sd")
    else:
        fits = unit in ("", "-") or f"[{unit}]" in known.lower()
    converted = known.endswith("[Hz]") and unit in CSV_UNITS
    if field is None or not (fits or converted):
        cure = ""
        if field == "sd" and percent:
            cure = "; or leave the row out: FrequencyTerm(.., relative_sd=0.01)"
        one = f"one of {[*QUANTITIES]}, got {title!r}{cure}"
        raise ValueError(f"{place}, column 'quantity': expected {one}")
    return field, CSV_UNITS[unit] if converted else 0.01 if percent else 1.0


def _read_numbers(
    place: str, titles: list[str], cells: list[str], field: str, comma: bool
) -> list[float]:
    """Return the number of each mode in a row."""
    if len(cells) > len(titles):
        raise ValueError(
            f"{place}: {len(cells)} cells under {len(titles)} titles; write numbers "
            "with a decimal point, or put semicolons between cells"
        )
    numbers = []
    for title, cell in zip(titles[3:], cells[3:], strict=True):
        try:
            numbers.append(float(cell.replace(",", ".") if comma else cell))
        except ValueError:
            remedy = "a mode that was not identified has no column"
            if field in PARTLY:
                remedy = "leave the cell blank where it is not known"
            raise ValueError(
                f"{place}, column {title!r}: expected a number, got {cell!r}; "
                f"{remedy}; in a spreadsheet, format cells as numbers, not as dates, "
                "and without marks of thousands"
            ) from None
    return numbers


def _trim(row: list[str]) -> list[str]:
    """Return the cells without surrounding blanks and without empty ones at the end."""
    cells = [cell.strip() for cell in row]
    while cells and not cells[-1]:
        cells.pop()
    return cells
