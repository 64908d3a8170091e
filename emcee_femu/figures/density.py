"""Where the mass of two parameters lies: an ellipse, or regions of highest density."""

import math

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from ..contracts import Floats

RADIUS = math.sqrt(-2 * math.log(0.05))  # of an ellipse, in standard deviations
REGION_SHARES = 0.95, 0.5  # of the draws in the regions
CELLS = 160  # along an axis
LINE = 1e-8  # 1 - r^2 of points on a line
SMOOTH = 1.25  # times Scott's rule, for even outlines
TENTH = 0.251  # standard deviations of a Gaussian that hold its middle tenth
# Area that region and ellipse share, over that of both, from which draws count as
# Gaussian; the second for one independent draw, since few draws make ragged regions.
SAME_WIDTH, GRID_NOISE = 0.8, 1.5


def covariance_ellipse(points: Floats) -> tuple[Floats, float]:
    r"""Return the ellipse that holds 95 % of a Gaussian like the points ``(n, 2)``.

    .. math:: (x - \bar x)^T C^{-1} (x - \bar x) = \chi^2_2(0.95) = -2 \ln 0.05

    with mean and covariance of the points; 95 % of the joint distribution lie inside
    2.448 standard deviations, not the 1.96 of one variable.

    Returns:
        Its major and minor axis ``(2,)``, and the angle from the first coordinate to
        the major one, counter-clockwise in degrees.

    Examples:
        >>> square = np.array([[1.0, 1], [1, -1], [-1, 1], [-1, -1]])
        >>> covariance_ellipse(square)[0].round(3).tolist()
        [5.653, 5.653]
    """
    variances, axes = np.linalg.eigh(np.cov(points, rowvar=False))
    # Ascending eigenvalues; points on a line may leave one just below zero.
    variances = np.maximum(variances[::-1], 0.0)
    x, y = axes[:, 1]
    return 2 * RADIUS * np.sqrt(variances), float(np.degrees(np.arctan2(y, x)))


def estimate_density(
    points: Floats, limits: Floats, size: float
) -> tuple[tuple[Floats, Floats, Floats], Floats, bool] | None:
    """Return the density of points ``(n, 2)`` inside the axes' limits ``(2, 2)``.

    A histogram of coordinates without correlation, smoothed by a Gaussian as wide as
    ``size`` independent points allow, in units of the narrowest tenth of them along
    each axis: separate clouds stay separate. Points are mirrored at the limits, so that
    a density that leans on a bound does not fade there. None for points on a line.
    """
    near = points[((points >= limits[:, 0]) & (points <= limits[:, 1])).all(axis=1)]
    centre, scale = near.mean(axis=0), near.std(axis=0)
    correlation: Floats = np.atleast_2d(np.corrcoef(near, rowvar=False))
    if not 1 - correlation[0, 1] ** 2 > LINE:
        return None
    # x = centre + turn z; without correlation z are the parameters themselves.
    turn = scale[:, None] * np.linalg.cholesky(correlation)
    back = np.linalg.inv(turn)
    z = (near - centre) @ back.T
    tenth = min(max(len(z) // 10, 50), len(z) - 1)  # fewer may be close by chance
    ordered = np.sort(z, axis=0)
    narrow = (ordered[tenth:] - ordered[:-tenth]).min(axis=0) / TENTH
    width = SMOOTH * np.where(narrow < 0.4, narrow, 1.0) * size ** (-1 / 6)
    low, high = z.min(axis=0) - 4 * width, z.max(axis=0) + 4 * width
    cells = (high - low) / CELLS
    mirrored = [near]
    for axis, end in np.ndindex(2, 2):
        mirrored.append(near.copy())
        mirrored[-1][:, axis] = 2 * limits[axis, end] - near[:, axis]
    everywhere = (np.concatenate(mirrored) - centre) @ back.T
    edges = np.linspace(low, high, CELLS + 1).T
    counts = np.histogramdd(everywhere, bins=[*edges])[0]
    values = gaussian_filter(counts, width / cells, mode="constant")
    at_points = np.zeros(len(points))  # none where the axes do not reach
    places = ((z - low) / cells - 0.5).T
    at_points[: len(near)] = map_coordinates(values, places, order=1)
    levels = np.quantile(at_points, 1 - np.array(REGION_SHARES))
    centres = low + cells * (0.5 + np.arange(CELLS)[:, None])
    x = centre + np.stack(np.meshgrid(*centres.T, indexing="ij"), axis=-1) @ turn.T
    covariance = np.cov(points, rowvar=False)
    offsets = x - points.mean(axis=0)
    squares = np.einsum("...i,ij,...j", offsets, np.linalg.inv(covariance), offsets)
    shown = ((x >= limits[:, 0]) & (x <= limits[:, 1])).all(axis=-1)
    region = (values >= levels[0]) & shown
    cell = abs(np.linalg.det(turn)) * np.prod(cells)
    shared = (region & (squares <= RADIUS**2)).sum() * cell
    ellipse = math.pi * RADIUS**2 * math.sqrt(np.linalg.det(covariance))
    overlap = shared / (ellipse + region.sum() * cell - shared)
    reach = RADIUS * np.sqrt(np.diag(covariance))
    ends = points.mean(axis=0) + np.outer([-1, 1], reach)
    fits = ((ends >= limits[:, 0]) & (ends <= limits[:, 1])).all()
    gaussian = bool(fits and overlap > SAME_WIDTH - GRID_NOISE / math.sqrt(size))
    return (x[..., 0], x[..., 1], values), levels, gaussian
