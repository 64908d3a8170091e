"""Modes and FRFs as other programs hand them over: universal files, pyOMA2."""

import warnings
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, TypeAlias

import numpy as np

from .. import checks

Path = str | PathLike[str]
DataSet: TypeAlias = Mapping[str, Any]  # as pyuff reads it
# Analysis types of data set 55 that are modes: normal, and complex of both orders.
MODES = (2, 3, 7)
FRF, COHERENCE = 4, 6  # types of functions
ORDINATES = {8: "receptance", 11: "mobility", 12: "accelerance"}
FORCE = 13
AXES = {"r1": "x", "r2": "y", "r3": "z", "r4": "rx", "r5": "ry", "r6": "rz"}


def read_uff(path: Path, sensors: Sequence[str] | None = None) -> dict[str, Any]:
    """Return the arguments of :class:`Measurements` that a universal file holds."""
    sets = read_sets(path, 55)
    modes = {i: data for i, data in sets.items() if data["analysis_type"] in MODES}
    if not modes:
        raise ValueError(
            f"{path}: expected data sets 55 with normal or complex modes, got "
            f"{len(sets)} data sets 55 and no mode among them"
        )
    values = {i: _nodal_values(path, data) for i, data in modes.items()}
    first, *others = values
    for i in others:
        if [*values[i]] != [*values[first]]:
            raise ValueError(
                f"{path}, data set {i}: its nodes and directions are not those of data "
                f"set {first}, of the first mode; all modes need the same"
            )
    shapes = np.array([[*column.values()] for column in values.values()]).T
    labels = [*values[first]]
    if sensors is None:
        kept = [label for label, row in zip(labels, shapes, strict=True) if row.any()]
        if len(kept) < len(labels):
            warnings.warn(
                f"{path}: zero in all modes, taken as not measured and left out: "
                f"{[x for x in labels if x not in kept]}; pass sensors= to choose",
                UserWarning,
                stacklevel=3,
            )
    else:
        kept = [*checks.parameter_names("sensors", sensors)]
        unknown = set(kept) - set(labels)
        if unknown:
            raise ValueError(f"sensors: {path} has no {sorted(unknown)}, only {labels}")
    fields = {
        "frequencies": np.array([_frequency(data) for data in modes.values()]),
        "shapes": shapes[[labels.index(label) for label in kept]],
        "damping": _known([_damping(data) for data in modes.values()]),
    }
    return {**_sort_modes(fields), "sensors": kept}


def read_pyoma2(result: Any, shape_sd: bool) -> dict[str, Any]:
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
    known = {field: _known(fields[field]) for field in of_damping if field in fields}
    return _sort_modes(fields | known)


def _sort_modes(fields: dict[str, Any]) -> dict[str, Any]:
    """Put the modes, the last axis of every field, in ascending order of frequency.

    Where the fields do not fit together :class:`Measurements` says so.
    """
    order = np.argsort(fields["frequencies"], kind="stable")
    fit = all(value.shape[-1:] == order.shape for value in fields.values())
    return {k: v[..., order] for k, v in fields.items()} if fit else fields


def read_sets(path: Path, number: int) -> dict[int, DataSet]:
    """Return the data sets of a number, such as 55, by their place in the file."""
    checks.file_name("path", path)
    try:
        import pyuff
    except ImportError:
        raise ImportError(
            'universal files need pyuff: pip install "emcee_femu[uff]"'
        ) from None
    with open(path, "rb"):  # Python's message for a missing file, not pyuff's
        pass
    try:
        file = pyuff.UFF(str(path))
        places = [i for i, kind in enumerate(file.get_set_types()) if kind == number]
        return {i + 1: file.read_sets(i) for i in places}
    except Exception as error:  # the class that pyuff raises for whatever goes wrong
        raise ValueError(f"{path}: pyuff cannot read it ({error})") from error


def _frequency(data: DataSet) -> float:
    """Return Hz: as stated, or the undamped frequency of an eigenvalue in rad/s."""
    normal = data["analysis_type"] == 2
    return float(data["freq"] if normal else abs(data["eig"]) / (2 * np.pi))


