"""Universal files: their data sets, and the axes of their nodes."""

import re
import warnings
from collections.abc import Hashable, Iterable, Mapping, Sequence
from os import PathLike
from typing import NamedTuple, TypeAlias

import numpy as np

from .. import checks
from ..contracts import Floats
from .directions import write_combination

Path = str | PathLike[str]
END = "    -1"  # the line before and after a data set
BINARY = "    58b"  # begins one whose values END follows on the same line
# Widths of columns are not relied on: numbers may touch, "1.0E+00-2.0E+00".
UFF_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[ED][-+]?\d+)?", re.I)
UFF_AXES = ("x", "y", "z", "rx", "ry", "rz")
# Data sets of nodes: a label, the systems of its coordinates and of its displacements,
# a colour, and three coordinates, which are in the former system except in the last.
NODE_SETS = ("15", "781", "2411")
IN_GLOBAL_COORDINATES = "2411"
NODE_NUMBERS = 7
# Data sets of coordinate systems, which have so many lines each: by three points in
# another system, or by the matrix of their axes and their origin.
BY_POINTS, LINES_BY_POINTS = "18", 4
BY_MATRIX, LINES_BY_MATRIX = "2420", 6
HEADINGS = {BY_POINTS: 1, BY_MATRIX: 3}  # lines before the first system
CARTESIAN, CYLINDRICAL = 0, 1  # types of systems
GLOBAL_SYSTEMS = (0, 1)  # what these numbers mean unless the file defines them
COSINE_DIGITS = 5  # data sets 18 have six digits
SKEW_AXES = 1e-3  # how far axes may be from orthogonal ones of length one

ALONG = ("own", "global")  # whose axes values are along

Nodes: TypeAlias = Mapping[int, Hashable]  # node of the file -> node of the model


class DataSet(NamedTuple):
    """A data set of text."""

    place: str  # the file and the number of the set, for messages
    kind: str
    lines: list[str]  # the first states the kind


class System(NamedTuple):
    """A coordinate system: its type, its origin and, in rows, its axes."""

    kind: int
    origin: Floats
    axes: Floats

    def locate(self, point: Floats) -> Floats:
        """Return the global coordinates of a point that is given in the system."""
        if self.kind == CYLINDRICAL:
            radius, angle, height = point
            turn = np.deg2rad(angle)
            point = np.array([radius * np.cos(turn), radius * np.sin(turn), height])
        return np.asarray(self.origin + self.axes.T @ point)

    def axes_at(self, point: Floats) -> Floats:
        """Return the axes, in rows, along which a node at a global point moves."""
        if self.kind == CARTESIAN:
            return self.axes
        x, y, _ = self.axes @ (point - self.origin)
        angle = np.arctan2(y, x)
        c, s = np.cos(angle), np.sin(angle)
        radial = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(radial @ self.axes)


def read_sets(path: Path) -> list[DataSet]:
    """Return all data sets of a universal file.

    Raises:
        ValueError: If it ends inside one.
    """
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
    return [
        DataSet(f"{path}, data set {i}", lines[0].split()[0] if lines else "", lines)
        for i, lines in enumerate(sets, 1)
    ]


def read_numbers(place: str, lines: Sequence[str]) -> Floats:
    """Return all numbers of some lines, which hold nothing else."""
    text = "\n".join(lines)
    if others := UFF_NUMBER.sub(" ", text).split():
        raise ValueError(f"{place}: expected numbers, got {others[0]!r}")
    found = [number.upper().replace("D", "E") for number in UFF_NUMBER.findall(text)]
    return np.array(found, dtype=np.float64)


def read_axes(sets: Iterable[DataSet]) -> dict[int, Floats | str]:
    """Return the axes of nodes that have their own, in rows, in global coordinates.

    A text says instead whose axes they are, if these are not known. A file without
    coordinate systems has global axes everywhere.
    """
    systems: dict[int, System] = {}
    for data in sets:
        if data.kind in HEADINGS:
            systems |= _read_systems(data, systems)
    axes: dict[int, Floats | str] = {}
    for data in sets if systems else ():
        if data.kind not in NODE_SETS:
            continue
        numbers = read_numbers(data.place, data.lines[1:])
        if len(numbers) % NODE_NUMBERS:
            raise ValueError(
                f"{data.place}: expected {NODE_NUMBERS} numbers for each node, got "
                f"{len(numbers)} in all"
            )
        for node, own, moved, _, *point in numbers.reshape(-1, NODE_NUMBERS).tolist():
            its = 0 if data.kind == IN_GLOBAL_COORDINATES else int(own)
            found = _axes_of(int(moved), its, np.array(point), systems)
            digits = found if isinstance(found, str) else found.round(COSINE_DIGITS)
            if not np.array_equal(digits, np.eye(3)):
                axes[int(node)] = found
    return axes


