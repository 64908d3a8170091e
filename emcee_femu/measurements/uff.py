"""Modes and FRFs as other programs hand them over: universal files, pyOMA2."""

import re
import warnings
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..contracts import Floats

Path = str | PathLike[str]
Indices: TypeAlias = NDArray[np.intp]
DataSet: TypeAlias = Mapping[str, Any]  # as pyuff reads it
END = "    -1"  # the line before and after a data set
BINARY = "    58b"  # begins one whose values END follows on the same line
# Types of analysis: modes, and complex ones of two orders.
NORMAL_MODES, COMPLEX_MODES = 2, (3, 7)
# Types of data that are shapes: unknown, general, displacement, velocity, acceleration.
MOTIONS = (0, 1, 8, 11, 12)
COMPLEX_DATA = (5, 6)  # of single and double precision
# Widths of columns are not relied on: numbers may touch, "1.0E+00-2.0E+00".
UFF_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[ED][-+]?\d+)?", re.I)
FRF, COHERENCE = 4, 6  # types of functions
UNKNOWN_ORDINATES = (0, 1)  # types of ordinates: unknown and general
ORDINATES = {8: "receptance", 11: "mobility", 12: "accelerance"}
FORCE, FREQUENCY, IEEE = 13, 18, 2
UFF_AXES = ("x", "y", "z", "rx", "ry", "rz")
UFF_DIRECTIONS = range(-6, 7)  # 0: not stated, or a scalar
ENDS = "rsp", "ref"


# Where a data set has what: the line of six numbers that say what the values are; the
# lines of real numbers, after which values follow; among these the places of Hz, of
# viscous and hysteretic damping, and of the eigenvalue's real part.
LAYOUTS = {
    "55": (6, slice(8, 9), [0, 2, 3], 0),
    "2414": (9, slice(12, 14), [1, 4, 5], 6),
}


class Mode(NamedTuple):
    """A data set that holds a mode."""

    place: str  # the file and the data set, for messages
    hertz: float  # undamped
    damping: float  # a ratio; not above zero where none is stated
    size: int  # of the values at a node, 3 or 6
    is_complex: bool
    lines: list[str]


def read_uff(
    path: Path, sensors: Sequence[str] | None, numbers: Sequence[int] | None
) -> dict[str, Any]:
    """Return the arguments of :class:`Measurements` that a universal file holds."""
    found = _find_modes(path)
    hertz = np.array([mode.hertz for mode in found])
    order = _choose_modes(hertz, numbers, [f"{mode.place}: " for mode in found])
    values = [_nodal_values(found[i]) for i in order]
    labels = [*dict.fromkeys(label for column in values for label in column)]
    rows = [[column.get(label, np.nan) for column in values] for label in labels]
    shapes = np.array(rows)
    zero = [x for x, row in zip(labels, shapes, strict=True) if not np.nansum(abs(row))]
    chosen = [x for x in labels if x not in zero] if sensors is None else sensors
    kept = [*checks.parameter_names("sensors", chosen)]
    unknown = set(kept) - set(labels)
    if unknown:
        raise ValueError(f"sensors: {path} has no {sorted(unknown)}, only {labels}")
    shapes = shapes[[labels.index(label) for label in kept]]
    absent = [x for x, row in zip(kept, shapes, strict=True) if np.isnan(row).any()]
    if absent or (zero and sensors is None):
        warnings.warn(
            f"{path}: taken as not measured: zero in all modes, left out, {zero}; "
            f"absent in some modes, NaN there, {absent}; pass sensors= to choose",
            UserWarning,
            stacklevel=3,
        )
    return {
        "frequencies": hertz[order],
        "shapes": shapes,
        "damping": _known([found[i].damping for i in order]),
        "sensors": kept,
    }