def _damping(data: DataSet) -> float:
    """Return the damping ratio; zero where a file of normal modes states none."""
    if data["analysis_type"] == 2:
        return float(data["modal_damp_vis"])
    return float(-data["eig"].real / abs(data["eig"]))


def _known(damping: Any) -> Any:
    """Return damping ratios, NaN where one is not above zero: none was identified."""
    return np.where(np.asarray(damping) > 0, damping, np.nan)


def _nodal_values(path: Path, data: DataSet) -> dict[str, complex]:
    """Return ``{"node:direction": value}`` of one mode, node by node."""
    axes = [key for key in AXES if key in data]
    nodes = [int(node) for node in data["node_nums"]]
    if any(len(data[key]) != len(nodes) for key in axes):  # pyuff reads on regardless
        raise ValueError(
            f"{path}, data set 55: expected 3 or 6 values per node, got "
            f"{data['n_data_per_node']} at {len(nodes)} nodes"
        )
    if len(set(nodes)) < len(nodes):
        raise ValueError(f"{path}, data set 55: a node appears twice: {nodes}")
    return {
        f"{node}:{AXES[key]}": data[key][i]
        for i, node in enumerate(nodes)
        for key in axes
    }


def read_uff58(path: Path, averages: int | None) -> dict[str, Any]:
    """Return the arguments of :class:`FRFMeasurements` that a universal file holds."""
    sets = read_sets(path, 58)
    functions = {i: data for i, data in sets.items() if data["func_type"] == FRF}
    if not functions:
        types = sorted({int(data["func_type"]) for data in sets.values()})
        raise ValueError(
            f"{path}: expected data sets 58 of type 4 (FRF), got {len(sets)} data sets "
            f"58, of types {types}"
        )
    first = next(iter(functions))
    lines = np.asarray(functions[first]["x"], dtype=float)
    kinds, values = {}, {}
    for i, data in functions.items():
        if not np.array_equal(data["x"], lines):
            raise ValueError(f"{path}, data set {i}: other lines than data set {first}")
        above, below = data["ordinate_spec_data_type"], data["orddenom_spec_data_type"]
        if above not in ORDINATES or below != FORCE:
            raise ValueError(
                f"{path}, data set {i}: expected displacement, velocity or acceleration"
                f" (types {list(ORDINATES)}) over force ({FORCE}), got type {above} "
                f"over {below}"
            )
        kinds[i] = ORDINATES[above]
        channel, sign = _find_channel(data)
        if channel in values:
            raise ValueError(f"{path}, data set {i}: {'/'.join(channel)} appears twice")
        values[channel] = sign * np.asarray(data["data"], dtype=complex)
    if len(set(kinds.values())) > 1:
        raise ValueError(f"{path}: expected FRFs of one kind, got {kinds} by data set")
    fields = {
        "lines": lines,
        "values": np.array([*values.values()]),
        "channels": [*values],
        "kind": kinds[first],
    }
    if averages is None:
        return fields
    coherences = {
        _find_channel(data)[0]: np.asarray(data["data"]).real
        for data in sets.values()
        if data["func_type"] == COHERENCE
    }
    missing = ["/".join(channel) for channel in values if channel not in coherences]
    if missing:
        raise ValueError(f"averages: {path} has no coherence of {missing}; omit it")
    coherence = np.array([coherences[channel] for channel in values])
    return {**fields, "coherence": coherence, "averages": averages}


def _find_channel(data: DataSet) -> tuple[tuple[str, str], float]:
    """Return labels of DOFs, and the sign of both directions."""
    labels, sign = [], 1.0
    for end in ("rsp", "ref"):
        direction = int(data[f"{end}_dir"])
        sign *= -1.0 if direction < 0 else 1.0
        axis = f":{[*AXES.values()][abs(direction) - 1]}" if direction else ""
        labels.append(f"{int(data[f'{end}_node'])}{axis}")
    return (labels[0], labels[1]), sign