def _axes_of(
    moved: int, own: int, point: Floats, systems: Mapping[int, System]
) -> Floats | str:
    """Return the axes of a node by its two systems and its place, or why not."""
    for number in (moved, own):
        if number not in systems and number not in GLOBAL_SYSTEMS:
            return f"coordinate system {number}, which the file does not define"
    if moved not in systems:
        return np.eye(3)
    if systems[moved].kind not in (CARTESIAN, CYLINDRICAL):
        return f"coordinate system {moved}, which is spherical"
    at = systems[own].locate(point) if own in systems else point
    return systems[moved].axes_at(at)


def _read_systems(data: DataSet, known: Mapping[int, System]) -> dict[int, System]:
    """Return the coordinate systems of a data set."""
    body = data.lines[HEADINGS[data.kind] :]
    size = LINES_BY_POINTS if data.kind == BY_POINTS else LINES_BY_MATRIX
    if len(body) % size:
        raise ValueError(
            f"{data.place}: expected {size} lines for each coordinate system, got "
            f"{len(body)} in all"
        )
    found: dict[int, System] = {}
    for i in range(0, len(body), size):
        label, kind, reference, *_ = read_numbers(data.place, [body[i]]).astype(int)
        numbers = read_numbers(data.place, body[i + 2 : i + size])
        if data.kind == BY_MATRIX:
            *axes, origin = numbers.reshape(4, 3)
            matrix = np.array(axes)
        else:
            points = numbers.reshape(3, 3)
            if reference in (systems := {**known, **found}):
                points = np.array([systems[reference].locate(p) for p in points])
            origin, *ahead = points
            x, upward = ahead - origin
            y = np.cross(upward, x)
            rows = [x, y, np.cross(x, y)]
            matrix = np.array([row / np.linalg.norm(row) for row in rows])
        if not np.abs(matrix @ matrix.T - np.eye(3)).max() < SKEW_AXES:
            raise ValueError(
                f"{data.place}: the axes of coordinate system {label} are not "
                f"orthogonal, or not of length one: {matrix.tolist()}"
            )
        found[int(label)] = System(int(kind), origin, matrix)
    return found


def name_dofs(
    path: Path,
    sets: Iterable[DataSet],
    sensors: Iterable[str],
    nodes: Nodes,
    along: str | None,
) -> dict[str, str]:
    """Return the model's DOF, or combination, of each sensor at a node of the model.

    Args:
        path: The file, for messages.
        sets: Its data sets.
        sensors: Their labels in the file, ``"12:x"``, or ``"12"`` without a direction.
        nodes: The nodes of the model.
        along: Which axes the values are along, one of ALONG; None if that is not known.
    """
    checks.mapping("nodes", nodes, "{node of the file: node of the model}")
    axes = {} if along == "global" else read_axes(sets)
    ends = {label: _split(label) for label in sensors}
    turned = [label for label, (node, _) in ends.items() if {node} & {*axes} & {*nodes}]
    if turned and along is None:
        raise ValueError(
            f"axes: the file defines axes of their own for the nodes of {_few(turned)} "
            "(data sets 18 or 2420), and programs differ in whether they write values "
            "along these; say axes='own', or axes='global'"
        )
    there = [*dict.fromkeys(node for node, _ in ends.values())]
    if unknown := [node for node in nodes if node not in there]:
        raise ValueError(
            f"nodes: {path} measures nothing at {unknown}, only at {there}"
        )
    dofs = {}
    for label, (node, way) in ends.items():
        if node not in nodes:
            continue
        own = axes.get(node, np.eye(3))
        if isinstance(own, str) or not way:
            why = own if way else "a direction that the file does not state"
            raise ValueError(
                f"nodes: {label!r} of {path} is along {why}; leave nodes= out, and "
                "name its DOF, or its cosines, such as '0.8*3:ux + 0.6*3:uy'"
            )
        turn = "r" if way.startswith("r") else "u"
        cosines = own["xyz".index(way[-1])].round(COSINE_DIGITS).tolist()
        parts: dict[Hashable, float] = {
            f"{nodes[node]}:{turn}{axis}": cosine
            for axis, cosine in zip("xyz", cosines, strict=True)
            if cosine
        }
        dofs[label] = write_combination(parts)
        if len(parts) == 1:
            ((dof, cosine),) = parts.items()
            dofs[label] = str(dof) if cosine > 0 else str(dof).replace(":", ":-")
    return dofs


def warn_of_own_axes(
    path: Path, sets: Iterable[DataSet], sensors: Iterable[str], along: str | None
) -> None:
    """Warn about sensors at nodes with own axes, unless they are along global ones."""
    axes = {} if along == "global" else read_axes(sets)
    if turned := [label for label in sensors if _split(label)[0] in axes]:
        warnings.warn(
            f"{path}: it defines axes of their own for the nodes of {_few(turned)} "
            "(data sets 18 or 2420); if the values are along these, give axes='own' "
            "and nodes={node of the file: node of the model}, else axes='global'",
            stacklevel=4,
        )


def _few(labels: Iterable[str]) -> str:
    """Return labels for a message."""
    return f"[{checks.listed(map(repr, labels))}]"


def _split(label: str) -> tuple[int, str]:
    """Return the node and the direction of a sensor."""
    node, _, way = label.partition(":")
    return int(node), way
