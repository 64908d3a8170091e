r"""Gaussian processes of many outputs, with a linear trend and shared length scales.

.. math:: y(x) = B^T f(x) + z(x), \qquad f = (1, x_1, \dots, x_d), \qquad
    \mathrm{cov}(z(x), z(x')) = \Sigma \, k(x, x')

One kernel for all outputs means one Cholesky factor, and predictions that are matrix
products. The trend is integrated out under a flat prior.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.optimize import minimize

from ..interfaces import Floats
from .kernel import Kernel

NUGGET = 1e-7  # of the amplitude squared: keeps the factor of close points definite
STRAIGHT = 0.01  # an output that leaves its trend by less has no say in the lengths
TINY = 1e-20  # variance of an output that is straight
SCALES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # first lengths, in spreads of the points
WIDEST = 200.0  # length, in spreads, beyond which the trend says as much


@dataclass(frozen=True, eq=False)
class Processes:
    """Gaussian processes conditioned on ``N`` points; made by :func:`fit_processes`.

    Attributes:
        points: Where the values are known, ``(N, d)``.
        values: ``(N, q)``.
        kernel: The correlation of all outputs.
        covariance: Of the outputs' amplitudes, ``(q, q)``.
    """

    points: Floats
    values: Floats
    kernel: Kernel
    covariance: Floats
    _whitener: Floats = field(repr=False)  # inverse of the kernel's Cholesky factor
    _trend: Floats = field(repr=False)  # the same of the trend's information
    _weights: Floats = field(repr=False)  # of kernel and trend, (N + p, q)

    @property
    def lengths(self) -> Floats:
        """The length scales ``(d,)``."""
        return self.kernel.lengths

    @property
    def amplitudes(self) -> Floats:
        """Standard deviations of the processes about their trend, ``(q,)``."""
        result: Floats = np.sqrt(self.covariance.diagonal())
        return result

    def predict(self, points: Floats) -> tuple[Floats, Floats]:
        """Return means and standard deviations ``(n, q)`` at points ``(n, d)``."""
        kernel, trend = self._basis(points)
        mean = np.hstack([kernel, trend]) @ self._weights
        return mean, self.doubt(points)[:, None] * self.amplitudes

    def doubt(self, points: Floats) -> Floats:
        """Return the standard deviation ``(n,)`` for an amplitude of one."""
        known, unknown = self._parts(points)
        square = 1.0 - (known**2).sum(axis=1) + (unknown**2).sum(axis=1)
        result: Floats = np.sqrt(np.maximum(square, 0.0))
        return result

    def slopes(self, points: Floats) -> Floats:
        """Return the derivatives of the means by the coordinates, ``(n, q, d)``."""
        n, d = points.shape
        steep = self.kernel.steepen(points, self.points)
        size, q = self.values.shape
        weights = self._weights[:size]
        moved = weights[:, :, None] * self.points[:, None]
        pulled = (steep @ moved.reshape(size, q * d)).reshape(n, q, d)
        slopes = pulled - (steep @ weights)[:, :, None] * points[:, None]
        slopes /= self.lengths**2
        if len(self._weights) > size + 1:
            slopes += self._weights[size + 1 :].T
        return slopes

    def leave_one_out(self) -> tuple[Floats, Floats]:
        """Return residuals and standard deviations of each point from the others.

        Trend refitted, lengths and amplitudes kept; each ``(N, q)``.

        Source: Dubrule (1983), doi:10.1007/BF01033232.
        """
        sd = self.amplitudes / np.sqrt(self._projector().diagonal()[:, None])
        return self.leave_out(self.values), sd

    def leave_out(self, values: Floats) -> Floats:
        """Return such residuals of any values ``(N, r)`` at these points."""
        projector = self._projector()
        result: Floats = projector @ values / projector.diagonal()[:, None]
        return result

    def variance_after(self, points: Floats, extra: Floats) -> Floats:
        """Return the variances ``(n, q)``, once ``extra (m, d)`` were solved too."""
        known, unknown = self._parts(points)
        at, free = self._parts(extra)
        square = 1.0 - (known**2).sum(axis=1) + (unknown**2).sum(axis=1)
        if len(extra):
            between = self.kernel.correlate(extra, points)
            between += free @ unknown.T - at @ known.T
            own = self.kernel.correlate(extra, extra) + free @ free.T - at @ at.T
            own[np.diag_indices(len(extra))] += NUGGET
            factor = np.linalg.cholesky(own)
            square -= (solve_triangular(factor, between, lower=True) ** 2).sum(axis=0)
        result: Floats = np.maximum(square, 0.0)[:, None] * self.covariance.diagonal()
        return result

    def _basis(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the kernel to the known points ``(n, N)`` and the trend ``(n, p)``."""
        size = len(self._weights) - len(self.values)
        return self.kernel.correlate(points, self.points), _trend(points, size)

    def _parts(self, points: Floats) -> tuple[Floats, Floats]:
        """Return what the values tell ``(n, N)`` and the trend hides ``(n, p)``."""
        kernel, trend = self._basis(points)
        known = kernel @ self._whitener.T
        own = self._whitener @ _trend(self.points, trend.shape[1])
        return known, (trend - known @ own) @ self._trend.T

    def _projector(self) -> Floats:
        """Return the precision of the values, free of the trend, ``(N, N)``."""
        size = len(self._weights) - len(self.values)
        unknown = self._trend @ (self._whitener @ _trend(self.points, size)).T
        part = unknown @ self._whitener
        return self._whitener.T @ self._whitener - part.T @ part


