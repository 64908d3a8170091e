"""A function that assembles K and M, whose eigenproblem is solved here."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from copy import copy
from functools import partial
from typing import Self, TypeAlias

import numpy as np
from scipy.sparse import issparse

from .. import checks
from ..contracts import (
    Derivatives,
    Floats,
    ModalSolution,
    Parameters,
    modal_variables,
    placed,
    read_declared,
    show_declared,
)
from .eigen_dense import Eigenproblem, ModeRequest, Modes, join
from .eigen_sparse import DenseProblem, SparseEigenproblem
from .geometry import Geometry
from .matrices import Matrix, read_matrix
from .matrix import AffineModel
from .parameter_sets import read_batch
from .sensors import Dofs, choose_sensors

MATRIX_STEP = 1e-4  # of a parameter's value: matrices are then known to some 1e-8
UNBOUNDED_DOFS = 10**9  # DOFs, before it is known how many there are

Assemble: TypeAlias = Callable[[dict[str, float]], tuple[Matrix, Matrix]]


class AssembledModel:
    r"""A model from a function that assembles K and M; modes are computed here.

    .. math:: K(\theta) \phi = (2 \pi f)^2 M(\theta) \phi, \qquad
        \lambda' = \phi^T (K' - \lambda M') \phi

    Use it if the matrices are not sums of given parts (see :class:`MatrixModel`): for a
    Poisson ratio, the position of a spring, scikit-fem, or a program that writes
    matrices without solving. K' and M' are central differences and cost two assemblies
    per parameter, but no eigenproblem. Shapes have derivatives too. A solve costs one
    assembly and one eigenproblem.

    Args:
        assemble: A function from ``{name: float}`` to ``(K, M)``, each ``(N, N)``,
            symmetric, dense or scipy.sparse, without the supported DOFs.
        names: The parameters that it reads.
        n_modes: Number of elastic modes to return.
        skip: Number of rigid-body modes below them, checked at each solve.
        shapes: The DOFs at which to return mass-normalised mode shapes, in the given
            order, or ``{label: DOF}``, or ``{label: {DOF: factor}}``; False for none.

    Raises:
        TypeError: If assemble is not callable, or shapes is True (the number of DOFs is
            only known at the first solve).
        ValueError: If a name or a DOF is repeated. When called: if a matrix is not
            finite, square and symmetric, M is not positive definite, or the number of
            rigid-body modes is not skip.

    Examples:
        >>> import numpy as np
        >>> import emcee_femu as ef
        >>> def assemble(p):  # two masses; how far up the spring is held
        ...     part = p["a"] ** 2
        ...     return np.array([[2.0, -1.0], [-1.0, 1.0 + part]]), np.eye(2)
        >>> model = ef.AssembledModel(assemble, ["a"], n_modes=2)
        >>> model({"a": np.array([0.0, 1.0])}).frequencies.round(4).tolist()
        [[0.0984, 0.2575], [0.1592, 0.2757]]
    """

    one_by_one = True
    dofs: Sequence[Hashable] | None = None
    geometry: Geometry | None = None
    bounds: Mapping[str, tuple[float, float]] = {}

    def __init__(
        self,
        assemble: Assemble,
        names: Iterable[str],
        *,
        n_modes: int,
        skip: int = 0,
        shapes: bool | Dofs = False,
    ) -> None:
        checks.function("assemble", assemble)
        self.assemble, self.names = assemble, checks.parameter_names("names", names)
        self.n_modes = checks.whole_number("n_modes", n_modes, 1)
        self.modes = tuple(range(1, self.n_modes + 1))
        self.skip = checks.whole_number("skip", skip)
        if shapes is True:
            raise TypeError(
                "shapes: expected DOFs, or {label: DOF}, got True; how many DOFs there "
                "are is not known before the first solve"
            )
        self.sensors = choose_sensors("shapes", shapes, range(UNBOUNDED_DOFS))
        self.shape_dofs: tuple[Hashable, ...] = self.sensors.rows
        self.variables = modal_variables(self.n_modes, self.sensors.labels)
        self._output: Floats | None = None  # of a basis, at these DOFs

    @classmethod
    def from_frame(
        cls,
        frame: Callable[[dict[str, float]], AffineModel],
        at: Mapping[str, float],
    ) -> Self:
        """Return the model of a frame whose geometry depends on parameters too.

        Use it for a coordinate that is not known: where a roller stands, where a crack
        or a joint is, where a sensor was. A solve costs one assembly of the frame and
        one eigenproblem; the parameter sets of a batch are solved one by one.

        Args:
            frame: A function from ``{name: float}`` to a :class:`FrameModel` (or
                another model that is a sum of matrices) with the modes and shapes that
                are wanted. It may read parameters for coordinates, offsets and whatever
                else is a number there; those that its sections name are read by name.
            at: ``{name: value}`` of all parameters, at which the frame is built once,
                for its DOFs and for drawings.

        Returns:
            The model, with the DOFs, sensors and bounds of the frame.

        Raises:
            TypeError: If frame does not return such a model.
            ValueError: If ``at`` lacks a parameter that the frame names. When called:
                if the frame has other DOFs than it had at first, or as for a call.

        Examples:
            >>> import emcee_femu as ef
            >>> pipe = ef.Section(E=(2.1e11, "E"), rho=7850, A=2e-3, I=3e-6)
            >>> def beam(p):  # 4 m, clamped, and a roller at x
            ...     nodes = [(0, 0), (p["x"] / 2, 0), (p["x"], 0), (4, 0)]
            ...     bars = [(0, 1, "pipe"), (1, 2, "pipe"), (2, 3, "pipe")]
            ...     supports = {0: "fixed", 2: "roller"}
            ...     return ef.FrameModel(nodes, bars, {"pipe": pipe}, supports,
            ...                          n_modes=2, plane="xy")
            >>> model = ef.AssembledModel.from_frame(beam, {"E": 1.0, "x": 3.0})
            >>> model({"E": [1.0, 1.0], "x": [3.0, 2.5]}).frequencies.round(1).tolist()
            [[43.0, 90.6], [29.5, 99.5]]
        """
        checks.function("frame", frame)
        names = checks.parameter_names("at", checks.mapping("at", at, "{name: value}"))
        point = dict(zip(names, checks.numbers_by_name("at", at, names), strict=True))
        built = checks.instance("frame", frame(dict(point)), AffineModel)
        if missing := [name for name in built.names if name not in names]:
            raise ValueError(f"at: no value of {missing}, which the frame names")
        assemble = partial(_assemble_frame, frame, built.dofs)
        model = cls(assemble, names, n_modes=built.n_modes, skip=built.skip)
        model.modes, model.sensors = built.modes, built.sensors
        model.shape_dofs, model.variables = built.shape_dofs, built.variables
        model.dofs, model.geometry = built.dofs, built.geometry
        model.bounds = read_declared(built, "bounds") or {}
        return model

    __repr__ = show_declared

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``."""
        return self._solve(parameters, ())[0]

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives by all parameters, from one solve.

        The format is that of ``MatrixModel.jacobian``. Two assemblies per parameter
        are added.

        Raises:
            ValueError: As for a call, or if two modes coincide that separate as a
                parameter changes.
        """
        return self._solve(parameters, self.names)

    def matrices(self, values: Mapping[str, float]) -> tuple[Matrix, Matrix]:
        """Return K and M of one parameter set, checked.

        Raises:
            TypeError: If they are not a pair of matrices.
            ValueError: If they are not finite, symmetric and of the same size.
        """
        pair = checks.group("assemble", self.assemble(dict(values)), "(K, M)", 2)
        sparse = issparse(pair[0])
        K = read_matrix("assemble: K", pair[0], sparse=sparse)
        size = K.shape[0]
        last = max(self.sensors.rows, default=0) if self._output is None else 0
        if last >= size or self.skip + self.n_modes > size:
            raise ValueError(
                f"assemble: expected matrices with DOF {last} of shapes, and at least "
                f"skip + n_modes = {self.skip + self.n_modes} rows, got {size}"
            )
        return K, read_matrix("assemble: M", pair[1], size, sparse=sparse)

    def project(self, V: Floats, added: float) -> Self:
        """Return the model in a basis: one assembly and one small problem per solve.

        Args:
            V: The basis, ``(N, r)``.
            added: What is added to the diagonal of the projected mass.
        """
        small = copy(self)
        small.assemble = partial(_project, self, V, added)
        small._output = self.sensors.of(V)
        return small

    def _solve(self, parameters: Parameters, by: tuple[str, ...]) -> Modes:
        """Solve parameter sets one by one, with derivatives by some parameters."""
        values, n = read_batch(parameters, self.names)
        results = []
        for i in range(n):
            row = {name: float(values[name][i]) for name in self.names}
            with placed(row, self.names):
                results.append(self._solve_one(row, by))
        return join(results)

    def _solve_one(self, row: dict[str, float], by: tuple[str, ...]) -> Modes:
        K, M = ([matrix] for matrix in self.matrices(row))
        for name in by:
            step = MATRIX_STEP * (abs(row[name]) or 1.0)
            sides = [row | {name: row[name] + move} for move in (step, -step)]
            ahead, behind = map(self.matrices, sides)
            for units, high, low in zip((K, M), ahead, behind, strict=True):
                units.append((high - low) / (2 * step))
        label = f"the mass matrix at {row}"
        problem: SparseEigenproblem | DenseProblem | Eigenproblem
        wanted = ModeRequest(self.modes, self.skip, self.sensors)
        if self._output is None:
            kind = SparseEigenproblem if issparse(K[0]) else DenseProblem
            problem = kind(K, M, wanted, label)
        else:
            parts = np.array(K), np.array(M)
            problem = Eigenproblem(*parts, wanted, self._output, label)
        still = np.zeros((1, len(by)))
        each = np.eye(len(by))[:, None]
        slopes = {name: (one, one) for name, one in zip(by, each, strict=True)}
        return problem.solve([still, still], lambda _: str(row), slopes)


def _assemble_frame(
    frame: Callable[[dict[str, float]], AffineModel],
    dofs: Sequence[Hashable],
    values: dict[str, float],
) -> tuple[Matrix, Matrix]:
    """Return K and M of a frame at one parameter set."""
    built = frame(dict(values))
    if [*built.dofs] != [*dofs]:
        raise ValueError(
            f"frame: expected its first {len(dofs)} DOFs at {values}, got others; only "
            "numbers may depend on parameters, not supports or the number of nodes"
        )
    return built.matrices({name: values[name] for name in built.names})


def _project(
    model: AssembledModel, V: Floats, added: float, values: Mapping[str, float]
) -> tuple[Floats, Floats]:
    """Return K and M of one parameter set in a basis."""
    K, M = (V.T @ (matrix @ V) for matrix in model.matrices(values))
    return K, M + added * np.eye(V.shape[1])
