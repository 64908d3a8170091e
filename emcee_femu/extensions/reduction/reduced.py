"""A model reduced to a small Ritz basis, with bounds and a certified error.

The basis consists of mode shapes from full solves: at the centre of the bounds, then at
the point farthest from all earlier solves, until several in a row add nothing new. Its
principal directions (proper orthogonal decomposition) make the reduced model, as few as
the frequencies allow. Full solves at independent points certify it; points where it
fails are added to the basis.
"""

import time
import timeit
import warnings
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import issparse
from scipy.stats import qmc

from ... import checks
from ...contracts import (
    Derivatives,
    ModalSolution,
    Parameters,
    Variable,
    modal_variables,
    read_declared,
)
from ...models.assembled import AssembledModel
from ...models.geometry import Geometry
from ...models.matrix import AffineModel
from ...models.parameter_sets import read_inside
from ...table import Parts, Report
from .ritz_basis import GOOD_IN_A_ROW, RESERVE, RitzBasis, not_reached

INSIDE, CORNERS = 128, 32  # points for the basis
CHECKED = 96  # of these, where a basis is compared with its principal directions
INWARDS = 0.95  # corners certify; points pulled this far inwards serve the basis
SAFETY = 0.5  # share of the tolerance that truncation may use
PAYS = 3.0  # a smaller speed-up is worth a warning
BATCH = 16  # parameter sets in the batch that is timed


@dataclass(frozen=True, eq=False, repr=False)
class ReducedModel(Report):
    """A modal model in a Ritz basis, solved for all parameter sets at once.

    :func:`reduce_model` makes it. As for any Ritz approximation, each frequency is an
    upper bound (massless DOFs are given a little mass, which lowers it by a small
    fraction of the tolerance).

    **Frequencies are certified**: ``max_error`` is the largest relative error of any
    frequency at ``test_points`` points that were not used to build the basis, half of
    them corners of the bounds, each solved in full. This is not a bound for the whole
    box: after n random points without a failure, less than 3 / n of the box has a
    larger error, with 95 % confidence.

    **Shapes are measured, not certified**: ``shape_error`` is the largest 1 - MAC at
    these points (mass-weighted, over all DOFs). Each shape is compared with the space
    of the full modes within 2 % of its frequency, because shapes of close modes mix. It
    grows like the frequency error divided by the gap between modes, and may exceed the
    tolerance.

    Attributes:
        bounds: ``{parameter: (low, high)}``; the model refuses values outside.
        n_modes: Number of frequencies.
        shape_dofs: DOFs of the full model at which shapes are returned; () for none.
        tolerance: The required frequency error.
        max_error: The certified relative frequency error, below the tolerance.
        shape_error: Largest 1 - MAC at the test points.
        test_points: Number of points of the certificate.
        size: Number of basis vectors.
        full_size: Number of DOFs of the full model.
        full_solves: Number of full solves, including the certificate.
        speed_up: Time of the full model divided by that of this one, per parameter
            set in a batch of 16, measured when the model was made.
        geometry: The full model's geometry for drawings, or None.
        dofs: All DOFs of the full model, or None if it does not list them.
    """

    bounds: Mapping[str, tuple[float, float]]
    n_modes: int
    shape_dofs: tuple[Hashable, ...]
    tolerance: float
    max_error: float
    shape_error: float
    test_points: int
    size: int
    full_size: int
    full_solves: int
    speed_up: float
    geometry: Geometry | None
    dofs: Sequence[Hashable] | None
    _small: AffineModel | AssembledModel

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the model depends on."""
        return tuple(self.bounds)

    @property
    def variables(self) -> Mapping[str, Variable]:
        """Frequencies, and shapes if it returns them."""
        return modal_variables(self.n_modes, self.shape_dofs)

    @property
    def one_by_one(self) -> bool:
        """Whether it solves parameter sets one at a time."""
        return bool(read_declared(self._small, "one_by_one"))

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
        return self._small(parameters)

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and the derivatives of the reduced model.

        Raises:
            ValueError: As for a call, or if two modes coincide that separate as a
                parameter changes; see ``MatrixModel.jacobian``.
        """
        read_inside(parameters, self.bounds, "reduce")
        return self._small.jacobian(parameters)


