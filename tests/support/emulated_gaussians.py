"""Gaussian posteriors, and emulated ones of which the exact weights are known."""

from dataclasses import dataclass

import emcee
import numpy as np
from scipy import stats

import emcee_femu as ef
from support.chains import ar1
from support.free_posterior import box, free_posterior

COVARIANCE = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 1.0]])


@dataclass(frozen=True)
class LogGaussian:
    """A log density that is pickled, with a level that weights must not depend on."""

    mean: np.ndarray
    covariance: np.ndarray
    level: float = 0.0

    def __call__(self, theta):
        law = stats.multivariate_normal(self.mean, self.covariance)
        return self.level + np.atleast_1d(law.logpdf(theta))


TRUE = LogGaussian(np.zeros(3), COVARIANCE)
SHIFTED = LogGaussian(np.array([0.4, 0.2, -0.3]), 1.15 * COVARIANCE, 7.0)
NEAR = LogGaussian(np.array([0.02, 0.0, -0.02]), 1.02 * COVARIANCE, -5.0)


def posterior(law, low=-12.0, high=12.0):
    """Return a law as a posterior inside a box, uniform prior."""
    return free_posterior(law, box(low, high, len(law.mean)))


def draws(law, n, seed, phi=0.0):
    """Return an AR(1) chain of a law, ``(n, d)``; independent draws by default."""
    white = ar1([phi] * len(law.mean), n, 1, seed)[:, 0]
    return law.mean + white @ np.linalg.cholesky(law.covariance).T


def sampled(emulated, theta, walkers=1, ensembles=1):
    """Return the ArviZ object of a run on an emulated posterior with these draws."""
    runs = [_held(emulated, part, walkers) for part in np.split(theta, ensembles)]
    return ef.to_inference_data(runs, emulated)


def _held(emulated, theta, walkers):
    """Return the draws as emcee stores them."""
    rows = emulated(theta).reshape(-1, walkers, len(emulated.rejected()))
    coords = theta.reshape(-1, walkers, theta.shape[1])
    held = emcee.backends.Backend()
    held.reset(walkers, theta.shape[1])
    held.grow(len(rows), rows[0, :, 1:])
    for x, row in zip(coords, rows, strict=True):
        state = emcee.State(x, log_prob=row[:, 0], blobs=row[:, 1:])
        held.save_step(state, np.ones(walkers, dtype=bool))
    return held
