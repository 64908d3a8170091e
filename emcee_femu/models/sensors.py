"""What sensors measure of a model: displacements at DOFs, and combinations of them."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..contracts import Floats, Model, Variable, read_declared
from ..measurements import Measurements
from ..measurements.directions import (
    along_axis,
    read_combination,
    unit_of,
    write_combination,
)

Sensor: TypeAlias = Hashable | Mapping[Hashable, float]  # a DOF, or {DOF: factor}
Dofs: TypeAlias = (
    Sequence[Hashable] | Mapping[Hashable, Hashable | Sensor] | NDArray[np.intp]
)
SIMILAR = 0.6  # of two labels, by difflib, above which one is proposed for the other
MOST_LISTED = 8  # labels that a message names
FORM = "{'tip': {'2:ux': 0.87, '2:uy': 0.5}}"
EXAMPLE = (0.87, 0.5)  # cosines of 30 and 60 degrees


@dataclass(frozen=True)
class Sensors:
    """Sensors, each of which measures a DOF or a combination of some.

    Attributes:
        labels: Their names.
        rows: The places among a model's DOFs that they read, each once.
        factors: What each sensor measures of these, ``(n_sensors, n_rows)``; None where
            each measures its own row.
    """

    labels: tuple[Hashable, ...]
    rows: tuple[int, ...]
    factors: Floats | None = None

    def of(self, shapes: Floats) -> Floats:
        """Return what they measure of ``(..., N, m)``, ``(..., n_sensors, m)``."""
        read = shapes[..., list(self.rows), :]
        return read if self.factors is None else np.asarray(self.factors @ read)

    def combination(self, number: int) -> dict[int, float]:
        """Return ``{row: factor}`` of one sensor."""
        if self.factors is None:
            return {self.rows[number]: 1.0}
        pairs = zip(self.rows, self.factors[number].tolist(), strict=True)
        return {row: factor for row, factor in pairs if factor}


def choose_sensors(
    argument: str, chosen: bool | Dofs, dofs: Sequence[Hashable]
) -> Sensors:
    """Return the requested sensors of a model.

    Args:
        argument: Its name, for messages.
        chosen: False for none, True for one at each DOF, a sequence of DOFs in any
            order, or ``{label: sensor}``, where a sensor is a DOF or a combination,
            ``{DOF: factor}`` or ``"0.87*2:ux + 0.5*2:uy"``. In a sequence, a DOF
            against its axis, ``"2:-ux"``, is that along it, as measurements are turned.
        dofs: All DOFs of the model, by number or by label.

    Raises:
        TypeError: If chosen is of another type, or a factor is no number.
        ValueError: If a DOF does not exist or is repeated, a factor is zero or not
            finite, or there are none.
    """
    if isinstance(chosen, bool | np.bool_):
        return Sensors(tuple(dofs), tuple(range(len(dofs)))) if chosen else NONE
    if isinstance(chosen, Mapping):
        labels, wanted = list(chosen), list(chosen.values())
        arguments = [f"{argument}[{label!r}]" for label in labels]
    elif not isinstance(chosen, str) and np.ndim(np.asarray(chosen, dtype=object)) == 1:
        wanted = [*chosen]
        labels = [
            write_combination(x) if isinstance(x, Mapping) else along_axis(x)[0]
            for x in wanted
        ]
        arguments = [argument] * len(wanted)
    else:
        raise TypeError(
            f"{argument}: expected True, False, DOFs or {FORM}, got {chosen!r}"
        )
    combined = [_parts_of(argument, each, dofs) for each in wanted]
    for of, parts in zip(arguments, combined, strict=True):
        if not parts:
            raise ValueError(f"{of}: expected {{DOF: factor}}, got none")
        for dof, factor in parts.items():
            if isinstance(dofs, range):
                checks.whole_number(of, dof)
            if dof not in dofs:
                raise ValueError(f"{of}: no DOF {dof!r}{propose(dof, dofs)}")
            if not checks.real_number(of, factor):
                raise ValueError(f"{of}: expected factors other than 0, got {parts}")
    rows = [dofs.index(dof) for parts in combined for dof in parts]
    factors = [float(factor) for parts in combined for factor in parts.values()]
    if all(len(parts) == 1 for parts in combined) and {*factors} == {1.0}:
        if len({*rows}) < len(rows):
            raise ValueError(f"{argument}: expected DOFs, each once, got {wanted}")
        return Sensors(tuple(labels), tuple(rows))
    if not wanted:
        raise ValueError(f"{argument}: expected DOFs, each once, got {wanted}")
    places = tuple(dict.fromkeys(rows))
    matrix = np.zeros((len(labels), len(places)))
    which = np.repeat(np.arange(len(labels)), [len(parts) for parts in combined])
    matrix[which, [places.index(row) for row in rows]] = factors
    return Sensors(tuple(labels), places, matrix)


NONE = Sensors((), ())


def _parts_of(
    argument: str, sensor: Hashable | Sensor, dofs: Sequence[Hashable]
) -> Mapping[Hashable, float]:
    """Return ``{DOF: factor}`` of a sensor, along the axes of the DOFs."""
    if isinstance(sensor, Mapping):
        turned = {dof: along_axis(dof) for dof in sensor}
        parts = {
            axis: sensor[dof]
            if sign > 0
            else -checks.real_number(argument, sensor[dof])
            for dof, (axis, sign) in turned.items()
        }
        if len(parts) < len(sensor):
            raise ValueError(f"{argument}: expected each DOF once, got {sensor}")
        return parts
    read = None if sensor in dofs else read_combination(sensor)
    return dict([along_axis(sensor)]) if read is None else read


def match_sensors(
    wanted: Sequence[Hashable], labels: Sequence[Hashable]
) -> tuple[Sensors, list[Hashable]]:
    """Return what sensors measure of rows with labels, and DOFs that have no row."""
    places = {label: row for row, label in enumerate(labels)}

    def read(sensor: Hashable) -> Mapping[Hashable, float]:
        if sensor in places:
            return {sensor: 1.0}
        number = int(str(sensor)) if str(sensor).isdecimal() else sensor
        return read_combination(sensor) or {number: 1.0}

    parts = [read(sensor) for sensor in wanted]
    rows = [*dict.fromkeys(dof for each in parts for dof in each)]
    if missing := [dof for dof in rows if dof not in places]:
        return NONE, missing
    chosen = tuple(places[dof] for dof in rows)
    if all(len(each) == 1 and {*each.values()} == {1.0} for each in parts):
        return Sensors(tuple(wanted), chosen), []
    factors = np.array([[each.get(dof, 0.0) for dof in rows] for each in parts])
    return Sensors(tuple(wanted), chosen, factors), []


def propose(dof: object, dofs: Sequence[Hashable]) -> str:
    """Return the end of a message on a DOF that a model has not: what it may mean."""
    if isinstance(dofs, range):
        return f"; they are {dofs[0]} to {dofs[-1]}"
    labels = {str(known).lower(): known for known in dofs}
    near = get_close_matches(str(dof).lower(), labels, 1, SIMILAR)
    node, _, direction = str(dof).partition(":")
    nodes = list(dict.fromkeys(str(known).partition(":")[0] for known in dofs))
    if direction and node not in nodes:
        return f"; nodes with free DOFs are {_range_of(nodes)}"
    there = [str(known) for known in dofs if str(known).partition(":")[0] == node]
    if not direction and there:
        return f"; DOFs have labels, such as {there[0]!r}"
    longer = any(str(dof).startswith(f"{known}") for known in there)  # as 9:uzz
    if near and (longer or near[0] == str(dof).lower()) or not there:
        guess = f"; did you mean {labels[near[0]]!r}?" if near else "."
        return f"{guess} Nodes with DOFs are {_range_of(nodes)}"
    return (
        f"; node {node} has {' '.join(there)}; in place of {dof!r}, give a sensor in "
        "another direction as a combination of these, such as "
        f"{dict(zip(there, EXAMPLE, strict=False))}"
    )


def _range_of(nodes: Sequence[str]) -> str:
    """Return names in a few words."""
    return ", ".join(nodes) if len(nodes) <= 3 else f"{nodes[0]} to {nodes[-1]}"


def match_rows(
    variables: Mapping[str, Variable] | None,
    measurements: Measurements,
    dofs: Sequence[Hashable] | None,
) -> Sensors | None:
    """Return what the sensors measure of the model's rows; None if unknown."""
    if variables is None:
        return None
    if "shapes" not in variables:
        raise ValueError(
            "model: it returns no mode shapes, which pairing needs; ask for them "
            "(shapes=True)"
        )
    labels = variables["shapes"].coords.get("dof")
    if labels is None or measurements.dofs is None:
        if labels is not None:  # refuses another number of rows
            at_sensors(np.empty((len(labels), 0)), None, measurements.n_sensors)
        return None
    found, missing = match_sensors(measurements.dofs.tolist(), labels)
    if missing:
        known = [dof for dof in missing if dof in (dofs or ())]
        if known or not dofs:
            more = len(labels) - MOST_LISTED
            there = f"{[*labels[:MOST_LISTED]]}{f' and {more} more' * (more > 0)}"
            cure = f", only at {there}; name the sensors so, or ask it for those"
            if isinstance(dofs, range):
                cure += f" (numbers count its {len(dofs)} DOFs from 0)"
        else:
            cure = propose(missing[0], dofs)
        raise ValueError(
            f"dofs: the measurements have sensors at {missing}, but the model has no "
            f"shapes there{cure}"
        )
    return found


