"""Checks of measured modes by mode number; complex shapes; the scatter of repeats."""

import warnings
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..contracts import Floats
from .directions import SENSOR_UNITS, unit_of

# Two modes this near to each other in frequency and MAC are one, identified twice.
SAME_FREQUENCY, SAME_MAC = 1e-3, 0.99
COLLINEAR = 0.9  # below it a real shape is a poor picture of the mode
LARGE_DAMPING = 0.2  # of structures, but for dampers; 0.2 is also a usual percentage
LARGE_ERROR_PRIOR = 0.1  # a relative standard deviation that may be in percent
# Translations of a mode that only turns, by its rotations: what rounding leaves.
NO_MOTION = 1e-9
OTHER_MODE = 0.5  # a shape with a smaller MAC with the mean belongs to another mode
Shapes = NDArray[np.float64] | NDArray[np.complex128]
Fields: TypeAlias = dict[str, Any]  # of Measurements, by the names of arguments


def frequencies(value: ArrayLike) -> Floats:
    """Return measured frequencies in Hz; errors name the mode, 1 = the first."""
    hertz = checks.numeric_array("frequencies", value)
    if hertz.ndim != 1 or not hertz.size:
        raise ValueError(f"frequencies: expected (n_modes >= 1,), got {hertz.shape}")
    expected = "Hz above zero (leave out what was not identified)"
    _refuse("frequencies", hertz, expected, ~((hertz > 0) & np.isfinite(hertz)))
    for i in np.flatnonzero(np.diff(hertz) < 0):
        raise ValueError(
            f"frequencies: expected ascending ones, but mode {i + 2} ({hertz[i + 1]} "
            f"Hz) is below mode {i + 1} ({hertz[i]} Hz); sort all by np.argsort"
        )
    return hertz


def shapes(value: ArrayLike, n_modes: int, missing: bool = False) -> Shapes:
    """Return real or complex shapes ``(..., n_sensors, n_modes)``, none zero.

    With ``missing`` some may be NaN.
    """
    raw = checks.complex_array("shapes", value)
    if raw.ndim < 2 or raw.shape[-1] != n_modes or not raw.size:
        turned = "; transpose them" if raw.shape[:1] == (n_modes,) else ""
        if raw.ndim == 1 and n_modes == 1:
            turned = "; a column is np.reshape(shapes, (-1, 1))"
        expected = f"(n_sensors, {n_modes}), one column per frequency"
        raise ValueError(f"shapes: expected {expected}, got {raw.shape}{turned}")
    wrong = np.isinf(raw) if missing else ~np.isfinite(raw)
    _refuse("shapes", raw, "finite numbers", wrong)
    for index in np.argwhere(~np.nan_to_num(raw).any(axis=-2)):
        raise ValueError(
            f"shapes: mode {index[-1] + 1} is zero, or missing, at all sensors; leave "
            "the mode out here, and give its frequency to a FrequencyTerm of its own"
        )
    return raw


def phases(raw: Shapes) -> Shapes:
    """Return the factor per mode that turns its shape to its largest real part."""
    if not np.iscomplexobj(raw):
        return np.ones(raw.shape[-1])
    unit = raw / np.abs(raw).max(axis=0)  # squares neither over- nor underflow
    return np.asarray(np.exp(-0.5j * np.angle((unit * unit).sum(axis=0))))


def phase_collinearity(raw: Shapes, stated: ArrayLike | None = None) -> Floats:
    """Return the MAC of each shape with its own conjugate; 1 for a real shape.

    ``stated`` is what real shapes had before they were turned real, ``(n_modes,)``.
    """
    n_modes = raw.shape[-1]
    if np.iscomplexobj(raw):
        if stated is not None:
            raise ValueError("phase_collinearity: complex shapes give it; leave it out")
        unit = raw / np.abs(raw).max(axis=0)
        ratio = np.abs((unit * unit).sum(axis=0)) / (np.abs(unit) ** 2).sum(axis=0)
        stated = np.minimum(ratio**2, 1.0)  # above 1 by rounding only
    stated = [1.0] * n_modes if stated is None else stated
    mpc = checks.shaped_array("phase_collinearity", stated, (n_modes,))
    if mpc.min() < 0 or mpc.max() > 1:
        raise ValueError(f"phase_collinearity: expected [0, 1], got {mpc}")
    return mpc


def warn_about_complex(mpc: Floats) -> None:
    """Warn about modes that a real shape describes poorly."""
    which = [f"{i + 1} (MPC {x:.2f})" for i, x in enumerate(mpc) if x < COLLINEAR]
    if which:
        warnings.warn(
            f"shapes: phase collinearity below {COLLINEAR} for mode "
            f"{', '.join(which)}; a real shape describes it poorly",
            stacklevel=3,
        )


