"""Models of given stiffness and mass matrices, affine in the parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, issparse

from .. import checks
from ..interfaces import Floats, ModalSolution, Parameters, Variable, modal_variables
from .differences import affine_parts
from .eigen.dense import Eigenproblem, output_rows
from .eigen.sensitivity import Derivatives, unit_slopes
from .eigen.sparse import SparseEigenproblem, check_mass
from .eigen.symmetric import sparse_symmetric, symmetric
from .parameters import check_mapping, choose_dofs, columns, describe, read_batch

Shapes: TypeAlias = (
    bool | Sequence[int] | NDArray[np.integer] | Mapping[str, int | np.integer]
)


@dataclass(frozen=True, eq=False, init=False)
class MatrixModel:
    r"""Matrices of any FE program, dense or sparse, affine in named parameters.

    .. math:: K(\theta) = K_0 + \sum_i \theta_i K_i, \qquad
        M(\theta) = M_0 + \sum_j \theta_j M_j, \qquad
        K \phi = (2 \pi f)^2 M \phi

    A name may be in both K and M. **Dense** arrays are solved for all parameter sets
    at once; a constant M is folded into K once, one that depends on parameters is
    factored by a batched Cholesky. If K0 is a **scipy.sparse** matrix, all others may
    be sparse or dense and are made sparse; each parameter set then costs one sparse
    factorisation and a Lanczos iteration, massless DOFs are allowed, and an M that
    depends on parameters costs a second factorisation, to check it. For thousands of
    evaluations see :func:`reduce_model`.

    Args:
        K0: Constant part of the stiffness, ``(N, N)``, symmetric.
        M0: Constant part of the mass, ``(N, N)``, symmetric.
        K: ``{parameter: K_i}``, the stiffness that multiplies the parameter.
        M: ``{parameter: M_j}``, the mass that multiplies the parameter.
        n_modes: How many elastic modes to return.
        skip: Number of rigid-body modes below them, checked at each solve.
        shapes: Whether to return mass-normalised mode shapes too, ``(n, N, n_modes)``;
            or the DOFs (0 to N - 1) at which to return them, in the order given; or
            ``{label: DOF}``, labels as :class:`Measurements` have them as ``dofs``.

    Raises:
        TypeError: If K0 is dense and another matrix is sparse.
        ValueError: If a matrix is not square, symmetric or of the size of K0, M is
            constant and not positive definite, or there are not enough modes. When
            called: if M is not positive definite, or the number of rigid-body modes
            is not skip.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import MatrixModel
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
    variables: Mapping[str, Variable] = field(repr=False)
    names: tuple[str, ...] = field(repr=False)
    required: tuple[str, ...] = field(repr=False)
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
        shapes: Shapes = False,
    ) -> None:
        read = sparse_symmetric if issparse(K0) else symmetric
        stiffness = read("K0", K0)
        size = stiffness.shape[0]
        units = {"K": K, "M": {} if M is None else M}
        for label, given in units.items():
            check_mapping(label, given, "{parameter: matrix}")
        K, M = (
            {name: read(f"{label}[{name!r}]", given[name], size) for name in given}
            for label, given in units.items()
        )
        if names := tuple(dict.fromkeys([*K, *M])):
            checks.parameter_names("K, M", names)
        n_modes = checks.whole_number("n_modes", n_modes, 1)
        skip = checks.whole_number("skip", skip)
        if skip + n_modes > size:
            raise ValueError(
                f"n_modes: expected skip + n_modes <= {size} (the DOFs of K0), "
                f"got {skip} + {n_modes}"
            )
        labels = dofs = choose_dofs(
            [*shapes.values()] if isinstance(shapes, Mapping) else shapes, range(size)
        )
        if isinstance(shapes, Mapping):
            labels = checks.parameter_names("shapes", shapes)
        checks.set_fields(
            self,
            K0=stiffness,
            M0=read("M0", M0, size),
            K=K,
            M=M,
            n_modes=n_modes,
            skip=skip,
            shape_dofs=dofs,
            variables=modal_variables(n_modes, labels),
            names=names,
            required=names,
        )
        build = sparse_problem if issparse(K0) else _dense_problem
        checks.set_fields(self, _problem=build(self))

    @classmethod
    def from_differences(
        cls,
        base: Any,
        changes: Mapping[str, Mapping[float, Any]],
        *,
        at: Mapping[str, float] | None = None,
        n_modes: int,
        skip: int = 0,
        shapes: Shapes = False,
    ) -> Self:
        r"""Return the model of matrices that a program exports at several values.

        .. math:: K_j = \frac{K(\theta_j = b) - K(\theta_j = a)}{b - a}, \qquad
            K_0 = K - \sum_j a_j K_j

        and M alike; a is the value at the base. One export for each parameter is
        enough; each further one is compared with the line through the base and the
        one that is farthest. Two exports are on a line whatever they are: give three
        unless the parameter is known to be a factor of K or of M. Parameters that
        multiply each other, E and I of one member, are not affine together.

        Args:
            base: :class:`Matrices`, or ``(K0, M0)``, at the values ``at``.
            changes: ``{parameter: {value: export}}``, only this parameter changed;
                an export is Matrices, ``(K, M)``, or K alone where M is the same.
            at: The parameters' values at the base; 1 where it does not say.
            n_modes: As above.
            skip: As above.
            shapes: As above.

        Returns:
            The model.

        Raises:
            TypeError: If an argument is not of the form described.
            ValueError: If a parameter changes nothing, K or M is not affine in it, or
                an export has other DOFs, or is not finite and symmetric.

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
        constants, units = affine_parts(base, changes, {} if at is None else at)
        return cls(*constants, *units, n_modes=n_modes, skip=skip, shapes=shapes)

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``."""
        return self._problem.solve(*self._coefficients(parameters))

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives by all parameters, from one solve.

        ``{"frequency": {parameter: (n, n_modes)}, "shapes": {parameter: (n, n_dof,
        n_modes)}}``, in Hz per unit of the parameter, of shapes that keep their signs.

        Raises:
            ValueError: As a call does, or if modes coincide that part as a parameter
                changes: they have no derivatives there.
        """
        k, m, name_set = self._coefficients(parameters)
        return self._problem.jacobian(k, m, unit_slopes(self.K, self.M), name_set)

    def _coefficients(
        self, parameters: Parameters
    ) -> tuple[Floats, Floats, Callable[[int], str]]:
        """Return the coefficients of K and M, and what names a parameter set."""
        values, n = read_batch(parameters, self.names)
        where = partial(describe, values, self.names)
        return columns(values, self.K, n), columns(values, self.M, n), where


def sparse_problem(model: MatrixModel) -> SparseEigenproblem:
    """Return the sparse problem of a model, also where its matrices are dense."""
    K, M = (
        tuple(csc_array(matrix) for matrix in (constant, *units.values()))
        for constant, units in ((model.K0, model.K), (model.M0, model.M))
    )
    if not model.M:
        check_mass(M[0], "M0")
    return SparseEigenproblem(K, M, model.n_modes, model.skip, model.shape_dofs)


def _dense_problem(model: MatrixModel) -> Eigenproblem:
    if not model.M:
        try:
            np.linalg.cholesky(model.M0)
        except np.linalg.LinAlgError:
            raise ValueError(
                "M0: expected a positive definite matrix; remove massless DOFs "
                "by static condensation, or give scipy.sparse matrices"
            ) from None
    return Eigenproblem(
        np.array([model.K0, *model.K.values()]),
        np.array([model.M0, *model.M.values()]),
        selected=tuple(range(model.skip, model.skip + model.n_modes)),
        skip=model.skip,
        shapes=bool(model.shape_dofs),
        output=output_rows(model.shape_dofs, len(model.K0)),
    )
