r"""Gaussian processes of many outputs, with a linear trend and shared length scales.

.. math:: y(x) = B^T f(x) + z(x), \qquad f = (1, x_1, \dots, x_d), \qquad
    \mathrm{cov}(z(x), z(x')) = \Sigma \, k(x, x')

with the squared exponential kernel, or Matern's of twice differentiable functions where
there are kinks that a smooth one would deny,

.. math:: r^2 = \sum_j \Big(\frac{x_j - x_j'}{\ell_j}\Big)^2, \qquad
    k = e^{-r^2 / 2} \quad \text{or} \quad
    k = \Big(1 + \sqrt5 r + \frac{5 r^2}{3}\Big) e^{-\sqrt5 r}

One kernel for all outputs means one Cholesky factor, and predictions that are matrix
products. The trend is integrated out under a flat prior.
"""

# scikit-learn has neither lengths that outputs share, nor a trend in the restricted
# likelihood, nor slopes, nor leaving one out.

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.optimize import minimize

from ..interfaces import Floats

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
        lengths: Of the kernel, one for each coordinate, ``(d,)``.
        rough: Whether the kernel is Matern's.
        covariance: Of the outputs' amplitudes, ``(q, q)``.
    """

    points: Floats
    values: Floats
    lengths: Floats
    rough: bool
    covariance: Floats
    _whitener: Floats = field(repr=False)  # inverse of the kernel's Cholesky factor
    _trend: Floats = field(repr=False)  # the same of the trend's information
    _weights: Floats = field(repr=False)  # of kernel and trend, (N + p, q)

    @classmethod
    def condition(
        cls, points: Floats, values: Floats, lengths: Floats, rough: bool
    ) -> "Processes":
        """Return the processes of a given kernel, conditioned on the values.

        Where leaving one out shows larger errors than the likelihood expects, these set
        the amplitude.
        """
        trend = _trend(points, _trend_size(points))
        kernel = _correlate(points, points, lengths, rough)[0]
        whitener = solve_triangular(_factor(kernel), np.eye(len(points)), lower=True)
        white_trend, white = whitener @ trend, whitener @ values
        information = np.linalg.cholesky(white_trend.T @ white_trend)
        unknown = solve_triangular(information, np.eye(len(information)), lower=True)
        slopes = unknown.T @ (unknown @ (white_trend.T @ white))
        residual = white - white_trend @ slopes
        weights = np.vstack([whitener.T @ residual, slopes])
        # The variance of Student's t, which values of unknown amplitude have.
        free = max(len(points) - trend.shape[1] - 2, 1)
        covariance = residual.T @ residual / free
        expected = cls(
            points, values, lengths, rough, covariance, whitener, unknown, weights
        )
        sd = np.maximum(
            expected.amplitudes * expected.left_out_sd[:, None], np.sqrt(TINY)
        )
        ratios = expected.leave_out(values) / sd
        wider = np.sqrt(np.maximum((ratios**2).mean(axis=0), 1.0))
        return replace(expected, covariance=covariance * np.outer(wider, wider))

    @property
    def amplitudes(self) -> Floats:
        """Standard deviations of the processes about their trend, ``(q,)``."""
        return np.asarray(np.sqrt(self.covariance.diagonal()))

    def predict(self, points: Floats) -> Floats:
        """Return means ``(n, q)`` at points ``(n, d)``."""
        kernel = self._correlate(points, self.points)
        basis = np.hstack([kernel, _trend(points, len(self._trend))])
        predicted: Floats = basis @ self._weights
        return predicted

    def unit_sd(self, points: Floats, extra: Floats | None = None) -> Floats:
        """Return the standard deviation ``(n,)`` of an output of amplitude one.

        Args:
            points: Where, ``(n, d)``.
            extra: Points ``(m, d)`` that are solved too, whatever comes out.
        """
        explained, hidden = self._parts(points)
        square = 1.0 - (explained**2).sum(axis=1) + (hidden**2).sum(axis=1)
        if extra is not None and len(extra):
            there, free = self._parts(extra)
            between = self._correlate(extra, points)
            between += free @ hidden.T - there @ explained.T
            among = self._correlate(extra, extra) + free @ free.T - there @ there.T
            factor = np.linalg.cholesky(among + NUGGET * np.eye(len(extra)))
            square -= (solve_triangular(factor, between, lower=True) ** 2).sum(axis=0)
        return np.asarray(np.sqrt(np.maximum(square, 0.0)))

    def slopes(self, points: Floats) -> Floats:
        """Return the derivatives of the means by the coordinates, ``(n, q, d)``."""
        n, d = points.shape
        steep = _correlate(points, self.points, self.lengths, self.rough)[1]
        size, q = self.values.shape
        weights = self._weights[:size]
        moved = weights[:, :, None] * self.points[:, None]
        pulled = (steep @ moved.reshape(size, q * d)).reshape(n, q, d)
        slopes = pulled - (steep @ weights)[:, :, None] * points[:, None]
        slopes /= self.lengths**2
        if len(self._weights) > size + 1:
            slopes += self._weights[size + 1 :].T
        return slopes

    def leave_out(self, values: Floats) -> Floats:
        """Return what each point of ``values (N, r)`` differs by from the others' fit.

        The trend is refitted, lengths and amplitudes are kept.

        Source: Dubrule (1983), doi:10.1007/BF01033232.
        """
        residuals: Floats = self._projector @ values
        return residuals / self._projector.diagonal()[:, None]

    @property
    def left_out_sd(self) -> Floats:
        """The ``unit_sd`` of each point of the fit from the others, ``(N,)``."""
        return np.asarray(1.0 / np.sqrt(self._projector.diagonal()))

    @cached_property
    def _projector(self) -> Floats:
        """The precision of the values, free of the trend, ``(N, N)``."""
        trend = _trend(self.points, len(self._trend))
        part = self._trend @ (self._whitener @ trend).T @ self._whitener
        projector: Floats = self._whitener.T @ self._whitener - part.T @ part
        return projector

    def _correlate(self, a: Floats, b: Floats) -> Floats:
        return _correlate(a, b, self.lengths, self.rough)[0]

    def _parts(self, points: Floats) -> tuple[Floats, Floats]:
        """Return what the values tell ``(n, N)`` and the trend hides ``(n, p)``."""
        size = len(self._trend)
        explained = self._correlate(points, self.points) @ self._whitener.T
        white_trend = self._whitener @ _trend(self.points, size)
        hidden = _trend(points, size) - explained @ white_trend
        return explained, hidden @ self._trend.T


def fit_processes(
    points: Floats, values: Floats, start: Floats | None = None
) -> Processes:
    r"""Return the processes whose kernel has the largest restricted likelihood.

    .. math:: -2 \ln L = (N - p) \sum_k \ln \sigma_k^2
        + q \ln |R| + q \ln |F^T R^{-1} F|

    of a smooth and a rough kernel, by L-BFGS over the lengths from ``start`` and from a
    common length, or from several such. Outputs that are as good as straight have no
    say in it.

    Args:
        points: ``(N, d)`` coordinates of at least three points, of about unit spread.
        values: ``(N, q)``, in units in which 0.01 does not matter.
        start: Lengths ``(d,)``, those of the last fit.

    Source: Santner, Williams and Notz (2018), doi:10.1007/978-1-4939-8847-1; Bachoc
    (2013) for amplitudes by leaving one out, doi:10.1016/j.csda.2013.03.016.

    Examples:
        >>> x = np.linspace(-1.0, 1.0, 7)[:, None]
        >>> fitted = fit_processes(x, 100.0 * np.sin(x))
        >>> at = np.array([[0.5]])
        >>> sd = fitted.unit_sd(at) * fitted.amplitudes
        >>> error = fitted.predict(at)[0] - 100.0 * np.sin(0.5)
        >>> bool(abs(error[0]) < 5.0 * sd[0] < 0.5)
        True
    """
    spread = np.maximum(points.std(axis=0), 1e-12)
    trend = _trend(points, _trend_size(points))
    bent = values - trend @ np.linalg.lstsq(trend, values, rcond=None)[0]
    square = (bent**2).mean(axis=0)
    counts = square / (square + STRAIGHT**2)  # of outputs that are not straight

    def cost(logs: Floats, rough: bool) -> tuple[float, Floats]:
        return _restricted(points, bent, trend, np.exp(logs), rough, counts)

    bounds = np.log(np.outer(spread, [0.1, WIDEST]))
    common = [np.log(scale * spread) for scale in SCALES]
    best, lengths, kind = np.inf, spread, False
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
                best, lengths, kind = climb.fun, np.exp(climb.x), rough
    return Processes.condition(points, values, lengths, kind)


def _correlate(
    a: Floats, b: Floats, lengths: Floats, rough: bool
) -> tuple[Floats, Floats]:
    r"""Return the correlations of points ``(n, d)`` with others ``(n, m)``, and slopes.

    The slope by :math:`x_j` is minus the second times :math:`(x_j - x_j') / \ell_j^2`.
    """
    a, b = a / lengths, b / lengths
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    square = np.maximum(square, 0.0, out=square)
    if not rough:
        square *= -0.5
        smooth = np.exp(square, out=square)
        return smooth, smooth
    r = np.sqrt(5.0 * square)
    decay = np.exp(-r)
    return (1.0 + r + r**2 / 3.0) * decay, 5.0 / 3.0 * (1.0 + r) * decay


def _trend_size(points: Floats) -> int:
    """Return how many columns of a trend the points can tell: linear, or constant."""
    n, d = points.shape
    return d + 1 if n >= d + 3 else 1


def _trend(points: Floats, size: int) -> Floats:
    return np.hstack([np.ones((len(points), 1)), points[:, : size - 1]])


def _factor(kernel: Floats) -> Floats:
    """Return the Cholesky factor of a kernel and its nugget."""
    kernel = kernel.copy()
    np.fill_diagonal(kernel, 1.0 + NUGGET)
    return np.asarray(np.linalg.cholesky(kernel))


def _restricted(
    points: Floats,
    values: Floats,
    trend: Floats,
    lengths: Floats,
    rough: bool,
    counts: Floats,
) -> tuple[float, Floats]:
    """Return minus the restricted log-likelihood, and its slopes by log-lengths.

    Outputs have a say in it by their ``counts (q,)``, from 0 to 1.
    """
    kernel, steep = _correlate(points, points, lengths, rough)
    factor = _factor(kernel)
    inverse = cho_solve((factor, True), np.eye(len(points)))
    weighed = inverse @ trend
    information = np.linalg.cholesky(trend.T @ weighed)
    half = solve_triangular(information, weighed.T, lower=True)
    projector = inverse - half.T @ half
    projected = projector @ values
    free, total = len(points) - trend.shape[1], counts.sum()
    squares = (values * projected).sum(axis=0)
    variances = np.maximum(squares / free, TINY)
    logs = np.log(factor.diagonal()).sum() + np.log(information.diagonal()).sum()
    cost = 0.5 * free * (counts * np.log(variances)).sum() + total * logs
    # d cost / d R, times R; the squared differences by coordinates come as products
    inner = total * projector - (projected * counts / variances) @ projected.T
    pull = 0.5 * steep * inner
    scaled = points / lengths
    around = (pull.sum(axis=1) @ scaled**2) - (scaled * (pull @ scaled)).sum(axis=0)
    return float(cost), 2.0 * around
