"""Lumped masses joined by springs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats, ModalSolution, Parameters, Variable, modal_variables
from .eigen.dense import Eigenproblem, output_rows
from .eigen.sensitivity import Derivatives, unit_slopes
from .parameters import check_mapping, check_positive, choose_dofs

Spring = tuple[int, int, float | str]


@dataclass(frozen=True, eq=False, init=False)
class MassSpringModel:
    r"""Point masses on a line, each with one DOF, joined by linear springs.

    .. math:: K = \sum_s k_s b_s b_s^T, \qquad M = \mathrm{diag}(m_1 .. m_n)

    with ``b_s`` = +1 at one end of spring s, -1 at the other, nothing at the ground. A
    parameter with the name of a spring overrides its default stiffness; a spring with
    another spring's name in place of a number always has that spring's stiffness.

    Args:
        masses: Masses of nodes 1 .. n in kg, ``(n,)``.
        springs: ``{name: (node, node, default stiffness in N/m)}``, or
            ``{name: (node, node, "name of the spring that it follows")}``; node 0 is
            the ground.
        shapes: Whether to return mass-normalised mode shapes too (about twice the
            time), or the DOFs at which to return them, in the order given. DOFs count
            from 0: DOF 0 is node 1.

    Raises:
        TypeError: If springs is not such a mapping, or a node is not a whole number.
        ValueError: If a mass or stiffness is not above zero, or a node or followed
            spring does not exist.
            When called: if a stiffness is not above zero.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import MassSpringModel
        >>> model = MassSpringModel([1.0, 1.0], {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)})
        >>> model({"k1": np.array([10.0, 40.0])}).frequencies.round(3).tolist()
        [[0.272, 0.658], [0.333, 1.075]]
    """

    masses: Floats
    springs: Mapping[str, Spring]
    names: tuple[str, ...] = field(repr=False)
    positive: tuple[str, ...] = field(repr=False)
    n_modes: int = field(repr=False)
    shape_dofs: tuple[int, ...]
    variables: Mapping[str, Variable] = field(repr=False)
    _defaults: Floats = field(repr=False)
    _problem: Eigenproblem = field(repr=False)

    def __init__(
        self,
        masses: ArrayLike,
        springs: Mapping[str, Spring],
        *,
        shapes: bool | Sequence[int] = False,
    ) -> None:
        mass = checks.positive_array("masses", masses, 1)
        n = len(mass)
        if not n:
            raise ValueError("masses: expected at least one, got none")
        dofs = choose_dofs(shapes, range(n))
        check_mapping("springs", springs, "{name: (node, node, stiffness)}")
        every = checks.parameter_names("springs", list(springs))
        defaults = _default_stiffnesses(springs)
        names = tuple(defaults)
        K = np.zeros((1 + len(names), n, n))  # the first is the constant part
        for name in every:
            first, second, stiffness = springs[name]
            leader = stiffness if isinstance(stiffness, str) else name
            b = _incidence(name, first, second, n)
            K[1 + names.index(leader)] += np.outer(b, b)
        checks.set_fields(
            self,
            masses=mass,
            springs={name: tuple(springs[name]) for name in every},
            names=names,
            positive=names,
            n_modes=n,
            shape_dofs=dofs,
            variables=modal_variables(n, dofs),
            _defaults=np.array([*defaults.values()]),
            _problem=Eigenproblem(
                K,
                np.diag(mass)[None],
                selected=tuple(range(n)),
                shapes=bool(dofs),
                output=output_rows(dofs, n),
            ),
        )

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_masses)`` in Hz; each value is ``(n,)`` in N/m."""
        return self._problem.solve(*self._coefficients(parameters))

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives by the stiffnesses that are given.

        ``{"frequency": {name: (n, n_masses)}, "shapes": {name: (n, n_dof, n_masses)}}``
        in Hz per N/m and so on, from one solve.

        Raises:
            ValueError: As a call does, or if modes coincide that part as a parameter
                changes; see :meth:`MatrixModel.jacobian`.
        """
        k, m, describe = self._coefficients(parameters)
        every = unit_slopes(self.names, ())
        slopes = {name: every[name] for name in self.names if name in parameters}
        return self._problem.jacobian(k, m, slopes, describe)

    def _coefficients(
        self, parameters: Parameters
    ) -> tuple[Floats, Floats, Callable[[int], str]]:
        """Return the coefficients of K and M, and what names a parameter set."""
        parameters, n = checks.batch(parameters)
        k = np.empty((n, len(self.names)))
        k[:] = self._defaults
        for column, name in enumerate(self.names):
            if name in parameters:
                k[:, column] = parameters[name]
        if n and not k.min() > 0:
            check_positive(
                dict(zip(self.names, k.T, strict=True)), self.names, "stiffness"
            )

        def describe(row: int) -> str:
            return str(dict(zip(self.names, k[row].tolist(), strict=True)))

        return k, np.empty((n, 0)), describe


def _default_stiffnesses(springs: Mapping[str, Spring]) -> dict[str, float]:
    """Return the default stiffness of each spring that follows no other."""
    defaults = {}
    for name, spring in springs.items():
        if not isinstance(spring, Sequence) or len(spring) != 3:
            raise TypeError(
                f"springs[{name!r}]: expected (node, node, stiffness), got {spring!r}"
            )
        if not isinstance(spring[2], str):
            value = checks.positive_array(f"springs[{name!r}]", spring[2], 0)
            defaults[name] = value.item()
    for name, (_, _, leader) in springs.items():
        if isinstance(leader, str) and leader not in defaults:
            raise ValueError(
                f"springs[{name!r}]: expected a spring with a stiffness of its own to "
                f"follow, got {leader!r}; there are {sorted(defaults)}"
            )
    return defaults


def _incidence(name: str, first: int, second: int, n: int) -> Floats:
    """Return +1 at one end and -1 at the other, without the ground, ``(n,)``."""
    for node in (first, second):
        if checks.whole_number(f"springs[{name!r}]", node) > n:
            raise ValueError(
                f"springs[{name!r}]: no node {node}; nodes are 0 (ground) to {n}"
            )
    if first == second:
        raise ValueError(f"springs[{name!r}]: both ends are node {first}")
    b = np.zeros(n + 1)
    b[first], b[second] = 1.0, -1.0
    return b[1:]
