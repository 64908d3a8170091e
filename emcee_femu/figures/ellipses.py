"""Geometry of covariance ellipses (NumPy only)."""

from typing import NamedTuple

import numpy as np

from ..interfaces import Floats


class Ellipse(NamedTuple):
    """An ellipse in the plane.

    Attributes:
        centre: ``(2,)``.
        semi_axes: Major and minor semi-axis, ``(2,)``.
        angle: From the first axis to the major one, counter-clockwise in degrees.
    """

    centre: Floats
    semi_axes: Floats
    angle: float


def covariance_ellipse(points: Floats, probability: float = 0.95) -> Ellipse:
    r"""Return the ellipse that holds a share of a Gaussian like the points ``(n, 2)``.

    .. math:: (x - \bar x)^T C^{-1} (x - \bar x) = \chi^2_2(p) = -2 \ln(1 - p)

    with mean and covariance of the points; 95 % of the joint distribution lie inside
    2.448 standard deviations, not the 1.96 of one variable.

    Examples:
        >>> square = np.array([[1.0, 1], [1, -1], [-1, 1], [-1, -1]])
        >>> covariance_ellipse(square).semi_axes.round(3).tolist()
        [2.826, 2.826]
    """
    variances, axes = np.linalg.eigh(np.cov(points, rowvar=False))
    radius_squared = -2 * np.log1p(-probability)
    # Ascending eigenvalues; points on a line may leave one just below zero.
    semi_axes = np.sqrt(radius_squared * np.maximum(variances[::-1], 0.0))
    x, y = axes[:, 1]
    angle = float(np.degrees(np.arctan2(y, x)))
    return Ellipse(points.mean(axis=0), semi_axes, angle)
