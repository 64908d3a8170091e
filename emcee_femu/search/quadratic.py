"""The Gaussian that fits the posterior at a maximum, and its mass inside bounds."""

import numpy as np
from scipy import special
from scipy.optimize import brentq, lsq_linear

from ..contracts import Floats

# Least curvature: no direction is wider than 3.2 prior standard deviations.
LEAST_CURVATURE = 0.1
# Curvature relative to the largest, below which it is rounding.
CURVATURE_ROUNDED = 1e-14
# Draws from which the probability of a box is estimated to a percent or two.
BOX_DRAWS = 1_000
# Standard deviations from which on a bound cuts off nothing.
FAR_BOUND = 8.0


def log_integral(
    gradient: Floats, curvature: Floats, low: Floats, high: Floats
) -> float:
    r"""Return the log of an integral over the box ``low < p < high`` around a maximum.

    .. math:: \ln \int \exp(g^T p - \tfrac12 p^T H p) \, dp
    """
    values, vectors = np.linalg.eigh(curvature)  # an inverse might be rounded worse
    covariance: Floats = (vectors / values) @ vectors.T
    mean, d = covariance @ gradient, len(gradient)
    log_scale = 0.5 * (d * np.log(2 * np.pi) - np.log(values).sum())
    if is_inside(mean, covariance, low, high):
        return float(log_scale + 0.5 * gradient @ mean)
    top, gain = step_within(gradient, curvature, low, high)
    slope = gradient - curvature @ top
    log_weights = _draw_about(top, slope, mean, covariance, low, high)[1]
    mean_weight = special.logsumexp(log_weights) - np.log(BOX_DRAWS)
    return float(gain + log_scale + mean_weight)


def moments_inside(
    mean: Floats, covariance: Floats, low: Floats, high: Floats
) -> tuple[Floats, Floats]:
    """Return mean and covariance of a Gaussian cut at bounds, by Monte Carlo."""
    if is_inside(mean, covariance, low, high):
        return mean, covariance
    draws, weights = draw_inside(mean, covariance, low, high)
    centre = weights @ draws
    return centre, (draws - centre).T * weights @ (draws - centre)


def is_inside(mean: Floats, covariance: Floats, low: Floats, high: Floats) -> bool:
    """Return whether the bounds are too far to matter."""
    room = np.minimum(mean - low, high - mean)
    return bool((room > FAR_BOUND * np.sqrt(np.diag(covariance))).all())


def draw_inside(
    mean: Floats, covariance: Floats, low: Floats, high: Floats
) -> tuple[Floats, Floats]:
    """Return draws of a Gaussian inside a box, and their weights, which sum to one."""
    curvature = np.asarray(np.linalg.inv(covariance), np.float64)
    top = mean + step_within(np.zeros_like(mean), curvature, low - mean, high - mean)[0]
    slope = curvature @ (mean - top)
    draws, log_weights = _draw_about(top, slope, mean, covariance, low, high)
    return draws, special.softmax(log_weights)


