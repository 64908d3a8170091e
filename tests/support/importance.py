"""Posterior moments by importance sampling, a route that shares nothing with MCMC."""

import numpy as np
from scipy import stats


def importance_moments(posterior, pilots, draws, seed):
    """Return mean, sd and Kish size, from Student-t components fitted to the pilots.

    The pilots only shape the proposal: with any proposal that covers the posterior
    the weights make the result exact, and a poor one shows in the Kish size.
    """
    rng = np.random.default_rng(seed)
    scale = np.abs(pilots[0].mean(axis=0))  # areas beside moments of area
    laws = []
    for pilot in pilots:
        x = pilot / scale
        centre, covariance = x.mean(axis=0), np.cov(x, rowvar=False)
        laws.append(stats.multivariate_t(centre, covariance, df=5, seed=rng))
        laws.append(stats.multivariate_t(centre, 6 * covariance, df=5, seed=rng))
    x = np.vstack([law.rvs(draws // len(laws)) for law in laws])
    density = np.mean([law.pdf(x) for law in laws], axis=0)
    parts = np.array_split(x * scale, 1 + len(x) // 5_000)
    log_prob = np.concatenate([posterior(part)[:, 0] for part in parts])
    weights = np.exp(log_prob - log_prob.max()) / density
    weights /= weights.sum()
    mean = weights @ x
    sd = np.sqrt(weights @ (x - mean) ** 2)
    return mean * scale, sd * scale, 1 / (weights**2).sum()