def read_pyoma2(
    result: Any, shape_sd: bool, numbers: Sequence[int] | None
) -> dict[str, Any]:
    """Return the arguments of :class:`Measurements` that a pyOMA2 result holds."""
    if not (hasattr(result, "Fn") and hasattr(result, "Phi")):
        raise TypeError(
            "result: expected a result of pyOMA2 with Fn and Phi, such as "
            f"algorithm.result, got {type(result).__name__}"
        )
    if result.Fn is None or result.Phi is None:
        raise ValueError("result: no modes yet; call mpe(..) of pyOMA2 first")
    names = {"frequencies": "Fn", "shapes": "Phi", "sd": "Fn_std"}
    if checks.flag("shape_sd", shape_sd):
        names["shape_sd"] = "Phi_std"
        if getattr(result, "Phi_std", None) is None:
            raise ValueError(
                "result: no Phi_std; run pyOMA2 with calc_unc=True, or leave shape_sd "
                "out"
            )
    of_damping = {"damping": "Xi", "damping_sd": "Xi_std"}
    fields = {
        field: checks.complex_array(f"result.{name}", value)
        for field, name in (names | of_damping).items()
        if (value := getattr(result, name, None)) is not None
    }
    fields |= {field: _known(fields[field]) for field in of_damping if field in fields}
    hertz = np.asarray(fields["frequencies"].real)
    if any(value.shape[-1:] != hertz.shape for value in fields.values()):
        return fields  # Measurements says what does not fit
    order = _choose_modes(hertz, numbers, ["result.Fn: "] * len(hertz))
    return {field: value[..., order] for field, value in fields.items()}


def _choose_modes(
    hertz: Floats, numbers: Sequence[int] | None, places: Sequence[str]
) -> Indices:
    """Return which modes to read, in ascending order of frequency.

    Args:
        hertz: The frequencies of all.
        numbers: Those that a user asks for, 1 = the first; None for all.
        places: Where each comes from, for messages.
    """
    count = len(hertz)
    some = range(1, count + 1) if numbers is None else np.atleast_1d(numbers)
    wanted = [checks.whole_number("modes", number, 1) - 1 for number in some]
    if not wanted or len({*wanted}) < len(wanted) or max(wanted) >= count:
        raise ValueError(
            f"modes: expected numbers from 1 to {count}, each once, got {numbers}"
        )
    good = (hertz > 0) & np.isfinite(hertz)
    for i in wanted:
        if not good[i]:
            others = [j + 1 for j in wanted if good[j]]
            raise ValueError(
                f"{places[i]}mode {i + 1} has {hertz[i]:g} Hz, and Measurements hold "
                f"elastic modes that were identified; read the others: modes={others}"
            )
    return np.array(sorted(wanted, key=lambda i: hertz[i]))


def _find_modes(path: Path) -> list[Mode]:
    """Return all data sets of a universal file that hold a mode."""
    checks.file_name("path", path)
    sets: list[list[str]] = []
    inside = False
    with open(path, encoding="latin-1") as file:
        for line in map(str.rstrip, file):
            binary = inside and "".join(sets[-1][:1]).startswith(BINARY)
            if line == END or (binary and line.endswith(END)):
                inside = not inside
                sets += [[]] if inside else []
            elif inside:
                sets[-1].append(line)
    if inside:
        raise ValueError(f"{path}: it ends inside data set {len(sets)}; is it cut?")
    found: list[Mode | None] = []
    kinds = [data[0].split()[0] if data else "" for data in sets]
    for i, (kind, data) in enumerate(zip(kinds, sets, strict=True), 1):
        if kind in LAYOUTS:
            found.append(_read_header(f"{path}, data set {i}", kind, data))
    modes = [mode for mode in found if mode is not None]
    if not modes:
        raise ValueError(
            f"{path}: expected modes, data sets 55 or 2414 of an analysis of type 2, 3 "
            f"or 7, got none; its data sets are of types {sorted({*kinds})}: export "
            "the modes too, or read FRFs (type 58) by FRFMeasurements.from_uff"
        )
    return modes


