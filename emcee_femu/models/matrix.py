"""Models from given matrices and their coefficients: of modes, and of static tests."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from copy import copy
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import issparse

from .. import checks
from ..contracts import (
    Derivatives,
    Floats,
    ModalSolution,
    Parameters,
    Variable,
    modal_variables,
    read_declared,
    show_declared,
)
from ..measurements.directions import along_axis
from .coefficients import Coefficients, Unit, read_units
from .eigen_dense import Eigenproblem, ModeRequest, combine
from .eigen_sparse import DenseProblem, SparseEigenproblem, SparseSum
from .factorization import factor_definite
from .geometry import Geometry
from .matrices import Matrix, read_matrix, refuse_empty, warn_of_uncoupled
from .polynomials import Export, fit_polynomials
from .sensors import Dofs, choose_sensors


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
        sensors: What is returned of the shapes.
        parts: The matrices of K and those of M, the constant ones first.
        wanted: The modes and DOFs that are returned.
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
        self.sensors = choose_sensors("shapes", shapes, self.dofs)
        self.shape_dofs = tuple(self.dofs[row] for row in self.sensors.rows)
        self.variables = modal_variables(self.n_modes, self.sensors.labels)
        self.parts: tuple[list[Matrix], list[Matrix]]
        self.parts = [self.K0, *self.K.values()], [self.M0, *self.M.values()]
        refuse_empty(*self.parts, self.dofs)
        self.problem: SparseEigenproblem | DenseProblem | Eigenproblem
        kind = SparseEigenproblem if sparse else DenseProblem
        self.wanted = ModeRequest(self.modes, self.skip, self.sensors)
        self.problem = kind(*self.parts, self.wanted)

    __repr__ = show_declared

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``."""
        return self.problem.solve(*self.coefficients(parameters), {})[0]

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives by all parameters, from one solve.

        ``{"frequency": {parameter: (n, n_modes)}, "shapes": {parameter: (n, n_dof,
        n_modes)}}``, in Hz per unit of the parameter, of shapes that keep their signs.

        Raises:
            ValueError: As a call does, or if modes coincide that part as a parameter
                changes: they have no derivatives there.
        """
        slopes = self.coefficients.slopes(parameters)
        return self.problem.solve(*self.coefficients(parameters), slopes)

    def matrices(self, values: Mapping[str, float]) -> tuple[Matrix, Matrix]:
        """Return K and M of one parameter set."""
        one = {name: np.array([value]) for name, value in values.items()}
        (k, m), _ = self.coefficients(one)
        return self.problem.stiffness(k[0]), self.problem.mass(m[0])

    def static(
        self,
        loads: Mapping[str, ArrayLike | Mapping[Hashable, float]],
        *,
        points: Dofs | None = None,
        unit: str = "m",
    ) -> StaticModel:
        """Return a static test of the same structure, by the same parameters.

        Args:
            loads: ``{load case: {DOF: force}}``, DOFs as in ``model.dofs``.
            points: Where displacements are measured, as of :class:`StaticModel`.
            unit: Their unit, a label as for :class:`StaticModel`: ``"m"`` if K is in
                N/m and the forces are in N.

        Returns:
            The :class:`StaticModel`.

        Raises:
            ValueError: As :class:`StaticModel` does.
        """
        K = dict[str, Unit](self.K)
        for label, (_, function) in self.coefficients.parts[0].items():
            if function is not None:
                K[label] = self.K[label], function
        return StaticModel(self.K0, loads, K, points=points, unit=unit, dofs=self.dofs)

    def project(self, K: Floats, M: Floats, output: Floats) -> Self:
        """Return the model in a basis, from its projected parts and shapes.

        It keeps no large matrix, and can be sent to other processes.
        """
        small = copy(self)
        small.parts = [*K], [*M]
        (small.K0, *of_K), (small.M0, *of_M) = small.parts
        small.K = dict(zip(self.K, of_K, strict=True))
        small.M = dict(zip(self.M, of_M, strict=True))
        small.problem = Eigenproblem(K, M, self.wanted, output)
        return small


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
            ``dofs``. A sensor that measures several DOFs is ``{label: {DOF: factor}}``.

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
        warn_of_uncoupled(*self.parts)

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

        Matrices of up to 200 DOFs, all with mass, become dense, which makes a solve
        several times faster, the more so the fewer DOFs there are.

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
        model.geometry = read_declared(base, "geometry")
        return model


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
            dof}``; None for all. For a sensor that measures several, such as a skew
            one, ``{label: {dof: factor}}``.
        unit: The unit of the displacements, a label: nothing is converted. It must be
            the one that follows from K and the loads, and that of the measurements: m
            for K in N/m and loads in N, mm for K in N/mm and loads in N.
        dofs: Labels of the DOFs, by which loads and points are then given; None for
            numbers. ``FrameModel.static`` gives ``"8:uz"``.

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

        In N and m, a spring of 2e6 N/m under 10 kN gives way by 5 mm:

        >>> spring = StaticModel([[0.0]], {"pull": [10e3]}, {"k": [[1.0]]}, unit="m")
        >>> spring({"k": np.array([2e6])})["displacement"].item()
        0.005
    """

    def __init__(
        self,
        K0: Matrix,
        loads: Mapping[str, ArrayLike | Mapping[Hashable, float]],
        K: Mapping[str, Unit],
        *,
        points: Dofs | None = None,
        unit: str = "m",
        dofs: Sequence[Hashable] | None = None,
    ) -> None:
        sparse = issparse(K0)
        self.K0: Matrix = read_matrix("K0", K0, sparse=sparse)
        size = self.K0.shape[0]
        self.K, of_K = read_units("K", K, size, sparse)
        self.coefficients = Coefficients((of_K,))
        self.names = self.coefficients.names
        self.dofs = range(size) if dofs is None else dofs
        self.cases = tuple(checks.by_label("loads", loads, "forces"))
        forces = [_read_force(case, force, self.dofs) for case, force in loads.items()]
        self._forces = np.stack(forces, axis=1)  # (N, cases)
        every = True if points is None else points
        self.sensors = choose_sensors("points", every, self.dofs)
        coords = {"load_case": self.cases, "point": list(self.sensors.labels)}
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
        (k,), where = self.coefficients(parameters)
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
        return [self.sensors.of(part).swapaxes(-1, -2) for part in every]


def _indefinite(where: str) -> ValueError:
    return ValueError(
        f"K: the stiffness is not positive definite at {where}: do the supports hold "
        "the structure, and are their rows taken out? Or is a parameter negative?"
    )


def _read_force(
    case: str, value: ArrayLike | Mapping[Hashable, float], dofs: Sequence[Hashable]
) -> Floats:
    """Return the forces ``(N,)`` of a load case."""
    label = f"loads[{case!r}]"
    if isinstance(value, Mapping):
        force = np.zeros(len(dofs))
        sides = [along_axis(dof)[1] for dof in value]  # a force along "2:-ux"
        places = choose_sensors(label, tuple(value), dofs).rows
        for place, side, number in zip(places, sides, value.values(), strict=True):
            force[place] = side * checks.real_number(label, number)
    elif isinstance(value, int | float):
        example = {"case": {case: value}}
        raise TypeError(
            f"{label}: expected the forces of a load case, {{DOF: force}}, got "
            f"{value}; a case has a name, as in loads={example}"
        )
    else:
        force = checks.shaped_array(label, value, (len(dofs),))
    if not force.any():
        raise ValueError(f"{label}: expected forces that are not all zero")
    return force
