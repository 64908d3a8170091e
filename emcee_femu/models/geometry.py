"""The positions of a structure's nodes and sensors, for drawings."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats
from ..measurements.directions import read_combination

UNIT_AXES = {"ux": (1.0, 0.0, 0.0), "uy": (0.0, 1.0, 0.0), "uz": (0.0, 0.0, 1.0)}
Node: TypeAlias = Hashable
Sensor: TypeAlias = tuple[Node, str | Sequence[float]]


class Geometry:
    """Nodes, the lines between them, and the position and direction of each DOF.

    :func:`plot_shapes` and :func:`report` use it to draw mode shapes. If a model has no
    ``geometry``, set one before you pair its modes: ``model.geometry = Geometry(...)``.

    Args:
        nodes: ``{node: coordinates}``, two (x and y) or three each, in one unit of
            length.
        lines: ``(node, node)`` each: the lines of the drawing.
        sensors: ``{DOF: (node, direction)}``, where a DOF is named as in the model and
            in :class:`Measurements`, and a direction is one of ux uy uz or a vector.
            DOFs named ``"node:ux"`` may be left out; None stands for one that moves no
            node, such as a strain gauge.
        supports: Nodes that do not move. Not needed if the model returns shapes at all
            its DOFs (``shapes=True``): all other nodes are then supports.

    Attributes:
        nodes: ``{node: coordinates (3,)}``; a missing third coordinate is 0.
        lines: As given.
        supports: As given.

    Raises:
        TypeError: If an argument is not of the form described.
        ValueError: If a line, sensor or support has an unknown node or direction.

    Examples:
        >>> from emcee_femu.models.geometry import Geometry
        >>> column = Geometry({0: (0, 0), 1: (0, 3)}, [(0, 1)], {"roof": (1, "ux")})
        >>> node, direction = column.locate("roof")
        >>> node, direction.tolist()
        (1, [1.0, 0.0, 0.0])
    """

    def __init__(
        self,
        nodes: Mapping[Node, ArrayLike],
        lines: Iterable[tuple[Node, Node]] = (),
        sensors: Mapping[Hashable, Sensor | None] | None = None,
        supports: Iterable[Node] = (),
    ) -> None:
        if not checks.mapping("nodes", nodes, "{node: coordinates}"):
            raise TypeError("nodes: expected {node: coordinates}, got none")
        self.nodes: dict[Node, Floats] = {}
        for node, given in nodes.items():
            place = checks.shaped_array(f"nodes[{node!r}]", given, (2,), (3,))
            self.nodes[node] = np.append(place, np.zeros(3 - place.size))
        self._by_text = {str(node): node for node in self.nodes}
        self.lines: list[tuple[Node, ...]] = []
        for i, line in enumerate(checks.sequence("lines", lines, "(node, node)")):
            self.lines.append(checks.group(f"lines[{i}]", line, "(node, node)", 2))
            self._check_nodes(f"lines[{i}]", line)
        self.supports = checks.sequence("supports", supports, "nodes")
        self._check_nodes("supports", self.supports)
        self.sensors: dict[Hashable, tuple[Node, Floats]] = {}
        self.undrawn: set[Hashable] = set()
        form = "{DOF: (node, direction)}"
        by_dof = checks.mapping("sensors", {} if sensors is None else sensors, form)
        for dof, sensor in by_dof.items():
            label = f"sensors[{dof!r}]"
            if sensor is None:
                self.undrawn.add(dof)
                continue
            node, along = checks.group(label, sensor, "(node, direction)", 2)
            self._check_nodes(label, [node])
            axis = UNIT_AXES.get(along) if isinstance(along, str) else along
            if axis is None:
                raise ValueError(
                    f"{label}: expected a direction out of {' '.join(UNIT_AXES)} "
                    f"or a vector, got {along!r}"
                )
            vector = checks.shaped_array(label, axis, (3,))
            if not vector.any():
                raise ValueError(f"{label}: expected a vector that is not zero")
            self.sensors[dof] = node, vector / np.linalg.norm(vector)

    def locate(self, dof: Hashable) -> tuple[Node, Floats] | None:
        """Return the node and the direction ``(3,)`` of a DOF; None if unknown.

        Rotations, such as ``"3:rz"``, are unknown because they move no node, and so are
        combinations of DOFs of several nodes.
        """
        if dof in self.sensors:
            return self.sensors[dof]
        nodes, along = set[str](), np.zeros(3)
        for part, factor in (read_combination(dof) or {dof: 1.0}).items():
            node, _, direction = str(part).rpartition(":")
            if node not in self._by_text or direction not in UNIT_AXES:
                return None
            nodes.add(node)
            along += factor * np.array(UNIT_AXES[direction])
        # Not of unit length: what is measured is its product with the motion.
        return (self._by_text[nodes.pop()], along) if len(nodes) == 1 else None

    def _check_nodes(self, label: str, nodes: Iterable[Node]) -> None:
        for node in nodes:
            if node not in self.nodes:
                some = ", ".join(map(repr, [*self.nodes][:6]))
                raise ValueError(f"{label}: no node {node!r}; there are {some} ...")