def _read_header(place: str, kind: str, lines: list[str]) -> Mode | None:
    """Return the mode that a data set holds, None for other results."""
    line, of_reals, normal, eigenvalue = LAYOUTS[kind]
    try:
        _, analysis, _, motion, data, size = map(int, lines[line].split())
    except (IndexError, ValueError):
        raise ValueError(f"{place}: its header is not that of type {kind}") from None
    at_nodes = kind == "55" or lines[3].strip() == "1"
    if (
        analysis not in (NORMAL_MODES, *COMPLEX_MODES)
        or motion not in MOTIONS
        or not at_nodes
    ):
        return None
    reals = np.append(_read_numbers(place, lines[of_reals]), np.zeros(12))
    if analysis == NORMAL_MODES:
        hertz, viscous, hysteretic = reals[normal]
        damping = viscous if viscous > 0 else hysteretic / 2
    else:
        value = complex(*reals[eigenvalue : eigenvalue + 2])
        hertz = abs(value) / (2 * np.pi)
        damping = -value.real / abs(value) if value else 0.0
    rest = lines[of_reals.stop :]
    return Mode(place, hertz, damping, size, data in COMPLEX_DATA, rest)


def _read_numbers(place: str, lines: Sequence[str]) -> Floats:
    """Return all numbers of some lines, which hold nothing else."""
    text = "\n".join(lines)
    if others := UFF_NUMBER.sub(" ", text).split():
        raise ValueError(f"{place}: expected numbers, got {others[0]!r}")
    found = [number.upper().replace("D", "E") for number in UFF_NUMBER.findall(text)]
    return np.array(found, dtype=np.float64)


def _known(damping: Any) -> Any:
    """Return damping ratios, NaN where one is not above zero: none was identified."""
    return np.where(np.asarray(damping) > 0, damping, np.nan)


def _nodal_values(mode: Mode) -> dict[str, complex]:
    """Return ``{"node:direction": value}`` of one mode, node by node."""
    numbers = _read_numbers(mode.place, mode.lines)
    width = 1 + mode.size * (1 + mode.is_complex)
    if mode.size not in (3, 6) or not len(numbers) or len(numbers) % width:
        raise ValueError(
            f"{mode.place}: expected nodes with 3 or 6 values each, got {mode.size}, "
            f"and {len(numbers)} numbers in all"
        )
    table = numbers.reshape(-1, width)
    nodes, values = table[:, 0], table[:, 1:]
    if len({*nodes}) < len(nodes) or (nodes % 1).any():
        raise ValueError(
            f"{mode.place}: expected numbers of nodes, each once, got {nodes.tolist()}"
        )
    if mode.is_complex:
        values = values[:, ::2] + 1j * values[:, 1::2]
    return {
        f"{node:.0f}:{axis}": value
        for node, row in zip(nodes, values.tolist(), strict=True)
        for axis, value in zip(UFF_AXES, row, strict=False)
    }


def read_uff58(path: Path, averages: int | None, kind: str | None) -> dict[str, Any]:
    """Return the arguments of :class:`FRFMeasurements`, in SI, of a universal file."""
    file, types = _open_uff(path)
    units: DataSet = {"length": 1.0, "force": 1.0}
    read: dict[int, dict[tuple[str, str], Any]] = {FRF: {}, COHERENCE: {}}
    lines, kinds, others = None, {}, set()
    for i, number in enumerate(types):
        place = f"{path}, data set {i + 1}"
        if number == 164:
            units = _read_set(place, file, i)
        if number != 58:
            continue
        function = _read_set(place, file, i, header_only=True)["func_type"]
        if function != FRF and (function != COHERENCE or averages is None):
            others.add(function)
            continue
        data = _read_set(place, file, i)
        _check_function(place, data)
        if lines is None:
            lines = np.asarray(data["x"], dtype=float)
        if not np.array_equal(data["x"], lines):
            raise ValueError(f"{place}: other lines than the functions before it")
        channel, factor = _find_channel(data, units)
        if channel in read[function]:
            raise ValueError(
                f"{place}: {'/'.join(channel)} appears twice; give a file with one"
            )
        if function == FRF:
            kinds[i + 1] = _find_kind(place, data, kind)
            read[FRF][channel] = factor * np.asarray(data["data"], dtype=complex)
        else:
            read[COHERENCE][channel] = np.asarray(data["data"]).real
    if not kinds:
        raise ValueError(
            f"{path}: expected data sets 58 of type 4 (FRF), got "
            f"{types.count(58)} data sets 58, of types {sorted(others)}"
        )
    if len({*kinds.values()}) > 1:
        raise ValueError(f"{path}: expected FRFs of one kind, got {kinds} by data set")
    factors = units["length"], units["force"]
    if factors != (1.0, 1.0):
        warnings.warn(
            f"{path}: FRFs are converted to SI by the file's units (data set 164), "
            f"with factors of length and force {factors}",
            UserWarning,
            stacklevel=3,
        )
    fields = {
        "lines": lines,
        "values": np.array([*read[FRF].values()]),
        "channels": [*read[FRF]],
        "kind": kinds.popitem()[1],
    }
    if averages is None:
        return fields
    missing = ["/".join(channel) for channel in read[FRF].keys() - read[COHERENCE]]
    if missing:
        raise ValueError(f"averages: {path} has no coherence of {missing}; omit it")
    coherence = np.array([read[COHERENCE][channel] for channel in read[FRF]])
    return {**fields, "coherence": coherence, "averages": averages}


