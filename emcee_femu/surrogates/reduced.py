"""A model reduced to a few shapes, which knows its bounds and its certified error.

Mode shapes of full solves are a Ritz basis: at the centre of the bounds, then where the
nearest earlier solve is farthest, until a few in a row bring nothing new. Its principal
directions (proper orthogonal decomposition), as few as keep the frequencies, make the
reduced model. Full solves at independent points certify it; those where it fails join
the basis.
"""

import time
import timeit
import warnings
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csc_array, issparse
from scipy.stats import qmc

from .. import checks
from ..interfaces import (
    Derivatives,
    Floats,
    ModalSolution,
    Parameters,
    Variable,
    modal_variables,
)
from ..models.coefficients import Coefficients
from ..models.eigen_dense import Eigenproblem, combine
from ..models.inputs import Weights, read_inside
from ..models.matrix import MatrixModel, sparse_problem
from ..table import Parts, Report

INSIDE, CORNERS = 128, 32  # points for the basis
CHECKED = 96  # of these, where a basis is compared with its principal directions
INWARDS = 0.95  # of corners that certify, what is near them is for the basis
GOOD = 3  # full solves in a row that bring nothing new
SAFETY = 0.5  # what the truncation may cost, as a share of the tolerance
RESERVE = 0.2  # share of that for the basis before truncation
RIGID_WEIGHT = 1e3  # so that rigid motions stay in a basis of any size
DEPENDENT = 1e-7  # share of a shape's energy norm; what is new in it must be more
BUFFER = 2  # extra modes, so that those which cross the wanted ones are in the basis
CLOSE = 0.02  # modes nearer to each other in frequency mix their shapes
MISSED = 1e-6  # a Ritz frequency this much below the full one, relatively, is an error
PAYS = 3.0  # a smaller speed-up is worth a warning
BATCH = 16  # parameter sets in the batch that is timed

# Of K and of M in a basis, (1 + n_k, r, r) and (1 + n_m, r, r), constants first.
Matrices: TypeAlias = tuple[Floats, Floats]
Modes: TypeAlias = tuple[Floats, Floats]  # eigenvalues (m,) and shapes (N, m)


