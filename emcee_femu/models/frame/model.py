"""3-D Euler-Bernoulli frames: assembly, supports and named parameters."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from ... import checks
from ...interfaces import Floats, ModalSolution, Parameters, Variable, modal_variables
from ..eigen.blocks import Weight
from ..eigen.dense import Eigenproblem, output_rows
from ..eigen.sensitivity import Derivatives
from ..parameters import check_positive, choose_dofs, describe, read_batch
from .assembly import DOFS, Element, Terms, assemble, check_elements, free_dofs, split
from .section import Section


@dataclass(frozen=True, eq=False, init=False)
class FrameModel:
    r"""A frame of straight Euler-Bernoulli elements in space, with consistent mass.

    .. math:: K = \sum_e T_e^T (EA\,k_{EA} + GJ\,k_{GJ} + EI_z k_{EI_z}
        + EI_y k_{EI_y}) T_e, \qquad
        M = \sum_e T_e^T (\rho A\,m_{\rho A} + \rho (I_y + I_z)\,m_{\rho I}) T_e

    Each section contributes at most four stiffness and two mass matrices, assembled
    once; a batch of parameter sets is then a matrix product. In a plane frame supports
    hold uz, rx and ry of every node.

    Args:
        nodes: Coordinates in m, ``(n_nodes, 3)``.
        elements: ``(node, node, section name)`` each; nodes count from 0.
        sections: ``{name: Section}``.
        supports: ``{node: held DOFs}`` out of ux uy uz rx ry rz; ``"all"`` holds six.
        n_modes: How many elastic modes to return, the lowest; or give
        modes: Which elastic modes to return, 1 = the lowest, ascending.
        skip: Number of rigid-body modes, checked at each solve (6 for free-free).
        shapes: Whether to return mass-normalised mode shapes too; or the DOFs at which
            to return them, in the order given. A DOF is named by node and direction,
            as in ``"3:uy"``; ``model.dofs`` are all that are free.

    Raises:
        TypeError: If not exactly one of n_modes and modes is given.
        ValueError: If nodes, elements, sections or supports do not fit together.
            When called: if a property is not above zero, or the number of rigid-body
            modes is not skip.

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

    sections: Mapping[str, Section]
    dofs: tuple[str, ...]
    modes: tuple[int, ...]
    n_modes: int
    skip: int
    shape_dofs: tuple[str, ...]
    variables: Mapping[str, Variable] = field(repr=False)
    names: tuple[str, ...] = field(repr=False)
    required: tuple[str, ...] = field(repr=False)
    positive: tuple[str, ...] = field(repr=False)
    _stiffness: Terms = field(repr=False)
    _mass: Terms = field(repr=False)
    _problem: Eigenproblem = field(repr=False)

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
        shapes: bool | Sequence[str] = False,
    ) -> None:
        points = checks.real_array("nodes", nodes, 2)
        if points.shape[1] != 3 or len(points) < 2:
            raise ValueError(
                f"nodes: expected two or more, (n_nodes, 3), got {points.shape}"
            )
        free = free_dofs(len(points), supports)
        check_elements(len(points), elements, sections)
        K, M = assemble(points, elements, sections)
        stiffness, stiffness_terms = split(K, sections, free)
        mass, mass_terms = split(M, sections, free)
        skip = checks.whole_number("skip", skip)
        wanted = _choose_modes(n_modes, modes, skip, len(free))
        dofs = tuple(f"{i // 6}:{DOFS[i % 6]}" for i in free.tolist())
        chosen = choose_dofs(shapes, dofs)
        names = tuple(dict.fromkeys(p for s in sections.values() for p in s.parameters))
        checks.set_fields(
            self,
            sections=dict(sections),
            dofs=dofs,
            modes=wanted,
            n_modes=len(wanted),
            skip=skip,
            shape_dofs=chosen,
            variables=modal_variables(len(wanted), chosen),
            names=names,
            required=names,
            positive=names,
            _stiffness=stiffness_terms,
            _mass=mass_terms,
            _problem=Eigenproblem(
                stiffness,
                mass,
                selected=tuple(skip + mode - 1 for mode in wanted),
                skip=skip,
                shapes=bool(chosen),
                output=output_rows([dofs.index(dof) for dof in chosen], len(dofs)),
            ),
        )

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``."""
        _, k, m, name_set = self._read(parameters)
        return self._problem.solve(k, m, name_set)

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives by all parameters, from one solve.

        Exact also where one parameter multiplies another, as E and A do, or is in
        several sections: the matrices are affine in the products.

        Raises:
            ValueError: As a call does, or if modes coincide that part as a parameter
                changes; see :meth:`MatrixModel.jacobian`.
        """
        values, k, m, name_set = self._read(parameters)
        slopes: dict[str, tuple[dict[int, Weight], dict[int, Weight]]]
        slopes = {name: ({}, {}) for name in self.names}
        for which, terms in enumerate((self._stiffness, self._mass)):
            for number, (section, kind) in enumerate(terms):
                own = self.sections[section].slopes(kind, values)
                for name, change in own.items():
                    slopes[name][which][number] = change
        return self._problem.jacobian(k, m, slopes, name_set)

    def _read(
        self, parameters: Parameters
    ) -> tuple[Parameters, Floats, Floats, Callable[[int], str]]:
        """Return the values, coefficients of K and M, and what names a set."""
        values, n = read_batch(parameters, self.names)
        check_positive(values, self.names, "section property")

        def coefficients(terms: Terms) -> Floats:
            columns = [self.sections[s].coefficient(k, values) for s, k in terms]
            return np.array(columns).reshape(len(terms), n).T

        where = partial(describe, values, self.names)
        return values, coefficients(self._stiffness), coefficients(self._mass), where


def _choose_modes(
    n_modes: int | None, modes: Sequence[int] | None, skip: int, n_free: int
) -> tuple[int, ...]:
    if (n_modes is None) == (modes is None):
        raise TypeError("n_modes, modes: expected exactly one of the two")
    if modes is None:
        wanted = tuple(range(1, checks.whole_number("n_modes", n_modes, 1) + 1))
    elif np.ndim(modes) != 1:
        raise TypeError(f"modes: expected a sequence of mode numbers, got {modes!r}")
    else:
        wanted = tuple(checks.whole_number("modes", mode, 1) for mode in modes)
        if not wanted or list(wanted) != sorted(set(wanted)):
            raise ValueError(
                f"modes: expected ascending mode numbers from 1, got {wanted}"
            )
    if skip + wanted[-1] > n_free:
        argument = "n_modes" if modes is None else "modes"
        raise ValueError(
            f"{argument}: mode {wanted[-1]} after {skip} rigid-body modes (skip), but "
            f"there are only {n_free} free DOFs"
        )
    return wanted
