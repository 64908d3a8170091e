"""Modes as other programs hand them over: universal files, pyOMA2."""

import warnings
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..contracts import Floats
from .directions import read_combination
from .modes import Fields, find_duplicates, phases
from .universal import (
    ALONG,
    UFF_AXES,
    DataSet,
    Nodes,
    Path,
    name_dofs,
    read_numbers,
    read_sets,
    warn_of_own_axes,
)

Indices: TypeAlias = NDArray[np.intp]
# Types of analysis: modes, and complex ones of two orders.
NORMAL_MODES, COMPLEX_MODES = 2, (3, 7)
# Types of data that are shapes: unknown, general, displacement, velocity, acceleration.
MOTIONS = (0, 1, 8, 11, 12)
COMPLEX_DATA = (5, 6)  # of single and double precision

# Where a data set has what: the line of six numbers that say what the values are; the
# lines of real numbers, after which values follow; among these the places of Hz, of
# viscous and hysteretic damping, and of the eigenvalue's real part.
LAYOUTS = {
    "55": (6, slice(8, 9), [0, 2, 3], 0),
    "2414": (9, slice(12, 14), [1, 4, 5], 6),
}


# Attributes of pyOMA2's results, by our names.
PYOMA2 = {"frequencies": "Fn", "shapes": "Phi", "sd": "Fn_std", "shape_sd": "Phi_std"}
PYOMA2_DAMPING = {"damping": "Xi", "damping_sd": "Xi_std"}


class Mode(NamedTuple):
    """A data set that holds a mode."""

    place: str  # the file and the data set, for messages
    hertz: float  # undamped
    damping: float  # a ratio; not above zero where none is stated
    size: int  # of the values at a node, 3 or 6
    is_complex: bool
    lines: list[str]


def read_uff(
    path: Path,
    sensors: Sequence[str] | None,
    numbers: Sequence[int] | None,
    dofs: ArrayLike | None,
    nodes: Nodes | None,
    axes: str | None,
) -> Fields:
    """Return the arguments of :class:`Measurements` that a universal file holds."""
    checks.one_of("axes", axes, [None, *ALONG])
    sets = read_sets(path)
    found = _find_modes(path, sets)
    hertz = np.array([mode.hertz for mode in found])
    order = _choose_modes(hertz, numbers, [f"{mode.place}: " for mode in found])
    values = [_nodal_values(found[i]) for i in order]
    labels = dict.fromkeys(label for column in values for label in column)
    rows = {x: np.array([column.get(x, np.nan) for column in values]) for x in labels}
    if nodes is not None:
        named = name_dofs(path, sets, rows, nodes, axes)
        rows = {x: rows[x] for x in named}
    zero = [x for x, row in rows.items() if not np.nansum(abs(row))]
    chosen = [x for x in rows if x not in zero] if sensors is None else sensors
    kept = [*checks.parameter_names("sensors", chosen)]
    if unknown := sorted({*kept} - {*rows}):
        at = "" if nodes is None else " at these nodes"
        raise ValueError(f"sensors: {path} has no {unknown}{at}, only {[*rows]}")
    absent = [x for x in kept if np.isnan(rows[x]).any()]
    if absent or (zero and sensors is None):
        warnings.warn(
            f"{path}: taken as not measured: zero in all modes, left out, "
            f"[{checks.listed(map(repr, zero))}]; absent in some modes, NaN there, "
            f"[{checks.listed(map(repr, absent))}]; pass sensors= to choose",
            stacklevel=3,
        )
    shapes = np.array([rows[x] for x in kept])
    if nodes is not None:
        if dofs is not None:
            raise TypeError("dofs, nodes: expected one of the two")
        dofs = [named[x] for x in kept]
    else:
        given = [] if dofs is None else np.asarray(dofs, dtype=object).ravel().tolist()
        said = [read_combination(dof) is not None for dof in given]
        plain = [x for i, x in enumerate(kept) if not any(said[i : i + 1])]
        warn_of_own_axes(path, sets, plain, axes)
    known = np.nan_to_num(shapes)
    twice = find_duplicates(hertz[order], (known * phases(known)).real)
    if twice and known.any(axis=0).all():
        again = [*{int(order[j]) for _, j in twice}]
        others = [i + 1 for i in sorted(order.tolist()) if i not in again]
        first, second = (int(order[i]) + 1 for i in twice[0])
        raise ValueError(
            f"{path}: its modes {first} and {second} are the same, of "
            f"{hertz[second - 1]:g} Hz; read each once: modes={others}"
        )
    return {
        "frequencies": hertz[order],
        "shapes": shapes,
        "damping": _known([found[i].damping for i in order]),
        "sensors": kept,
        "dofs": dofs,
    }