def refuse_mixed_units(model: Model, test: Measurements) -> None:
    """Refuse a sensor whose name does not tell that it measures in another unit."""
    sensors = read_declared(model, "sensors")
    if not isinstance(sensors, Sensors) or sensors.factors is None:
        return
    dofs, meant = read_declared(model, "dofs") or (), dict[Hashable, str]()
    for number, label in enumerate(sensors.labels):
        parts = sensors.combination(number)
        meant[label] = write_combination({dofs[row]: x for row, x in parts.items()})
    names = [] if test.dofs is None else test.dofs.tolist()
    units = {name: unit_of(meant.get(name, name)) for name in names}
    hidden = [name for name in names if units[name] != unit_of(name)]
    if hidden and len({*units.values()}) > 1:
        one = hidden[0]
        raise ValueError(
            f"dofs: sensor {one!r} measures {meant[one]}, in another unit than others, "
            "and a MAC over both would depend on the unit of length; write "
            f"Measurements(dofs=[.., {meant[one]!r}, ..]), and let the model return "
            "shapes=True, to leave it out of the MAC as rotations are"
        )


def at_sensors(shapes: Floats, dofs: NDArray[np.intp] | None, n_sensors: int) -> Floats:
    """Return the rows of a model's shapes at the sensors, in the sensors' order.

    Args:
        shapes: ``(..., n_rows, n_modes)``, at all DOFs of the model or at the sensors.
        dofs: The sensors' rows among all DOFs; None if rows and sensors correspond.
        n_sensors: The number of sensors.

    Raises:
        ValueError: If the rows are ambiguous: there are too few, or dofs reorders as
            many rows as there are sensors.
    """
    n_rows = shapes.shape[-2]
    numbers = None if dofs is None or dofs.dtype.kind == "U" else dofs
    if dofs is not None and any(map(read_combination, dofs.tolist())):
        sensors, missing = match_sensors(dofs.tolist(), range(n_rows))
        if not missing:
            return sensors.of(shapes)
    if n_rows == n_sensors:
        order = [] if numbers is None else numbers.tolist()
        if sorted(order) == [*range(n_rows)] != order:
            raise ValueError(
                f"dofs: {n_rows} sensors at all {n_rows} rows of the model's shapes, "
                f"in another order ({order}): are the rows DOFs, or sensors already? "
                "List the sensors in the order of the DOFs"
            )
        return shapes
    if numbers is None or numbers.max() >= n_rows:
        labels = "None" if dofs is None else str(dofs.tolist())
        remedy = "; give Measurements(dofs=[...])" if dofs is None else ""
        raise ValueError(
            f"dofs: expected the rows of {n_sensors} sensors among the {n_rows} of the "
            f"model's shapes, got {labels}{remedy}"
        )
    return shapes[..., numbers, :]
