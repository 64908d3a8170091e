"""Tests with normal likelihoods and priors, whose populations have closed forms."""

import numpy as np
from scipy import stats

from .chains import by_hand

ERROR = 0.2  # of what was measured


def as_idata(names, theta, lp, log_priors, prior, bounds=None):
    """Return draws ``(n, d)`` as to_inference_data would; ``log_priors (n, d)``."""
    ends = np.tile([-np.inf, np.inf], (len(names), 1)) if bounds is None else bounds
    constants = dict(zip(("prior_mean", "prior_sd"), prior, strict=True))
    constants |= {"lower": ends[:, 0], "upper": ends[:, 1]}
    draws, log_prior = (
        dict(zip(names, columns.T[:, None], strict=True))
        for columns in (theta, log_priors)
    )
    sampled = {"lp": lp[None], "log_prior": log_priors.sum(axis=1)[None]}
    return by_hand(draws, constants, sample_stats=sampled, log_prior=log_prior)


def normal_test(rng, measured, error, prior, number=400, names=None, bounds=None):
    """Return the ArviZ object of ``measured = theta + error``, drawn exactly.

    ``prior`` are mean and standard deviation; bounds are stated, and cut nothing.
    """
    mean, sd = map(np.asarray, prior)
    d = len(measured)
    precision = np.linalg.inv(error) + np.diag(1 / sd**2)
    covariance = np.linalg.inv(precision)
    centre = covariance @ (np.linalg.solve(error, measured) + mean / sd**2)
    theta = rng.multivariate_normal(centre, covariance, number)
    log_priors = stats.norm(mean, sd).logpdf(theta)
    log_likelihood = stats.multivariate_normal(measured, error).logpdf(theta)
    names = names or [f"k{i + 1}" for i in range(d)]
    lp = log_likelihood + log_priors.sum(axis=1)
    return as_idata(names, theta, lp, log_priors, prior, bounds)


def many(seed, tests=8, mean=(10.0, 5.0), sd=(0.4, 0.2), width=1.0, **options):
    """Return ``{name: ArviZ object}`` and what was measured, ``(tests, d)``.

    ``mean`` may be that of each test; priors have the standard deviation ``width``.
    """
    rng, mean = np.random.default_rng(seed), np.broadcast_to(mean, (tests, len(sd)))
    theta = rng.normal(mean, sd)
    measured = theta + ERROR * rng.standard_normal(theta.shape)
    noise, wide = ERROR**2 * np.eye(len(sd)), np.full(len(sd), width)
    found = {
        f"test {t + 1}": normal_test(rng, own, noise, (mean[t] + 0.3, wide), **options)
        for t, own in enumerate(measured)
    }
    return found, measured