def find_duplicates(
    hertz: Floats, real: Floats, apart: float = SAME_FREQUENCY, mac: float = SAME_MAC
) -> list[list[int]]:
    """Return pairs of modes of the same frequency with a MAC near 1, identified twice.

    Not with a single sensor: symmetric structures have equal frequencies.

    Args:
        hertz: Measured frequencies ``(n_modes,)``.
        real: Measured shapes ``(n_sensors, n_modes)``.
        apart: Relative difference up to which frequencies are the same.
        mac: MAC above which shapes are.
    """
    if len(real) < 2:
        return []
    unit = real / np.maximum(np.linalg.norm(real, axis=0), np.finfo(float).tiny)
    same = np.abs(hertz[:, None] - hertz) <= apart * hertz
    same &= (unit.T @ unit) ** 2 > mac
    pairs: list[list[int]] = np.argwhere(np.triu(same, 1)).tolist()
    return pairs


def refuse_duplicates(hertz: Floats, real: Floats) -> None:
    """Refuse modes that were identified twice."""
    for i, j in find_duplicates(hertz, real):
        raise ValueError(
            f"frequencies: modes {i + 1} and {j + 1} are the same ({hertz[i]} and "
            f"{hertz[j]} Hz; their MAC is near 1); leave out one of them"
        )


def deviations(
    argument: str,
    value: ArrayLike | None,
    shape: tuple[int, ...],
    there: NDArray[np.bool_] | None = None,
    partly: bool = False,
) -> Floats | None:
    """Return standard deviations of the given shape; NaN for missing modes.

    With ``partly`` some may be NaN or None, not known; None is returned for all.
    """
    if value is None:
        return None
    if partly and isinstance(value, Sequence):
        value = [np.nan if number is None else number for number in value]
    sd = checks.numeric_array(argument, value)
    checks.shaped(argument, sd.shape, shape)
    if there is None:
        there = ~np.isnan(sd) if partly else np.ones(shape, dtype=bool)
    sd[~there] = np.nan
    wrong = there & ~((sd > 0) & np.isfinite(sd))
    _refuse(argument, sd, "finite numbers above zero", wrong)
    return sd if there.any() else None


def doubt_percent(
    argument: str, ratios: Floats, large: float, of: str = "what was measured"
) -> None:
    """Warn about ratios, some perhaps NaN, that may have been given in percent."""
    if (largest := np.nanmax(ratios)) > large:
        instead = "relative_sd" if argument == "sd" else argument
        warnings.warn(
            f"{argument}: expected at most {large:g} of {of}, got {largest:.3g}, which "
            f"is {100 * largest:.3g} %; 1 % is {instead}=0.01",
            stacklevel=3,
        )


def covariance(value: ArrayLike, n_modes: int) -> Floats:
    """Return a symmetric positive definite ``(n_modes, n_modes)``."""
    matrix = checks.shaped_array("covariance", value, (n_modes, n_modes))
    deviations("covariance (diagonal)", np.diag(matrix), (n_modes,))
    checks.covariance_factor("covariance", matrix)
    return 0.5 * (matrix + matrix.T)  # printed digits are rounded


def labels(value: Sequence[str] | None, n_sensors: int) -> tuple[str, ...]:
    """Return a label for each sensor: s1, s2, ... by default."""
    if value is None:
        return tuple(f"s{i + 1}" for i in range(n_sensors))
    names = checks.parameter_names("sensors", value)
    checks.shaped("sensors", (len(names),), (n_sensors,))
    return names


def compares(shapes: Shapes, labels: Iterable[object]) -> NDArray[np.bool_]:
    """Return where a MAC compares shapes, ``(n_sensors, n_modes)``: at one unit each.

    A sum of squares of metres and radians would depend on the unit of length. Rotations
    are therefore left out beside translations, unless a mode only turns; and strains
    beside either.
    """
    units = np.array([unit_of(label) for label in labels])
    if len({*units.tolist()}) < 2:
        return np.ones(shapes.shape, dtype=bool)
    size = np.nan_to_num(np.abs(shapes))
    largest = np.stack(
        [(size * (units == unit)[:, None]).max(0) for unit in SENSOR_UNITS]
    )
    first = (largest > NO_MOTION * largest.max(axis=0)).argmax(axis=0)
    return np.asarray(units[:, None] == first)