def fit_processes(
    points: Floats, values: Floats, start: Floats | None = None
) -> Processes:
    r"""Return the processes whose kernel has the largest restricted likelihood.

    .. math:: -2 \ln L = (N - p) \sum_k \ln \sigma_k^2
        + q \ln |R| + q \ln |F^T R^{-1} F|

    of a smooth and a rough kernel, by L-BFGS over the lengths from ``start`` and from a
    common length, or from several such. Outputs that are as good as straight have no
    say in it. Where leaving one out shows larger errors than the likelihood expects,
    these set the amplitude.

    Args:
        points: ``(N, d)`` coordinates, best of about unit spread.
        values: ``(N, q)``, in units in which 0.01 does not matter.
        start: Lengths ``(d,)``, those of the last fit.

    Raises:
        ValueError: If there are fewer than three points, or shapes do not fit.

    Source: Santner, Williams and Notz (2018), doi:10.1007/978-1-4939-8847-1; Bachoc
    (2013) for amplitudes by leaving one out, doi:10.1016/j.csda.2013.03.016.

    Examples:
        >>> x = np.linspace(-1.0, 1.0, 7)[:, None]
        >>> mean, sd = fit_processes(x, 100.0 * np.sin(x)).predict(np.array([[0.5]]))
        >>> bool(abs(mean[0, 0] - 100.0 * np.sin(0.5)) < 5.0 * sd[0, 0] < 0.5)
        True
    """
    if len(points) < 3 or points.ndim != 2 or len(points) != len(values):
        raise ValueError(
            "points, values: expected (N, d) and (N, q) of at least three points, got "
            f"{points.shape} and {values.shape}"
        )
    spread = np.maximum(points.std(axis=0), 1e-12)
    trend = _trend(points, _trend_size(points))
    bent = values - trend @ np.linalg.lstsq(trend, values, rcond=None)[0]
    square = (bent**2).mean(axis=0)
    say = square / (square + STRAIGHT**2)

    def cost(logs: Floats, rough: bool) -> tuple[float, Floats]:
        return _restricted(points, bent, trend, Kernel(np.exp(logs), rough), say)

    bounds = np.log(np.outer(spread, [0.1, WIDEST]))
    common = [np.log(scale * spread) for scale in SCALES]
    best, kernel = np.inf, Kernel(spread, False)
    for rough in (False, True):
        starts = common
        if start is not None:  # and a common one, lest a valley holds the last ones
            starts = [np.log(start), min(common, key=lambda x: cost(x, rough)[0])]
        for first in starts:
            climb = minimize(
                cost,
                np.clip(first, *bounds.T),
                (rough,),
                jac=True,
                method="L-BFGS-B",
                bounds=bounds,
                options={"maxiter": 100},
            )
            if climb.fun < best:
                best, kernel = climb.fun, Kernel(np.exp(climb.x), rough)
    return _condition(points, values, trend, kernel)