def _draw_about(
    top: Floats,
    slope: Floats,
    mean: Floats,
    covariance: Floats,
    low: Floats,
    high: Floats,
) -> tuple[Floats, Floats]:
    r"""Return draws of a Gaussian inside a box, and the logs of their weights.

    The mean of the weights is the integral over the box of the density relative to that
    at ``top``, over that of the whole Gaussian relative to its largest. Each coordinate
    is drawn given those before, with the slope that the density has there at the top of
    the box. Without that slope, those before would be drawn as if later bounds took
    nothing away, which fails where the mean is far outside several bounds.

    Args:
        top: The point inside the box where the Gaussian is largest.
        slope: The gradient of its logarithm there.
        mean: Its mean.
        covariance: Its covariance.
        low: The lower ends of the box.
        high: The upper ends.

    Source: the simulator of Geweke, Hajivassiliou and Keane; Börsch-Supan and
    Hajivassiliou (1993), doi:10.1016/0304-4076(93)90098-C. The slopes are a choice of
    what Botev (2017), doi:10.1111/rssb.12162, finds by optimization.
    """
    room = np.minimum(mean - low, high - mean) / np.sqrt(np.diag(covariance))
    order = np.argsort(room)  # the tightest first, for least scatter
    root = np.linalg.cholesky(covariance[np.ix_(order, order)])
    alone = np.diag(root) * slope[order]
    pushed = root.T @ slope[order] - alone  # by bounds of later coordinates
    uniform = np.random.default_rng(0).random((BOX_DRAWS, len(mean)))
    white = np.zeros_like(uniform)
    draws = np.empty_like(uniform)
    log_weights = np.zeros(BOX_DRAWS)
    for i, j in enumerate(order):
        centre, spread = top[j] + white[:, :i] @ root[i, :i], root[i, i]
        ends = (low[j] - centre) / spread, (high[j] - centre) / spread
        log_mass, white[:, i] = _cut_normal(*ends, alone[i], uniform[:, i])
        draws[:, j] = centre + spread * white[:, i]
        log_weights += log_mass + pushed[i] * white[:, i]
    return draws, log_weights


def _cut_normal(
    low: Floats, high: Floats, slope: float, uniform: Floats
) -> tuple[Floats, Floats]:
    r"""Return log-masses and draws of normals cut at ``low`` and ``high``.

    .. math:: \frac{1}{\sqrt{2 \pi}} \int \exp(s w - \tfrac12 w^2) \, dw

    No digits are lost to the square of the slope s, however steep it is.
    """
    mirrored = low > slope  # the lower tail keeps its digits
    a, b = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    s = np.where(mirrored, -slope, slope)
    start, stop, outside = a - s, b - s, b < s
    with np.errstate(all="ignore"):  # in the branch not taken
        scaled = [np.log(0.5 * special.erfcx(-x / 2**0.5)) for x in (start, stop)]
        log_ratio = np.where(
            outside,
            scaled[0] - scaled[1] + 0.5 * (b - a) * (start + stop),
            special.log_ndtr(start) - special.log_ndtr(stop),
        )
        log_mass = np.where(
            outside,
            scaled[1] + b * (s - b / 2),
            special.log_ndtr(stop) + s**2 / 2,
        )
    ratio = np.exp(log_ratio)
    below = special.log_ndtr(stop) + np.log(uniform + (1 - uniform) * ratio)
    draws = np.clip(s + special.ndtri_exp(below), a, b)
    return log_mass + np.log1p(-ratio), np.where(mirrored, -draws, draws)


def make_positive(curvature: Floats) -> Floats:
    """Return the matrix with its eigenvalues made positive, and none too small."""
    values, vectors = np.linalg.eigh(curvature)
    least = max(LEAST_CURVATURE, CURVATURE_ROUNDED * values[-1])
    if values[0] >= least:
        return curvature
    return np.asarray((vectors * np.maximum(np.abs(values), least)) @ vectors.T)


def clip_curvature(curvature: Floats) -> Floats:
    """Return the matrix with its eigenvalues made positive, by no more than rounding.

    Those below zero become as good as zero: the density goes on as its slope does.
    """
    values, vectors = np.linalg.eigh(curvature)
    least = CURVATURE_ROUNDED * max(1.0, values[-1])
    return np.asarray((vectors * np.maximum(values, least)) @ vectors.T)


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


def find_damping(
    gradient: Floats, curvature: Floats, radius: float, low: Floats, high: Floats
) -> float:
    """Return what to add to the diagonal for a step in a box, at most a radius long."""
    identity = np.eye(len(gradient))

    def excess(damping: float) -> float:
        step, _ = step_within(gradient, curvature + damping * identity, low, high)
        return float(np.linalg.norm(step)) - radius

    if excess(0.0) <= 0:
        return 0.0
    most = float(np.linalg.norm(gradient)) / radius
    if excess(most) >= 0:  # by rounding
        return most
    return float(brentq(excess, 0.0, most, rtol=1e-3))
