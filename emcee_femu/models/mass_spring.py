"""Lumped masses joined by springs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats, ModalSolution, Parameters
from .eigen.dense import Eigenproblem


@dataclass(frozen=True, eq=False, init=False)
class MassSpringModel:
    r"""Point masses on a line, each with one DOF, joined by linear springs.

    .. math:: K = \sum_s k_s b_s b_s^T, \qquad M = \mathrm{diag}(m_1 .. m_n)

    with ``b_s`` = +1 at one end of spring s, -1 at the other, nothing at the ground. A
    parameter of a spring's name overrides its default stiffness; a spring with another
    spring's name in place of a number always has that spring's stiffness.

    Args:
        masses: Masses of nodes 1 .. n in kg, ``(n,)``.
        springs: ``{name: (node, node, default stiffness in N/m)}``, or
            ``{name: (node, node, "name of the spring that it follows")}``; node 0 is
            the ground.
        shapes: Whether to return mode shapes too (about twice the time).

    Raises:
        TypeError: If springs is not such a mapping, or a node not a whole number.
        ValueError: If a mass or stiffness is not above zero, or a node or followed
            spring does not exist.
            When called: if a stiffness is not above zero.

    Example:
        >>> model = MassSpringModel([1.0, 1.0], {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)})
        >>> model({"k1": np.array([10.0, 40.0])}).frequencies.round(3).tolist()
        [[0.272, 0.658], [0.333, 1.075]]
    """

    masses: Floats
    springs: Mapping[str, tuple[int, int, float | str]]
    shapes: bool
    _names: tuple[str, ...] = field(repr=False)
    _defaults: Floats = field(repr=False)
    _problem: Eigenproblem = field(repr=False)

    def __init__(
        self,
        masses: ArrayLike,
        springs: Mapping[str, tuple[int, int, float | str]],
        *,
        shapes: bool = False,
    ) -> None:
        """See the class."""
        mass = checks.positive_array("masses", masses, 1)
        if not mass.size:
            raise ValueError("masses: expected at least one, got none")
        shapes = checks.flag("shapes", shapes)
        if not isinstance(springs, Mapping):
            raise TypeError(
                "springs: expected {name: (node, node, stiffness)}, got "
                f"{type(springs).__name__}"
            )
        names = checks.parameter_names("springs", list(springs))
        defaults = _defaults(springs, names)
        n = len(mass)
        K = np.zeros((len(defaults), n, n))
        for name in names:
            first, second, stiffness = springs[name]
            leader = stiffness if isinstance(stiffness, str) else name
            b = _incidence(name, first, second, n)
            K[list(defaults).index(leader)] += np.outer(b, b)
        problem = Eigenproblem(
            K0=np.zeros((n, n)),
            K=K,
            M0=np.diag(mass),
            M=np.empty((0, n, n)),
            selected=tuple(range(n)),
            shapes=shapes,
        )
        object.__setattr__(self, "masses", mass)
        object.__setattr__(self, "springs", {k: tuple(springs[k]) for k in names})
        object.__setattr__(self, "shapes", shapes)
        object.__setattr__(self, "_names", tuple(defaults))
        object.__setattr__(self, "_defaults", np.array([*defaults.values()]))
        object.__setattr__(self, "_problem", problem)

    @property
    def names(self) -> tuple[str, ...]:
        """The springs with a stiffness of their own: the parameters that it reads."""
        return self._names

    @property
    def positive(self) -> tuple[str, ...]:
        """The parameters that must stay above zero: all."""
        return self.names

    @property
    def n_modes(self) -> int:
        """Number of modes, that of the masses."""
        return len(self.masses)

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_masses)`` in Hz; each value is ``(n,)`` in N/m."""
        parameters, n = checks.batch(parameters)
        k = np.empty((n, len(self._names)))
        k[:] = self._defaults
        for column, name in enumerate(self._names):
            if name in parameters:
                k[:, column] = parameters[name]

        def describe(row: int) -> str:
            return str(dict(zip(self._names, k[row].tolist(), strict=True)))

        if n and not k.min() > 0:
            row, column = np.argwhere(~(k > 0))[0]
            raise ValueError(
                f"parameters: the stiffness {self.names[column]!r} must be above "
                f"zero, got {k[row, column]:g}; give its prior a lower bound"
            )
        return self._problem.solve(k, np.empty((n, 0)), describe)


def _defaults(
    springs: Mapping[str, tuple[int, int, float | str]], names: tuple[str, ...]
) -> dict[str, float]:
    """Return the default stiffness of each spring that follows no other."""
    defaults = {}
    for name in names:
        spring = springs[name]
        if not isinstance(spring, Sequence) or len(spring) != 3:
            raise TypeError(
                f"springs[{name!r}]: expected (node, node, stiffness), got {spring!r}"
            )
        stiffness = spring[2]
        if not isinstance(stiffness, str):
            checked = checks.positive_array(f"springs[{name!r}]", stiffness, 0)
            defaults[name] = checked.item()
    for name in names:
        leader = springs[name][2]
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
