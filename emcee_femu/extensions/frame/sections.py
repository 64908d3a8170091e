"""Sections of bars, supports, and the plane in which a frame moves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import checks
from ...contracts import Floats

Property: TypeAlias = float | str | tuple[float, str]
Term: TypeAlias = tuple[str, ...]  # the parameters whose product multiplies a matrix
Scale: TypeAlias = tuple[float, Term]  # a number, times a product
Indices: TypeAlias = NDArray[np.intp]
Supports: TypeAlias = Mapping[int, str | Iterable[str]]

DOFS = ("ux", "uy", "uz", "rx", "ry", "rz")
# Properties that may be zero, as those of a bar in a truss: it has no stiffness there.
MAY_BE_ZERO = ("GJ", "I", "Iy", "Iz")
IN_SPACE = ("E", "GJ", "rho", "A", "Iy", "Iz")
IN_PLANE = ("E", "rho", "A", "I")
PLANES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}  # the axes in each


@dataclass(frozen=True)
class Section:
    """Properties of a bar.

    Each is a number, the name of a parameter, or ``(number, name)``: the number times
    the parameter, for a factor on a nominal value.

    In space all of E, GJ, rho, A, Iy and Iz are needed; in a plane frame E, rho, A and
    I.

    Args:
        E: Young's modulus, N/m2.
        GJ: Torsional stiffness, N m2.
        rho: Density, kg/m3.
        A: Area, m2.
        Iy: Second moment of area for bending in the local x-z plane, m4.
        Iz: Second moment of area for bending in the local x-y plane, m4. With GJ, Iy
            and Iz of 0.0 it is a bar of a truss, which stays straight.
        orientation: A vector whose part normal to the bar is local y; local x runs
            along the bar; None for global z.
        Ip: What resists twisting by its inertia, m4; None for Iy + Iz. Give it where Iy
            or Iz are factors of a stiffness, and no mass changes with them.
        I: Second moment of area for bending in the plane of a plane frame, m4.

    Raises:
        TypeError: If a property is of none of these forms.
        ValueError: If a number is not above zero (GJ, I, Iy, Iz may be zero), or
            orientation is not (3,) or zero.

    Examples:
        >>> from emcee_femu import Section
        >>> bar = Section(E="E", GJ=700.0, rho=2700.0, A=3e-4, Iy=2e-9, Iz=(2e-9, "f"))
        >>> sorted(bar.parameters)
        ['E', 'f']
    """

    E: Property
    GJ: Property | None = None
    rho: Property | None = None
    A: Property | None = None
    Iy: Property | None = None
    Iz: Property | None = None
    orientation: tuple[float, float, float] | None = None
    Ip: Property | None = None
    I: Property | None = None  # noqa: E741

    def __post_init__(self) -> None:
        """Check the properties."""
        for name, value in self.properties.items():
            read_property(name, value, zero=name in MAY_BE_ZERO)
        needed = IN_PLANE if self.I is not None else IN_SPACE
        there = {*self.properties} - {"Ip"}
        if missing := [name for name in needed if name not in there]:
            raise TypeError(
                f"{missing[0]}: expected a number, name or (number, name), got None; a "
                f"section has {', '.join(IN_SPACE)}, and of a plane frame "
                f"{', '.join(IN_PLANE)}"
            )
        if self.I is not None and (extra := [*there - {*IN_PLANE}]):
            raise TypeError(
                f"{extra[0]}: a section of a plane frame has {', '.join(IN_PLANE)} "
                "alone; leave it out, or leave I out"
            )
        if not checks.shaped_array("orientation", self.upright, (3,)).any():
            raise ValueError("orientation: expected a vector that is not zero")

    @property
    def upright(self) -> tuple[float, float, float]:
        """The orientation, or global z."""
        return (0.0, 0.0, 1.0) if self.orientation is None else self.orientation

    @property
    def properties(self) -> dict[str, Property]:
        """All that are given but the orientation, by name."""
        given = {k: value for k, value in vars(self).items() if value is not None}
        given.pop("orientation", None)
        return given

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of parameters among the properties."""
        return tuple(name for _, names in self.read().values() for name in names)

    def read(self) -> dict[str, Scale]:
        """Return the number of each property that is not 0, and its parameter."""
        read = {k: read_property(k, v, True) for k, v in self.properties.items()}
        return {name: scale for name, scale in read.items() if scale[0]}