def frequency_scatter(value: ArrayLike, correlated: bool) -> Fields:
    """Return mean and covariance, or sd, of frequencies ``(n_tests, n_modes)``."""
    tests, correlated = _read_tests(value), checks.flag("correlated", correlated)
    n_tests, n_modes = tests.shape
    found = ~np.isnan(tests)
    for i in np.flatnonzero(found.sum(axis=0) < 2):
        raise ValueError(
            f"frequencies: mode {i + 1} was found by {found[:, i].sum()} of {n_tests} "
            "tests, and its scatter needs two; leave the mode out"
        )
    if correlated and not found.all():
        test, mode = np.argwhere(~found)[0] + 1
        raise ValueError(
            f"frequencies: test {test} missed mode {mode}, and a covariance needs all "
            "modes of every test; give correlated=False, or leave that test out"
        )
    if correlated and n_tests <= n_modes:
        raise ValueError(
            f"frequencies: {n_tests} tests do not determine the covariance of "
            f"{n_modes} modes; use more tests than modes, or correlated=False for one "
            "standard deviation per mode"
        )
    for i in np.flatnonzero(np.nanmax(tests, axis=0) == np.nanmin(tests, axis=0)):
        raise ValueError(
            f"frequencies: mode {i + 1} is {np.nanmax(tests[:, i])} Hz in all tests, "
            "so its scatter is not known; give more digits, or Measurements(.., sd=..)"
        )
    scatter: Fields = {"frequencies": np.nanmean(tests, axis=0)}
    if correlated:
        return scatter | {"covariance": np.atleast_2d(np.cov(tests, rowvar=False))}
    return scatter | {"sd": np.nanstd(tests, axis=0, ddof=1)}


def _read_tests(value: ArrayLike) -> Floats:
    """Return frequencies ``(n_tests, n_modes)``, NaN where a test missed a mode."""
    try:
        tests = checks.numeric_array("frequencies", value)
    except ValueError as error:
        counts = [np.size(row) for row in np.asarray(value, dtype=object)]
        if len({*counts}) < 2:
            raise
        raise ValueError(
            f"frequencies: expected the same modes in each test, got {counts} "
            "frequencies; write nan where a test missed a mode"
        ) from error
    if tests.ndim != 2 or len(tests) < 2 or not tests.size:
        raise ValueError(
            f"frequencies: expected (n_tests >= 2, n_modes), got {tests.shape}"
        )
    checks.positive_array("frequencies", tests[~np.isnan(tests)])
    return tests


def shape_scatter(
    value: ArrayLike, found: NDArray[np.bool_], labels: Sequence[object] | None
) -> Fields:
    """Return mean and sample sd of shapes ``(n_tests, n_sensors, n_modes)``.

    Over the modes that were found, ``(n_tests, n_modes)``. Labels of sensors tell which
    are rotations, by which shapes are neither scaled nor compared.
    """
    n_tests, n_modes = found.shape
    raw = checks.complex_array("shapes", value)
    if raw.ndim == 3 and raw.shape[::2] == found.shape:
        raw = np.where(found[:, None], raw, 1.0)
    tests = shapes(raw, n_modes)
    if tests.ndim != 3 or len(tests) != n_tests:
        expected = f"({n_tests} tests, n_sensors, {n_modes} modes)"
        raise ValueError(f"shapes: expected {expected}, got {tests.shape}")
    known = labels is not None and len(labels) == tests.shape[1]  # else refused
    alike = compares(np.abs(tests).max(axis=0), (labels or ()) if known else ())
    tests = tests / np.linalg.norm(tests * alike, axis=1, keepdims=True)
    mean, sd = np.zeros_like(tests[0]), np.zeros(tests[0].shape)
    for mode in range(n_modes):
        there = np.flatnonzero(found[:, mode])
        columns = tests[there, :, mode].T  # (n_sensors, n_found)
        compared = columns[alike[:, mode]]
        first = np.linalg.svd(compared, full_matrices=False)[0][:, 0]
        product = first.conj() @ compared
        for test in np.flatnonzero(np.abs(product) ** 2 < OTHER_MODE):
            raise ValueError(
                f"shapes: mode {mode + 1} of test {there[test] + 1} has a MAC of "
                f"{abs(product[test]) ** 2:.2f} with the mean; are modes out of order?"
            )
        columns = columns * (product.conj() / np.abs(product))
        mean[:, mode] = columns.mean(axis=1)
        # Complex shapes are turned real at the phase of the mean.
        turned = columns * phases(mean[alike[:, mode]][:, [mode]])
        sd[:, mode] = turned.real.std(axis=1, ddof=1)
    for sensor, mode in np.argwhere(sd == 0):
        raise ValueError(
            f"shapes: mode {mode + 1} is the same at sensor {sensor + 1} in all tests, "
            "which says nothing about its scatter; give more digits"
        )
    return {"shapes": mean, "shape_sd": sd}


def _refuse(
    argument: str, array: Shapes, expected: str, bad: NDArray[np.bool_]
) -> None:
    """Refuse ``(..., n_modes)`` numbers if one is wrong, and name its mode."""
    for *others, mode in np.argwhere(bad):
        sensor = f" at sensor {others[-1] + 1}" if others else ""
        raise ValueError(
            f"{argument}: expected {expected}, but mode {mode + 1} has "
            f"{array[*others, mode]}{sensor}"
        )