def _open_uff(path: Path) -> tuple[Any, list[int]]:
    """Return a universal file, opened by pyuff, and the types of its data sets."""
    checks.file_name("path", path)
    try:
        import pyuff
    except ImportError:
        raise ImportError(
            'FRFs of universal files need pyuff: pip install "emcee_femu[uff]"'
        ) from None
    with open(path, "rb"):  # Python's message for a missing file, not pyuff's
        pass
    try:
        file = pyuff.UFF(str(path))
        return file, [int(number) for number in file.get_set_types()]
    except Exception as error:  # the class that pyuff raises for whatever goes wrong
        raise ValueError(f"{path}: pyuff cannot read it ({error})") from error


def _read_set(place: str, file: Any, i: int, **options: bool) -> DataSet:
    """Return data set i of a file."""
    try:
        data: DataSet = file.read_sets(i, **options)
    except Exception as error:
        raise ValueError(f"{place}: pyuff cannot read it ({error})") from error
    return data


def _check_function(place: str, data: DataSet) -> None:
    """Refuse a function that is not what is read, or not wholly there."""
    for what, got, expected in (
        ("binary numbers of format", data.get("fp_format", IEEE), (IEEE,)),
        (
            "an abscissa of type",
            data["abscissa_spec_data_type"],
            (*UNKNOWN_ORDINATES, FREQUENCY),
        ),
        ("a response direction of", data["rsp_dir"], UFF_DIRECTIONS),
        ("a reference direction of", data["ref_dir"], UFF_DIRECTIONS),
        ("a number of values of", len(data["data"]), (data["num_pts"],)),
    ):
        if got not in expected:
            raise ValueError(f"{place}: expected {what} {expected}, got {got}")


def _find_kind(place: str, data: DataSet, kind: str | None) -> str:
    """Return the kind of an FRF: that of the file, or else the one that was given."""
    above, below = data["ordinate_spec_data_type"], data["orddenom_spec_data_type"]
    stated = ORDINATES.get(above, kind)
    if (
        kind not in (None, stated)
        or above not in (*UNKNOWN_ORDINATES, *ORDINATES)
        or below not in (*UNKNOWN_ORDINATES, FORCE)
    ):
        raise ValueError(
            f"{place}: type {above} over {below} is not kind={kind!r}; expected one of "
            f"{ORDINATES} over force ({FORCE})"
        )
    if stated is None or (kind is None and below != FORCE):
        raise ValueError(
            f"{place}: it does not say what was measured, type {above} over {below}; "
            f"if you know, give kind=, one of {[*ORDINATES.values()]}"
        )
    return stated


def _find_channel(data: DataSet, units: DataSet) -> tuple[tuple[str, str], float]:
    """Return labels of DOFs, and the factor to SI and to directions along the axes."""
    response, reference = directions = [int(data[f"{end}_dir"]) for end in ENDS]
    first, second = (
        f"{int(data[f'{end}_node'])}" + (f":{UFF_AXES[abs(x) - 1]}" if x else "")
        for end, x in zip(ENDS, directions, strict=True)
    )
    sign = -1.0 if (response < 0) != (reference < 0) else 1.0
    power = (abs(response) > 3) + (abs(reference) > 3) - 1  # rotations, moments
    return (first, second), sign * units["force"] * units["length"] ** power
