"""3-D Euler-Bernoulli frames: sections, bars, point masses, springs and supports.

DOFs of an element: (ux, uy, uz, rx, ry, rz) of its first node, then of its second, in
local axes: x along the bar, y along the part of the orientation vector normal to it.
Its matrices are sums of products ``properties x matrix``; see Przemieniecki, Theory of
Matrix Structural Analysis (1968), sections 5.6 and 11.5 (without shear deformation and
rotary inertia of bending).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array, csc_array

from ... import checks
from ...contracts import Floats
from ...models.coefficients import Product, Unit
from ...models.geometry import Geometry
from ...models.matrix import AffineModel
from ...models.sensors import Dofs
from .sections import (
    DOFS,
    PLANES,
    Indices,
    Place,
    Property,
    Scale,
    Section,
    Supports,
    Term,
    check_nodes,
    read_property,
)

AXIAL, TORSION = [0, 6], [3, 9]
ACROSS_Y, ACROSS_Z = [1, 7], [2, 8]
BENDING_Y = [1, 5, 7, 11]  # displacement uy, rotation rz = +d uy / dx; resisted by Iz
BENDING_Z = [2, 4, 8, 10]  # displacement uz, rotation ry = -d uz / dx; resisted by Iy
ROTATION_SIGNS = np.outer([1.0, -1.0, 1.0, -1.0], [1.0, -1.0, 1.0, -1.0])

# Of an element of unit length: of two displacements; of displacement and rotation at
# either end, cubic in between.
UNIT_STRAINED = np.array([[1.0, -1.0], [-1.0, 1.0]])
UNIT_MOVED = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
UNIT_BENT = np.array(
    [[12.0, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
)
UNIT_SWUNG = np.array(
    [[156.0, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
)
UNIT_SWUNG /= 420

MOST_DENSE = 200  # DOFs, above which a sparse solve is the faster one

Offset: TypeAlias = Sequence[float] | None
Element: TypeAlias = tuple[int, int, str] | tuple[int, int, str, tuple[Offset, Offset]]
# About the axes; about the normal alone in a plane.
Inertia: TypeAlias = Property | Sequence[Property] | None
Mass: TypeAlias = (
    tuple[int, Property]
    | tuple[int, Property, Offset]
    | tuple[int, Property, Offset, Inertia]
)
Spring: TypeAlias = tuple[int, int | None, Mapping[str, Property]]
# What is added to the matrix of each term: rows, columns and entries, (3, m) each.
Pieces: TypeAlias = dict[Term, list[Floats]]


class FrameModel(AffineModel):
    r"""A frame of straight Euler-Bernoulli elements in space, with consistent mass.

    .. math:: K = \sum_e T_e^T (EA\,k_{EA} + GJ\,k_{GJ} + EI_z k_{EI_z}
        + EI_y k_{EI_y}) T_e, \qquad
        M = \sum_e T_e^T (\rho A\,m_{\rho A} + \rho (I_y + I_z)\,m_{\rho I}) T_e

    and of point masses and springs. A property is a number, the name of a parameter, or
    ``(number, name)``, the number times the parameter.

    K and M are **affine in products of parameters**: each parameter, and each product
    that occurs, as E I where both are parameters, multiplies a matrix that is assembled
    once, ``model.K["E"]`` or ``model.K["E * I"]``. So the model is a
    :class:`MatrixModel` in all else: a batch is solved at once, :func:`reduce_model`
    takes it, its derivatives are exact. With more than 200 free DOFs, or some without
    mass, each set is solved by itself, with sparse matrices.

    **A plane frame** is ``plane="xy"`` (or ``"xz"``, ``"yz"``): nodes of two
    coordinates, sections of E, rho, A and one second moment of area I, offsets of two
    components, one moment of inertia of a point mass. DOFs out of the plane do not
    exist.

    Args:
        nodes: Coordinates in m, ``(n_nodes, 3)``, or ``(n_nodes, 2)`` in a plane.
        elements: ``(node, node, section name)`` each; nodes count from 0. With a fourth
            entry, ``(offset, offset)``, the ends of the bar are held by rigid arms:
            vectors in m from either node to its end, in global axes, or None.
        sections: ``{name: Section}``.
        supports: ``{node: held DOFs}`` out of ux uy uz rx ry rz; ``"fixed"``, or
            ``"all"``, holds all, ``"pinned"`` all translations, and in a plane
            ``"roller"`` the one along its second axis.
        masses: ``(node, mass)``, ``(node, mass, offset)`` or ``(node, mass, offset,
            inertia)`` each: kg; m from the node to the centre of mass, on a rigid arm;
            and the moments of inertia about axes through it that are parallel to the
            global ones, kg m2, each a number or a property. Masses must be positive.
        springs: ``(node, node, {direction: stiffness})`` each, directions out of ux uy
            uz rx ry rz in global axes, N/m or N m; None for the second node is the
            ground. The spring acts at the first node; a rigid arm connects it to the
            second.
        n_modes: How many elastic modes to return, the lowest; or give
        modes: Which elastic modes to return, 1 = the lowest, ascending.
        skip: Number of rigid-body modes, checked at each solve (6 for free-free).
        shapes: Whether to return mass-normalised mode shapes too; or the DOFs at which
            to return them, in the given order. A DOF is named by node and direction,
            such as ``"3:uy"``; ``model.dofs`` lists the free ones. Sensors by name are
            ``{"roof": "3:uy"}``, and of several DOFs ``{"skew": {"3:ux": 0.6, "3:uy":
            0.8}}``: a strain gauge, or a difference of two points, is one of these.
        plane: The plane of a plane frame: "xy", "xz" or "yz"; None for a frame in
            space.

    Raises:
        TypeError: If not exactly one of n_modes and modes is given, or an argument is
            not of the form described.
        ValueError: If nodes, elements, sections, masses, springs or supports do not fit
            together; or a frame in space is held in a plane, and which of Iy and Iz
            bends there was not said by an orientation. When called: if a parameter is
            not above zero, or the number of rigid-body modes is not skip.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import FrameModel, Section
        >>> bar = Section(E=7e10, GJ=700, rho=2700, A=3e-4, Iy=2e-9, Iz=(1e-8, "bend"))
        >>> points = [(x, 0, 0) for x in np.linspace(0, 1, 9)]
        >>> bars = [(i, i + 1, "bar") for i in range(8)]
        >>> tip = [(8, (0.1, "tip"), (0.05, 0, 0))]  # kg, 50 mm beyond the end
        >>> beam = FrameModel(points, bars, {"bar": bar}, {0: "all"}, masses=tip,
        ...                   n_modes=2)
        >>> beam.names, [*beam.K]
        (('bend', 'tip'), ['bend'])
        >>> at = {"bend": np.array([1.0, 2.0]), "tip": np.array([1.0, 1.0])}
        >>> beam(at).frequencies.round(2).tolist()
        [[5.87, 13.12], [5.87, 18.55]]
    """

    def __init__(
        self,
        nodes: ArrayLike,
        elements: Sequence[Element],
        sections: Mapping[str, Section],
        supports: Supports | None = None,
        *,
        masses: Sequence[Mass] = (),
        springs: Sequence[Spring] = (),
        n_modes: int | None = None,
        modes: Sequence[int] | None = None,
        skip: int = 0,
        shapes: bool | Dofs = False,
        plane: str | None = None,
    ) -> None:
        place = Place("" if plane is None else checks.one_of("plane", plane, PLANES))
        points = place.nodes(nodes)
        free = place.find_free(len(points), supports)
        wanted = _choose_modes(n_modes, modes)
        K: Pieces = {(): [np.empty((3, 0))]}
        M: Pieces = {(): [np.empty((3, 0))]}
        bars = checks.sequence("elements", elements, "(node, node, section name)")
        _add_bars(K, M, points, bars, sections, place)
        place.refuse_ambiguous(sections, free)
        _add_masses(M, len(points), masses, place)
        _add_springs(K, points, springs, place, free)
        rows = [piece[0] for part in (K, M) for each in part.values() for piece in each]
        joined = {*(np.concatenate(rows) // 6).tolist()}
        if alone := sorted({*range(len(points))} - joined):
            raise ValueError(f"nodes: nothing is fixed to {alone}")
        free = free[_touched(K, M, 6 * len(points))[free]]
        in_K, in_M = (
            {term: _add_up(each, free, 6 * len(points)) for term, each in part.items()}
            for part in (K, M)
        )
        massive = sum(A.diagonal() for A in in_M.values()) > 0
        if len(free) <= MOST_DENSE and np.all(massive):
            in_K, in_M = (
                {term: A.toarray() for term, A in part.items()} for part in (in_K, in_M)
            )
        dofs = tuple(f"{i // 6}:{DOFS[i % 6]}" for i in free.tolist())
        constant, units = (in_K.pop(()), in_M.pop(())), (_label(in_K), _label(in_M))
        super().__init__(*constant, *units, wanted, skip, shapes, dofs, "property")
        self.sections = dict(sections)
        self.bounds = dict.fromkeys(self.names, (0.0, np.inf))
        lines = [(first, second) for first, second, *_ in bars]
        self.geometry = Geometry(dict(enumerate(points)), lines)
        self._place_sensors(self.geometry)

    def _place_sensors(self, geometry: Geometry) -> None:
        """Add sensors that combine DOFs of one node, and name those that do not."""
        if self.sensors.factors is None:
            return
        for i, label in enumerate(self.sensors.labels):
            parts, along = self.sensors.combination(i), np.zeros(3)
            nodes, axes = zip(
                *(str(self.dofs[row]).split(":") for row in parts), strict=True
            )
            if len({*nodes}) == 1 and {*axes} <= {*DOFS[:3]}:
                along[[DOFS.index(axis) for axis in axes]] = [*parts.values()]
                # Not of unit length: what it measures is its product with the motion.
                geometry.sensors[label] = int(nodes[0]), along
            else:
                geometry.undrawn.add(label)


def _add(
    pieces: Pieces, scales: Iterable[Scale], dofs: Indices, T: Floats, matrix: Floats
) -> None:
    """Add ``scales x T^T matrix T`` to what the product of parameters scales."""
    number, term = 1.0, list[str]()
    for factor, names in scales:
        number *= factor
        term += names
    entries = number * (T.T @ matrix @ T).ravel()
    piece = np.array([np.repeat(dofs, len(dofs)), np.tile(dofs, len(dofs)), entries])
    pieces.setdefault(tuple(sorted(term)), []).append(piece)


def _add_up(pieces: list[Floats], free: Indices, size: int) -> csc_array:
    """Return the sum over the free DOFs."""
    *places, entries = np.hstack(pieces)
    at = np.array(places, dtype=np.intp)
    total = csc_array(coo_array((entries, at), shape=(size, size)))
    return csc_array(total[free][:, free])


def _touched(K: Pieces, M: Pieces, size: int) -> NDArray[np.bool_]:
    """Return which DOFs have an entry: rotations in trusses have none."""
    touched = np.zeros(size, dtype=bool)
    for pieces in (*K.values(), *M.values()):
        rows, _, entries = np.hstack(pieces)
        touched[rows[entries != 0].astype(np.intp)] = True
    return touched


def _label(matrices: Mapping[Term, csc_array | Floats]) -> dict[str, Unit]:
    """Return them as :class:`MatrixModel` takes them."""
    return {
        " * ".join(term): matrix if len(term) == 1 else (matrix, Product(term))
        for term, matrix in matrices.items()
    }


def _add_bars(
    K: Pieces,
    M: Pieces,
    points: Floats,
    elements: Sequence[Element],
    sections: Mapping[str, Section],
    place: Place,
) -> None:
    """Add the bars, checked."""
    for name, section in checks.by_label("sections", sections, "a Section").items():
        checks.instance(f"sections[{name!r}]", section, Section)
    form = "(node, node, section name) or (node, node, section name, (offset, offset))"
    if not elements:
        raise TypeError(f"elements: expected at least one {form}, got none")
    plain: dict[tuple[object, ...], int] = {}  # without offsets, and which they are
    for e, element in enumerate(elements):
        label = f"elements[{e}]"
        entry = checks.group(label, element, form, 3, 4)
        *ends, name, offsets = (*entry, (None, None))[:4]
        check_nodes(label, ends, len(points))
        if name not in sections:
            raise ValueError(
                f"{label}: no section {name!r}; sections are {sorted(sections)}"
            )
        pair = checks.group(label, offsets, "(offset, offset)", 2)
        if pair[0] is None and pair[1] is None:
            same = plain.setdefault((*sorted(ends), name), e)
            if same != e:
                raise ValueError(
                    f"{label}: it is elements[{same}] again, which would count twice; "
                    "leave it out, or give bars side by side a section of their own"
                )
        arms = [place.vector(label, offset) for offset in pair]
        section, T = sections[name], np.zeros((12, 12))
        read, upright = place.section(f"sections[{name!r}]", section)
        start, end = points[ends] + arms
        length, axes = local_axes(start, end, upright, label)
        T[:6, :6], T[6:, 6:] = map(rigid_arm, arms)
        T = np.kron(np.eye(4), axes) @ T
        polar = ["Iy", "Iz"] if section.Ip is None else ["Ip"]
        parts = element_matrices(length, polar, read)
        for part, matrices in zip((K, M), parts, strict=True):
            for product, matrix in matrices.items():
                if {*product} <= {*read}:
                    _add(part, [read[key] for key in product], _dofs(*ends), T, matrix)
    if unused := sorted({*sections} - {name for _, _, name, *_ in elements}):
        raise ValueError(f"sections: no element uses {unused}")


def _add_masses(M: Pieces, n_nodes: int, masses: Sequence[Mass], place: Place) -> None:
    """Add the point masses, checked."""
    form = "(node, mass), (node, mass, offset) or (node, mass, offset, inertia)"
    units = np.eye(6)
    for i, given in enumerate(checks.sequence("masses", masses, form)):
        label = f"masses[{i}]"
        entry = checks.group(label, given, form, 2, 3, 4)
        node, mass, offset, inertia = (*entry, None, None)[:4]
        check_nodes(label, [node], n_nodes)
        T = rigid_arm(place.vector(label, offset))
        moved = np.diag(units[:3].sum(axis=0))
        _add(M, [read_property(label, mass)], _dofs(node), T, moved)
        moments = (0.0, 0.0, 0.0) if inertia is None else inertia
        if place.plane:  # one moment, about the normal to it
            moments = [0.0 if inertia is None else inertia]
        form_of, count = "(Ix, Iy, Iz)", len(place.turns)
        three = checks.group(label, moments, form_of, count)
        for axis, moment in zip(place.turns, three, strict=True):
            scale = read_property(label, moment, zero=True)
            if scale[0]:
                turned = np.diag(units[3 + axis])
                _add(M, [scale], _dofs(node), T, turned)


def _add_springs(
    K: Pieces, points: Floats, springs: Sequence[Spring], place: Place, free: Indices
) -> None:
    """Add the springs, checked; ``free`` are the DOFs that no support holds."""
    form = "(node, node or None, {direction: stiffness})"
    for s, given in enumerate(checks.sequence("springs", springs, form)):
        label = f"springs[{s}]"
        first, second, by_direction = checks.group(label, given, form, 3)
        ends = [first] if second is None else [first, second]
        check_nodes(label, ends, len(points))
        if first == second:
            raise ValueError(f"{label}: both ends are node {first}")
        apart = [rigid_arm(points[first] - points[node]) for node in ends]
        T = np.hstack([apart[0], *(-arm for arm in apart[1:])])
        for direction, stiffness in _read_spring(label, by_direction, place).items():
            number, dofs = DOFS.index(direction), _dofs(*ends)
            if not np.isin(dofs[T[number] != 0], free).any():
                raise ValueError(
                    f"{label}: it does nothing, since supports hold {direction} at its "
                    f"ends {ends}; hold less there, such as 'pinned' in place of "
                    "'fixed', or leave it out"
                )
            axis = np.diag(np.eye(6)[number])
            _add(K, [read_property(label, stiffness)], dofs, T, axis)


def _read_spring(
    label: str, value: Mapping[str, Property], place: Place
) -> dict[str, Property]:
    given = dict(checks.mapping(label, value, "{direction: stiffness}"))
    if unknown := [name for name in given if name not in place.dofs]:
        raise ValueError(
            f"{label}: expected directions out of {place.dofs}, got {unknown}"
        )
    return given


def _dofs(*nodes: int) -> Indices:
    """Return the numbers of the DOFs of nodes, six each."""
    return np.concatenate([np.arange(6 * node, 6 * node + 6) for node in nodes])


def rigid_arm(offset: Floats) -> Floats:
    """Return the transformation of a node's DOFs to an offset from it, ``(6, 6)``."""
    T = np.eye(6)
    T[:3, 3:] = np.cross(np.eye(3), offset).T  # rotation x offset
    return T