@dataclass(frozen=True)
class Place:
    """Where a frame lies: in space, or in a plane of two axes.

    Attributes:
        plane: Its name, or "" for space.
    """

    plane: str = ""

    @property
    def axes(self) -> list[int]:
        """The axes of coordinates."""
        return list(PLANES[self.plane]) if self.plane else [0, 1, 2]

    @property
    def turns(self) -> list[int]:
        """The axes about which something turns."""
        return [3 - sum(self.axes)] if self.plane else [0, 1, 2]

    @property
    def dofs(self) -> tuple[str, ...]:
        """The DOFs of a node."""
        return tuple(DOFS[i] for i in (*self.axes, *(3 + axis for axis in self.turns)))

    def nodes(self, value: ArrayLike) -> Floats:
        """Return the nodes in space, ``(n_nodes, 3)``.

        Raises:
            ValueError: If they have another number of coordinates, or are too few.
        """
        points = checks.real_array("nodes", value, 2)
        count = len(self.axes)
        if points.shape[1] != count or len(points) < 2:
            cure = ""
            if points.shape[1] == 2:
                cure = (
                    "; a frame of two coordinates is FrameModel(..., plane='xy') (or "
                    "'xz', 'yz'), with Section(E=.., rho=.., A=.., I=..)"
                )
            raise ValueError(
                f"nodes: expected (n_nodes >= 2, {count}), got {points.shape}{cure}"
            )
        return self.lift(points)

    def lift(self, values: ArrayLike) -> Floats:
        """Return vectors in the plane as those in space."""
        given = np.asarray(values)
        lifted = np.zeros((*given.shape[:-1], 3))
        lifted[..., self.axes] = given
        return lifted

    def vector(self, label: str, value: ArrayLike | None) -> Floats:
        """Return a vector in space, zero for None."""
        count = len(self.axes)
        given = np.zeros(count) if value is None else value
        return self.lift(checks.shaped_array(label, given, (count,)))

    def section(self, label: str, section: Section) -> tuple[dict[str, Scale], Floats]:
        """Return the properties of a section in space, and its orientation.

        Raises:
            TypeError: If it is one for space in a plane, or the reverse.
        """
        read = section.read()
        if bool(self.plane) != (section.I is not None):
            needed = ", ".join(IN_PLANE if self.plane else IN_SPACE)
            where = f"plane={self.plane!r}" if self.plane else "a frame in space"
            raise TypeError(f"{label}: expected a Section of {needed} for {where}")
        if not self.plane:
            return read, np.array(section.upright, dtype=float)
        if "I" in read:  # the local y axis is normal to the plane
            read["Iy"] = read.pop("I")
        return read, np.eye(3)[self.turns[0]]

    def find_free(self, n_nodes: int, supports: Supports | None) -> Indices:
        """Return the numbers of the DOFs that no support holds, six per node."""
        words = {"all": DOFS, "fixed": DOFS, "pinned": DOFS[:3]}
        if self.plane:  # gravity acts along the second axis
            words["roller"] = (DOFS[self.axes[1]],)
        supports = {} if supports is None else supports
        checks.mapping("supports", supports, "{node: held DOFs}, as {0: 'fixed'}")
        free = np.zeros((n_nodes, 6), dtype=bool)
        free[:, [DOFS.index(dof) for dof in self.dofs]] = True
        for node, held in supports.items():
            check_nodes("supports", [node], n_nodes)
            names = words.get(held, (held,)) if isinstance(held, str) else held
            for dof in checks.sequence(f"supports[{node}]", names, "DOFs"):
                if dof not in self.dofs and names not in words.values():
                    plane = "" if self.plane else "; 'roller' needs plane="
                    raise ValueError(
                        f"supports[{node}]: expected one of {[*words]}, or a list of "
                        f"DOFs out of {self.dofs}, got {dof!r}"
                        f"{plane * (dof == 'roller')}"
                    )
                free[node, DOFS.index(dof)] = False
        if not free.any():
            raise ValueError("supports: every DOF is held")
        return np.flatnonzero(free)

    def refuse_ambiguous(self, sections: Mapping[str, Section], free: Indices) -> None:
        """Refuse a frame in space that is held in a plane, with a section of two sides.

        Which of Iy and Iz bends in the plane follows from the orientation; textbooks
        call it Iz in the x-y plane, where global z makes it Iy.
        """
        moving = {DOFS[i % 6] for i in free.tolist()}
        for plane in PLANES if not self.plane else ():
            if not moving <= {*Place(plane).dofs}:
                continue
            normal = tuple(int(axis in Place(plane).turns) for axis in range(3))
            for name, section in sections.items():
                if section.orientation is None and section.Iy != section.Iz:
                    raise ValueError(
                        f"sections[{name!r}]: the supports leave motion in the {plane} "
                        "plane alone; which of Iy and Iz bends there? Give FrameModel("
                        f"..., plane={plane!r}) with Section(E, rho=.., A=.., I=..), "
                        f"or Section(..., orientation={normal}), with which Iy does"
                    )


def read_property(label: str, value: Property, zero: bool = False) -> Scale:
    """Return the number of a property, and the parameter that multiplies it, if any.

    A number alone may be 0 with ``zero``.
    """
    number: ArrayLike = value
    names: tuple[str, ...] = ()
    if isinstance(value, str):
        number, names = 1.0, (value,)
    elif isinstance(value, tuple):
        form = "a number, name or (number, name)"
        number, name = checks.group(label, value, form, 2)
        names = (name,)
        if isinstance(number, str):
            raise TypeError(f"{label}: expected {form}, got {value!r}")
    elif zero and np.ndim(value) == 0 and value == 0:
        return 0.0, ()
    names = tuple(checks.text(label, name) for name in names)
    return checks.positive_array(label, number, 0).item(), names


def check_nodes(label: str, nodes: Iterable[int], n_nodes: int) -> None:
    """Refuse numbers of nodes that do not exist."""
    for node in nodes:
        if checks.whole_number(label, node) >= n_nodes:
            raise ValueError(f"{label}: no node {node}; nodes are 0 to {n_nodes - 1}")
