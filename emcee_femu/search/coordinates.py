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
from ..posterior.priors import prior_scale

# Draws of the prior by which its quantiles are known.
QUANTILE_DRAWS = 20_000
# Ratio of the quantiles .95 and .05, from which logarithms are natural.
DECADES = 30.0


@dataclass(frozen=True, eq=False)
class Coordinates:
    """A prior in coordinates: logarithms or logits of some of the parameters.

    The stiffness of a support between 1e3 and 1e9, say: what a model makes of it bends
    within a small part of the range, and no process of one length follows that. And a
    posterior that is pressed to a bound ends there abruptly, as no Student t does.

    Attributes:
        prior: The prior.
        logs: Whether a parameter is seen by its logarithm, ``(d,)``.
        logits: Whether by ``ln((x - low) / (high - x))`` between its bounds, ``(d,)``.
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
        """Return coordinates that know no bounds: what is pressed to one has a tail."""
        low, high = prior.bounds.T
        return cls(prior, (low == 0) & np.isinf(high), np.isfinite(high - low))

    @classmethod
    def positive(cls, prior: Prior) -> Self:
        """Return logarithms of all parameters that are positive."""
        theta = prior.sample(np.random.default_rng(0), QUANTILE_DRAWS)
        logs = (theta.min(axis=0) > 0) & (prior.bounds[:, 0] >= 0)
        return cls(prior, logs, np.zeros_like(logs))

    @classmethod
    def of(cls, prior: Prior) -> Self:
        """Return logarithms of parameters over decades if these are symmetric so."""
        theta = prior.sample(np.random.default_rng(0), QUANTILE_DRAWS)
        low, middle, high = np.quantile(theta, [0.05, 0.5, 0.95], axis=0)
        logs = cls.positive(prior).logs & (high > DECADES * low)
        ends = np.log(np.where(logs, [low, middle, high], 1.0))
        skew = np.abs(low + high - 2 * middle) / (high - low)
        bend = np.abs(ends[0] + ends[2] - 2 * ends[1])
        logs &= bend < skew * (ends[2] - ends[0])
        return cls(prior, logs, np.zeros_like(logs))

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the parameters."""
        return self.prior.names

    @property
    def bounds(self) -> Floats:
        """Those of the coordinates, ``(d, 2)``."""
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
        """Return by what the log-density of coordinates exceeds that of parameters."""
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

        NaN is what is not known. Differences are of logarithms too: beside a small
        value those of the parameter would be too far. There may be no logits.
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
                # At a maximum a logarithm bends the density by one more.
                information = information + np.diag(1.0 * self.logs)
        if information is None:
            information = np.full((*x.shape, x.shape[1]), np.nan)
        return rows, gradient, information

    def compare(self, evaluator: Evaluation, other: Evaluation, x: Floats) -> Floats:
        """Return rows, the density of another posterior in place of the prior's."""
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
