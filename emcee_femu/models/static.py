"""Static tests: displacements under given loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import issparse

from .. import checks
from ..contracts import Derivatives, Floats, Parameters, Variable, show_declared
from .coefficients import Coefficients, Unit, read_units
from .eigen_dense import combine
from .eigen_sparse import SparseSum
from .factorization import factor_definite
from .inputs import Dofs, Matrix, choose_dofs, read_matrix


class StaticModel:
    r"""Displacements of a structure under several load cases.

    .. math:: K(\theta) \, u_c = f_c, \qquad
        K(\theta) = K_0 + \sum_i a_i(\theta) K_i, \qquad
        \frac{\partial u_c}{\partial \theta_j} = -K^{-1} \sum_i
        \frac{\partial a_i}{\partial \theta_j} K_i u_c

    Use it with a :class:`DisplacementTerm`. To combine a static and a modal test of the
    same structure, use :meth:`LogPosterior.joint`. The matrices are those of a
    :class:`MatrixModel`, without the supported DOFs. **Dense** matrices are solved for
    all parameter sets at once. If K0 is a **scipy.sparse** matrix, each parameter set
    costs one factorisation, whatever the number of load cases.

    Args:
        K0: Constant part of the stiffness, ``(N, N)``, symmetric.
        loads: ``{load case: forces}``, where forces are ``(N,)`` or ``{dof: force}``.
        K: ``{parameter: K_i}``, where K_i is multiplied by the parameter, or
            ``{label: (K_i, function)}``, as for :class:`MatrixModel`.
        points: The DOFs (0 to N - 1) at which displacements are returned, or ``{label:
            dof}``; None for all.
        unit: The unit of the displacements, which follows from those of K and the
            loads.

    Attributes:
        cases: The names of the load cases.
        variables: ``displacement``, with the dimensions ``load_case`` and ``point``.

    Raises:
        TypeError: If K0 is dense and another matrix is sparse.
        ValueError: If a matrix is not square, symmetric or of the size of K0, a load is
            not finite, zero everywhere or of another size, or a DOF does not exist.
            When called: if the stiffness is not positive definite.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import StaticModel
        >>> k = np.array([[1.0, -1.0], [-1.0, 1.0]])
        >>> model = StaticModel(np.diag([4.0, 0.0]), {"top": {1: 2.0}}, {"k2": k})
        >>> model({"k2": np.array([1.0, 2.0])})["displacement"].round(6).tolist()
        [[[0.5, 2.5]], [[0.5, 1.5]]]
    """

    def __init__(
        self,
        K0: Matrix,
        loads: Mapping[str, ArrayLike | Mapping[int, float]],
        K: Mapping[str, Unit],
        *,
        points: Dofs | None = None,
        unit: str = "m",
    ) -> None:
        sparse = issparse(K0)
        self.K0: Matrix = read_matrix("K0", K0, sparse=sparse)
        size = self.K0.shape[0]
        self.K, of_K = read_units("K", K, size, sparse)
        self.coefficients = Coefficients((of_K,))
        self.names = self.coefficients.names
        checks.mapping("loads", loads, "{load case: forces}")
        self.cases = checks.parameter_names("loads", tuple(loads))
        forces = [_read_force(case, force, size) for case, force in loads.items()]
        self._forces = np.stack(forces, axis=1)  # (N, cases)
        dofs = choose_dofs("points", True if points is None else points, range(size))
        self.points = tuple(dofs.values())
        coords = {"load_case": self.cases, "point": list(dofs)}
        self.variables = {"displacement": Variable(coords, unit)}
        terms = [self.K0, *self.K.values()]
        self._sum = SparseSum(terms) if sparse else np.array(terms)

    __repr__ = show_declared

    def __call__(self, parameters: Parameters) -> dict[str, Floats]:
        """Return displacements ``(n, cases, points)`` for values of shape ``(n,)``."""
        return self._solve(parameters, {})[0]

    def jacobian(self, parameters: Parameters) -> tuple[dict[str, Floats], Derivatives]:
        """Return the response and its derivatives by all parameters, from one solve."""
        response, by_unit = self._solve(parameters, self.K)
        slopes = {
            name: np.einsum("nu,uncp->ncp", by_parameter, by_unit)
            for name, (by_parameter,) in self.coefficients.slopes(parameters).items()
        }
        return response, {"displacement": slopes}

    def _solve(
        self, parameters: Parameters, units: Mapping[str, Matrix]
    ) -> tuple[dict[str, Floats], list[Floats]]:
        """Return displacements and their derivatives by each coefficient."""
        k, where = self.coefficients(parameters)
        if isinstance(self._sum, SparseSum):
            rows = []
            for i in range(len(k)):
                factor = factor_definite(self._sum(k[i]))
                if factor is None:
                    raise _indefinite(where(i))
                rows.append(self._displace(factor.solve, units))
            u, *by_unit = map(np.array, zip(*rows, strict=True))
        else:
            K = combine(self._sum, k)
            try:
                np.linalg.cholesky(K)
            except np.linalg.LinAlgError:
                worst = int(np.argmin(np.linalg.eigvalsh(K)[:, 0]))
                raise _indefinite(where(worst)) from None
            u, *by_unit = self._displace(partial(np.linalg.solve, K), units)
        return {"displacement": u}, by_unit

    def _displace(
        self, solve: Callable[[Floats], Floats], units: Mapping[str, Matrix]
    ) -> list[Floats]:
        """Return displacements ``(..., cases, points)`` and derivatives by each unit.

        ``solve`` returns ``K^-1 f`` for forces ``(..., N, cases)``.
        """
        u = solve(self._forces)
        every = [u, *(-solve(unit @ u) for unit in units.values())]
        return [part[..., list(self.points), :].swapaxes(-1, -2) for part in every]


def _indefinite(where: str) -> ValueError:
    return ValueError(
        f"K: the stiffness is not positive definite at {where}: a mechanism, a "
        "support that was not taken out, or a negative parameter"
    )


def _read_force(case: str, value: ArrayLike | Mapping[int, float], size: int) -> Floats:
    """Return the forces ``(N,)`` of a load case."""
    label = f"loads[{case!r}]"
    if isinstance(value, Mapping):
        force = np.zeros(size)
        places = choose_dofs(label, tuple(value), range(size)).values()
        for place, number in zip(places, value.values(), strict=True):
            force[place] = checks.real_number(label, number)
    else:
        force = checks.real_array(label, value, 1)
    if force.shape != (size,) or not force.any():
        raise ValueError(
            f"{label}: expected forces ({size},) on the DOFs of K0, not all zero, or "
            f"{{dof: force}}, got shape {force.shape}, {np.count_nonzero(force)} not 0"
        )
    return force
