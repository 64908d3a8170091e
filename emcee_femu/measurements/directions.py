"""What sensors measure: DOFs along and against axes, and combinations of them."""

import re
from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..contracts import Floats

SIGNED = re.compile(r"(.+:)([-+])(u?[xyz]|r[xyz])")  # a DOF such as "2:-ux"
NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
# One term of a combination of DOFs, such as "- 0.5*2:uy" or "2:ux" before " - 1:ux".
COMBINED = re.compile(
    rf"\s*([-+]?)\s*(?:({NUMBER})\s*\*\s*)?(\S+?)"
    rf"(?=\s+[-+]\s|\s*[-+]\s*{NUMBER}\s*\*|\s*$)"
)
ROTATION = re.compile(r".*:[-+]?r[xyz]")  # a DOF in radians, such as "3:ry"
# What sensors measure: a MAC compares those of the first that moves in a mode.
SENSOR_UNITS = TRANSLATION, TURN, STRAIN = range(3)
BLIND = 1e-6  # a sum of factors, of their size, that printed digits leave of zero
UNIT_LENGTH = 0.05  # how far the squares of cosines may be from 1, by printed digits


def along_axis(dof: Hashable) -> tuple[Any, float]:
    """Return a DOF along its axis, and -1 if it was against it, as ``"2:-ux"`` is."""
    signed = SIGNED.fullmatch(dof) if isinstance(dof, str) else None
    if signed is None:
        return dof, 1.0
    return signed[1] + signed[3], -1.0 if signed[2] == "-" else 1.0


def read_dofs(
    value: ArrayLike | None, n_sensors: int
) -> tuple[NDArray[Any] | None, Floats]:
    """Return the model's DOF at each sensor, and the sign of what it measured.

    DOFs are whole numbers from 0, or labels.
    """
    if value is None:
        return None, np.ones(n_sensors)
    given = np.asarray(value, dtype=object).tolist()
    if isinstance(given, list):
        given = [_label(each) for each in given]
    places = np.array(given)
    labels = places.dtype.kind == "U"
    if places.dtype.kind not in "iU":
        raise TypeError(
            f"dofs: expected whole numbers, or labels such as '3:uy', got {value!r}"
        )
    checks.shaped("dofs", places.shape, (n_sensors,))
    turned = [
        along_axis(each) if read_combination(each) is None else (each, 1.0)
        for each in places.tolist()
    ]
    places = np.array([place for place, _ in turned])
    if len({*places.tolist()}) < n_sensors or (not labels and places.min() < 0):
        got = f"{places.tolist()}; average sensors at one DOF first"
        raise ValueError(f"dofs: expected distinct DOFs, numbers from 0, got {got}")
    return places, np.array([sign for _, sign in turned])


def read_combination(label: object) -> dict[Hashable, float] | None:
    """Return ``{DOF: factor}`` of a label such as ``"0.87*2:ux + 0.5*2:uy"``.

    None for the label of a single DOF. In ``"2:ux - 1:ux"`` the factors are 1 and -1.
    What is no label, but such a mapping, is returned as a dict.
    """
    if isinstance(label, Mapping):
        return dict(label)
    parts: dict[Hashable, float] = {}
    end, text = 0, str(label).strip()
    while end < len(text):
        if (term := COMBINED.match(text, end)) is None or (end and not term[1]):
            return None
        dof, turned = along_axis(int(term[3]) if term[3].isdecimal() else term[3])
        sign = -turned if term[1] == "-" else turned
        parts[dof] = parts.get(dof, 0.0) + sign * float(term[2] or 1)
        if term.end() == len(text) and end == 0 and term[2] is None:
            return None
        end = term.end()
    return parts or None


def write_combination(parts: Mapping[Hashable, float]) -> str:
    """Return the label of ``{DOF: factor}`` that :func:`read_combination` reads."""
    terms = [f"{float(factor)!r}*{dof}" for dof, factor in parts.items()]
    return " + ".join(terms).replace("+ -", "- ")


def unit_of(label: object) -> int:
    """Return which unit a sensor measures in, by its label: one of SENSOR_UNITS.

    A difference, which rigid motions leave at zero, is a strain or a curvature if its
    factors have a length other than 1 at a node: one over the distance of two nodes.
    """
    parts = read_combination(label) or {label: 1.0}
    moved = {dof: x for dof, x in parts.items() if not is_rotation(dof)}
    unit = TRANSLATION if moved else TURN
    along: dict[str, float] = {}
    at: dict[str, float] = {}
    for dof, factor in (moved or parts).items():
        node, _, direction = str(dof).rpartition(":")
        along[direction] = along.get(direction, 0.0) + factor
        at[node] = at.get(node, 0.0) + factor**2
    rigid = max(map(abs, along.values())) > BLIND * max(at.values()) ** 0.5
    of_length_one = all(abs(square - 1) < UNIT_LENGTH for square in at.values())
    return unit if "" in at or rigid or of_length_one else STRAIN


def is_rotation(dof: object) -> bool:
    """Return whether a DOF is labelled as a rotation; a number never is."""
    return bool(ROTATION.fullmatch(str(dof)))


def _label(dof: object) -> object:
    """Return a DOF, or the label of a combination, however it was written."""
    if (parts := read_combination(dof)) is None:
        return dof
    factors = [checks.real_number("dofs", factor) for factor in parts.values()]
    if not all(factors):
        raise ValueError(f"dofs: expected factors other than 0, got {dof!r}")
    return write_combination(parts)
