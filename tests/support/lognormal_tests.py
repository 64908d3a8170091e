"""Tests of d independent parameters whose logarithms are measured.

Their likelihoods are skewed, and draws of their posteriors exact; and the posterior of
the population falls apart into d of two dimensions, each by quadrature.
"""

import numpy as np
from scipy import stats

MEAN, SPREAD, ERROR = 1.0, 0.06, 0.1
PRIOR = stats.lognorm(0.3, scale=1.1)


def simulate(rng, tests, d):
    """Return ln of what was measured, ``(tests, d)``."""
    theta = MEAN + SPREAD * rng.standard_normal((tests, d))
    return np.log(theta) + ERROR * rng.standard_normal(theta.shape)


GRID, STEP = np.linspace(0.5, 1.7, 601, retstep=True)


def log_marginals(measured, mean, sd):
    """Return ln of each test's likelihood ``(n, tests)`` of one parameter."""
    likelihood = np.exp(-0.5 * ((np.log(GRID) - measured[:, None]) / ERROR) ** 2)
    edges = np.append(GRID, GRID[-1] + STEP) - STEP / 2
    law = np.diff(stats.norm(mean[:, None], sd[:, None]).cdf(edges), axis=1)
    return np.log(law @ likelihood.T)


def quadrature(measured, hyperpriors, names=("mean k1", "sd k1"), points=60):
    """Return grids and weights ``(points, points)`` of one parameter's mean and sd."""
    tests = len(measured)
    reach = 6 * np.hypot(SPREAD, ERROR) / np.sqrt(tests)
    means = np.linspace(MEAN - reach, MEAN + reach, points)
    spreads = (np.arange(points) + 0.5) / points * (0.06 + 0.8 / np.sqrt(tests))
    mean, sd = (v.ravel() for v in np.meshgrid(means, spreads, indexing="ij"))
    total = log_marginals(measured, mean, sd).sum(axis=1)
    total += hyperpriors[names[0]].logpdf(mean) + hyperpriors[names[1]].logpdf(sd)
    weights = np.exp(total - total.max()).reshape(points, points)
    return means, spreads, weights / weights.sum()
