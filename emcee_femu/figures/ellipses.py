"""Geometry of covariance ellipses (NumPy only)."""

from typing import NamedTuple

import numpy as np

from .. import checks
from ..interfaces import Floats


class Ellipse(NamedTuple):
    """An ellipse in the plane.

    Attributes:
        centre: ``(2,)``.
        semi_axes: Major and minor semi-axis, ``(2,)``.
        angle: Of the major axis, in degrees, counter-clockwise from the first axis.
    """

    centre: Floats
    semi_axes: Floats
    angle: float


def covariance_ellipse(points: Floats, probability: float = 0.95) -> Ellipse:
    r"""Return the ellipse that holds a share of a Gaussian like the given points.

    .. math:: (x - \bar x)^T C^{-1} (x - \bar x) = \chi^2_2(p) = -2 \ln(1 - p)

    with mean and covariance of the points; 95 % of the joint distribution lie inside
    2.448 standard deviations, not the 1.96 of one variable.

    Args:
        points: ``(n, 2)``, at least 3.
        probability: The share p inside, between 0 and 1.

    Raises:
        ValueError: If points is not ``(n >= 3, 2)`` and finite, or probability is not
            between 0 and 1.

    Example:
        >>> square = np.array([[1.0, 1], [1, -1], [-1, 1], [-1, -1]])
        >>> covariance_ellipse(square).semi_axes.round(3).tolist()
        [2.826, 2.826]
    """
    xy = checks.real_array("points", points, 2)
    if len(xy) < 3 or xy.shape[1] != 2:
        raise ValueError(f"points: expected (n >= 3, 2), got {xy.shape}")
    probability = checks.real_number("probability", probability)
    if not 0 < probability < 1:
        raise ValueError(f"probability: expected between 0 and 1, got {probability:g}")
    variances, axes = np.linalg.eigh(np.cov(xy, rowvar=False))
    radius_squared = -2 * np.log1p(-probability)
    # Ascending eigenvalues; points on a line may leave one just below zero.
    semi_axes = np.sqrt(radius_squared * np.maximum(variances[::-1], 0.0))
    x, y = axes[:, 1]
    return Ellipse(xy.mean(axis=0), semi_axes, float(np.degrees(np.arctan2(y, x))))


def share_inside(points: Floats, ellipse: Ellipse) -> float:
    """Return the share of ``points (n, 2)`` that lie inside the ellipse."""
    angle = np.radians(ellipse.angle)
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    along = (points - ellipse.centre) @ axes.T / ellipse.semi_axes
    return float(((along * along).sum(axis=1) <= 1).mean())