def element_matrices(
    length: float, polar: Sequence[str], stiff: Collection[str] = ("Iy", "Iz")
) -> tuple[dict[Term, Floats], dict[Term, Floats]]:
    """Return stiffness and consistent mass in local axes, ``(12, 12)`` matrices.

    Each by the properties whose product it multiplies. rho times the sum of the
    properties ``polar`` resists twisting. Where Iy or Iz is not among the ``stiff``
    properties, the bar stays straight.
    """
    arms = np.array([1.0, length, 1.0, length])  # rotations are by length
    bent, swung = (np.outer(arms, arms) * unit for unit in (UNIT_BENT, UNIT_SWUNG))
    bent, swung = bent / length**3, swung * length
    strained, moved = UNIT_STRAINED / length, UNIT_MOVED * length
    along = _place(AXIAL, moved)
    bends_y, bends_z = "Iz" in stiff, "Iy" in stiff
    along += _place(BENDING_Y, swung) if bends_y else _place(ACROSS_Y, moved)
    turned = swung * ROTATION_SIGNS
    along += _place(BENDING_Z, turned) if bends_z else _place(ACROSS_Z, moved)
    twist = _place(TORSION, moved)
    stiffness: dict[Term, Floats] = {
        ("E", "A"): _place(AXIAL, strained),
        ("GJ",): _place(TORSION, strained),
        ("E", "Iz"): _place(BENDING_Y, bent),
        ("E", "Iy"): _place(BENDING_Z, bent * ROTATION_SIGNS),
    }
    mass: dict[Term, Floats] = {("rho", "A"): along}
    return stiffness, mass | {("rho", name): twist for name in polar}


