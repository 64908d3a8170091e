"""The Gaussian that fits the posterior at a maximum, and its mass inside bounds."""

import numpy as np
from scipy import special
from scipy.optimize import brentq, lsq_linear

from ..contracts import Floats

# Curvature at least: no direction is wider than 3.2 prior standard deviations.
LEAST_CURVATURE = 0.1
# Curvature relative to the largest, below which it is rounding.
CURVATURE_ROUNDED = 1e-14
# Draws by which the probability of a box is known to a percent or two.
BOX_DRAWS = 1_000
# Standard deviations beyond which a bound takes nothing away.
FAR_BOUND = 8.0


def log_integral(
    gradient: Floats, curvature: Floats, low: Floats, high: Floats
) -> float:
    r"""Return the log of an integral over the box ``low < p < high`` around a maximum.

    .. math:: \ln \int \exp(g^T p - \tfrac12 p^T H p) \, dp
    """
    values, vectors = np.linalg.eigh(curvature)  # an inverse might be rounded worse
    covariance: Floats = (vectors / values) @ vectors.T
    mean = covariance @ gradient
    log_determinant = np.log(values).sum()
    whole = 0.5 * (len(mean) * np.log(2 * np.pi) - log_determinant + gradient @ mean)
    if is_inside(mean, covariance, low, high):
        return float(whole)
    log_weights = draw_inside(mean, covariance, low, high)[1]
    return float(whole + special.logsumexp(log_weights) - np.log(BOX_DRAWS))


def moments_inside(
    mean: Floats, covariance: Floats, low: Floats, high: Floats
) -> tuple[Floats, Floats]:
    """Return mean and covariance of a Gaussian cut at bounds, by Monte Carlo."""
    if is_inside(mean, covariance, low, high):
        return mean, covariance
    draws, log_weights = draw_inside(mean, covariance, low, high)
    weights = special.softmax(log_weights)
    centre = weights @ draws
    return centre, (draws - centre).T * weights @ (draws - centre)


def is_inside(mean: Floats, covariance: Floats, low: Floats, high: Floats) -> bool:
    """Return whether the bounds are too far to matter."""
    room = np.minimum(mean - low, high - mean)
    return bool((room > FAR_BOUND * np.sqrt(np.diag(covariance))).all())


def draw_inside(
    mean: Floats, covariance: Floats, low: Floats, high: Floats
) -> tuple[Floats, Floats]:
    """Return draws of a Gaussian inside a box and the logs of their weights.

    Source: the simulator of Geweke, Hajivassiliou and Keane; Börsch-Supan and
    Hajivassiliou (1993), doi:10.1016/0304-4076(93)90098-C.
    """
    room = np.minimum(mean - low, high - mean) / np.sqrt(np.diag(covariance))
    order = np.argsort(room)  # the tightest first, for least scatter
    root = np.linalg.cholesky(covariance[np.ix_(order, order)])
    uniform = np.random.default_rng(0).random((BOX_DRAWS, len(mean)))
    white = np.zeros_like(uniform)
    draws = np.empty_like(uniform)
    log_weights = np.zeros(BOX_DRAWS)
    for i, j in enumerate(order):
        centre, spread = mean[j] + white[:, :i] @ root[i, :i], root[i, i]
        ends = (low[j] - centre) / spread, (high[j] - centre) / spread
        log_mass, white[:, i] = _cut_normal(*ends, uniform[:, i])
        draws[:, j] = centre + spread * white[:, i]
        log_weights += log_mass
    return draws, log_weights


def _cut_normal(low: Floats, high: Floats, uniform: Floats) -> tuple[Floats, Floats]:
    """Return log-mass and draws of standard normals cut at ``low`` and ``high``."""
    mirrored = low > 0  # the lower tail keeps its digits
    a, b = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    start, stop = special.log_ndtr(a), special.log_ndtr(b)
    ratio = np.exp(start - stop)
    draws = special.ndtri_exp(stop + np.log(uniform + (1 - uniform) * ratio))
    return stop + np.log1p(-ratio), np.where(mirrored, -draws, draws)


def make_positive(curvature: Floats) -> Floats:
    """Return the matrix with its eigenvalues made positive, and none too small."""
    values, vectors = np.linalg.eigh(curvature)
    least = max(LEAST_CURVATURE, CURVATURE_ROUNDED * values[-1])
    if values[0] >= least:
        return curvature
    return np.asarray((vectors * np.maximum(np.abs(values), least)) @ vectors.T)


def step_within(
    gradient: Floats, curvature: Floats, low: Floats, high: Floats
) -> tuple[Floats, float]:
    """Return the step that maximises a quadratic inside a box, and what it gains."""
    step = np.asarray(np.linalg.solve(curvature, gradient), np.float64)
    if (step < low).any() or (step > high).any():
        root = np.linalg.cholesky(curvature)
        target = np.linalg.solve(root, gradient)
        try:
            step = lsq_linear(root.T, target, (low, high), method="bvls").x
        except np.linalg.LinAlgError:  # LAPACK's SVD does not always end; no SVD then
            step = lsq_linear(root.T, target, (low, high), lsq_solver="lsmr").x
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
