"""Static tests: displacements under given loads, affine in the parameters."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import issparse

from .. import checks
from ..interfaces import Floats, Parameters, Variable
from .eigen.dense import combine
from .eigen.sparse import symmetric_factor
from .eigen.sparse_sum import SparseSum
from .eigen.symmetric import sparse_symmetric, symmetric
from .parameters import check_mapping, columns, describe, read_batch


@dataclass(frozen=True, eq=False, init=False)
class StaticModel:
    r"""Displacements of a structure under several load cases.

    .. math:: K(\theta) \, u_c = f_c, \qquad K(\theta) = K_0 + \sum_i \theta_i K_i,
        \qquad \frac{\partial u_c}{\partial \theta_i} = -K^{-1} K_i u_c

    The matrices are those of a :class:`MatrixModel`, supports taken out. **Dense** ones
    are solved for all parameter sets at once; if K0 is a **scipy.sparse** matrix, each
    parameter set costs one factorisation, whatever the number of load cases. A test of
    the same structure by its modes goes beside it in :meth:`LogPosterior.joint`.

    Args:
        K0: Constant part of the stiffness, ``(N, N)``, symmetric.
        loads: ``{load case: forces}``, the forces ``(N,)`` or ``{dof: force}``.
        K: ``{parameter: K_i}``, the stiffness that multiplies the parameter.
        points: Where displacements are returned: DOFs (0 to N - 1), or ``{label:
            dof}``; None for all.
        unit: That of the displacements, which follows from those of K and the loads.

    Attributes:
        cases: The names of the load cases.
        variables: ``displacement``, with the dimensions ``load_case`` and ``point``.

    Raises:
        TypeError: If K0 is dense and another matrix is sparse.
        ValueError: If a matrix is not square, symmetric or of the size of K0, a load
            is not finite, zero everywhere or of another size, or a DOF does not exist.
            When called: if the stiffness is not positive definite.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import StaticModel
        >>> k = np.array([[1.0, -1.0], [-1.0, 1.0]])
        >>> model = StaticModel(np.diag([4.0, 0.0]), {"top": {1: 2.0}}, {"k2": k})
        >>> model({"k2": np.array([1.0, 2.0])})["displacement"].round(6).tolist()
        [[[0.5, 2.5]], [[0.5, 1.5]]]
    """

    K0: Any = field(repr=False)
    loads: Mapping[str, Floats] = field(repr=False)
    K: Mapping[str, Any]
    points: tuple[int, ...]
    cases: tuple[str, ...]
    variables: Mapping[str, Variable] = field(repr=False)
    names: tuple[str, ...] = field(repr=False)
    required: tuple[str, ...] = field(repr=False)
    _forces: Floats = field(repr=False)  # (N, cases)
    _sum: Any = field(repr=False)  # of sparse matrices, or (1 + d, N, N)

    def __init__(
        self,
        K0: Any,
        loads: Mapping[str, ArrayLike | Mapping[int, float]],
        K: Mapping[str, Any],
        *,
        points: Mapping[Hashable, int] | Sequence[int] | NDArray[Any] | None = None,
        unit: str = "m",
    ) -> None:
        read = sparse_symmetric if issparse(K0) else symmetric
        stiffness = read("K0", K0)
        size = stiffness.shape[0]
        check_mapping("K", K, "{parameter: matrix}")
        K = {name: read(f"K[{name!r}]", own, size) for name, own in K.items()}
        names = checks.parameter_names("K", tuple(K))
        check_mapping("loads", loads, "{load case: forces}")
        cases = checks.parameter_names("loads", tuple(loads))
        forces = {case: _read_force(case, loads[case], size) for case in cases}
        dofs, labels = _read_points(points, size)
        coords = {"load_case": cases, "point": labels}
        terms = (stiffness, *K.values())
        checks.set_fields(
            self,
            K0=stiffness,
            loads=forces,
            K=K,
            points=dofs,
            cases=cases,
            variables={"displacement": Variable(coords, unit)},
            names=names,
            required=names,
            _forces=np.stack([*forces.values()], axis=1),
            _sum=SparseSum(terms) if issparse(stiffness) else np.array(terms),
        )

    def __call__(self, parameters: Parameters) -> dict[str, Floats]:
        """Return displacements ``(n, cases, points)`` for values of shape ``(n,)``."""
        return self._solve(parameters, False)[0]

    def jacobian(
        self, parameters: Parameters
    ) -> tuple[dict[str, Floats], dict[str, dict[str, Floats]]]:
        """Return the response and its derivatives by all parameters, from one solve."""
        return self._solve(parameters, True)

    def _solve(
        self, parameters: Parameters, differentiate: bool
    ) -> tuple[dict[str, Floats], dict[str, dict[str, Floats]]]:
        values, n = read_batch(parameters, self.names)
        k = columns(values, self.names, n)
        u = np.empty((n, len(self.cases), len(self.points)))
        slopes = np.empty((len(self.names) if differentiate else 0, *u.shape))
        solve = self._solve_sparse if isinstance(self._sum, SparseSum) else self._batch
        try:
            solve(k, u, slopes)
        except _IndefiniteError as error:
            where = describe(values, self.names, error.row)
            raise ValueError(
                f"K: the stiffness is not positive definite at {where}: a mechanism, a "
                "support that was not taken out, or a negative parameter"
            ) from None
        by_name = dict(zip(self.names, slopes, strict=True)) if differentiate else {}
        return {"displacement": u}, {"displacement": by_name}

    def _batch(self, k: Floats, u: Floats, slopes: Floats) -> None:
        """Fill in displacements and derivatives of all parameter sets at once."""
        K = combine(self._sum, k)
        try:
            np.linalg.cholesky(K)
        except np.linalg.LinAlgError:
            raise _IndefiniteError(_first_indefinite(K)) from None
        all_u, points = np.linalg.solve(K, self._forces), list(self.points)
        u[:] = all_u[:, points].swapaxes(1, 2)
        for slope, unit in zip(slopes, self._sum[1:], strict=False):
            moved = np.linalg.solve(K, unit @ all_u)[:, points]
            slope[:] = -moved.swapaxes(1, 2)

    def _solve_sparse(self, k: Floats, u: Floats, slopes: Floats) -> None:
        """Fill in displacements and derivatives, one parameter set after another."""
        points = list(self.points)
        for i, row in enumerate(k):
            try:
                factor = symmetric_factor(self._sum(row))
                definite = bool((factor.U.diagonal() > 0).all())
            except RuntimeError:  # exactly singular
                definite = False
            if not definite:
                raise _IndefiniteError(i)
            all_u = factor.solve(self._forces)
            u[i] = all_u[points].T
            for slope, unit in zip(slopes, self.K.values(), strict=False):
                slope[i] = -factor.solve(unit @ all_u)[points].T


class _IndefiniteError(Exception):
    """A stiffness that is not positive definite, and of which parameter set."""

    def __init__(self, row: int) -> None:
        super().__init__(row)
        self.row = row


def _first_indefinite(K: Floats) -> int:
    for row, matrix in enumerate(K):
        try:
            np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            return row
    return 0


def _read_force(case: str, value: Any, size: int) -> Floats:
    """Return the forces ``(N,)`` of a load case."""
    label = f"loads[{case!r}]"
    if isinstance(value, Mapping):
        force = np.zeros(size)
        for dof, own in value.items():
            force[_read_dof(label, dof, size)] = checks.real_number(label, own)
    else:
        force = checks.real_array(label, value, 1)
    if force.shape != (size,) or not force.any():
        raise ValueError(
            f"{label}: expected forces ({size},) on the DOFs of K0, not all zero, or "
            f"{{dof: force}}, got shape {force.shape}"
            + ("" if force.any() else " of zeros")
        )
    return force


def _read_points(points: Any, size: int) -> tuple[tuple[int, ...], list[Any]]:
    """Return DOFs and labels of the points."""
    if points is None:
        points = range(size)
    named = isinstance(points, Mapping)
    if not named and np.ndim(points) != 1:
        raise TypeError(f"points: expected DOFs or {{label: dof}}, got {points!r}")
    given = points.values() if named else points
    dofs = tuple(_read_dof("points", dof, size) for dof in given)
    if not dofs or len(set(dofs)) < len(dofs):
        raise ValueError(f"points: expected DOFs, each once, got {list(dofs)}")
    return dofs, list(points if named else dofs)


def _read_dof(label: str, dof: Any, size: int) -> int:
    number = checks.whole_number(label, dof)
    if number >= size:
        raise ValueError(f"{label}: no DOF {number}; DOFs are 0 to {size - 1}")
    return number
