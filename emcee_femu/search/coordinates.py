"""One map of coordinates: logarithms of positive parameters, logits of bounded ones."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit
from scipy.stats import logistic

from ..contracts import Floats, Prior
from ..evaluation.evaluator import Evaluation
from ..posterior.derivatives import difference, unstack
from ..posterior.log_posterior import LOG_POSTERIOR, LOG_PRIOR
from ..posterior.priors import MOMENT_DRAWS, prior_scale

# Least ratio of the quantiles .95 and .05 at which logarithms are considered.
DECADES = 30.0


@dataclass(frozen=True, eq=False)
class Coordinates:
    """A prior in coordinates: logarithms or logits of some of the parameters.

    Take the stiffness of a support between 1e3 and 1e9: the response bends within a
    small part of that range, and a Gaussian process with one length scale cannot follow
    it. And a posterior pressed against a bound ends abruptly, which no Student t does.

    Attributes:
        prior: The prior.
        logs: Whether a parameter is replaced by its logarithm, ``(d,)``.
        logits: Whether it is replaced by ``ln((x - low) / (high - x))``, with its
            bounds, ``(d,)``.
    """

    prior: Prior
    logs: NDArray[np.bool_]
    logits: NDArray[np.bool_]

    @classmethod
    def plain(cls, prior: Prior) -> Self:
        """Return the parameters themselves as coordinates."""
        return cls(prior, *np.zeros((2, len(prior.names)), dtype=bool))

    @classmethod
    def unbounded(cls, prior: Prior) -> Self:
        """Return coordinates without bounds: a density at a bound gets a tail."""
        low, high = prior.bounds.T
        return cls(prior, (low == 0) & np.isinf(high), np.isfinite(high - low))

    @classmethod
    def positive(cls, prior: Prior) -> Self:
        """Return logarithms of all parameters that are positive."""
        theta = prior.sample(np.random.default_rng(0), MOMENT_DRAWS)
        logs = (theta.min(axis=0) > 0) & (prior.bounds[:, 0] >= 0)
        return cls(prior, logs, np.zeros_like(logs))

    @classmethod
    def of(cls, prior: Prior) -> Self:
        """Return logarithms of parameters over decades that are symmetric on them."""
        theta = prior.sample(np.random.default_rng(0), MOMENT_DRAWS)
        low, middle, high = np.quantile(theta, [0.05, 0.5, 0.95], axis=0)
        logs = cls.positive(prior).logs & (high > DECADES * low)
        ends = np.log(np.where(logs, [low, middle, high], 1.0))
        skew = np.abs(low + high - 2 * middle) / (high - low)
        bend = np.abs(ends[0] + ends[2] - 2 * ends[1])
        logs &= bend < skew * (ends[2] - ends[0])
        return cls(prior, logs, np.zeros_like(logs))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.prior.names

    @property
    def bounds(self) -> Floats:
        """Bounds of the coordinates, ``(d, 2)``."""
        return self.coordinates(self.prior.bounds.T).T

    @property
    def scale(self) -> Floats:
        """Their spread under the prior, from its quartiles, ``(d,)``."""
        return prior_scale(self)

    def logpdf(self, x: Floats) -> Floats:
        """Return the log-density of coordinates ``(n, d)`` under the prior."""
        density: Floats = self.prior.logpdf(self.parameters(x)) + self.log_volume(x)
        return density

    def coordinates(self, theta: Floats) -> Floats:
        """Return the coordinates ``(n, d)`` of parameters within their bounds."""
        x = theta.copy()
        x[:, self.logs] = _log(theta[:, self.logs])
        low, high = self.prior.bounds[self.logits].T
        below, above = theta[:, self.logits] - low, high - theta[:, self.logits]
        x[:, self.logits] = _log(below) - _log(above)
        return x

    def parameters(self, x: Floats) -> Floats:
        """Return the parameters ``(n, d)`` that have these coordinates."""
        theta = x.copy()
        largest = np.log(np.finfo(float).max)
        theta[:, self.logs] = np.exp(np.minimum(x[:, self.logs], largest))
        low, high = self.prior.bounds[self.logits].T
        theta[:, self.logits] = low + (high - low) * expit(x[:, self.logits])
        return theta

    def log_volume(self, x: Floats) -> Floats:
        """Return log-densities of coordinates minus those of parameters, ``(n,)``."""
        volume: Floats = x[:, self.logs].sum(axis=1)
        volume += logistic.logpdf(x[:, self.logits]).sum(axis=1)
        volume += np.log(np.diff(self.prior.bounds[self.logits])).sum()
        return volume

    def lift(self, rows: Floats, x: Floats) -> Floats:
        """Return rows at coordinates ``(n, d)`` with the densities of these."""
        return _shifted(rows, self.log_volume(x))

    def lower(self, rows: Floats, x: Floats) -> Floats:
        """Return rows at coordinates ``(n, d)`` with the densities of parameters."""
        return _shifted(rows, -self.log_volume(x))

    def rows(self, evaluator: Evaluation, x: Floats) -> Floats:
        """Return rows at coordinates ``(n, d)``, with the densities of these."""
        return self.lift(evaluator.rows(self.parameters(x)), x)

    def inside(self, x: Floats) -> Floats:
        """Return parameters within the bounds, which rounding can pass by an ulp."""
        return np.clip(self.parameters(x), *self.prior.bounds.T)

    def linearize(
        self, evaluator: Evaluation, x: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return rows, gradients and information, with the densities of coordinates.

        Unknown values are NaN. Differences are taken in logarithms too, since the steps
        of a small parameter itself would be too long. Logits are not allowed.
        """
        posterior, theta = evaluator.posterior, self.inside(x)
        if self.logs.any() and not posterior.differentiable:

            def look(x: Floats) -> Floats:
                return self.lift(evaluator.stack(self.inside(x), "deviations"), x)

            law = self, self.scale
            stacked = difference(posterior, x, look, True, True, law)
            rows, gradient, information = unstack(posterior, stacked)
        else:
            rows, gradient, information = evaluator.linearize(theta)
            rows, slopes = self.lift(rows, x), np.where(self.logs, theta, 1.0)
            gradient = gradient * slopes + self.logs
            if information is not None:
                information = information * (slopes[:, :, None] * slopes[:, None])
                # At a maximum, the change to a logarithm adds 1 to the curvature.
                information = information + np.diag(1.0 * self.logs)
        if information is None:
            information = np.full((*x.shape, x.shape[1]), np.nan)
        return rows, gradient, information

    def compare(self, evaluator: Evaluation, other: Evaluation, x: Floats) -> Floats:
        """Return rows with the density of another posterior in place of the prior."""
        rows = self.rows(evaluator, x)
        rows[:, LOG_PRIOR] = self.rows(other, x)[:, LOG_POSTERIOR]
        return rows

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` coordinates from the prior."""
        return self.coordinates(self.prior.sample(rng, n))


def _log(distance: Floats) -> Floats:
    """Return logarithms of distances from a bound, finite on it too."""
    return np.asarray(np.log(np.maximum(distance, np.finfo(float).tiny)))


def _shifted(rows: Floats, by: Floats) -> Floats:
    """Return rows with other log-posteriors and log-priors."""
    shifted = rows.copy()
    shifted[:, [LOG_POSTERIOR, LOG_PRIOR]] += by[:, None]
    return shifted
