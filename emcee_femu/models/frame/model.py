"""3-D Euler-Bernoulli frames: assembly, supports and named parameters."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import checks
from ...interfaces import Floats, ModalSolution, Parameters
from ..eigen.dense import Eigenproblem
from .beam_element import local_axes, mass_matrices, stiffness_matrices
from .section import MASS_KINDS, STIFFNESS_KINDS, Section

DOFS = ("ux", "uy", "uz", "rx", "ry", "rz")
Terms: TypeAlias = tuple[tuple[str, str], ...]  # (section name, kind of coefficient)


@dataclass(frozen=True, eq=False, init=False)
class FrameModel:
    r"""A frame of straight Euler-Bernoulli elements in space, with consistent mass.

    .. math:: K = \sum_e T_e^T (EA\,k_{EA} + GJ\,k_{GJ} + EI_z k_{EI_z}
        + EI_y k_{EI_y}) T_e, \qquad
        M = \sum_e T_e^T (\rho A\,m_{\rho A} + \rho (I_y + I_z)\,m_{\rho I}) T_e

    Each section contributes at most four stiffness and two mass matrices, assembled
    once; a batch of parameter sets is then a matrix product. A plane frame is one
    whose supports hold uz, rx and ry of every node.

    Args:
        nodes: Coordinates in m, ``(n_nodes, 3)``.
        elements: ``(node, node, section name)`` each; nodes count from 0.
        sections: ``{name: Section}``.
        supports: ``{node: held DOFs}`` out of ux uy uz rx ry rz; ``"all"`` holds six.
        n_modes: How many elastic modes to return, the lowest; or give
        modes: Which elastic modes to return, 1 = the lowest, ascending.
        skip: Number of rigid-body modes, checked at each solve (6 for free-free).
        shapes: Whether to return mass-normalised shapes over :attr:`dofs` too.

    Raises:
        TypeError: If not exactly one of n_modes and modes is given.
        ValueError: If nodes, elements, sections or supports do not fit together.
            When called: if a property is not above zero, or the count of rigid-body
            modes is not skip.

    Example:
        >>> bar = Section(E=7e10, GJ=700, rho=2700, A=3e-4, Iy=2e-9, Iz="Iz")
        >>> points = [(x, 0, 0) for x in np.linspace(0, 1, 9)]
        >>> beam = FrameModel(points, [(i, i + 1, "bar") for i in range(8)],
        ...                   {"bar": bar}, {0: "all"}, n_modes=2)
        >>> beam({"Iz": np.array([1e-8, 2e-8])}).frequencies.round(2).tolist()
        [[7.36, 16.45], [7.36, 23.26]]
    """

    sections: Mapping[str, Section]
    dofs: tuple[str, ...]
    modes: tuple[int, ...]
    skip: int
    _stiffness: Terms = field(repr=False)
    _mass: Terms = field(repr=False)
    _problem: Eigenproblem = field(repr=False)

    def __init__(
        self,
        nodes: ArrayLike,
        elements: Sequence[tuple[int, int, str]],
        sections: Mapping[str, Section],
        supports: Mapping[int, str | Iterable[str]] | None = None,
        *,
        n_modes: int | None = None,
        modes: Sequence[int] | None = None,
        skip: int = 0,
        shapes: bool = False,
    ) -> None:
        """See the class."""
        points = checks.real_array("nodes", nodes, 2)
        if points.shape[1] != 3 or len(points) < 2:
            raise ValueError(
                f"nodes: expected two or more, (n_nodes, 3), got {points.shape}"
            )
        free = _free_dofs(len(points), {} if supports is None else supports)
        K, M = _assemble(points, elements, sections)
        skip = checks.whole_number("skip", skip)
        wanted = _wanted_modes(n_modes, modes, skip, len(free))
        K0, stiffness, unit_K = _split(K, sections, free)
        M0, mass, unit_M = _split(M, sections, free)
        problem = Eigenproblem(
            K0=K0,
            K=unit_K,
            M0=M0,
            M=unit_M,
            selected=tuple(skip + mode - 1 for mode in wanted),
            skip=skip,
            shapes=checks.flag("shapes", shapes),
        )
        dofs = tuple(f"{i // 6}:{DOFS[i % 6]}" for i in free.tolist())
        object.__setattr__(self, "sections", dict(sections))
        object.__setattr__(self, "dofs", dofs)
        object.__setattr__(self, "modes", wanted)
        object.__setattr__(self, "skip", skip)
        object.__setattr__(self, "_stiffness", stiffness)
        object.__setattr__(self, "_mass", mass)
        object.__setattr__(self, "_problem", problem)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the sections name."""
        return tuple(
            dict.fromkeys(p for s in self.sections.values() for p in s.parameters)
        )

    @property
    def positive(self) -> tuple[str, ...]:
        """The parameters that must stay above zero: all."""
        return self.names

    @property
    def required(self) -> tuple[str, ...]:
        """The parameters without which there is no model: all."""
        return self.names

    @property
    def n_modes(self) -> int:
        """Number of returned modes."""
        return len(self.modes)

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``."""
        parameters, n = checks.batch(parameters)
        for name in self.names:
            if name not in parameters:
                raise ValueError(f"parameters: no value for {name!r}")
            if n and not parameters[name].min() > 0:
                raise ValueError(
                    f"parameters: the section property {name!r} must be above zero, "
                    f"got {parameters[name].min():g}; give its prior a lower bound"
                )

        def coefficients(terms: Terms) -> Floats:
            with np.errstate(over="ignore"):  # has no eigenvalues, which is an error
                columns = [
                    self.sections[s].coefficient(k, parameters) for s, k in terms
                ]
            return np.array(columns).reshape(len(terms), n).T

        def describe(row: int) -> str:
            return str({name: float(parameters[name][row]) for name in self.names})

        return self._problem.solve(
            coefficients(self._stiffness), coefficients(self._mass), describe
        )


def _free_dofs(
    n_nodes: int, supports: Mapping[int, str | Iterable[str]]
) -> NDArray[np.intp]:
    if not isinstance(supports, Mapping):
        raise TypeError(
            f"supports: expected {{node: held DOFs}}, got {type(supports).__name__}"
        )
    free = np.ones((n_nodes, 6), dtype=bool)
    for node, held in supports.items():
        if checks.whole_number("supports", node) >= n_nodes:
            raise ValueError(f"supports: no node {node}; nodes are 0 to {n_nodes - 1}")
        if isinstance(held, str):
            held = DOFS if held == "all" else [held]
        try:
            names = list(held)
        except TypeError:
            message = f"supports[{node}]: expected names of DOFs, got {held!r}"
            raise TypeError(message) from None
        for dof in names:
            if not isinstance(dof, str) or dof not in DOFS:
                raise ValueError(
                    f"supports[{node}]: expected DOFs out of {DOFS} or 'all', "
                    f"got {dof!r}"
                )
            free[node, DOFS.index(dof)] = False
    if not free.any():
        raise ValueError("supports: every DOF is held")
    return np.flatnonzero(free)


def _wanted_modes(
    n_modes: Any, modes: Sequence[int] | None, skip: int, n_free: int
) -> tuple[int, ...]:
    if (n_modes is None) == (modes is None):
        raise TypeError("n_modes, modes: expected exactly one of the two")
    if modes is None:
        highest = checks.whole_number("n_modes", n_modes, 1)
        _check_highest("n_modes", highest, skip, n_free)
        return tuple(range(1, highest + 1))
    if not isinstance(modes, Sequence):
        raise TypeError(f"modes: expected a sequence of mode numbers, got {modes!r}")
    wanted = tuple(checks.whole_number("modes", mode, 1) for mode in modes)
    if not wanted or any(a >= b for a, b in zip(wanted, wanted[1:], strict=False)):
        raise ValueError(
            f"modes: expected ascending mode numbers from 1, got {tuple(modes)}"
        )
    _check_highest("modes", wanted[-1], skip, n_free)
    return wanted


def _check_highest(argument: str, mode: int, skip: int, n_free: int) -> None:
    if skip + mode > n_free:
        raise ValueError(
            f"{argument}: mode {mode} after {skip} rigid-body modes (skip), but there "
            f"are only {n_free} free DOFs"
        )


def _assemble(
    points: Floats,
    elements: Sequence[tuple[int, int, str]],
    sections: Mapping[str, Section],
) -> tuple[dict[tuple[str, str], Floats], dict[tuple[str, str], Floats]]:
    """Return unit matrices over all DOFs by (section name, kind)."""
    size = 6 * len(points)

    def zeros(kinds: Iterable[str]) -> dict[tuple[str, str], Floats]:
        return {(s, k): np.zeros((size, size)) for s in sections for k in kinds}

    if not isinstance(sections, Mapping):
        raise TypeError(
            f"sections: expected {{name: Section}}, got {type(sections).__name__}"
        )
    if not isinstance(elements, Sequence) or isinstance(elements, str | bytes):
        raise TypeError(
            "elements: expected a sequence of (node, node, section name), got "
            f"{type(elements).__name__}"
        )
    checks.parameter_names("sections", list(sections))
    for name, section in sections.items():
        if not isinstance(section, Section):
            raise TypeError(f"sections[{name!r}]: expected a Section, got {section!r}")
    K, M = zeros(STIFFNESS_KINDS), zeros(MASS_KINDS)
    if not len(elements):
        raise ValueError("elements: expected at least one element, got none")
    used: set[int] = set()
    named: set[str] = set()
    for e, element in enumerate(elements):
        try:
            first, second, name = element
        except (TypeError, ValueError):
            raise TypeError(
                f"elements[{e}]: expected (node, node, section name), got {element!r}"
            ) from None
        for node in (first, second):
            if checks.whole_number(f"elements[{e}]", node) >= len(points):
                raise ValueError(
                    f"elements[{e}]: no node {node}; nodes are 0 to {len(points) - 1}"
                )
        used |= {first, second}
        if not isinstance(name, str) or name not in sections:
            raise ValueError(
                f"elements[{e}]: no section {name!r}; sections are {sorted(sections)}"
            )
        named.add(name)
        try:
            length, axes = local_axes(
                points[first], points[second], np.array(sections[name].orientation)
            )
        except ValueError as error:
            raise ValueError(f"elements[{e}]: {error}") from None
        T = np.kron(np.eye(4), axes)
        dofs = np.r_[6 * first : 6 * first + 6, 6 * second : 6 * second + 6]
        where = np.ix_(dofs, dofs)
        for kind, matrix in stiffness_matrices(length).items():
            K[name, kind][where] += T.T @ matrix @ T
        for kind, matrix in mass_matrices(length).items():
            M[name, kind][where] += T.T @ matrix @ T
    alone = sorted(set(range(len(points))) - used)
    if alone:
        raise ValueError(f"nodes: no element uses nodes {alone}")
    unused = sorted(set(sections) - named)
    if unused:
        raise ValueError(f"sections: no element uses {unused}")
    return K, M


def _split(
    matrices: Mapping[tuple[str, str], Floats],
    sections: Mapping[str, Section],
    free: NDArray[np.intp],
) -> tuple[Floats, Terms, Floats]:
    """Return the constant part, the varying terms and their unit matrices."""
    constant = np.zeros((len(free), len(free)))
    varying = {}
    for (name, kind), matrix in matrices.items():
        part = matrix[np.ix_(free, free)]
        if sections[name].varies(kind):
            varying[name, kind] = part
        else:
            constant += sections[name].coefficient(kind, {}) * part
    units = np.array([*varying.values()]).reshape(-1, len(free), len(free))
    return constant, tuple(varying), units