def read_pyoma2(
    result: object, shape_sd: bool, numbers: Sequence[int] | None
) -> Fields:
    """Return the arguments of :class:`Measurements` that a pyOMA2 result holds."""
    if not {"Fn", "Phi"} <= {*dir(result)}:
        raise TypeError(
            "result: expected a result of pyOMA2 with Fn and Phi, such as "
            f"algorithm.result, got {type(result).__name__}"
        )
    fields: Fields = {}
    for field, name in (PYOMA2 | PYOMA2_DAMPING).items():
        if (value := getattr(result, name, None)) is not None:
            fields[field] = checks.complex_array(f"result.{name}", value)
    if not {"frequencies", "shapes"} <= fields.keys():
        raise ValueError("result: no modes yet; call mpe(..) of pyOMA2 first")
    if not checks.flag("shape_sd", shape_sd):
        fields.pop("shape_sd", None)
    elif "shape_sd" not in fields:
        remedy = "run pyOMA2 with calc_unc=True, or leave shape_sd out"
        raise ValueError(f"result: no Phi_std; {remedy}")
    for field in fields.keys() & PYOMA2_DAMPING.keys():
        fields[field] = _known(fields[field])
    hertz = np.asarray(fields["frequencies"].real)
    if any(value.shape[-1:] != hertz.shape for value in fields.values()):
        return fields  # Measurements says what does not fit
    order = _choose_modes(hertz, numbers, ["result.Fn: "] * len(hertz))
    sd = fields.get("sd", np.ones(len(hertz))).real
    if zero := [i + 1 for i in sorted(order.tolist()) if sd[i] == 0]:
        good = [i + 1 for i in sorted(order.tolist()) if sd[i] != 0]
        raise ValueError(
            f"result.Fn_std: expected numbers above zero, but modes {zero} have 0, "
            f"which pyOMA2 writes where it found no uncertainty; read others, modes="
            f"{good}, or set result.Fn_std = None and give FrequencyTerm relative_sd"
        )
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
    wanted = [i - 1 for i in checks.chosen_numbers("modes", numbers, len(hertz))]
    good = (hertz > 0) & np.isfinite(hertz)
    for i in wanted:
        if not good[i]:
            others = [j + 1 for j in wanted if good[j]]
            raise ValueError(
                f"{places[i]}mode {i + 1} has {hertz[i]:g} Hz, and Measurements hold "
                f"elastic modes that were identified; read the others: modes={others}"
            )
    return np.array(sorted(wanted, key=lambda i: hertz[i]))


def _find_modes(path: Path, sets: Sequence[DataSet]) -> list[Mode]:
    """Return all data sets of a universal file that hold a mode."""
    found = [_read_header(*data) for data in sets if data.kind in LAYOUTS]
    if not (modes := [mode for mode in found if mode is not None]):
        kinds = sorted({data.kind for data in sets})
        doubt = "" if kinds else " (none: is it a universal file?)"
        raise ValueError(
            f"{path}: expected modes, data sets 55 or 2414 of an analysis of type 2, 3 "
            f"or 7, got none; its data sets are of types {kinds}{doubt}: export "
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
    of_modes = analysis in (NORMAL_MODES, *COMPLEX_MODES) and motion in MOTIONS
    if not (at_nodes and of_modes):
        return None
    reals = np.append(read_numbers(place, lines[of_reals]), np.zeros(12))
    if analysis == NORMAL_MODES:
        hertz, viscous, hysteretic = reals[normal]
        damping = viscous if viscous > 0 else hysteretic / 2
    else:
        value = complex(*reals[eigenvalue : eigenvalue + 2])
        hertz = abs(value) / (2 * np.pi)
        damping = -value.real / abs(value) if value else 0.0
    rest = lines[of_reals.stop :]
    return Mode(place, hertz, damping, size, data in COMPLEX_DATA, rest)


def _known(damping: ArrayLike) -> Floats:
    """Return damping ratios, NaN where one is not above zero: none was identified."""
    return np.where(np.real(damping) > 0, np.real(damping), np.nan)


def _nodal_values(mode: Mode) -> dict[str, complex]:
    """Return ``{"node:direction": value}`` of one mode, node by node."""
    numbers = read_numbers(mode.place, mode.lines)
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
