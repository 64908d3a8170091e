"""Mean and scatter of repeated modal tests of one structure."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from . import modes

OTHER_MODE = 0.5  # a shape with a smaller MAC with the mean belongs to another mode


def frequency_scatter(value: ArrayLike, correlated: bool) -> dict[str, Any]:
    """Return mean and covariance, or sd, of frequencies ``(n_tests, n_modes)``."""
    tests = checks.positive_array("frequencies", value, 2)
    correlated = checks.flag("correlated", correlated)
    n_tests, n_modes = tests.shape
    if n_tests < 2 or not n_modes:
        raise ValueError(
            "frequencies: expected (n_tests, n_modes) with at least two tests, got "
            f"{tests.shape}"
        )
    if correlated and n_tests <= n_modes:
        raise ValueError(
            f"frequencies: {n_tests} tests cannot tell the covariance of {n_modes} "
            "modes; use more tests than modes, or correlated=False for one standard "
            "deviation per mode"
        )
    for i in np.flatnonzero(np.ptp(tests, axis=0) == 0):
        raise ValueError(
            f"frequencies: mode {i + 1} is {tests[0, i]} Hz in all tests, which says "
            "nothing about its scatter; give more digits, or Measurements(.., sd=..)"
        )
    found: dict[str, Any] = {"frequencies": tests.mean(axis=0)}
    if correlated:
        return found | {"covariance": np.atleast_2d(np.cov(tests, rowvar=False))}
    return found | {"sd": tests.std(axis=0, ddof=1)}


def shape_scatter(value: ArrayLike, n_tests: int, n_modes: int) -> dict[str, Any]:
    """Return mean and sample sd of shapes ``(n_tests, n_sensors, n_modes)``."""
    tests = modes.shapes(value, n_modes)
    if tests.ndim != 3 or len(tests) != n_tests:
        raise ValueError(
            f"shapes: expected ({n_tests} tests, n_sensors, {n_modes} modes), got "
            f"{tests.shape}"
        )
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
    # Complex shapes are turned real at the phase of the mean.
    sd = (tests * modes.phases(mean)).real.std(axis=0, ddof=1)
    for sensor, mode in np.argwhere(sd == 0):
        raise ValueError(
            f"shapes: mode {mode + 1} is the same at sensor {sensor + 1} in all tests, "
            "which says nothing about its scatter; give more digits"
        )
    return {"shapes": mean, "shape_sd": sd}
