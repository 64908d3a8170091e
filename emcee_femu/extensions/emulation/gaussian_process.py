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

Where slopes are known the processes are conditioned on these too. A slope times the
length along it, :math:`\ell_j \, \partial y / \partial x_j`, has no unit, and with
:math:`\Delta_j = (x_j - x_j') / \ell_j`

.. math:: \mathrm{cov}\Big(z, \ell_j \frac{\partial z'}{\partial x_j'}\Big)
    = k_1 \Delta_j, \qquad
    \mathrm{cov}\Big(\ell_i \frac{\partial z}{\partial x_i},
    \ell_j \frac{\partial z'}{\partial x_j'}\Big)
    = k_1 \delta_{ij} - k_2 \Delta_i \Delta_j, \qquad
    k_{m + 1} = - \frac{1}{r} \frac{d k_m}{d r}, \quad k_0 = k

Source: Solak, Murray-Smith, Leithead, Leith and Rasmussen (2003), Derivative
observations in Gaussian process models of dynamic systems.
"""

# scikit-learn has neither lengths that outputs share, nor a trend in the restricted
# likelihood, nor slopes, nor leaving one out.

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dtrmm
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from ...contracts import Floats

NUGGET = 1e-7  # of the amplitude squared: keeps the factor of close points definite
VAGUE = 1e6  # the same for an unknown slope
STRAIGHT = 0.01  # outputs this close to their trend do not affect the lengths
LEAST_OF_OUTPUT = 1e-20  # variance of an output that is straight
SCALES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # first lengths, in spreads of the points
LONGEST_LENGTH = 200.0  # length, in spreads, beyond which the trend says as much
# Values and slopes by which lengths are found, of points early and late.
LENGTH_ROWS = 300


class Processes:
    """Gaussian processes of a given kernel, conditioned on the values at ``N`` points.

    Where leaving one out shows larger errors than the likelihood expects, these set the
    amplitude.

    Args:
        points: Where the values are known, ``(N, d)``.
        values: ``(N, 1, q)``, or ``(N, 1 + d, q)`` with the slopes behind each; NaN
            where the slopes of a point are not known.
        lengths: Of the kernel, one for each coordinate, ``(d,)``.
        rough: Whether the kernel is Matern's.

    Attributes:
        sloped: Whether slopes are known at some points.
        covariance: Of the outputs' amplitudes, ``(q, q)``.
        amplitudes: Standard deviations of the processes about their trend, ``(q,)``.
        left_out_sd: The ``unit_sd`` of each point of the fit from the others, ``(N,)``.
    """

    def __init__(
        self, points: Floats, values: Floats, lengths: Floats, rough: bool
    ) -> None:
        self.points, self.values = points, values
        self.lengths, self.rough, self.sloped = lengths, rough, values.shape[1] > 1
        known, stacked, trend = _scale(points, values, lengths)
        width = known.shape[1]
        kernel = _correlate(points, points, lengths, rough, width, width)[0]
        factor = _factor(kernel, known)
        # The inverse of the factor, it times the trend (M, p), and the inverse of the
        # factor of the trend's information.
        whitener = solve_triangular(factor, np.eye(len(factor)), lower=True)
        white_trend, white = whitener @ trend, whitener @ stacked
        information = np.linalg.cholesky(white_trend.T @ white_trend)
        unknown = solve_triangular(information, np.eye(len(information)), lower=True)
        self._whitener, self._white_trend, self._trend = whitener, white_trend, unknown
        # The precision of values and slopes, free of the trend, (M, M), and the
        # covariance of a point's value and slopes given the others.
        hidden, each = unknown @ white_trend.T @ whitener, np.arange(len(points))
        self._projector: Floats = whitener.T @ whitener - hidden.T @ hidden
        own = self._projector.reshape(kernel.shape)[each, :, each]
        self._left_out = np.linalg.inv(own)
        self.left_out_sd: Floats = np.sqrt(self._left_out[:, 0, 0])
        slopes = unknown.T @ (unknown @ (white_trend.T @ white))
        residual = white - white_trend @ slopes
        # Of kernel and trend, (M + p, q).
        self._weights: Floats = np.vstack([whitener.T @ residual, slopes])
        # The variance of Student's t, which values of unknown amplitude have.
        free = max(int(known.sum()) - trend.shape[1] - 2, 1)
        covariance = residual.T @ residual / free
        sd = np.sqrt(covariance.diagonal()) * self.left_out_sd[:, None]
        ratios = self.leave_out(values) / np.maximum(sd, np.sqrt(LEAST_OF_OUTPUT))
        wider = np.sqrt(np.maximum((ratios**2).mean(axis=0), 1.0))
        self.covariance: Floats = covariance * np.outer(wider, wider)
        self.amplitudes: Floats = np.sqrt(self.covariance.diagonal())

    def predict(self, points: Floats) -> Floats:
        """Return means ``(n, q)`` at points ``(n, d)``."""
        return np.asarray(np.hstack(self._basis(points, 1)) @ self._weights)

    def unit_sd(self, points: Floats) -> Floats:
        """Return the standard deviation ``(n,)`` of an output of amplitude one."""
        explained, hidden = self._parts(points, 1)
        square = 1.0 - (explained**2).sum(axis=1) + (hidden**2).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(square, 0.0)))

    def unit_covariance(self, points: Floats, extra: Floats) -> Floats:
        """Return the covariance ``(n, n)`` between points, of amplitude one.

        Args:
            points: Where, ``(n, d)``.
            extra: Points ``(m, d)`` that are solved too, whatever comes out.
        """
        explained, hidden = self._parts(points, 1)
        left = self._correlate(points, points, 1, 1)
        left += hidden @ hidden.T - explained @ explained.T
        if len(extra):
            width = self.values.shape[1]
            there, free = self._parts(extra, width)
            between = self._correlate(extra, points, width, 1)
            between += free @ hidden.T - there @ explained.T
            among = self._correlate(extra, extra, width, width)
            among += free @ free.T - there @ there.T
            factor = np.linalg.cholesky(among + NUGGET * np.eye(len(among)))
            known = solve_triangular(factor, between, lower=True)
            left -= known.T @ known
        return left

    def slopes(self, points: Floats) -> Floats:
        """Return the derivatives of the means by the coordinates, ``(n, q, d)``."""
        n, d = points.shape
        moved = np.hstack(self._basis(points, 1 + d)) @ self._weights
        slopes: Floats = moved.reshape(n, 1 + d, -1)[:, 1:] / self.lengths[:, None]
        return slopes.swapaxes(1, 2)

    def leave_out(self, values: Floats) -> Floats:
        """Return what each point of ``values`` differs by from the others' fit.

        The trend is refitted, lengths and amplitudes are kept; a point is left out with
        its slopes.

        Args:
            values: As those of the processes, of any ``r`` outputs.

        Returns:
            ``(N, r)``.

        Source: Dubrule (1983), doi:10.1007/BF01033232.
        """
        stacked = _scale(self.points, values, self.lengths)[1]
        residuals = (self._projector @ stacked).reshape(values.shape)
        return np.asarray((self._left_out[:, :1] @ residuals)[:, 0])

    def _correlate(self, a: Floats, b: Floats, rows: int, columns: int) -> Floats:
        blocks = _correlate(a, b, self.lengths, self.rough, rows, columns)[0]
        return blocks.reshape(len(a) * rows, len(b) * columns)

    def _basis(self, points: Floats, width: int) -> tuple[Floats, Floats]:
        """Return kernel ``(n, M)`` and trend ``(n, p)``, slopes scaled."""
        kernel = self._correlate(points, self.points, width, self.values.shape[1])
        trend = _trend(points, len(self._trend), self.lengths, width)
        return kernel, trend

    def _parts(self, points: Floats, width: int) -> tuple[Floats, Floats]:
        """Return what the values tell ``(n, M)`` and the trend hides ``(n, p)``."""
        kernel, trend = self._basis(points, width)
        # The whitener is a triangle, of which this takes half the time.
        explained = dtrmm(1.0, self._whitener, kernel.T, lower=True).T
        hidden = trend - explained @ self._white_trend
        return explained, hidden @ self._trend.T


def fit_processes(
    points: Floats,
    values: Floats,
    start: Floats | None = None,
    kinds: tuple[bool, ...] = (False, True),
) -> Processes:
    r"""Return the processes whose kernel has the largest restricted likelihood.

    .. math:: -2 \ln L = (M - p) \sum_k \ln \sigma_k^2
        + q \ln |R| + q \ln |F^T R^{-1} F| - 2 q \ln |S|

    of a smooth and a rough kernel, by L-BFGS over the lengths from ``start`` and from a
    common length, or from several such. S holds the lengths that scale the slopes among
    the M numbers known of each output. Outputs that are as good as straight have no say
    in it.

    Args:
        points: ``(N, d)`` coordinates of at least three points, of about unit spread;
            two where slopes are known.
        values: ``(N, 1, q)``, in units in which 0.01 does not matter; ``(N, 1 + d, q)``
            with the slopes by the coordinates behind, NaN where they are not known.
        start: Lengths ``(d,)``, those of the last fit.
        kinds: Whether the kernels that are tried are rough.

    Source: Santner, Williams and Notz (2018), doi:10.1007/978-1-4939-8847-1; Bachoc
    (2013) for amplitudes by leaving one out, doi:10.1016/j.csda.2013.03.016.

    Examples:
        >>> x = np.linspace(-1.0, 1.0, 7)[:, None]
        >>> fitted = fit_processes(x, 100.0 * np.sin(x)[:, None])
        >>> at = np.array([[0.5]])
        >>> sd = fitted.unit_sd(at) * fitted.amplitudes
        >>> error = fitted.predict(at)[0] - 100.0 * np.sin(0.5)
        >>> bool(abs(error[0]) < 5.0 * sd[0] < 0.5)
        True
    """
    spread = np.maximum(points.std(axis=0), 1e-12)
    _, stacked, trend = _scale(points, values, np.ones(points.shape[1]))
    stacked -= trend @ np.linalg.lstsq(trend, stacked, rcond=None)[0]
    square = (stacked**2).mean(axis=0)
    counts = square / (square + STRAIGHT**2)  # of outputs that are not straight
    bent = np.where(np.isnan(values), np.nan, stacked.reshape(values.shape))
    most = max(LENGTH_ROWS // values.shape[1], 3) if values.shape[1] > 1 else np.inf
    some = np.linspace(0, len(points) - 1, int(min(most, len(points)))).astype(int)

    def cost(logs: Floats, rough: bool) -> tuple[float, Floats]:
        return _restricted(points[some], bent[some], np.exp(logs), rough, counts)

    bounds = np.log(np.outer(spread, [0.1, LONGEST_LENGTH]))
    common = [np.log(scale * spread) for scale in SCALES]
    how = {"method": "L-BFGS-B", "jac": True, "bounds": bounds}
    how["options"] = {"maxiter": 100}
    best, lengths, kind = np.inf, spread, False
    for rough in kinds:
        starts = common
        if start is not None:  # and a common one, lest a valley holds the last ones
            starts = [np.log(start), min(common, key=lambda x: cost(x, rough)[0])]
        for first in starts:
            climb = minimize(cost, np.clip(first, *bounds.T), (rough,), **how)
            if climb.fun < best:
                best, lengths, kind = climb.fun, np.exp(climb.x), rough
    return Processes(points, values, lengths, kind)


def _kernel(
    a: Floats, b: Floats, lengths: Floats, rough: bool
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the kernel between points ``(n, d)`` and ``(m, d)``, and k_1, k_2, k_3."""
    a, b = a / lengths, b / lengths
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    square = np.maximum(square, 0.0, out=square)
    if not rough:
        square *= -0.5
        smooth = np.exp(square, out=square)
        return smooth, smooth, smooth, smooth
    r = np.sqrt(5.0 * square)
    decay = np.exp(-r)
    second = 25.0 / 3.0 * decay
    third = 5.0 * np.divide(second, r, out=np.zeros_like(r), where=r > 0)
    return (1.0 + r + r**2 / 3.0) * decay, (1.0 + r) * second / 5.0, second, third


