"""Modes as identification programs hand them over: universal files, pyOMA2."""

import warnings
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np

from .. import checks

# Analysis types of data set 55 that are modes: normal, and complex of both orders.
MODES = (2, 3, 7)
AXES = {"r1": "x", "r2": "y", "r3": "z", "r4": "rx", "r5": "ry", "r6": "rz"}


def read_uff(
    path: str | PathLike[str], sensors: Sequence[str] | None = None
) -> dict[str, Any]:
    """Return frequencies, shapes and sensors of the modes in a universal file.

    Args:
        path: A file with data sets 55; others are not read.
        sensors: Which ``"node:direction"`` to keep, in this order; None for all that
            are not zero in every mode, with a warning that names those left out.

    Raises:
        ImportError: If pyuff is not installed.
        ValueError: If there are no modes, their nodes differ, or a sensor is unknown.
    """
    checks.file_name("path", path)
    try:
        import pyuff
    except ImportError:
        raise ImportError(
            'universal files need pyuff: pip install "emcee_femu[uff]"'
        ) from None
    with open(path, "rb"):  # a missing file in Python's words, not in pyuff's
        pass
    try:
        file = pyuff.UFF(str(path))
        numbers = [i for i, kind in enumerate(file.get_set_types()) if kind == 55]
        sets = [(i + 1, file.read_sets(i)) for i in numbers]
    except Exception as error:  # the class that pyuff raises for whatever goes wrong
        raise ValueError(f"{path}: pyuff cannot read it ({error})") from error
    modes = [(i, data) for i, data in sets if data["analysis_type"] in MODES]
    if not modes:
        raise ValueError(
            f"{path}: expected data sets 55 with normal or complex modes, got "
            f"{len(sets)} data sets 55 and no mode among them"
        )
    columns = [_nodal_values(path, data) for _, data in modes]
    for (i, _), column in zip(modes, columns, strict=True):
        if list(column) != list(columns[0]):
            raise ValueError(
                f"{path}, data set {i}: its nodes and directions are not those of data "
                f"set {modes[0][0]}, of the first mode; all modes need the same"
            )
    shapes = np.array([[*column.values()] for column in columns]).T
    labels = [*columns[0]]
    keep = [i for i, row in enumerate(shapes) if row.any()]
    if sensors is not None:
        sensors = checks.parameter_names("sensors", sensors)
        unknown = set(sensors) - set(labels)
        if unknown:
            raise ValueError(
                f"sensors: {sorted(unknown)} are not in {path}; there are {labels}"
            )
        keep = [labels.index(label) for label in sensors]
    elif len(keep) < len(labels):
        left_out = [label for i, label in enumerate(labels) if i not in keep]
        warnings.warn(
            f"{path}: zero in all modes, taken as not measured and left out: "
            f"{left_out}; pass sensors= to choose",
            UserWarning,
            stacklevel=3,
        )
    found = {
        "frequencies": np.array([_frequency(data) for _, data in modes]),
        "shapes": shapes[keep],
    }
    return {**_ascending(found), "sensors": [labels[i] for i in keep]}


def read_pyoma2(result: Any, shape_sd: bool) -> dict[str, Any]:
    """Return the arguments of :class:`Measurements` that a pyOMA2 result holds.

    Raises:
        TypeError: If result has no Fn and Phi.
        ValueError: If there are no modes yet, or Phi_std is asked for and missing.
    """
    shape_sd = checks.flag("shape_sd", shape_sd)
    if not (hasattr(result, "Fn") and hasattr(result, "Phi")):
        raise TypeError(
            "result: expected a result of pyOMA2 with Fn and Phi, such as "
            f"algorithm.result, got {type(result).__name__}"
        )
    if result.Fn is None or result.Phi is None:
        raise ValueError("result: no modes yet; call mpe(..) of pyOMA2 first")
    names = {"frequencies": "Fn", "shapes": "Phi", "sd": "Fn_std"}
    if shape_sd:
        names["shape_sd"] = "Phi_std"
    found = {key: getattr(result, name, None) for key, name in names.items()}
    if shape_sd and found["shape_sd"] is None:
        raise ValueError(
            "result: no Phi_std; run pyOMA2 with calc_unc=True, or leave shape_sd out"
        )
    return _ascending(
        {
            key: checks.complex_array(f"result.{names[key]}", value)
            for key, value in found.items()
            if value is not None
        }
    )


def _ascending(found: dict[str, Any]) -> dict[str, Any]:
    """Put the modes, the last axis of every field, in ascending order of frequency.

    Where the fields do not fit together :class:`Measurements` says so.
    """
    order = np.argsort(found["frequencies"], kind="stable")
    fit = all(value.shape[-1:] == order.shape for value in found.values())
    return {k: v[..., order] for k, v in found.items()} if fit else found


def _frequency(data: Mapping[str, Any]) -> float:
    """Return Hz: the undamped frequency |lambda| / 2 pi where there is an eigenvalue.

    Real modes state Hz, whatever the units in data set 164; eigenvalues are in rad/s.
    """
    if data["analysis_type"] == 2:
        return float(data["freq"])
    return float(abs(data["eig"]) / (2 * np.pi))


def _nodal_values(
    path: str | PathLike[str], data: Mapping[str, Any]
) -> dict[str, complex]:
    """Return ``{"node:direction": value}`` of one mode, node by node."""
    axes = [key for key in AXES if key in data]
    nodes = [int(node) for node in data["node_nums"]]
    if any(len(data[key]) != len(nodes) for key in axes):  # pyuff reads on regardless
        raise ValueError(
            f"{path}, data set 55: expected 3 or 6 values a node, got "
            f"{data['n_data_per_node']} at {len(nodes)} nodes"
        )
    values = {
        f"{node}:{AXES[key]}": data[key][i]
        for i, node in enumerate(nodes)
        for key in axes
    }
    if len(values) < len(nodes) * len(axes):
        raise ValueError(
            f"{path}, data set 55: a node stands there twice, nodes are {nodes}"
        )
    return values