@dataclass(frozen=True, eq=False)
class ReducedModel(Report):
    """A modal model in a Ritz basis, solved for all parameter sets at once.

    Made by :func:`reduce_model`. Like any Ritz approximation it bounds each
    frequency from above (massless DOFs get a little mass, which lowers it by a small
    share of the tolerance). **Certified** is ``max_error``: the largest relative error
    of any frequency at ``test_points`` points that were not used to build the basis,
    half of them corners of the bounds, each solved in full. This is no bound over the
    whole box: after n points drawn at random, with 95 % confidence less than 3 / n of
    the box errs more. **Shapes are measured, not certified**: ``shape_error`` is the
    largest 1 - MAC there (mass-weighted, over all DOFs), each shape against the space
    of the full modes within 2 % of its frequency, because single shapes of close modes
    turn into each other. It grows like the frequency error divided by the gap, and is
    not held below the tolerance.

    Attributes:
        bounds: ``{parameter: (low, high)}``; the model refuses values outside.
        n_modes: Number of frequencies.
        shape_dofs: DOFs of the full model at which shapes are returned; () for none.
        tolerance: The demanded frequency error.
        max_error: The certified relative frequency error, below the tolerance.
        shape_error: Largest 1 - MAC at the test points.
        test_points: Number of points of the certificate.
        size: Number of basis vectors.
        full_size: Number of DOFs of the full model.
        full_solves: Full solves spent, the certificate included.
        speed_up: Time of the full model over that of this one, per parameter set, in
            a batch of 16; measured when the model was made.
    """

    bounds: Mapping[str, tuple[float, float]]
    n_modes: int
    shape_dofs: tuple[Hashable, ...] = field(repr=False)
    tolerance: float
    max_error: float
    shape_error: float
    test_points: int
    size: int
    full_size: int
    full_solves: int
    speed_up: float
    _coefficients: Coefficients = field(repr=False)
    _problem: Eigenproblem = field(repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the model depends on."""
        return tuple(self.bounds)

    @property
    def variables(self) -> Mapping[str, Variable]:
        """Frequencies, and shapes where it returns them."""
        return modal_variables(self.n_modes, self.shape_dofs)

    def _parts(self) -> Parts:
        return (
            f"{self.full_size} DOFs reduced to {self.size} basis vectors, "
            f"{self.n_modes} modes, {len(self.bounds)} parameters",
            f"largest frequency error {self.max_error:.1e} at {self.test_points} test "
            f"points (tolerance {self.tolerance:.0e})",
            f"largest 1 - MAC of a shape there {self.shape_error:.1e} (not certified)",
            f"{self.full_solves} full solves; {self.speed_up:.0f} times faster than "
            "the full model",
        )

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``.

        Raises:
            ValueError: If a parameter is missing or outside the bounds.
        """
        read_inside(parameters, self.bounds, "reduce")
        return self._problem.solve(*self._coefficients(parameters))

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives, those of the reduced model.

        Raises:
            ValueError: As a call does, or if modes coincide that part as a parameter
                changes; see :meth:`MatrixModel.jacobian`.
        """
        read_inside(parameters, self.bounds, "reduce")
        k, m, where = self._coefficients(parameters)
        slopes = self._coefficients.slopes(parameters)
        return self._problem.jacobian(k, m, slopes, where)


def reduce_model(
    model: MatrixModel,
    bounds: Mapping[str, tuple[float, float]],
    tolerance: float = 1e-4,
    *,
    test_points: int = 40,
    max_solves: int = 200,
    seed: int = 0,
) -> ReducedModel:
    """Return a small model that stands in for a large one inside ``bounds``.

    A Ritz basis is built from mode shapes at points that fill the bounds, until it
    brings nothing new. Full solves at independent points then certify it.

    Args:
        model: The full model, dense or sparse.
        bounds: ``{parameter: (low, high)}`` for every parameter of the model.
        tolerance: Largest relative error of a frequency, at the test points.
        test_points: Number of independent test points, half of them corners of the
            bounds, half drawn at random inside them.
        max_solves: How many full solves may be spent, tests included.
        seed: Seed of the points.

    Returns:
        The reduced model, with its certificate.

    Raises:
        TypeError: If model is not a MatrixModel.
        ValueError: If bounds do not fit the parameters, or the tolerance is not
            reached with ``max_solves`` full solves.

    Warns:
        UserWarning: If the reduction does not pay.

    Examples:
        >>> import numpy as np
        >>> from scipy.sparse import csc_array, diags_array
        >>> import emcee_femu as ef
        >>> n = 1000  # masses in a row; the springs of either half have one stiffness
        >>> unit = csc_array(np.eye(n))
        >>> B = csc_array(diags_array([np.ones(n), -np.ones(n - 1)], offsets=[0, -1]))
        >>> halves = {"low": B[: n // 2], "high": B[n // 2 :]}
        >>> K = {name: half.T @ half for name, half in halves.items()}
        >>> full = ef.MatrixModel(0 * unit, unit, K, n_modes=2)
        >>> bounds = {"low": (0.5, 2.0), "high": (0.5, 2.0)}
        >>> small = ef.reduce_model(full, bounds, tolerance=1e-3, test_points=4)
        >>> small.size < 20, small.max_error < 1e-3
        (True, True)
        >>> at = {"low": np.array([0.7]), "high": np.array([1.6])}
        >>> bool(np.allclose(small(at).frequencies, full(at).frequencies, rtol=1e-3))
        True
    """
    checks.instance("model", model, MatrixModel)
    box = _read_bounds(bounds, model.names)
    tolerance = checks.real_number("tolerance", tolerance)
    if not 1e-9 <= tolerance <= 0.1:
        raise ValueError(
            f"tolerance: expected 1e-9 (rounding) to 0.1, got {tolerance:g}"
        )
    n_tests = checks.whole_number("test_points", test_points, 2)
    max_solves = checks.whole_number("max_solves", max_solves, n_tests + 1 + GOOD)
    rng = np.random.default_rng(checks.whole_number("seed", seed))
    corners = np.unique(rng.integers(0, 2, size=(1024, len(box))), axis=0).astype(float)
    rng.shuffle(corners)
    certified, trained = corners[: n_tests // 2], corners[n_tests // 2 :][:CORNERS]
    near = 0.5 + INWARDS * (certified - 0.5)
    inside = qmc.Sobol(len(box), seed=rng).random(INSIDE)
    candidates = np.concatenate([trained, near, inside])
    basis, target = _Basis(model, box, tolerance), SAFETY * tolerance
    while True:
        basis.grow(candidates, RESERVE * target, max_solves - n_tests)
        V, matrices = basis.truncate(candidates[:CHECKED], target)
        rest = rng.uniform(size=(n_tests - len(certified), len(box)))
        tests = np.concatenate([certified, rest])
        comparisons = [basis.compare(V, matrices, point) for point in tests]
        errors = np.array([error for error, _, _ in comparisons])
        if errors.max() <= tolerance:
            break
        if len(basis.points) + n_tests >= max_solves:
            raise _not_reached(tolerance, errors.max(), len(basis.points))
        # Look closer there; certify at new points, and corners that were good.
        for i in np.flatnonzero(errors > target):
            basis.append(*comparisons[i][2])
        certified = certified[errors[: len(certified)] <= target]
        target *= 0.3
    dofs = list(model.shape_dofs)
    labels = model.variables["shapes"].coords["dof"] if dofs else ()
    reduced = ReducedModel(
        bounds=box,
        n_modes=model.n_modes,
        shape_dofs=tuple(labels),
        tolerance=tolerance,
        max_error=float(errors.max()),
        shape_error=max(lost for _, lost, _ in comparisons),
        test_points=n_tests,
        size=V.shape[1],
        full_size=len(V),
        full_solves=len(basis.points),
        speed_up=np.nan,
        _coefficients=model.coefficients,
        _problem=basis.reduce(matrices, V[dofs]),
    )
    speed_up = _measure_speed_up(model, reduced)
    if reduced.size >= reduced.full_size or speed_up < PAYS:
        warnings.warn(
            f"the reduction does not pay: {reduced.size} basis vectors for "
            f"{reduced.full_size} DOFs, {speed_up:.2g} times the speed of the full "
            "model; use the latter, narrower bounds or a larger tolerance",
            UserWarning,
            stacklevel=2,
        )
    return replace(reduced, speed_up=speed_up)


class _Basis:
    """Shapes of a model at points of the unit cube of its parameters.

    Attributes:
        points: Where it was solved in full.
        V: The shapes, orthonormal in the energy A, ``(N, r)``.
        snapshots: The shapes as they were solved for, scaled to unit energy.
    """

    def __init__(
        self,
        model: MatrixModel,
        bounds: dict[str, tuple[float, float]],
        tolerance: float,
    ) -> None:
        self.model, self.bounds, self.problem = model, bounds, sparse_problem(model)
        self.points: list[Floats] = []
        centre = np.full(len(bounds), 0.5)
        eigenvalues, shapes = self.solve(centre)
        k, m, _ = self.coefficients(centre[None])
        M = self.problem.mass(m[0])
        self.shift = 0.1 * float(eigenvalues[model.skip]) if model.skip else 0.0
        self.A = csc_array(self.problem.stiffness(k[0]) + self.shift * M)
        # A little mass keeps that of massless DOFs definite: 0.5 % of the tolerance.
        added = 0.0 if M.diagonal().all() else 0.01 * tolerance / float(eigenvalues[-1])
        M0, *units = self.problem.M
        self.terms = self.problem.K, (csc_array(M0 + added * self.A), *units)
        self.V, self.snapshots = np.empty((len(shapes), 0)), list[Floats]()
        self.append(eigenvalues, shapes)

    def parameters(self, points: Floats) -> dict[str, Floats]:
        """Return the parameters at points of the unit cube, ``(n, d)``."""
        low, high = np.array([*self.bounds.values()]).T
        values = np.clip(low + points * (high - low), low, high)  # rounding, by an ulp
        return dict(zip(self.bounds, values.T, strict=True))

    def coefficients(self, points: Floats) -> Weights:
        """Return those of K and of M there, and what names a point in a message."""
        k, m, where = self.model.coefficients(self.parameters(points))
        return k, m, where

    def solve(self, point: Floats) -> Modes:
        """Solve in full at one point, with rigid-body modes and some more."""
        k, m, where = self.coefficients(point[None])
        massive = int(np.count_nonzero(self.problem.mass(m[0]).diagonal()))
        count = min(self.model.skip + self.model.n_modes + BUFFER, massive)
        self.points.append(point)
        return self.problem.lowest(k[0], m[0], count, where(0))

    def append(self, eigenvalues: Floats, shapes: Floats) -> None:
        """Add mode shapes ``(N, n)``."""
        new = shapes / np.sqrt(np.abs(eigenvalues) + self.shift)  # unit energy
        rigid = np.arange(new.shape[1]) < self.model.skip
        self.snapshots.append(new * np.where(rigid, RIGID_WEIGHT, 1.0))
        for _ in range(2):  # once leaves the rounding of a difference behind
            new = new - self.V @ (self.V.T @ (self.A @ new))
        energy, directions = np.linalg.eigh(new.T @ (self.A @ new))
        kept = energy > DEPENDENT**2
        directions = directions[:, kept] / np.sqrt(energy[kept])
        self.V = np.hstack([self.V, new @ directions])

    def project(self) -> Matrices:
        """Return the matrices of the full model in the basis."""
        K, M = (
            np.array([self.V.T @ (unit @ self.V) for unit in units])
            for units in self.terms
        )
        return K, M

    def grow(self, candidates: Floats, target: float, allowed: int) -> None:
        """Solve at points far from all earlier ones until nothing new is found."""
        errors: list[float] = []
        while len(errors) < GOOD or max(errors[-GOOD:]) > target:
            if len(self.points) >= allowed:
                worst = max(errors[-GOOD:], default=np.inf)
                raise _not_reached(target, worst, len(self.points))
            gaps = ((candidates[:, None] - np.array(self.points)) ** 2).sum(axis=2)
            farthest = candidates[np.argmax(gaps.min(axis=1))]
            error, _, modes = self.compare(self.V, self.project(), farthest)
            self.append(*modes)
            errors.append(error)

    def reduce(self, matrices: Matrices, output: Floats) -> Eigenproblem:
        """Return the dense problem in a basis; ``output`` rows map to the DOFs."""
        skip, n_modes = self.model.skip, self.model.n_modes
        return Eigenproblem(*matrices, skip + np.arange(n_modes), skip, output)

    def truncate(self, points: Floats, target: float) -> tuple[Floats, Matrices]:
        """Return the fewest principal directions that keep all frequencies there."""
        coordinates = self.V.T @ (self.A @ np.hstack(self.snapshots))
        directions = np.linalg.svd(coordinates, full_matrices=True)[0]
        K, M = (directions.T @ part @ directions for part in self.project())
        coefficients = self.coefficients(points)

        def solve(size: int) -> Floats:
            problem = self.reduce(
                (K[:, :size, :size], M[:, :size, :size]), np.empty((0, size))
            )
            return problem.solve(*coefficients).frequencies

        low, high = self.model.skip + self.model.n_modes - 1, len(directions)
        whole = solve(high)
        while high - low > 1:
            middle = (low + high) // 2
            good = (solve(middle) / whole - 1).max() <= target
            low, high = (low, middle) if good else (middle, high)
        matrices = K[:, :high, :high], M[:, :high, :high]
        return self.V @ directions[:, :high], matrices

    def compare(
        self, V: Floats, matrices: Matrices, point: Floats
    ) -> tuple[float, float, Modes]:
        """Solve in full at a point; return what a basis errs there, and the modes.

        The largest relative error of a frequency, and the largest 1 - MAC.
        """
        skip, n_modes = self.model.skip, self.model.n_modes
        k, m, where = self.coefficients(point[None])
        squares, y = eigh(combine(matrices[0], k)[0], combine(matrices[1], m)[0])
        reduced = np.sqrt(squares[skip:][:n_modes]) / (2 * np.pi)
        eigenvalues, shapes = self.solve(point)
        full = np.sqrt(eigenvalues[skip:]) / (2 * np.pi)
        phi = V @ y[:, skip:][:, :n_modes]
        M_phi = self.problem.mass(m[0]) @ phi
        # The mass added to the first modes bounds what it lowers the last one by.
        kept = 1 - np.cumsum(1 - (phi * M_phi).sum(axis=0))
        least = full[:n_modes] * np.sqrt(np.maximum(kept, 0.0))
        for mode in np.flatnonzero(reduced < (1 - MISSED) * least):
            raise ValueError(
                f"the full model missed a mode near {reduced[mode]:g} Hz at "
                f"{where(0)}: a Ritz frequency is never below the true one; ask for "
                "other n_modes"
            )
        error = float(np.abs(reduced / full[:n_modes] - 1).max())
        mac = (shapes[:, skip:].T @ M_phi) ** 2
        close = np.abs(full[:, None] / reduced - 1) < CLOSE
        lost = float((1 - (mac * close).sum(axis=0)).max())
        return error, lost, (eigenvalues, shapes)


def _not_reached(target: float, error: float, solves: int) -> ValueError:
    return ValueError(
        f"the tolerance was not reached: frequency error {error:.2g}, wanted "
        f"{target:.2g}, after {solves} full solves; allow more max_solves, a "
        "larger tolerance, or give narrower bounds"
    )


def _read_bounds(
    bounds: Mapping[str, tuple[float, float]], names: tuple[str, ...]
) -> dict[str, tuple[float, float]]:
    """Return the bounds in the order of ``names``; every name must have them."""
    if not names:
        raise ValueError("bounds: the model has no parameters; solve it once instead")
    pairs, box = checks.by_name("bounds", bounds, names), {}
    for name in names:
        pair = checks.real_array(f"bounds[{name!r}]", pairs.get(name, ()), 1)
        if len(pair) != 2 or not pair[0] < pair[1]:
            raise ValueError(
                f"bounds[{name!r}]: expected (low, high) with low < high, got "
                f"{pairs.get(name)!r}"
            )
        box[name] = (float(pair[0]), float(pair[1]))
    return box


def _measure_speed_up(model: MatrixModel, reduced: ReducedModel) -> float:
    """Return the time of the full model over that of the other, per parameter set."""
    rng, box = np.random.default_rng(0), reduced.bounds
    batch = {name: rng.uniform(*ends, BATCH) for name, ends in box.items()}
    # A sparse model solves one by one: one is enough to know the time of each.
    rows = 1 if issparse(model.K0) else BATCH
    some = {name: value[:rows] for name, value in batch.items()}
    before, after = (
        np.median(timeit.repeat(call, timer=time.process_time, number=1, repeat=5))
        for call in (lambda: model(some), lambda: reduced(batch))
    )
    return float((before / rows) / (after / BATCH))
