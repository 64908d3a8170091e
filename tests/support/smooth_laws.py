"""Laws with gradients, as a LogPosterior offers them to moves."""

import numpy as np

from .checks import BoundedTriangle, Gaussian


class Differentiable:
    """What a move asks of a posterior; a law beside it is the density."""

    def gradient(self, theta):
        """Return log densities and gradients, NaN where the density is zero."""
        log_prob = self(theta)
        gradient = np.full(theta.shape, np.nan)
        inside = log_prob > -np.inf
        gradient[inside] = self.slope(theta[inside])
        return log_prob[..., None], gradient


class SmoothGaussian(Differentiable, Gaussian):
    """The correlated Gaussian."""

    def slope(self, theta):
        x = (theta - self.mean) / self.scale
        return -(x @ self.precision) / self.scale


class SmoothTriangle(Differentiable, BoundedTriangle):
    """The density that rises to an edge of its box."""

    def slope(self, theta):
        return 1 / theta


class CutGaussian(SmoothGaussian):
    """The correlated Gaussian in a box that cuts three of four draws."""

    LOW, HIGH = -0.5, 1.0

    def __init__(self, scale=(1.0, 1.0, 1.0), ndim=3):
        super().__init__(scale, ndim)
        self.expected = 0.0
        draws = self.sample(np.random.default_rng(9), (100_000,))
        self.expected = self.statistics(draws).mean(axis=0)

    def inside(self, theta):
        x = (theta - self.mean) / self.scale
        return ((x > self.LOW) & (x < self.HIGH)).all(axis=-1)

    def sample(self, rng, size):
        kept, needed = [], int(np.prod(size))
        while sum(map(len, kept)) < needed:
            draws = super().sample(rng, (3 * needed,))
            kept.append(draws[self.inside(draws)])
        return np.concatenate(kept)[:needed].reshape(*size, self.ndim)

    def __call__(self, theta):
        return np.where(self.inside(theta), super().__call__(theta), -np.inf)

    def statistics(self, theta):
        x = (theta - self.mean) / self.scale
        moments = [x, x * x, x * np.roll(x, 1, axis=-1), x**3]
        outside = ~self.inside(theta)[..., None]
        return np.concatenate([*moments, outside], axis=-1) - self.expected
