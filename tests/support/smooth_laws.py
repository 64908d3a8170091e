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
