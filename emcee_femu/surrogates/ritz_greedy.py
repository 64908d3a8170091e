"""From a full model to a reduced one: greedy basis, truncation, certificate."""

import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import issparse
from scipy.stats import qmc

from .. import checks
from ..interfaces import Floats
from ..models.matrix import MatrixModel, sparse_problem
from .full_model import FullModel
from .reduced import ReducedModel
from .ritz_basis import Projection, RitzBasis
from .ritz_points import check_bounds, corners, independent_points

CANDIDATES, CORNERS = 128, 64  # points where the error is estimated, inside and outside
SAFETY = 0.8  # largest estimate of the final basis, as a share of the tolerance
RESERVE = 0.2  # share of that for the basis before truncation
PAYS = 3.0  # a smaller speed-up is worth a warning
BATCH = 16  # parameter sets in the batch that is timed


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

    A Ritz basis is built from the mode shapes at the centre of the bounds and at
    points that a greedy search adds where a residual estimate of the error is
    largest. Full solves at independent points then certify it.

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
    """
    if not isinstance(model, MatrixModel):
        raise TypeError(
            f"model: expected a MatrixModel, got {type(model).__name__}; export its K "
            "and M for every parameter"
        )
    box = check_bounds(bounds, model.names)
    tolerance = checks.real_number("tolerance", tolerance)
    if not 1e-9 <= tolerance <= 0.1:
        raise ValueError(
            f"tolerance: expected 1e-9 (rounding) to 0.1, got {tolerance:g}"
        )
    n_tests = checks.whole_number("test_points", test_points, 2)
    max_solves = checks.whole_number("max_solves", max_solves, n_tests + 2)
    rng = np.random.default_rng(checks.whole_number("seed", seed))
    full = FullModel(model, sparse_problem(model), box)
    return _search(full, tolerance, n_tests, max_solves, rng)


def _search(
    full: FullModel,
    tolerance: float,
    n_tests: int,
    max_solves: int,
    rng: np.random.Generator,
) -> ReducedModel:
    """Extend the basis until full solves at independent points certify it."""
    d = len(full.bounds)
    outer = corners(d, rng)
    inside = qmc.Sobol(d, seed=rng).random(CANDIDATES)
    candidates = np.concatenate([inside, outer[n_tests // 2 :][:CORNERS]])
    basis, target = full.first_basis(tolerance, rng), SAFETY * tolerance
    while True:
        basis = _grow(basis, full, candidates, RESERVE * target, max_solves - n_tests)
        projection, T = _truncate(basis, full, candidates, target)
        vectors = basis.vectors @ T
        tests = independent_points(outer, candidates, n_tests, rng)
        errors, shape_error = full.errors(projection, vectors, tests)
        worst = int(np.argmax(errors))
        if errors[worst] <= tolerance:
            return _finish(full, projection, vectors, tolerance, errors, shape_error)
        if full.solves + 1 + n_tests > max_solves:
            raise _not_reached(tolerance, errors[worst], "at the test points", full)
        # The estimate misses something there: look closer, certify at new points.
        candidates = np.concatenate([candidates, tests[worst : worst + 1]])
        basis = basis.extend(*full.lowest(tests[worst]))
        target *= 0.3


def _grow(
    basis: RitzBasis, full: FullModel, points: Floats, target: float, allowed: int
) -> RitzBasis:
    """Add the modes at the worst point until the estimate is below the target."""
    while True:
        estimate = _estimate(basis.projection, full, points)
        largest = float(estimate.max())
        if largest <= target:
            return basis
        if full.solves >= allowed:
            raise _not_reached(target, largest, "estimated", full)
        basis = basis.extend(*full.lowest(points[np.argmax(estimate)]))
        # The estimate falls as the basis grows: what is good now stays good.
        points = points[estimate > target]


def _estimate(projection: Projection, full: FullModel, points: Floats) -> Floats:
    parts = [
        projection.estimate(*full.coefficients(points[i : i + BATCH])).max(axis=1)
        for i in range(0, len(points), BATCH)
    ]
    return np.concatenate(parts)


def _truncate(
    basis: RitzBasis, full: FullModel, points: Floats, target: float
) -> tuple[Projection, Floats]:
    """Return the smallest principal basis whose estimate is below the target."""
    directions = basis.principal_directions()
    rotated = basis.projection.rotate(directions)
    count = len(directions)
    identity = np.eye(count)

    def good(size: int) -> bool:
        part = rotated.rotate(identity[:, :size])
        return bool(_estimate(part, full, points).max() <= target)

    low = full.problem.skip + full.problem.n_modes - 1
    high = count  # the whole basis is good
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if good(middle) else (middle, high)
    return rotated.rotate(identity[:, :high]), directions[:, :high]


def _finish(
    full: FullModel,
    projection: Projection,
    vectors: Floats,
    tolerance: float,
    errors: Floats,
    shape_error: float,
) -> ReducedModel:
    model, size = full.model, projection.matrices[0].shape[1]
    dofs = list(model.shape_dofs)
    labels = model.variables["shapes"].coords["dof"] if dofs else ()
    reduced = ReducedModel(
        bounds=full.bounds,
        n_modes=model.n_modes,
        shape_dofs=tuple(labels),
        tolerance=tolerance,
        max_error=float(errors.max()),
        shape_error=shape_error,
        test_points=len(errors),
        size=size,
        full_size=len(vectors),
        full_solves=full.solves,
        speed_up=np.nan,
        _columns=(tuple(model.K), tuple(model.M)),
        _problem=projection.eigenproblem(bool(dofs), vectors[dofs] if dofs else None),
    )
    points = np.random.default_rng(0).uniform(size=(BATCH, len(full.bounds)))
    batch = full.parameters(points)
    # A sparse model solves one by one: one is enough to know the time of each.
    rows = 1 if issparse(model.K0) else BATCH
    some = {name: value[:rows] for name, value in batch.items()}
    before, after = _time(lambda: model(some)), _time(lambda: reduced(batch))
    speed_up = (before / rows) / (after / BATCH)
    if size >= len(vectors) or speed_up < PAYS:
        warnings.warn(
            f"the reduction does not pay: {size} basis vectors for {len(vectors)} "
            f"DOFs, {speed_up:.2g} times the speed of the full model; use the latter, "
            "narrower bounds or a larger tolerance",
            UserWarning,
            stacklevel=4,
        )
    return replace(reduced, speed_up=speed_up)


def _time(call: Callable[[], Any]) -> float:
    """Return the median process time of a call in s, over 0.1 s or at least 3 calls."""
    call()
    taken: list[float] = []
    while len(taken) < 3 or sum(taken) < 0.1:
        begin = time.process_time()
        call()
        taken.append(time.process_time() - begin)
    return float(np.median(taken))


def _not_reached(target: float, error: float, how: str, full: FullModel) -> ValueError:
    return ValueError(
        f"the tolerance was not reached: frequency error {error:.2g} {how}, wanted "
        f"{target:.2g}, after {full.solves} full solves; allow more max_solves, a "
        "larger tolerance, or give narrower bounds"
    )
