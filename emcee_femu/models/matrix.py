"""Models of given stiffness and mass matrices, affine in the parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, issparse

from .. import checks
from ..interfaces import Floats, ModalSolution, Parameters
from .eigen.dense import Eigenproblem
from .eigen.sparse import SparseEigenproblem, check_mass
from .eigen.symmetric import sparse_symmetric, symmetric


@dataclass(frozen=True, eq=False, init=False)
class MatrixModel:
    r"""Matrices of any FE program, dense or sparse, affine in named parameters.

    .. math:: K(\theta) = K_0 + \sum_i \theta_i K_i, \qquad
        M(\theta) = M_0 + \sum_j \theta_j M_j, \qquad
        K \phi = (2 \pi f)^2 M \phi

    A name may stand in both K and M. **Dense** arrays are solved for all parameter
    sets at once; a constant M is folded into K once, one that depends on parameters is
    factored by a batched Cholesky. If K0 is a **scipy.sparse** matrix, all others may
    be sparse or dense and are made sparse; each parameter set is then one sparse
    factor and a Lanczos iteration, massless DOFs are allowed, and an M that depends on
    parameters costs a second factor, its check. For thousands of evaluations see
    :func:`reduce_model`.

    Args:
        K0: Constant part of the stiffness, ``(N, N)``, symmetric.
        M0: Constant part of the mass, ``(N, N)``, symmetric.
        K: ``{parameter: K_i}``, the stiffness that multiplies the parameter.
        M: ``{parameter: M_j}``, the mass that multiplies the parameter.
        n_modes: How many elastic modes to return.
        skip: Number of rigid-body modes below them, checked at each solve.
        shapes: Whether to return mass-normalised mode shapes too, ``(n, N, n_modes)``;
            or the DOFs (0 to N - 1) at which to return them, in the order given.

    Raises:
        TypeError: If K0 is dense and another matrix is sparse.
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

    K0: Any = field(repr=False)
    M0: Any = field(repr=False)
    K: Mapping[str, Any]
    M: Mapping[str, Any]
    n_modes: int
    skip: int
    shape_dofs: tuple[int, ...]
    _problem: Eigenproblem | SparseEigenproblem = field(repr=False)

    def __init__(
        self,
        K0: Any,
        M0: Any,
        K: Mapping[str, Any],
        M: Mapping[str, Any] | None = None,
        *,
        n_modes: int,
        skip: int = 0,
        shapes: bool | Sequence[int] | NDArray[np.integer] = False,
    ) -> None:
        """See the class."""
        sparse = issparse(K0)
        check = sparse_symmetric if sparse else symmetric
        stiffness, mass = check("K0", K0), check("M0", M0)
        size = stiffness.shape[0]
        M = {} if M is None else M
        for label, given in (("K", K), ("M", M)):
            if not isinstance(given, Mapping):
                raise TypeError(
                    f"{label}: expected {{parameter: matrix}}, got "
                    f"{type(given).__name__}"
                )
        units = {
            "K": {name: check(f"K[{name!r}]", K[name]) for name in K},
            "M": {name: check(f"M[{name!r}]", M[name]) for name in M},
        }
        if units["K"] or units["M"]:
            checks.parameter_names("K, M", list({**units["K"], **units["M"]}))
        for label, matrix in (
            ("M0", mass),
            *((f"{k}[{name!r}]", m) for k, u in units.items() for name, m in u.items()),
        ):
            if matrix.shape != stiffness.shape:
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
        dofs = _shape_dofs(shapes, size)
        object.__setattr__(self, "K0", stiffness)
        object.__setattr__(self, "M0", mass)
        object.__setattr__(self, "K", units["K"])
        object.__setattr__(self, "M", units["M"])
        object.__setattr__(self, "n_modes", n_modes)
        object.__setattr__(self, "skip", skip)
        object.__setattr__(self, "shape_dofs", dofs)
        build = self.sparse_problem if sparse else self._dense_problem
        object.__setattr__(self, "_problem", build())

    def _dense_problem(self) -> Eigenproblem:
        if not self.M:
            try:
                np.linalg.cholesky(self.M0)
            except np.linalg.LinAlgError:
                raise ValueError(
                    "M0: expected a positive definite matrix; remove massless DOFs "
                    "by static condensation, or give scipy.sparse matrices"
                ) from None
        size = len(self.K0)
        natural = self.shape_dofs in ((), tuple(range(size)))
        return Eigenproblem(
            K0=self.K0,
            K=np.array([*self.K.values()]).reshape(-1, size, size),
            M0=self.M0,
            M=np.array([*self.M.values()]).reshape(-1, size, size),
            selected=tuple(range(self.skip, self.skip + self.n_modes)),
            skip=self.skip,
            shapes=bool(self.shape_dofs),
            output=None if natural else np.eye(size)[list(self.shape_dofs)],
        )

    def sparse_problem(self) -> SparseEigenproblem:
        """Return the sparse problem, also of dense matrices."""
        K0, M0 = csc_array(self.K0), csc_array(self.M0)
        if not self.M:
            check_mass(M0, "M0")
        return SparseEigenproblem(
            K0,
            [csc_array(matrix) for matrix in self.K.values()],
            M0,
            [csc_array(matrix) for matrix in self.M.values()],
            n_modes=self.n_modes,
            skip=self.skip,
            dofs=self.shape_dofs,
        )

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
        parameters, n = checks.batch(parameters)
        missing = [name for name in self.names if name not in parameters]
        if missing:
            raise ValueError(f"parameters: no value for {missing}")

        def columns(names: Mapping[str, Floats]) -> Floats:
            values = [parameters[name] for name in names]
            return np.array(values).reshape(len(values), n).T

        def describe(row: int) -> str:
            return str({name: float(parameters[name][row]) for name in self.names})

        return self._problem.solve(columns(self.K), columns(self.M), describe)


def _shape_dofs(shapes: Any, size: int) -> tuple[int, ...]:
    if isinstance(shapes, bool | np.bool_):
        return tuple(range(size)) if shapes else ()
    listed = isinstance(shapes, Sequence) and not isinstance(shapes, str)
    if not listed and not (isinstance(shapes, np.ndarray) and shapes.ndim):
        raise TypeError(f"shapes: expected True, False or DOFs, got {shapes!r}")
    dofs = tuple(checks.whole_number("shapes", dof) for dof in shapes)
    if not dofs:
        raise ValueError("shapes: expected at least one DOF, got none; write False")
    if max(dofs) >= size:
        raise ValueError(f"shapes: no DOF {max(dofs)}; DOFs are 0 to {size - 1}")
    if len(set(dofs)) < len(dofs):
        raise ValueError(f"shapes: each DOF once, got {dofs}")
    return dofs