def _trend_size(points: Floats) -> int:
    """Return how many columns of a trend the points can tell: linear, or constant."""
    n, d = points.shape
    return d + 1 if n >= d + 3 else 1


def _trend(points: Floats, size: int) -> Floats:
    return np.hstack([np.ones((len(points), 1)), points[:, : size - 1]])


def _factor(kernel: Floats) -> Floats:
    """Return the Cholesky factor of a kernel and its nugget."""
    kernel = kernel.copy()
    kernel[np.diag_indices(len(kernel))] = 1.0 + NUGGET
    return np.asarray(np.linalg.cholesky(kernel), dtype=float)


def _restricted(
    points: Floats, values: Floats, trend: Floats, kernel: Kernel, say: Floats
) -> tuple[float, Floats]:
    """Return minus the restricted log-likelihood, and its slopes by log-lengths.

    Each output counts as often as it has a say, ``(q,)``.
    """
    factor = _factor(kernel.correlate(points, points))
    inverse = cho_solve((factor, True), np.eye(len(points)))
    weighed = inverse @ trend
    information = np.linalg.cholesky(trend.T @ weighed)
    half = solve_triangular(information, weighed.T, lower=True)
    projector = inverse - half.T @ half
    projected = projector @ values
    free, count = len(points) - trend.shape[1], say.sum()
    squares = (values * projected).sum(axis=0)
    variances = np.maximum(squares / free, TINY)
    logs = np.log(factor.diagonal()).sum() + np.log(information.diagonal()).sum()
    cost = 0.5 * free * (say * np.log(variances)).sum() + count * logs
    # d cost / d R, times R; the squared differences by coordinates come as products
    inner = count * projector - (projected * say / variances) @ projected.T
    pull = 0.5 * kernel.steepen(points, points) * inner
    scaled = points / kernel.lengths
    around = (pull.sum(axis=1) @ scaled**2) - (scaled * (pull @ scaled)).sum(axis=0)
    return float(cost), 2.0 * around


def _condition(
    points: Floats, values: Floats, trend: Floats, kernel: Kernel
) -> Processes:
    """Return the processes of a given kernel, conditioned on the values."""
    eye = np.eye(len(points))
    whitener = solve_triangular(
        _factor(kernel.correlate(points, points)), eye, lower=True
    )
    own, white = whitener @ trend, whitener @ values
    information = np.linalg.cholesky(own.T @ own)
    unknown = solve_triangular(information, np.eye(len(information)), lower=True)
    slopes = unknown.T @ (unknown @ (own.T @ white))
    residual = white - own @ slopes
    weights = np.vstack([whitener.T @ residual, slopes])
    # The variance of Student's t, which values of unknown amplitude have.
    free = max(len(points) - trend.shape[1] - 2, 1)
    covariance = residual.T @ residual / free
    known = Processes(points, values, kernel, covariance, whitener, unknown, weights)
    errors, sd = known.leave_one_out()
    usual = np.maximum(sd, np.sqrt(TINY))
    wider = np.sqrt(np.maximum(((errors / usual) ** 2).mean(axis=0), 1.0))
    covariance = covariance * np.outer(wider, wider)
    return Processes(points, values, kernel, covariance, whitener, unknown, weights)
