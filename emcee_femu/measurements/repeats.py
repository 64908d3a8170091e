"""Mean and scatter of repeated modal tests of one structure."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from . import modes

# A repeat whose shape has a smaller MAC with the mean is of another mode.
OTHER_MODE = 0.5


def frequency_scatter(value: ArrayLike, correlated: bool) -> dict[str, Any]:
    """Return mean and sample covariance (or sd) of frequencies ``(n_tests, n_modes)``.

    Raises:
        ValueError: If there are too few tests, or a mode does not scatter.
    """
    tests = checks.positive_array("frequencies", value, 2)
    correlated = checks.flag("correlated", correlated)
    n_tests, n_modes = tests.shape
    if n_tests < 2 or not n_modes:
        raise ValueError(
            "frequencies: expected (n_tests, n_modes) with two tests at least, got "
            f"{tests.shape}"
        )
    if correlated and n_tests <= n_modes:
        raise ValueError(
            f"frequencies: {n_tests} tests cannot tell the covariance of {n_modes} "
            "modes; use more tests than modes, or correlated=False for a standard "
            "deviation a mode"
        )
    for i in np.flatnonzero(np.ptp(tests, axis=0) == 0):
        raise ValueError(
            f"frequencies: mode {i + 1} is {tests[0, i]} Hz in all tests, which says "
            "nothing about its scatter; give more digits, or Measurements(.., sd=..)"
        )
    found: dict[str, Any] = {"frequencies": tests.mean(axis=0)}
    if correlated:
        found["covariance"] = np.cov(tests, rowvar=False).reshape(n_modes, n_modes)
    else:
        found["sd"] = tests.std(axis=0, ddof=1)
    return found


def shape_scatter(value: ArrayLike, n_tests: int, n_modes: int) -> dict[str, Any]:
    """Return mean and sample sd of shapes ``(n_tests, n_sensors, n_modes)``.

    Raises:
        ValueError: If the sizes disagree, a shape is another mode than the mean, or a
            sensor does not scatter.
    """
    tests = modes.shapes(value, n_modes)
    if tests.ndim != 3 or len(tests) != n_tests:
        raise ValueError(
            f"shapes: expected ({n_tests} tests, n_sensors, {n_modes} modes), got "
            f"{tests.shape}"
        )
    tests = modes.scaled(tests)
    tests = tests / np.linalg.norm(tests, axis=1, keepdims=True)
    for mode in range(n_modes):
        columns = tests[:, :, mode].T  # (n_sensors, n_tests)
        mean = np.linalg.svd(columns, full_matrices=False)[0][:, 0]
        product = mean.conj() @ columns
        for test in np.flatnonzero(np.abs(product) ** 2 < OTHER_MODE):
            raise ValueError(
                f"shapes: mode {mode + 1} of test {test + 1} has a MAC of "
                f"{abs(product[test]) ** 2:.2f} with the mean of all tests; are its "
                "modes out of order?"
            )
        tests[:, :, mode] = (columns * (product.conj() / np.abs(product))).T
    mean = tests.mean(axis=0)
    # Of complex shapes the real part remains, at the phase of the mean.
    sd = (tests * modes.phases(mean)).real.std(axis=0, ddof=1)
    for sensor, mode in np.argwhere(sd == 0):
        raise ValueError(
            f"shapes: mode {mode + 1} is the same at sensor {sensor + 1} in all tests, "
            "which says nothing about its scatter; give more digits"
        )
    return {"shapes": mean, "shape_sd": sd}
