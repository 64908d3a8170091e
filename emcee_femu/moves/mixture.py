"""Mixtures of multivariate Student-t distributions: density, draws, fits to draws."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np
from numpy.random import Generator, RandomState
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from scipy.special import gammaln

from .. import checks
from ..contracts import Floats

GAUSSIAN = 1e6  # degrees of freedom above which a component is Gaussian
MOST_FITTED = 6  # components of a fit
MOST_FIT_DRAWS = 20_000  # more make a fit slower, not better
EM_ITERATIONS, EM_TOLERANCE = 300, 1e-5
PER_PARAMETER = 10  # draws that a component needs
COVER_WEIGHT = 0.1  # weight of the component that covers gaps between the others
LEAST_VARIANCE_SHARE = 1e-6  # of the variance of all draws
WEIGHTS_ROUNDED = 1e-9  # of the sum of weights: rounding, of up to a million components


@dataclass(frozen=True, eq=False)
class Mixture:
    r"""A mixture of multivariate Student-t distributions with the same tails.

    .. math:: q(x) = \sum_k w_k\, t_\nu(x; \mu_k, S_k)

    The covariance of a component is ``S df / (df - 2)``. It may be the law of the
    logarithms of some parameters; what it draws, and the density, is that of the
    parameters all the same.

    Attributes:
        weights: ``(k,)``, not below zero, which sum to one.
        means: Centres, ``(k, d)``, with the logarithms of those parameters.
        matrices: Scale matrices S, ``(k, d, d)``, positive definite.
        df: Degrees of freedom of all components.
        logs: Which parameters are seen by their logarithms, ``(d,)``; None for none.

    Raises:
        ValueError: If the weights sum to something else: draws and density would not
            be of the same law.
    """

    weights: Floats
    means: Floats
    matrices: Floats
    df: float = 8.0
    logs: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        """Check the weights."""
        if abs(self.weights.sum() - 1) > WEIGHTS_ROUNDED:
            raise ValueError(
                f"weights: expected a sum of one, got {self.weights.sum()}; divide "
                "them by their sum"
            )

    @cached_property
    def factors(self) -> Floats:
        """The Cholesky factors of the scale matrices, ``(k, d, d)``."""
        return np.asarray(np.linalg.cholesky(self.matrices), dtype=float)

    @cached_property
    def inverses(self) -> Floats:
        """The inverses of the factors, ``(k, d, d)``."""
        return np.asarray(np.linalg.inv(self.factors), dtype=float)

    @cached_property
    def log_heights(self) -> Floats:
        """The log of each component's share of the density at its centre, ``(k,)``."""
        d, df = self.means.shape[1], self.df
        diagonals = np.diagonal(self.factors, axis1=1, axis2=2)
        with np.errstate(divide="ignore"):  # a component may have no weight
            heights: Floats = np.log(self.weights)
        heights -= np.log(diagonals).sum(axis=1)
        heights += gammaln((df + d) / 2) - gammaln(df / 2)
        heights -= 0.5 * d * np.log(df * np.pi)
        return heights

    def given(self, kept: NDArray[np.bool_]) -> Self:
        """Return the law of a draw that is of one of some components, ``(k,)``."""
        weights = self.weights[kept]
        return replace(
            self,
            weights=weights / weights.sum(),
            means=self.means[kept],
            matrices=self.matrices[kept],
        )

    def coordinates(self, x: Floats) -> Floats:
        """Return parameters ``(n, d)`` with the logarithms of some of them."""
        if self.logs is None:
            return x
        positive = np.maximum(x, np.finfo(float).tiny)
        return np.where(self.logs, np.log(positive), x)

    def seen_in(self, logs: NDArray[np.bool_] | None) -> Self:
        """Return the mixture in other coordinates, each component about its centre.

        Where a component is wider than its distance from zero, it is put so far away.
        """
        d = self.means.shape[1]
        here, there = (np.zeros(d, bool) if x is None else x for x in (self.logs, logs))
        slopes = np.where(here, np.exp(np.where(here, self.means, 0.0)), 1.0)
        means = np.where(here, slopes, self.means)
        matrices = self.matrices * (slopes[:, :, None] * slopes[:, None])
        sds = np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
        slopes = np.where(there, np.maximum(means, sds), 1.0)
        means = np.where(there, np.log(slopes), means)
        matrices = matrices / (slopes[:, :, None] * slopes[:, None])
        return replace(self, means=means, matrices=matrices, logs=logs)

    def squared_distances(self, x: Floats) -> Floats:
        """Return the squared Mahalanobis distance ``(n, k)`` of each x ``(n, d)``."""
        return self._squared_distances(self.coordinates(x))

    def _squared_distances(self, x: Floats) -> Floats:
        standard = (x - self.means[:, None]) @ self.inverses.transpose(0, 2, 1)
        distances: Floats = np.einsum("kni,kni->kn", standard, standard)
        return distances.T

    def log_parts(self, x: Floats) -> Floats:
        """Return the log of each component's share of the density, ``(n, k)``."""
        x = self.coordinates(x)
        parts = self._log_parts_at(self._squared_distances(x))
        if self.logs is not None:
            parts -= x[:, self.logs].sum(axis=1)[:, None]
        return parts

    def _log_parts_at(self, squared_distances: Floats) -> Floats:
        parts: Floats = np.log1p(squared_distances / self.df)
        parts *= -0.5 * (self.df + self.means.shape[1])
        parts += self.log_heights
        return parts

    def log_density(self, x: Floats) -> Floats:
        """Return the log density ``(n,)`` at ``x (n, d)``."""
        # A hundred times as fast for few points as logsumexp of SciPy.
        return np.asarray(np.logaddexp.reduce(self.log_parts(x), axis=1))

    def draw(self, random: Generator | RandomState, n: int) -> Floats:
        """Draw ``(n, d)``."""
        several = len(self.weights) > 1
        if several:
            edges = np.cumsum(self.weights)[:-1]
            which = edges.searchsorted(random.random(n), side="right")
        normal = random.standard_normal((n, self.means.shape[1]))
        normal *= np.sqrt(self.df / random.chisquare(self.df, n))[:, None]
        drawn: Floats
        if several:
            drawn = np.einsum("nij,nj->ni", self.factors.take(which, axis=0), normal)
            drawn += self.means.take(which, axis=0)
        else:  # in a third of the time
            drawn = normal @ self.factors[0].T
            drawn += self.means[0]
        if self.logs is not None:
            with np.errstate(over="ignore"):  # out of any bounds
                drawn[:, self.logs] = np.exp(drawn[:, self.logs])
        return drawn

    def improve(
        self, x: Floats, shares: Floats, most: int = 50, tolerance: float = 1e-4
    ) -> tuple["Mixture", float]:
        r"""Return the mixture fitted to weighted draws by EM, starting from this one.

        .. math:: \max_q \sum_i W_i \ln q(x_i)

        Scale matrices are drawn towards those of the start, as if ``d + 1`` draws had
        said so, and a component on which less than one effective draw is left is
        dropped.

        Args:
            x: Draws, ``(n, d)``.
            shares: Their weights W, which sum to one.
            most: Iterations.
            tolerance: Gain of the mean log density below which they end.

        Returns:
            The fit, and its mean log density over the weighted draws, in its own
            coordinates.

        Source: Peel and McLachlan (2000), doi:10.1023/A:1008981510081.
        """
        d, df, x = x.shape[1], self.df, self.coordinates(x)
        size = 1.0 / np.sum(shares**2)
        best, gained, mixture, before = self, -np.inf, self, self.matrices
        for _ in range(most):
            distances = mixture._squared_distances(x)
            log_parts = mixture._log_parts_at(distances)
            log_density = np.logaddexp.reduce(log_parts, axis=1)
            mean_log = float(shares @ log_density)
            if mean_log - gained < tolerance:
                break
            best, gained = mixture, mean_log
            belongs = np.exp(log_parts - log_density[:, None]) * shares[:, None]
            counts = belongs.sum(axis=0)
            alive = counts * size > 1.0
            if not alive.any():
                break
            if not alive.all():
                belongs, counts = belongs[:, alive], counts[alive]
                before, distances = before[alive], distances[:, alive]
            pull = belongs * (df + d) / (df + distances)
            means = (pull.T @ x) / pull.sum(axis=0)[:, None]
            apart = x - means[:, None]
            sums = (pull.T[:, None, :] * apart.transpose(0, 2, 1)) @ apart
            n = (counts**2 / np.einsum("nk,nk->k", belongs, belongs))[:, None, None]
            matrices = n * sums / counts[:, None, None] + (d + 1) * before
            weights = counts / counts.sum()
            mixture = Mixture(weights, means, matrices / (n + d + 1), df, self.logs)
        return best, gained

    @classmethod
    def fit(
        cls,
        draws: Floats,
        components: int | Literal["auto"] = "auto",
        df: float = 8.0,
        covered: bool = True,
    ) -> Self:
        """Return a mixture fitted to draws of equal weight.

        With several components a tenth of the weight goes to one that is fitted to all
        draws: it covers gaps between the others.

        Args:
            draws: ``(n, d)``, at least ``10 d`` per component.
            components: How many, or "auto" for the number from 1 to 6 that the Bayesian
                information criterion prefers.
            df: Degrees of freedom of every component.
            covered: Whether there is a component for gaps.

        Raises:
            ValueError: If there are too few draws, they lie in a subspace, or no fit of
                that many components is possible.
        """
        n, d = draws.shape
        fewest = PER_PARAMETER * d * (1 if components == "auto" else components)
        if n < fewest or not d:
            raise ValueError(f"samples: expected {fewest} draws or more, got {n}")
        # Evenly spaced, so that every walker and time of a chain takes part.
        draws = draws[np.linspace(0, n - 1, min(n, MOST_FIT_DRAWS)).astype(int)]
        # Whitened by all draws: scales may differ by 1e11, correlations be 0.99999.
        centre = draws.mean(axis=0)
        covariance = np.atleast_2d(np.cov(draws, rowvar=False))
        factor = checks.covariance_factor("samples (their covariance)", covariance)
        white = (draws - centre) @ np.linalg.inv(factor).T
        most = min(MOST_FITTED, len(draws) // (PER_PARAMETER * d))
        counts = range(1, most + 1) if components == "auto" else [components]
        whole = _fit_white(white, 1, df)
        fits = [whole if k == 1 else _fit_white(white, k, df) for k in counts]
        possible = [fit for fit in fits if fit is not None]
        if whole is None or not possible:
            raise ValueError(
                f"samples: no fit with {components} components; give more draws, or "
                "ask for fewer components"
            )
        best, _ = min(possible, key=lambda fit: fit[1])
        weights, means, matrices = best.weights, best.means, best.matrices
        if len(weights) > 1:
            weights = np.append((1 - COVER_WEIGHT) * weights, COVER_WEIGHT)
            means = np.vstack([means, whole[0].means])
            matrices = np.concatenate([matrices, whole[0].matrices])
        means, matrices = centre + means @ factor.T, factor @ matrices @ factor.T
        fitted = cls(weights, means, matrices, df)
        if covered:
            return fitted
        return fitted.given(np.arange(len(weights)) < len(best.weights))


def _fit_white(x: Floats, count: int, df: float) -> tuple[Mixture, float] | None:
    """Return a fit to whitened draws, and its BIC; None where a component dies."""
    n, d = x.shape
    labels = np.zeros(n, dtype=np.intp)
    if count > 1:
        _, labels = kmeans2(x, count, minit="++", rng=np.random.default_rng(0))
    clusters = [x[labels == number] for number in range(count)]
    if min(map(len, clusters)) < 2 * d:
        return None
    start = Mixture(
        np.array([len(cluster) / n for cluster in clusters]),
        np.array([cluster.mean(axis=0) for cluster in clusters]),
        _widen(np.array([np.atleast_2d(np.cov(cluster.T)) for cluster in clusters])),
        df,
    )
    shares = np.full(n, 1 / n)
    fitted, mean_log = start.improve(x, shares, EM_ITERATIONS, EM_TOLERANCE)
    if len(fitted.weights) < count or fitted.weights.min() * n < 2 * d:
        return None
    n_parameters = count * (1 + d + d * (d + 1) / 2) - 1
    bic = -2 * n * mean_log + n_parameters * np.log(n)
    return replace(fitted, matrices=_widen(fitted.matrices)), bic


def _widen(matrices: Floats) -> Floats:
    """Return scale matrices with a ridge on those that are nearly singular.

    A walker that hardly moved, caught in a local maximum, needs a component of its own:
    only then do independence proposals set it free.
    """
    narrow = np.linalg.eigvalsh(matrices)[:, 0] < LEAST_VARIANCE_SHARE
    ridges: Floats = (
        LEAST_VARIANCE_SHARE * np.eye(matrices.shape[1]) * narrow[:, None, None]
    )
    return matrices + ridges
