"""Lumped masses joined by springs."""

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Derivatives, Floats, ModalSolution, Parameters, show_declared
from .matrix import AffineModel
from .sensors import Dofs

Spring: TypeAlias = tuple[int, int, float | str]
Springs: TypeAlias = Mapping[str, Spring]


class MassSpringModel:
    r"""Point masses on a line, each with one DOF, connected by linear springs.

    .. math:: K = \sum_s k_s b_s b_s^T, \qquad M = \mathrm{diag}(m_1 .. m_n)

    where :math:`b_s` is +1 at one end of spring s and -1 at the other; the ground has
    no entry. Use it for shear buildings and test problems. A parameter with the name of
    a spring or a mass replaces its default value. If the third entry of a spring is the
    name of another spring, both always have the same stiffness.

    Args:
        masses: Masses of nodes 1 .. n in kg, ``(n,)``, if they are constant; or
            ``{name: default mass in kg}``, in this order.
        springs: ``{name: (node, node, default stiffness in N/m)}``, or
            ``{name: (node, node, "name of the spring that it follows")}``; node 0 is
            the ground.
        skip: Number of rigid-body modes: 1 for a chain without a spring to the ground.
        shapes: Whether to return mass-normalised mode shapes too (about twice the
            time), or the DOFs at which to return them, in the given order. DOFs count
            from 0: DOF 0 is node 1.

    Raises:
        TypeError: If springs is not such a mapping, or a node is not a whole number.
        ValueError: If a mass or stiffness is not positive, or a node or followed spring
            does not exist. When called: if a stiffness or mass is not positive, or the
            number of rigid-body modes is not skip.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import MassSpringModel
        >>> model = MassSpringModel([1.0, 1.0], {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)})
        >>> model({"k1": np.array([10.0, 40.0])}).frequencies.round(3).tolist()
        [[0.272, 0.658], [0.333, 1.075]]
    """

    def __init__(
        self,
        masses: ArrayLike | Mapping[str, float],
        springs: Springs,
        *,
        skip: int = 0,
        shapes: bool | Dofs = False,
    ) -> None:
        named: dict[str, float] = {}
        if isinstance(masses, Mapping):
            named, masses = dict(masses), [*masses.values()]
        self.masses = checks.positive_array("masses", masses, 1)
        n = len(self.masses)
        skip = checks.whole_number("skip", skip)
        if n <= skip:
            raise ValueError(f"masses: expected more than skip={skip}, got {n}")
        self.springs = checks.by_label("springs", springs, "(node, node, stiffness)")
        if named:
            checks.parameter_names("masses", [*named, *springs])
        stiffnesses, leaders = _read_stiffnesses(self.springs)
        K = {name: np.zeros((n, n)) for name in stiffnesses}
        for name, (first, second, _) in springs.items():
            b = _incidence(name, first, second, n)
            K[leaders.get(name, name)] += np.outer(b, b)
        M = {name: np.diag(np.eye(n)[i]) for i, name in enumerate(named)}
        mass_of = dict(zip(named, self.masses.tolist(), strict=False))
        self._defaults = stiffnesses | mass_of
        M0 = np.diag(np.zeros(n) if named else self.masses)
        modes, positive = range(1, n - skip + 1), "stiffness or mass"
        self._model = AffineModel(
            np.zeros((n, n)), M0, K, M, modes, skip, shapes, positive=positive
        )
        self.shape_dofs, self.variables = self._model.shape_dofs, self._model.variables
        self.dofs = self._model.dofs
        self.names: tuple[str, ...] = ()  # every spring and mass has a default
        self.bounds = dict.fromkeys([*K, *M], (0.0, np.inf))

    __repr__ = show_declared

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz; values are ``(n,)``, N/m or kg."""
        return self._model(self._complete(parameters))

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives by all given values, from one solve.

        ``{"frequency": {name: (n, n_modes)}, "shapes": {name: (n, n_dof, n_modes)}}``
        in Hz per N/m or kg, and so on.

        Raises:
            ValueError: As for a call, or if two modes coincide that separate as a
                parameter changes; see ``MatrixModel.jacobian``.
        """
        values = self._complete(parameters)
        problem, coefficients = self._model.problem, self._model.coefficients
        slopes = coefficients.slopes(values)
        read = {name: slopes[name] for name in slopes if name in parameters}
        return problem.solve(*coefficients(values), read)

    def _complete(self, parameters: Parameters) -> Parameters:
        """Return the values of all springs and masses, or their defaults."""
        values, n = checks.batch(parameters)
        rest = {k: np.full(n, x) for k, x in self._defaults.items() if k not in values}
        return {**values, **rest}


def _read_stiffnesses(springs: Springs) -> tuple[dict[str, float], dict[str, str]]:
    """Return default stiffnesses, and the leaders of the springs that follow one."""
    defaults, leaders = dict[str, float](), dict[str, str]()
    for name, spring in springs.items():
        label = f"springs[{name!r}]"
        *_, stiffness = checks.group(label, spring, "(node, node, stiffness)", 3)
        if isinstance(stiffness, str):
            leaders[name] = stiffness
        else:
            defaults[name] = checks.positive_array(label, stiffness, 0).item()
    for name, leader in leaders.items():
        if leader not in defaults:
            raise ValueError(
                f"springs[{name!r}]: expected a spring with a stiffness of its own to "
                f"follow, got {leader!r}; there are {sorted(defaults)}"
            )
    return defaults, leaders


def _incidence(name: str, first: int, second: int, n: int) -> Floats:
    """Return +1 at one end and -1 at the other, without the ground, ``(n,)``."""
    for node in (first, second):
        if checks.whole_number(f"springs[{name!r}]", node) > n:
            raise ValueError(
                f"springs[{name!r}]: no node {node}; nodes are 0 (ground) to {n}"
            )
    if first == second:
        raise ValueError(f"springs[{name!r}]: both ends are node {first}")
    return np.eye(n + 1)[first, 1:] - np.eye(n + 1)[second, 1:]