def _correlate(
    a: Floats, b: Floats, lengths: Floats, rough: bool, rows: int, columns: int
) -> tuple[Floats, tuple[Floats, ...], Floats]:
    """Return correlations ``(n, rows, m, columns)``, k_1 to k_3, and the scaled gaps.

    Of values alone where rows or columns are 1, with the scaled slopes behind where
    they are ``1 + d``.
    """
    k, *others = _kernel(a, b, lengths, rough)
    if rows == columns == 1:
        return k[:, None, :, None], tuple(others), np.empty(0)
    apart = (a[:, None] - b) / lengths
    blocks = np.empty((len(a), rows, len(b), columns))
    blocks[:, 0, :, 0] = k
    first = others[0][:, :, None] * apart
    if columns > 1:
        blocks[:, 0, :, 1:] = first
    if rows > 1:
        blocks[:, 1:, :, 0] = -first.swapaxes(1, 2)
    if rows == columns:
        second = others[1][:, None, :, None] * apart.swapaxes(1, 2)[..., None]
        blocks[:, 1:, :, 1:] = -second * apart[:, None]
        each = np.arange(1, rows)
        blocks[:, each, :, each] += others[0]
    return blocks, tuple(others), apart


def _scale(
    points: Floats, values: Floats, lengths: Floats
) -> tuple[NDArray[np.bool_], Floats, Floats]:
    """Return which numbers are known ``(N, w)``, they and the trend, slopes scaled.

    As rows ``(M, q)`` and ``(M, p)``, point by point; zero where they are not known.
    The trend is linear, or constant where that is all that can be told.
    """
    known = np.asarray(~np.isnan(values).any(axis=2))
    width, d = values.shape[1], points.shape[1]
    scales = np.concatenate([[1.0], lengths])[:width, None]
    stacked = np.nan_to_num(values * scales).reshape(known.size, -1)
    size = d + 1 if known.sum() >= d + 3 else 1
    return known, stacked, _trend(points, size, lengths, width)


