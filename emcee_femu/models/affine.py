"""Models of given stiffness and mass matrices, affine in the parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats, ModalSolution, Parameters
from .eigenproblem import Eigenproblem


@dataclass(frozen=True, eq=False, init=False)
class MatrixModel:
    r"""Dense matrices of any FE program, affine in named parameters.

    .. math:: K(\theta) = K_0 + \sum_i \theta_i K_i, \qquad
        M(\theta) = M_0 + \sum_j \theta_j M_j, \qquad
        K \phi = (2 \pi f)^2 M \phi

    A constant M is folded into K once; one that depends on parameters is factored by
    a batched Cholesky. A name may stand in both K and M.

    Args:
        K0: Constant part of the stiffness, ``(N, N)``, symmetric.
        M0: Constant part of the mass, ``(N, N)``, symmetric.
        K: ``{parameter: K_i}``, the stiffness that multiplies the parameter.
        M: ``{parameter: M_j}``, the mass that multiplies the parameter.
        n_modes: How many elastic modes to return.
        skip: Number of rigid-body modes below them, checked at each solve.
        shapes: Whether to return mass-normalised mode shapes too.

    Raises:
        ValueError: If a matrix is not square, symmetric or of the size of K0, M is
            constant and not positive definite, or there are not enough modes. When
            called: if M is not positive definite, or the count of rigid-body modes
            is not skip.

    Example:
        >>> k = np.array([[1.0, -1.0], [-1.0, 1.0]])
        >>> model = MatrixModel(np.diag([9.0, 0.0]), np.eye(2), {"k2": k}, n_modes=2)
        >>> model({"k2": np.array([4.0])}).frequencies.round(4).tolist()
        [[0.2506, 0.6065]]
    """

    K: Mapping[str, Floats]
    M: Mapping[str, Floats]
    n_modes: int
    skip: int
    _problem: Eigenproblem = field(repr=False)

    def __init__(
        self,
        K0: ArrayLike,
        M0: ArrayLike,
        K: Mapping[str, ArrayLike],
        M: Mapping[str, ArrayLike] | None = None,
        *,
        n_modes: int,
        skip: int = 0,
        shapes: bool = False,
    ) -> None:
        """See the class."""
        stiffness, mass = symmetric("K0", K0), symmetric("M0", M0)
        size = len(stiffness)
        for label, given in (("K", K), ("M", M or {})):
            if not isinstance(given, Mapping):
                raise TypeError(
                    f"{label}: expected {{parameter: matrix}}, got "
                    f"{type(given).__name__}"
                )
        units = {
            "K": {name: symmetric(f"K[{name!r}]", K[name]) for name in K},
            "M": {name: symmetric(f"M[{name!r}]", (M or {})[name]) for name in M or {}},
        }
        if units["K"] or units["M"]:
            checks.parameter_names("K, M", list({**units["K"], **units["M"]}))
        for label, matrix in (
            ("M0", mass),
            *((f"{k}[{name!r}]", m) for k, u in units.items() for name, m in u.items()),
        ):
            if len(matrix) != size:
                raise ValueError(
                    f"{label}: expected the shape of K0, {stiffness.shape}, "
                    f"got {matrix.shape}"
                )
        n_modes = checks.whole_number("n_modes", n_modes, 1)
        skip = checks.whole_number("skip", skip)
        if skip + n_modes > size:
            raise ValueError(
                f"n_modes: expected skip + n_modes <= {size} (the DOFs of K0), "
                f"got {skip} + {n_modes}"
            )
        if not units["M"]:
            try:
                np.linalg.cholesky(mass)
            except np.linalg.LinAlgError:
                raise ValueError(
                    "M0: expected a positive definite matrix; remove massless DOFs "
                    "by static condensation"
                ) from None
        problem = Eigenproblem(
            K0=stiffness,
            K=np.array([*units["K"].values()]).reshape(-1, size, size),
            M0=mass,
            M=np.array([*units["M"].values()]).reshape(-1, size, size),
            selected=tuple(range(skip, skip + n_modes)),
            skip=skip,
            shapes=bool(shapes),
        )
        object.__setattr__(self, "K", units["K"])
        object.__setattr__(self, "M", units["M"])
        object.__setattr__(self, "n_modes", n_modes)
        object.__setattr__(self, "skip", skip)
        object.__setattr__(self, "_problem", problem)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the matrices depend on."""
        return tuple(dict.fromkeys([*self.K, *self.M]))

    @property
    def required(self) -> tuple[str, ...]:
        """The parameters without which there is no model: all."""
        return self.names

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``."""
        missing = [name for name in self.names if name not in parameters]
        if missing:
            raise ValueError(f"parameters: no value for {missing}")
        n = max((len(value) for value in parameters.values()), default=1)

        def columns(names: Mapping[str, Floats]) -> Floats:
            return np.array([parameters[name] for name in names]).reshape(-1, n).T

        def describe(row: int) -> str:
            return str({name: float(parameters[name][row]) for name in self.names})

        return self._problem.solve(columns(self.K), columns(self.M), describe)


def symmetric(argument: str, value: ArrayLike) -> Floats:
    """Return a finite, symmetric ``(N, N)`` matrix; a tiny asymmetry is averaged out.

    Raises:
        ValueError: If the matrix is not square, or differs from its transpose by more
            than 1e-8 of its largest entry (FE programs print 9 to 16 digits).
    """
    matrix = checks.real_array(argument, value, 2)
    if matrix.shape[0] != matrix.shape[1] or not matrix.size:
        raise ValueError(f"{argument}: expected a square matrix, got {matrix.shape}")
    gap = float(np.abs(matrix - matrix.T).max())
    largest = float(np.abs(matrix).max())
    if gap > 1e-8 * largest:
        raise ValueError(
            f"{argument}: expected a symmetric matrix, but entries differ from the "
            f"transpose by up to {gap:.3g} (largest entry {largest:.3g})"
        )
    return 0.5 * (matrix + matrix.T)
