"""Steps on a quadratic inside bounds, and what keeps it a good one."""

from typing import Any

import numpy as np
from scipy.optimize import brentq, lsq_linear

from ..interfaces import Floats

FLOOR = 0.1  # least curvature: no direction is wider than 3.2 prior sds
ROUNDED = 1e-14  # of the largest curvature, below which one is rounding


def make_positive(curvature: Floats) -> Floats:
    """Return the matrix with its eigenvalues made positive, and none too small."""
    values, vectors = np.linalg.eigh(curvature)
    least = max(FLOOR, ROUNDED * values[-1])
    if values[0] >= least:
        return curvature
    positive: Floats = (vectors * np.maximum(np.abs(values), least)) @ vectors.T
    return positive


def step_within(
    gradient: Floats, curvature: Floats, low: Floats, high: Floats
) -> tuple[Floats, float]:
    """Return the step that maximises a quadratic inside a box, and what it gains."""
    step: Any = np.linalg.solve(curvature, gradient)
    if (step < low).any() or (step > high).any():
        root = np.linalg.cholesky(curvature)
        target = np.linalg.solve(root, gradient)
        step = lsq_linear(root.T, target, (low, high), method="bvls").x
    return step, float(gradient @ step - 0.5 * step @ curvature @ step)


def find_damping(gradient: Floats, curvature: Floats, radius: float) -> float:
    """Return what the diagonal must gain for a step no longer than the radius."""
    values, vectors = np.linalg.eigh(curvature)
    along = vectors.T @ gradient

    def excess(damping: float) -> float:
        return float(np.linalg.norm(along / (values + damping))) - radius

    if excess(0.0) <= 0:
        return 0.0
    return float(brentq(excess, 0.0, np.linalg.norm(along) / radius, rtol=1e-3))


def update_secant(curvature: Floats, step: Floats, rest: Floats) -> Floats:
    """Return the curvature that also explains the rest of a change of gradient (SR1).

    Args:
        curvature: ``(d, d)``.
        step: ``(d,)``.
        rest: What the curvature does not explain of minus the change of gradient.
    """
    product = rest @ step
    if abs(product) <= 1e-8 * np.linalg.norm(rest) * np.linalg.norm(step):
        return curvature
    updated: Floats = curvature + np.outer(rest, rest) / product
    return updated
