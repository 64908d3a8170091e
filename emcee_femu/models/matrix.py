"""Models from given stiffness and mass matrices and their coefficients."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from functools import cached_property, partial
from typing import Self

import numpy as np
from scipy.sparse import csc_array, issparse

from .. import checks
from ..contracts import (
    Derivatives,
    Floats,
    ModalSolution,
    Parameters,
    modal_variables,
    show_declared,
)
from .coefficients import Coefficients, Unit, read_units
from .eigen_dense import Eigenproblem, Slopes, at_row, find_blurred, join
from .eigen_sparse import SparseEigenproblem
from .exports import Export, Matrices, fit_polynomials
from .geometry import Geometry
from .inputs import Dofs, Matrix, Where, choose_dofs, read_matrix, warn_of_uncoupled


class AffineModel:
    """Constant matrices, others with their coefficients, and what solves the sums.

    Args:
        K0: Constant part of the stiffness, ``(N, N)``, dense or sparse as all are made.
        M0: Constant part of the mass.
        K: What coefficients multiply, as of :class:`MatrixModel`.
        M: The same of the mass.
        modes: Which elastic modes to return, 1 = the lowest, ascending.
        skip: Number of rigid-body modes below them.
        shapes: DOFs at which to return shapes.
        dofs: All DOFs, by number or by label; None for numbers.
        positive: What the parameters are if all must be above zero, "" for any.

    Attributes:
        rows: Where the DOFs of the shapes are in the matrices.
    """

    def __init__(
        self,
        K0: Matrix,
        M0: Matrix,
        K: Mapping[str, Unit],
        M: Mapping[str, Unit],
        modes: Sequence[int],
        skip: int,
        shapes: bool | Dofs,
        dofs: Sequence[Hashable] | None = None,
        positive: str = "",
    ) -> None:
        sparse = issparse(K0)
        self.K0: Matrix = read_matrix("K0", K0, sparse=sparse)
        size = self.K0.shape[0]
        self.M0: Matrix = read_matrix("M0", M0, size, sparse=sparse)
        self.K, of_K = read_units("K", K, size, sparse)
        self.M, of_M = read_units("M", M, size, sparse)
        self.coefficients = Coefficients((of_K, of_M), positive)
        self.names = self.coefficients.names
        self.modes, self.n_modes = tuple(modes), len(modes)
        self.skip = checks.whole_number("skip", skip)
        self.geometry: Geometry | None = None
        if self.skip + self.modes[-1] > size:
            raise ValueError(
                f"n_modes: mode {self.modes[-1]} after {self.skip} rigid-body modes "
                f"(skip), but there are only {size} DOFs"
            )
        self.dofs = range(size) if dofs is None else dofs
        chosen = choose_dofs("shapes", shapes, self.dofs)
        self.rows = tuple(chosen.values())
        self.shape_dofs = tuple(self.dofs[row] for row in self.rows)
        self.variables = modal_variables(self.n_modes, tuple(chosen))
        self.problem = sparse_problem(self) if sparse else DenseProblem(self)

    __repr__ = show_declared

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``."""
        return self.problem.solve(*self.coefficients(parameters))

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives by all parameters, from one solve.

        ``{"frequency": {parameter: (n, n_modes)}, "shapes": {parameter: (n, n_dof,
        n_modes)}}``, in Hz per unit of the parameter, of shapes that keep their signs.

        Raises:
            ValueError: As a call does, or if modes coincide that part as a parameter
                changes: they have no derivatives there.
        """
        k, m, where = self.coefficients(parameters)
        slopes = self.coefficients.slopes(parameters)
        return self.problem.jacobian(k, m, slopes, where)


class MatrixModel(AffineModel):
    r"""K and M of any FE program, dense or sparse, scaled by parameters or functions.

    .. math:: K(\theta) = K_0 + \sum_i a_i(\theta) K_i, \qquad
        M(\theta) = M_0 + \sum_j b_j(\theta) M_j, \qquad
        K \phi = (2 \pi f)^2 M \phi

    Use it whenever an FE program can export matrices; :meth:`from_differences` finds
    the :math:`K_i` from exports at several parameter values. A coefficient is a
    parameter, or any function of parameters: for a plate, ``K={"E": membrane,
    "bending": (K3, lambda E, t: E * t**3)}``. A name may occur in both K and M.

    **Dense** matrices are solved for all parameter sets at once. A constant M is
    factored once; an M that depends on parameters is factored for each set. If K0 is a
    **scipy.sparse** matrix, the others may be sparse or dense and are converted. Each
    parameter set then costs one sparse factorisation and a Lanczos iteration; an M that
    depends on parameters costs a second factorisation, to check it. Massless DOFs are
    allowed. Up to a few hundred DOFs dense matrices are much faster: give
    ``K0.toarray()`` if ``scipy.io.mmread`` returned K0. For thousands of evaluations of
    a large model, see :func:`reduce_model`.

    Args:
        K0: Constant part of the stiffness, ``(N, N)``, symmetric.
        M0: Constant part of the mass, ``(N, N)``, symmetric.
        K: ``{parameter: K_i}``, where K_i is multiplied by the parameter; or
            ``{label: (K_i, function)}``, where the function's arguments are parameter
            names. It takes arrays ``(n,)``, returns one, and costs no solve. Its
            derivatives are finite differences, exact up to fourth powers.
        M: The same for the mass.
        n_modes: Number of elastic modes to return.
        skip: Number of rigid-body modes below them, checked at each solve.
        shapes: Whether to return mass-normalised mode shapes too, ``(n, N, n_modes)``;
            or the DOFs (0 to N - 1) at which to return them, in the given order; or
            ``{label: DOF}``, with the labels that :class:`Measurements` have as
            ``dofs``.

    Raises:
        TypeError: If K0 is dense and another matrix is sparse, or a function's
            arguments have no names.
        ValueError: If a matrix is not square, symmetric or of the size of K0, a
            constant M is not positive definite, or there are not enough modes. When
            called: if M is not positive definite, the number of rigid-body modes is not
            skip, or a function returns a number that is not finite.

    Warns:
        UserWarning: If rows with mass are not coupled to any other, as for held DOFs.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import MatrixModel
        >>> k = np.array([[1.0, -1.0], [-1.0, 1.0]])
        >>> model = MatrixModel(np.diag([9.0, 0.0]), np.eye(2), {"k2": k}, n_modes=2)
        >>> model({"k2": np.array([4.0])}).frequencies.round(4).tolist()
        [[0.2506, 0.6065]]
    """

    def __init__(
        self,
        K0: Matrix,
        M0: Matrix,
        K: Mapping[str, Unit],
        M: Mapping[str, Unit] | None = None,
        *,
        n_modes: int,
        skip: int = 0,
        shapes: bool | Dofs = False,
    ) -> None:
        modes = range(1, checks.whole_number("n_modes", n_modes, 1) + 1)
        super().__init__(K0, M0, K, {} if M is None else M, modes, skip, shapes)
        warn_of_uncoupled([self.K0, *self.K.values()], [self.M0, *self.M.values()])

    @classmethod
    def from_differences(
        cls,
        base: Export,
        changes: Mapping[str, Mapping[float, Export]],
        *,
        at: Mapping[str, float] | None = None,
        n_modes: int,
        skip: int = 0,
        shapes: bool | Dofs = False,
    ) -> Self:
        r"""Return the model of matrices that a program exports at several values.

        .. math:: K(\theta) = K_0 + \sum_j \sum_{p \le 3} \theta_j^p K_{jp}

        and similarly for M. If a parameter is a factor of K or of M, one export besides
        the base is enough. From several exports, the fewest powers that fit them are
        used, at most one fewer than there are exports: three exports show that a
        thickness t enters as t and t^3, with labels "t" and "t^3" in ``model.K``.
        Parameters that multiply each other, such as E and I of one member, cannot be
        separated in this way.

        Matrices of up to 200 DOFs, all with mass, become dense, which makes a solve 3
        times (160 DOFs) to 40 times (14 DOFs) faster.

        Args:
            base: :class:`Matrices` or ``(K0, M0)``, exported at the values ``at``.
            changes: ``{parameter: {value: export}}``, with only this parameter changed;
                an export is Matrices, ``(K, M)``, or K alone if M is unchanged.
            at: The parameters' values in the base; 1 for those not given.
            n_modes: Number of elastic modes to return.
            skip: Number of rigid-body modes below them.
            shapes: As for the class.

        Returns:
            The model, with the base's ``geometry`` for drawings.

        Raises:
            TypeError: If an argument is not of the form described.
            ValueError: If a parameter changes nothing, K or M is not a polynomial in
                it, or an export has other DOFs, or is not finite and symmetric.

        Examples:
            >>> import numpy as np
            >>> from emcee_femu import MatrixModel
            >>> K, M = np.array([[3.0, -1.0], [-1.0, 1.0]]), np.eye(2)
            >>> softer = np.array([[2.0, -1.0], [-1.0, 1.0]])  # k1 = 1, not 2
            >>> model = MatrixModel.from_differences(
            ...     (K, M), {"k1": {1.0: softer}}, at={"k1": 2.0}, n_modes=1)
            >>> model.K["k1"].tolist(), model.K0.tolist()
            ([[1.0, 0.0], [0.0, 0.0]], [[1.0, -1.0], [-1.0, 1.0]])
        """
        constants, units = fit_polynomials(base, changes, {} if at is None else at)
        (K0, M0), (K, M) = constants.values(), units.values()
        model = cls(K0, M0, K, M, n_modes=n_modes, skip=skip, shapes=shapes)
        model.geometry = base.geometry if isinstance(base, Matrices) else None
        return model


def sparse_problem(model: AffineModel) -> SparseEigenproblem:
    """Return the sparse problem of a model, also where its matrices are dense."""
    K, M = (
        tuple(csc_array(matrix) for matrix in (constant, *units.values()))
        for constant, units in ((model.K0, model.K), (model.M0, model.M))
    )
    return SparseEigenproblem(K, M, model.modes, model.skip, model.rows)


class DenseProblem:
    """The dense eigenproblem of a model, and the sparse one if rounding spoils it.

    Dense solvers round all eigenvalues to a fraction of the largest, which matters if,
    say, a DOF is held by a stiffness of 1e36. Sparse factors round each row on its own
    scale.

    Args:
        model: The model, with dense matrices.
    """

    def __init__(self, model: AffineModel) -> None:
        self.model = model
        K, M = (
            np.array([constant, *units.values()])
            for constant, units in ((model.K0, model.K), (model.M0, model.M))
        )
        selected = model.skip + np.array(model.modes) - 1
        output = np.eye(len(model.K0))[list(model.rows)]
        self.dense = Eigenproblem(K, M, selected, model.skip, output)
        self._diagonals = [A.diagonal(axis1=1, axis2=2) for A in (K, M)]

    @cached_property
    def sparse(self) -> SparseEigenproblem:
        """The sparse problem, created when it is first needed."""
        return sparse_problem(self.model)

    def solve(self, k: Floats, m: Floats, describe: Where) -> ModalSolution:
        """Solve for coefficients ``k (n, n_k)`` and ``m (n, n_m)``."""
        return self._solve(k, m, None, describe)[0]

    def jacobian(
        self, k: Floats, m: Floats, slopes: Slopes, describe: Where
    ) -> tuple[ModalSolution, Derivatives]:
        """Return what :meth:`solve` does, and its derivatives, from one solve."""
        return self._solve(k, m, slopes, describe)

    def _solve(
        self, k: Floats, m: Floats, slopes: Slopes | None, describe: Where
    ) -> tuple[ModalSolution, Derivatives]:
        """Solve rows spoilt by rounding one by one; other rows are unaffected."""
        in_K, in_M = self._diagonals
        blurred = find_blurred(in_K[0] + k @ in_K[1:], in_M[0] + m @ in_M[1:])
        if blurred.any() and len(k) > 1:
            results = []
            for i in range(len(k)):
                one, at = slice(i, i + 1), partial(lambda row, _: describe(row), i)
                here = slopes and {
                    name: (by_k[None], by_m[None])
                    for name, (by_k, by_m) in at_row(slopes, i).items()
                }
                results.append(self._solve(k[one], m[one], here, at))
            return join(results)
        problem = self.sparse if blurred.any() else self.dense
        if slopes is None:
            return problem.solve(k, m, describe), {}
        return problem.jacobian(k, m, slopes, describe)