def _place(dofs: list[int], block: Floats) -> Floats:
    matrix = np.zeros((12, 12))
    matrix[np.ix_(dofs, dofs)] = block
    return matrix


def local_axes(
    start: Floats, end: Floats, orientation: ArrayLike, label: str = "element"
) -> tuple[float, Floats]:
    """Return the length and the rotation ``(3, 3)`` whose rows are the local axes.

    Raises:
        ValueError: If the nodes coincide, or orientation is parallel to the bar.
    """
    upright = np.asarray(orientation, dtype=float)
    length = float(np.linalg.norm(end - start))
    if length == 0:
        raise ValueError(f"{label}: both nodes lie at {start.tolist()}")
    x = (end - start) / length
    y = upright - (upright @ x) * x
    norm = float(np.linalg.norm(y))
    if norm < 1e-6 * float(np.linalg.norm(upright)):
        raise ValueError(
            f"{label}: the orientation {upright.tolist()} is parallel to the bar, "
            f"whose direction is {x.tolist()}; give a vector that is not"
        )
    y /= norm
    return length, np.array([x, y, np.cross(x, y)])


def _choose_modes(n_modes: int | None, modes: Sequence[int] | None) -> tuple[int, ...]:
    """Return the numbers of the wanted modes, 1 = the lowest elastic one."""
    if (n_modes is None) == (modes is None):
        raise TypeError("n_modes, modes: expected exactly one of the two")
    if modes is None:
        modes = range(1, checks.whole_number("n_modes", n_modes, 1) + 1)
    numbers = checks.sequence("modes", modes, "mode numbers")
    wanted = tuple(checks.whole_number("modes", number, 1) for number in numbers)
    if not wanted or list(wanted) != sorted(set(wanted)):
        raise ValueError(f"modes: expected ascending mode numbers from 1, got {wanted}")
    return wanted