def reduce_model(
    model: AffineModel | AssembledModel,
    bounds: Mapping[str, tuple[float, float]],
    tolerance: float = 1e-4,
    *,
    test_points: int = 40,
    max_solves: int = 200,
    seed: int = 0,
) -> ReducedModel:
    """Return a small model that replaces a large one inside ``bounds``.

    Use it for a :class:`MatrixModel` or :class:`AssembledModel` with thousands of DOFs,
    before :func:`run`. Mode shapes at points that fill the bounds make a Ritz basis,
    until more of them add nothing new. Full solves at independent points then certify
    the frequencies. It takes some tens of full solves, at most ``max_solves``. The
    matrices of an :class:`AssembledModel` are projected at each call, so a reduced
    solve costs one assembly and one small dense eigenproblem.

    Args:
        model: The full model, dense or sparse.
        bounds: ``{parameter: (low, high)}`` for every parameter of the model.
        tolerance: Largest relative error of a frequency, at the test points.
        test_points: Number of independent test points, half of them corners of the
            bounds, half random points inside.
        max_solves: Maximum number of full solves, tests included.
        seed: Seed of the points.

    Returns:
        The reduced model, with its certificate.

    Raises:
        TypeError: If model is none of MatrixModel, FrameModel and AssembledModel.
        ValueError: If bounds do not fit the parameters, or the tolerance is not
            reached with ``max_solves`` full solves.

    Warns:
        UserWarning: If the reduced model is hardly faster, as when assembly dominates.

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
    if not isinstance(model, AffineModel | AssembledModel):
        raise TypeError(
            "model: expected a MatrixModel, FrameModel or AssembledModel, got "
            f"{type(model).__name__}"
        )
    box = _read_bounds(bounds, model.names)
    # Below 1e-9 errors are rounding.
    tolerance = checks.real_number("tolerance", tolerance, 1e-9, 0.1)
    n_tests = checks.whole_number("test_points", test_points, 2)
    max_solves = checks.whole_number(
        "max_solves", max_solves, n_tests + 1 + GOOD_IN_A_ROW
    )
    rng = np.random.default_rng(checks.whole_number("seed", seed))
    corners = np.unique(rng.integers(0, 2, size=(1024, len(box))), axis=0).astype(float)
    rng.shuffle(corners)
    certified, trained = corners[: n_tests // 2], corners[n_tests // 2 :][:CORNERS]
    near = 0.5 + INWARDS * (certified - 0.5)
    inside = qmc.Sobol(len(box), seed=rng).random(INSIDE)
    candidates = np.concatenate([trained, near, inside])
    basis, target = RitzBasis(model, box, tolerance), SAFETY * tolerance
    while True:
        basis.grow(candidates, RESERVE * target, max_solves - n_tests)
        directions = basis.truncate(candidates[:CHECKED], target)
        V, small = basis.V @ directions, basis.project(directions)
        rest = rng.uniform(size=(n_tests - len(certified), len(box)))
        tests = np.concatenate([certified, rest])
        comparisons = [basis.compare(V, small, point) for point in tests]
        errors = np.array([error for error, _, _ in comparisons])
        if errors.max() <= tolerance:
            break
        if len(basis.points) + n_tests >= max_solves:
            raise not_reached(tolerance, errors.max(), len(basis.points))
        # Look closer there; certify at new points, and corners that were good.
        for i in np.flatnonzero(errors > target):
            basis.append(*comparisons[i][2])
        certified = certified[errors[: len(certified)] <= target]
        target *= 0.3
    shaped = len(model.shape_dofs) > 0
    labels = model.variables["shapes"].coords["dof"] if shaped else ()
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
        geometry=read_declared(model, "geometry"),
        dofs=read_declared(model, "dofs"),
        _small=small,
    )
    speed_up = _measure_speed_up(model, reduced)
    if reduced.size >= reduced.full_size or speed_up < PAYS:
        warnings.warn(
            f"the reduction does not pay: {reduced.size} basis vectors for "
            f"{reduced.full_size} DOFs, {speed_up:.2g} times the speed of the full "
            "model; use the full model, narrower bounds or a larger tolerance"
            + ("; assembling takes most of the time" if reduced.one_by_one else ""),
            UserWarning,
            stacklevel=2,
        )
    return replace(reduced, speed_up=speed_up)


def _read_bounds(
    bounds: Mapping[str, tuple[float, float]], names: tuple[str, ...]
) -> dict[str, tuple[float, float]]:
    """Return the bounds in the order of ``names``; every name must have them."""
    if not names:
        raise ValueError("bounds: the model has no parameters; solve it once instead")
    pairs, box = checks.by_name("bounds", bounds, names), {}
    for name in names:
        low, high = checks.shaped_array(f"bounds[{name!r}]", pairs.get(name, ()), (2,))
        if not low < high:
            raise ValueError(
                f"bounds[{name!r}]: expected low < high, got {low}, {high}"
            )
        box[name] = float(low), float(high)
    return box


def _measure_speed_up(
    model: AffineModel | AssembledModel, reduced: ReducedModel
) -> float:
    """Return the time of the full model over that of the other, per parameter set."""
    rng, box = np.random.default_rng(0), reduced.bounds
    batch = {name: rng.uniform(*ends, BATCH) for name, ends in box.items()}
    # A sparse model solves one by one: one is enough to know the time of each.
    alone = isinstance(model, AssembledModel) or issparse(model.K0)
    rows = 1 if alone else BATCH
    some = {name: value[:rows] for name, value in batch.items()}
    before = _measure(lambda: model(some)) / rows
    return before / (_measure(lambda: reduced(batch)) / BATCH)


def _measure(call: Callable[[], ModalSolution]) -> float:
    """Return processor seconds, the median of several if a call takes less than one."""
    first = timeit.timeit(call, timer=time.process_time, number=1)
    if first > 1.0:
        return first
    again = timeit.repeat(call, timer=time.process_time, number=1, repeat=5)
    return float(np.median(again))
