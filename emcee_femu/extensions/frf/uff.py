"""FRFs as universal files hold them: data sets 58, read by pyuff."""

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from ... import checks
from ...measurements.universal import (
    ALONG,
    UFF_AXES,
    Nodes,
    Path,
    name_dofs,
    read_sets,
    warn_of_own_axes,
)

# Of data sets 58 of universal files.
TIME_HISTORY, FRF, COHERENCE = 1, 4, 6  # types of functions
UNKNOWN_ORDINATES = (0, 1)  # types of ordinates: unknown and general
ORDINATES = {8: "receptance", 11: "mobility", 12: "accelerance"}
FORCE, FREQUENCY, IEEE = 13, 18, 2
EVEN = 1  # spacing of the abscissa
VALUES_PER_LINE = 6  # of a data set 58, at most
UFF_DIRECTIONS = range(-6, 7)  # 0: not stated, or a scalar
ENDS = "rsp", "ref"
DataSet: TypeAlias = Mapping[str, Any]  # as pyuff reads it


def read_uff58(path: Path, averages: int | None, kind: str | None) -> dict[str, Any]:
    """Return the arguments of :class:`FRFMeasurements`, in SI, of a universal file."""
    file, types = _open_uff(path)
    units: DataSet = {"length": 1.0, "force": 1.0}
    read: dict[int, dict[tuple[str, str], Any]] = {FRF: {}, COHERENCE: {}}
    lines, kinds, others = None, {}, set()
    for i, number in enumerate(types):
        place = f"{path}, data set {i + 1}"
        if number == 164:
            units = _ask(place, partial(file.read_sets, i))
        if number != 58:
            continue
        header = _ask(place, partial(file.read_sets, i, header_only=True))
        function = header["func_type"]
        if function != FRF and (function != COHERENCE or averages is None):
            others.add(function)
            continue
        data = _ask(place, partial(file.read_sets, i))
        data = _cut_padding(data)
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
        got = f"{types.count(58)} data sets 58, of types {sorted(others)}"
        if TIME_HISTORY in others:
            got += "; time histories (type 1) are for identification, as by pyOMA2"
        raise ValueError(f"{path}: expected data sets 58 of type 4 (FRF), got {got}")
    if len({*kinds.values()}) > 1:
        raise ValueError(f"{path}: expected FRFs of one kind, got {kinds} by data set")
    factors = units["length"], units["force"]
    if factors != (1.0, 1.0):
        warnings.warn(
            f"{path}: FRFs are converted to SI by the file's units (data set 164), "
            f"with factors of length and force {factors}",
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


def place_channels(
    path: Path, fields: dict[str, Any], nodes: Nodes | None, axes: str | None
) -> None:
    """Name channels by the model's DOFs, or warn where axes are not the global ones."""
    checks.one_of("axes", axes, [None, *ALONG])
    sets, channels = read_sets(path), fields["channels"]
    labels = dict.fromkeys(label for channel in channels for label in channel)
    if nodes is None:
        stated = [label for label in labels if ":" in label]
        warn_of_own_axes(path, sets, stated, axes)
        return
    dofs = name_dofs(path, sets, labels, nodes, axes)
    kept = [i for i, pair in enumerate(channels) if {*pair} <= {*dofs}]
    if not kept:
        raise ValueError(
            f"nodes: {path} has no channel with both ends at {[*nodes]}; it has "
            f"{', '.join(map('/'.join, channels))}"
        )
    fields["channels"] = [tuple(dofs[label] for label in channels[i]) for i in kept]
    for name in fields.keys() & {"values", "coherence"}:
        fields[name] = fields[name][kept]


def _open_uff(path: Path) -> tuple[Any, list[int]]:
    """Return a universal file, opened by pyuff, and the types of its data sets."""
    checks.file_name("path", path)
    try:
        import pyuff
    except ImportError:
        raise ImportError(
            "FRFs of universal files need pyuff: pip install pyuff"
        ) from None
    with open(path, "rb"):  # Python's message for a missing file, not pyuff's
        pass
    file = _ask(path, partial(pyuff.UFF, str(path)))
    return file, [int(number) for number in _ask(path, file.get_set_types)]


def _ask(place: Path, call: Callable[[], Any]) -> Any:
    """Return what a function of pyuff does."""
    try:
        return call()
    except Exception as error:  # the class that pyuff raises for whatever goes wrong
        raise ValueError(f"{place}: pyuff cannot read it ({error})") from error


def _cut_padding(data: DataSet) -> DataSet:
    """Return an evenly spaced function without what fills its last line."""
    points, values = int(data["num_pts"]), data["data"]
    even = data.get("abscissa_spacing") == EVEN
    if not even or not 0 < len(values) - points < VALUES_PER_LINE:
        return data
    return {**data, "data": values[:points], "x": data["x"][:points]}


def _check_function(place: str, data: DataSet) -> None:
    """Refuse a function that is of another kind or incomplete."""
    abscissa = data["abscissa_spec_data_type"]
    for what, got, expected in (
        ("binary numbers of format", data.get("fp_format", IEEE), (IEEE,)),
        ("an abscissa of type", abscissa, (*UNKNOWN_ORDINATES, FREQUENCY)),
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
    known = above in (*UNKNOWN_ORDINATES, *ORDINATES)
    known &= below in (*UNKNOWN_ORDINATES, FORCE)
    if not known or kind not in (None, stated):
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
