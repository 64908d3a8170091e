"""Gaussian posteriors, and emulated ones of which the exact weights are known."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from emcee_femu.results.certified_idata import SolvedRun
from emcee_femu.results.inference_data import to_inference_data
from emcee_femu.results.solved_draws import EmulatedChain
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


def draws(law, n, seed):
    """Return independent draws."""
    white = np.random.default_rng(seed).standard_normal((n, len(law.mean)))
    return law.mean + white @ np.linalg.cholesky(law.covariance).T


def chains(law, n, repeats, phi=0.0):
    """Return AR(1) chains of an emulated posterior, of which the sizes are exact."""
    d = len(law.mean)
    white = ar1([phi] * d, n, repeats, seed=1)
    size, squares = (n * (1 - p) / (1 + p) for p in (phi, phi**2))
    bounds = np.tile([-12.0, 12.0], (d, 1))
    names = tuple(f"x{i}" for i in range(1, d + 1))
    sizes = np.array([[size] * d, [squares] * d])
    for own in white.swapaxes(0, 1):
        theta = law.mean + own @ np.linalg.cholesky(law.covariance).T
        yield EmulatedChain(names, theta, law(theta), bounds, size, sizes)


def sampled(emulated, theta):
    """Return the ArviZ object of a run on an emulated posterior with these draws."""
    return to_inference_data(SolvedRun(theta, emulated(theta)), emulated)