def _trend(points: Floats, size: int, lengths: Floats, width: int) -> Floats:
    """Return the columns of the trend at points and of its scaled slopes."""
    trend = np.zeros((len(points), width, size))
    trend[:, 0, 0], trend[:, 0, 1:] = 1.0, points[:, : size - 1]
    if size > 1:
        trend[:, 1:, 1:] = np.diag(lengths)[: width - 1]
    return trend.reshape(-1, size)


def _factor(kernel: Floats, known: NDArray[np.bool_]) -> Floats:
    """Return the Cholesky factor of a kernel ``(N, w, N, w)`` and its nugget."""
    kernel = kernel.reshape(known.size, known.size).copy()
    kernel[np.diag_indices(len(kernel))] += np.where(known, NUGGET, VAGUE).ravel()
    return np.asarray(np.linalg.cholesky(kernel))


def _restricted(
    points: Floats, values: Floats, lengths: Floats, rough: bool, counts: Floats
) -> tuple[float, Floats]:
    """Return minus the restricted log-likelihood, and its slopes by log-lengths.

    Outputs have a say in it by their ``counts (q,)``, from 0 to 1.
    """
    known, stacked, trend = _scale(points, values, lengths)
    width = known.shape[1]
    kernel, others, apart = _correlate(points, points, lengths, rough, width, width)
    factor = _factor(kernel, known)
    inverse = np.tril(dpotri(factor, lower=True)[0])
    inverse += np.tril(inverse, -1).T
    weighed = inverse @ trend
    information = np.linalg.cholesky(trend.T @ weighed)
    half = solve_triangular(information, weighed.T, lower=True)
    projector = inverse - half.T @ half
    projected = projector @ stacked
    free, total = int(known.sum()) - trend.shape[1], counts.sum()
    squares = (stacked * projected).sum(axis=0)
    variances = np.maximum(squares / free, LEAST_OF_OUTPUT)
    logs = np.log(factor.diagonal()).sum() + np.log(information.diagonal()).sum()
    slopes_known = known[:, 1:].sum(axis=0)
    logs -= slopes_known @ np.log(lengths[: width - 1])
    cost = 0.5 * free * (counts * np.log(variances)).sum() + total * logs
    # d cost / d R, as blocks of values and slopes
    inner = total * projector - (projected * counts / variances) @ projected.T
    pull = inner.reshape(kernel.shape)
    first, second, third = others
    by_square = first * pull[:, 0, :, 0]
    if width == 1:  # the squared differences by coordinates come as products
        scaled = points / lengths
        around = by_square.sum(axis=1) @ scaled**2
        return float(cost), around - (scaled * (by_square @ scaled)).sum(axis=0)
    across, within = pull[:, 0, :, 1:], pull[:, 1:, :, 1:]
    along = np.einsum("aibj,abj->abi", within, apart)
    by_square += second * np.einsum("aibi->ab", within)
    by_square += 2.0 * second * (across * apart).sum(axis=2)
    by_square -= third * (along * apart).sum(axis=2)
    by_gap = 2.0 * (second[:, :, None] * along - first[:, :, None] * across)
    steep = np.einsum("ab,abm,abm->m", by_square, apart, apart)
    steep += (by_gap * apart).sum(axis=(0, 1))
    own = (pull * kernel).sum(axis=(2, 3))
    own += NUGGET * inner.diagonal().reshape(own.shape)
    return float(cost), 0.5 * steep - own[:, 1:].sum(axis=0)
