"""Assembly of a frame: unit matrices of its sections, and the DOFs left free."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...interfaces import Floats
from ..parameters import check_mapping
from .beam_element import local_axes, mass_matrices, stiffness_matrices
from .section import MASS_KINDS, STIFFNESS_KINDS, Section

DOFS = ("ux", "uy", "uz", "rx", "ry", "rz")
Element = tuple[int, int, str]
Terms: TypeAlias = tuple[tuple[str, str], ...]  # (section name, kind of coefficient)
Matrices: TypeAlias = dict[tuple[str, str], Floats]


def free_dofs(
    n_nodes: int, supports: Mapping[int, str | Iterable[str]] | None
) -> NDArray[np.intp]:
    """Return the numbers of the DOFs that no support holds, six per node."""
    supports = {} if supports is None else supports
    check_mapping("supports", supports, "{node: held DOFs}")
    free = np.ones((n_nodes, 6), dtype=bool)
    for node, held in supports.items():
        if checks.whole_number("supports", node) >= n_nodes:
            raise ValueError(f"supports: no node {node}; nodes are 0 to {n_nodes - 1}")
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


def check_elements(
    n_nodes: int, elements: Sequence[Element], sections: Mapping[str, Section]
) -> None:
    """Check that nodes, elements and sections fit together."""
    check_mapping("sections", sections, "{name: Section}")
    checks.parameter_names("sections", list(sections))
    for name, section in sections.items():
        if not isinstance(section, Section):
            raise TypeError(f"sections[{name!r}]: expected a Section, got {section!r}")
    if not isinstance(elements, Sequence) or isinstance(elements, str) or not elements:
        raise TypeError(
            "elements: expected at least one (node, node, section name), got "
            f"{elements!r}"
        )
    for e, element in enumerate(elements):
        if not isinstance(element, Sequence) or len(element) != 3:
            raise TypeError(
                f"elements[{e}]: expected (node, node, section name), got {element!r}"
            )
        *nodes, name = element
        for node in nodes:
            if checks.whole_number(f"elements[{e}]", node) >= n_nodes:
                raise ValueError(
                    f"elements[{e}]: no node {node}; nodes are 0 to {n_nodes - 1}"
                )
        if name not in sections:
            raise ValueError(
                f"elements[{e}]: no section {name!r}; sections are {sorted(sections)}"
            )
    alone = set(range(n_nodes)) - {node for *nodes, _ in elements for node in nodes}
    if alone:
        raise ValueError(f"nodes: no element uses nodes {sorted(alone)}")
    unused = set(sections) - {name for *_, name in elements}
    if unused:
        raise ValueError(f"sections: no element uses {sorted(unused)}")


def assemble(
    points: Floats, elements: Sequence[Element], sections: Mapping[str, Section]
) -> tuple[Matrices, Matrices]:
    """Return unit matrices of stiffness and mass over all DOFs by section and kind."""
    size = 6 * len(points)
    K, M = (
        {(s, kind): np.zeros((size, size)) for s in sections for kind in kinds}
        for kinds in (STIFFNESS_KINDS, MASS_KINDS)
    )
    for e, (first, second, name) in enumerate(elements):
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
    return K, M


def split(
    matrices: Matrices, sections: Mapping[str, Section], free: NDArray[np.intp]
) -> tuple[Floats, Terms]:
    """Return the constant part, then one matrix per varying term; and those terms."""
    constant = np.zeros((len(free), len(free)))
    varying = {}
    for (name, kind), matrix in matrices.items():
        part = matrix[np.ix_(free, free)]
        if sections[name].varies(kind):
            varying[name, kind] = part
        else:
            constant += sections[name].coefficient(kind, {}) * part
    return np.array([constant, *varying.values()]), tuple(varying)
