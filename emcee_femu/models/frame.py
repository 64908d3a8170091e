"""3-D Euler-Bernoulli frames: sections, elements, assembly and supports.

DOFs of an element: (ux, uy, uz, rx, ry, rz) of its first node, then of its second, in
local axes: x along the bar, y along the part of the orientation vector normal to it.
Its matrices are sums of products ``properties x matrix``; see Przemieniecki, Theory of
Matrix Structural Analysis (1968), sections 5.6 and 11.5 (without shear deformation and
rotary inertia of bending).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_array

from .. import checks
from ..contracts import (
    Derivatives,
    Floats,
    ModalSolution,
    Parameters,
    modal_variables,
    show_declared,
)
from .eigen_dense import Eigenproblem
from .eigen_sparse import SparseEigenproblem
from .geometry import Geometry
from .inputs import (
    Dofs,
    Weights,
    check_positive,
    choose_dofs,
    columns,
    describe,
    read_batch,
)

DOFS = ("ux", "uy", "uz", "rx", "ry", "rz")
AXIAL, TORSION = [0, 6], [3, 9]
BENDING_Y = [1, 5, 7, 11]  # displacement uy, rotation rz = +d uy / dx; resisted by Iz
BENDING_Z = [2, 4, 8, 10]  # displacement uz, rotation ry = -d uz / dx; resisted by Iy
ROTATION_SIGNS = np.outer([1.0, -1.0, 1.0, -1.0], [1.0, -1.0, 1.0, -1.0])

MOST_DENSE = 200  # DOFs, above which a sparse solve is the faster one

Element = tuple[int, int, str]
Term: TypeAlias = tuple[float | str, ...]  # properties whose product varies


@dataclass(frozen=True)
class Section:
    """Section and material of a bar; each property is a number or a parameter name.

    Args:
        E: Young's modulus, N/m2.
        GJ: Torsional stiffness, N m2.
        rho: Density, kg/m3.
        A: Area, m2.
        Iy: Second moment of area for displacements along local z, m4.
        Iz: Second moment of area for displacements along local y, m4.
        orientation: A vector whose component normal to the bar is local y; local x
            runs along the bar. The default is global z.

    Raises:
        TypeError: If a property is neither a real number nor a name.
        ValueError: If a number is not positive, or orientation is not ``(3,)`` or is
            zero.

    Examples:
        >>> from emcee_femu import Section
        >>> bar = Section(E="E", GJ=700.0, rho=2700.0, A=3e-4, Iy=2e-9, Iz="Iz")
        >>> sorted(bar.parameters)
        ['E', 'Iz']
    """

    E: float | str
    GJ: float | str
    rho: float | str
    A: float | str
    Iy: float | str
    Iz: float | str
    orientation: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Check the properties."""
        for name, value in self.properties.items():
            if not isinstance(value, str):
                checks.positive_array(name, value, 0)
            elif not value:
                raise ValueError(f"{name}: expected a parameter name, got ''")
        vector = checks.real_array("orientation", self.orientation, 1)
        if vector.shape != (3,) or not vector.any():
            raise ValueError(f"orientation: expected (3,), not all zero, got {vector}")

    @property
    def properties(self) -> dict[str, float | str]:
        """All but the orientation, by name."""
        return {k: value for k, value in vars(self).items() if k != "orientation"}

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of parameters among the properties."""
        return tuple(v for v in self.properties.values() if isinstance(v, str))


class FrameModel:
    r"""A 3-D frame of straight Euler-Bernoulli elements with consistent mass.

    .. math:: K = \sum_e T_e^T (EA\,k_{EA} + GJ\,k_{GJ} + EI_z k_{EI_z}
        + EI_y k_{EI_y}) T_e, \qquad
        M = \sum_e T_e^T (\rho A\,m_{\rho A} + \rho (I_y + I_z)\,m_{\rho I}) T_e

    Use it for beams and small frames that need no FE program. Each section contributes
    at most four stiffness and two mass matrices, which are assembled once; a batch of
    parameter sets is then a matrix product. Above 200 free DOFs, parameter sets are
    solved one at a time with sparse matrices. For a plane frame in x and y, let the
    supports hold uz, rx and ry at every node.

    Args:
        nodes: Coordinates in m, ``(n_nodes, 3)``.
        elements: ``(node, node, section name)`` each; nodes count from 0.
        sections: ``{name: Section}``.
        supports: ``{node: held DOFs}`` out of ux uy uz rx ry rz; ``"all"`` holds six.
        n_modes: Number of elastic modes to return, starting with the lowest. Give
            either n_modes or modes.
        modes: The elastic modes to return, 1 = the lowest, ascending.
        skip: Number of rigid-body modes, checked at each solve (6 for free-free).
        shapes: Whether to return mass-normalised mode shapes too; or the DOFs at which
            to return them, in the given order. A DOF is named by node and direction,
            such as ``"3:uy"``; ``model.dofs`` lists the free ones.

    Raises:
        TypeError: If not exactly one of n_modes and modes is given.
        ValueError: If nodes, elements, sections or supports do not fit together. When
            called: if a property is not positive, or the number of rigid-body modes is
            not skip.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import FrameModel, Section
        >>> bar = Section(E=7e10, GJ=700, rho=2700, A=3e-4, Iy=2e-9, Iz="Iz")
        >>> points = [(x, 0, 0) for x in np.linspace(0, 1, 9)]
        >>> beam = FrameModel(points, [(i, i + 1, "bar") for i in range(8)],
        ...                   {"bar": bar}, {0: "all"}, n_modes=2)
        >>> beam({"Iz": np.array([1e-8, 2e-8])}).frequencies.round(2).tolist()
        [[7.36, 16.45], [7.36, 23.26]]
    """

    def __init__(
        self,
        nodes: ArrayLike,
        elements: Sequence[Element],
        sections: Mapping[str, Section],
        supports: Mapping[int, str | Iterable[str]] | None = None,
        *,
        n_modes: int | None = None,
        modes: Sequence[int] | None = None,
        skip: int = 0,
        shapes: bool | Dofs = False,
    ) -> None:
        points = checks.real_array("nodes", nodes, 2)
        if points.shape[1] != 3 or len(points) < 2:
            raise ValueError(f"nodes: expected (n_nodes >= 2, 3), got {points.shape}")
        free = _find_free_dofs(len(points), supports)
        _check_elements(len(points), elements, sections)
        lines = [(first, second) for first, second, _ in elements]
        self.geometry = Geometry(dict(enumerate(points)), lines)
        skip = checks.whole_number("skip", skip)
        self.modes = _choose_modes(n_modes, modes, skip, len(free))
        self.n_modes, self.sections = len(self.modes), dict(sections)
        self.dofs = tuple(f"{i // 6}:{DOFS[i % 6]}" for i in free.tolist())
        chosen = choose_dofs("shapes", shapes, self.dofs)
        self.shape_dofs = tuple(self.dofs[place] for place in chosen.values())
        self.variables = modal_variables(self.n_modes, tuple(chosen))
        named = [name for section in sections.values() for name in section.parameters]
        self.names = tuple(dict.fromkeys(named))
        self.bounds = dict.fromkeys(self.names, (0.0, np.inf))
        K, M = _assemble(points, elements, sections, free)
        self._terms = [*K][1:], [*M][1:]
        places = list(chosen.values())
        self._problem: Eigenproblem | SparseEigenproblem
        if len(free) > MOST_DENSE and self.modes[-1] == self.n_modes:
            Ks, Ms = ([*map(csc_array, A.values())] for A in (K, M))
            self._problem = SparseEigenproblem(Ks, Ms, self.n_modes, skip, places)
        else:
            self._problem = Eigenproblem(
                np.array([*K.values()]),
                np.array([*M.values()]),
                np.array(self.modes) + skip - 1,
                skip,
                np.eye(len(free))[places],
            )

    __repr__ = show_declared

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``."""
        return self._problem.solve(*self._read(parameters)[1])

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives by all parameters, from one solve.

        They are exact even if one parameter multiplies another, such as E and A, or
        occurs in several sections, because the matrices are affine in the products.

        Raises:
            ValueError: As for a call, or if two modes coincide that separate as a
                parameter changes; see :meth:`MatrixModel.jacobian`.
        """
        values, (k, m, where) = self._read(parameters)

        def derive(terms: Sequence[Term], name: str) -> Floats:
            """Return how products of properties change with one, ``(n, n_terms)``."""
            slopes = np.zeros((len(k), len(terms)))
            for number, term in enumerate(terms):
                for i, factor in enumerate(term):
                    if factor == name:
                        others = term[:i] + term[i + 1 :]
                        slopes[:, number] += _multiply(others, values)
            return slopes

        in_K, in_M = self._terms
        slopes = {name: (derive(in_K, name), derive(in_M, name)) for name in self.names}
        return self._problem.jacobian(k, m, slopes, where)

    def _read(self, parameters: Parameters) -> tuple[Parameters, Weights]:
        """Return the values; coefficients of K and M, and what names a set."""
        values, n = read_batch(parameters, self.names)
        check_positive(columns(values, self.names, n), self.names, "section property")
        k, m = (
            np.array([_multiply(term, values) for term in terms]).reshape(-1, n).T
            for terms in self._terms
        )
        return values, (k, m, partial(describe, values, self.names))


def _multiply(term: Term, values: Parameters) -> Floats | float:
    """Return a product of properties, ``(n,)`` or a number."""
    factors = (values[factor] if isinstance(factor, str) else factor for factor in term)
    return math.prod(factors, start=1.0)


def _assemble(
    points: Floats,
    elements: Sequence[Element],
    sections: Mapping[str, Section],
    free: NDArray[np.intp],
) -> list[dict[Term, Floats]]:
    """Return the matrices of K and of M by what multiplies them, ``()`` for nothing."""
    size = 6 * len(points)
    totals: list[dict[Term, Floats]] = [{(): np.zeros((size, size))} for _ in "KM"]
    for e, (first, second, name) in enumerate(elements):
        section = sections[name]
        start, end = points[[first, second]]
        length, axes = local_axes(start, end, section.orientation, f"elements[{e}]")
        T = np.kron(np.eye(4), axes)
        dofs = np.r_[6 * first : 6 * first + 6, 6 * second : 6 * second + 6]
        where = np.ix_(dofs, dofs)
        parts = stiffness_matrices(length), mass_matrices(length)
        for total, matrices in zip(totals, parts, strict=True):
            for product, matrix in matrices.items():
                term: Term = tuple(section.properties[key] for key in product)
                factor: Floats | float = 1.0
                if not {*section.parameters} & {*term}:
                    term, factor = (), _multiply(term, {})
                if term not in total:
                    total[term] = np.zeros((size, size))
                total[term][where] += factor * (T.T @ matrix @ T)
    keep = np.ix_(free, free)
    return [{term: A[keep] for term, A in total.items()} for total in totals]


def stiffness_matrices(length: float) -> dict[tuple[str, ...], Floats]:
    """Return ``(12, 12)`` matrices in local axes by the properties they multiply."""
    L = length
    rod = np.array([[1.0, -1.0], [-1.0, 1.0]]) / L
    bending = np.array(
        [
            [12.0, 6 * L, -12.0, 6 * L],
            [6 * L, 4 * L**2, -6 * L, 2 * L**2],
            [-12.0, -6 * L, 12.0, -6 * L],
            [6 * L, 2 * L**2, -6 * L, 4 * L**2],
        ]
    )
    bending /= L**3
    return {
        ("E", "A"): _place(AXIAL, rod),
        ("GJ",): _place(TORSION, rod),
        ("E", "Iz"): _place(BENDING_Y, bending),
        ("E", "Iy"): _place(BENDING_Z, bending * ROTATION_SIGNS),
    }


def mass_matrices(length: float) -> dict[tuple[str, ...], Floats]:
    """Return consistent ``(12, 12)`` matrices by the properties that they multiply.

    rho Iy and rho Iz resist torsion, by their sum.
    """
    L = length
    rod = np.array([[2.0, 1.0], [1.0, 2.0]]) * L / 6
    bending = np.array(
        [
            [156.0, 22 * L, 54.0, -13 * L],
            [22 * L, 4 * L**2, 13 * L, -3 * L**2],
            [54.0, 13 * L, 156.0, -22 * L],
            [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
        ]
    )
    bending *= L / 420
    along = _place(AXIAL, rod) + _place(BENDING_Y, bending)
    along += _place(BENDING_Z, bending * ROTATION_SIGNS)
    twist = _place(TORSION, rod)
    return {("rho", "A"): along, ("rho", "Iy"): twist, ("rho", "Iz"): twist}


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


def _find_free_dofs(
    n_nodes: int, supports: Mapping[int, str | Iterable[str]] | None
) -> NDArray[np.intp]:
    """Return the numbers of the DOFs that no support holds, six per node."""
    supports = {} if supports is None else supports
    checks.mapping("supports", supports, "{node: held DOFs}")
    free = np.ones((n_nodes, 6), dtype=bool)
    for node, held in supports.items():
        _check_node("supports", node, n_nodes)
        names = DOFS if held == "all" else (held,) if isinstance(held, str) else held
        if not isinstance(names, Iterable):
            raise TypeError(f"supports[{node}]: expected names of DOFs, got {held!r}")
        for dof in names:
            if dof not in DOFS:
                raise ValueError(
                    f"supports[{node}]: expected DOFs out of {DOFS} or 'all', "
                    f"got {dof!r}"
                )
            free[node, DOFS.index(dof)] = False
    if not free.any():
        raise ValueError("supports: every DOF is held")
    return np.flatnonzero(free)


def _check_node(label: str, node: int, n_nodes: int) -> None:
    if checks.whole_number(label, node) >= n_nodes:
        raise ValueError(f"{label}: no node {node}; nodes are 0 to {n_nodes - 1}")


def _check_elements(
    n_nodes: int, elements: Sequence[Element], sections: Mapping[str, Section]
) -> None:
    """Check that nodes, elements and sections fit together."""
    checks.mapping("sections", sections, "{name: Section}")
    checks.parameter_names("sections", list(sections))
    for name, section in sections.items():
        checks.instance(f"sections[{name!r}]", section, Section)
    if not isinstance(elements, Sequence) or isinstance(elements, str) or not elements:
        raise TypeError(
            "elements: expected at least one (node, node, section name), got "
            f"{elements!r}"
        )
    for e, element in enumerate(elements):
        form = "(node, node, section name)"
        *nodes, section_name = checks.group(f"elements[{e}]", element, form, 3)
        for node in nodes:
            _check_node(f"elements[{e}]", node, n_nodes)
        if section_name not in sections:
            raise ValueError(
                f"elements[{e}]: no section {section_name!r}; sections are "
                f"{sorted(sections)}"
            )
    alone = {*range(n_nodes)} - {node for *nodes, _ in elements for node in nodes}
    unused = {*sections} - {name for *_, name in elements}
    for label, missed in (("nodes", alone), ("sections", unused)):
        if missed:
            raise ValueError(f"{label}: no element uses {sorted(missed)}")


def _choose_modes(
    n_modes: int | None, modes: Sequence[int] | None, skip: int, n_free: int
) -> tuple[int, ...]:
    """Return the numbers of the wanted modes, 1 = the lowest elastic one."""
    if (n_modes is None) == (modes is None):
        raise TypeError("n_modes, modes: expected exactly one of the two")
    if modes is None:
        modes = range(1, checks.whole_number("n_modes", n_modes, 1) + 1)
    elif np.ndim(modes) != 1:
        raise TypeError(f"modes: expected a sequence of mode numbers, got {modes!r}")
    wanted = tuple(checks.whole_number("modes", mode, 1) for mode in modes)
    if not wanted or list(wanted) != sorted(set(wanted)):
        raise ValueError(f"modes: expected ascending mode numbers from 1, got {wanted}")
    if skip + wanted[-1] > n_free:
        raise ValueError(
            f"n_modes, modes: mode {wanted[-1]} after {skip} rigid-body modes (skip), "
            f"but there are only {n_free} free DOFs"
        )
    return wanted
