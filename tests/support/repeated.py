"""Repeated tests of a two-parameter structure, and their population by quadrature.

Two equal storeys of unit mass on springs k1 and k2, which differ from test to test;
two frequencies are measured. Each test is drawn exactly, by rejection, under
a lognormal prior, whose mean is not that of the population and whose spread is not
much larger.
"""

import numpy as np
import xarray
from scipy import stats

import emcee_femu as ef

from .chains import wrap

NAMES = ("k1", "k2")
NOISE = 0.02  # of ln f
PRIOR = ef.IndependentPrior(
    {"k1": stats.lognorm(0.15, scale=0.9), "k2": stats.lognorm(0.12, scale=1.2)}
)
GRID = np.linspace(0.55, 1.75, 241)


def as_idata(names, theta, lp, log_priors, prior, bounds=None):
    """Return draws ``(n, d)`` as to_inference_data would; ``log_priors (n, d)``."""

    def group(columns):
        values = {name: (("chain", "draw"), v[None]) for name, v in columns.items()}
        return xarray.Dataset(values, attrs={"sampled": list(names)})

    ends = np.tile([-np.inf, np.inf], (len(names), 1)) if bounds is None else bounds
    mean, sd = prior
    constants = {"lower": ends[:, 0], "upper": ends[:, 1]}
    constants |= {"prior_mean": mean, "prior_sd": sd}
    by_parameter = {name: ("parameter", v) for name, v in constants.items()}
    return wrap(
        {
            "posterior": group(dict(zip(names, theta.T, strict=True))),
            "sample_stats": group({"lp": lp, "log_prior": log_priors.sum(axis=1)}),
            "log_prior": group(dict(zip(names, log_priors.T, strict=True))),
            "constant_data": xarray.Dataset(by_parameter, {"parameter": list(names)}),
        }
    )


def frequencies(k1, k2):
    """Return both, on a last axis."""
    trace, root = k1 + 2 * k2, np.sqrt(k1**2 + 4 * k2**2)
    return np.sqrt(np.stack([(trace - root) / 2, (trace + root) / 2], axis=-1))


def log_likelihood(measured, k1, k2):
    deviations = np.log(frequencies(k1, k2) / measured) / NOISE
    return -0.5 * (deviations**2).sum(axis=-1)


def draw_test(rng, measured, number):
    """Return draws ``(number, 2)`` of a test's posterior, by rejection."""
    k1, k2 = np.meshgrid(GRID[::2], GRID[::2], indexing="ij")
    points = np.stack([k1, k2], -1).reshape(-1, 2)
    density = log_likelihood(measured, *points.T) + PRIOR.logpdf(points)
    top = density.max() + 0.05  # between the points
    near = points[density > top - 16]
    low, high = near.min(axis=0) - 0.01, near.max(axis=0) + 0.01
    drawn = np.empty((0, 2))
    while len(drawn) < number:
        tried = rng.uniform(low, high, (20_000, 2))
        log_density = log_likelihood(measured, *tried.T) + PRIOR.logpdf(tried)
        assert log_density.max() < top
        kept = np.log(rng.random(len(tried))) < log_density - top
        drawn = np.concatenate([drawn, tried[kept]])
    return drawn[:number]


def make_test(rng, measured, number=1_000):
    """Return a test's ArviZ object."""
    theta = draw_test(rng, measured, number)
    log_priors = PRIOR.logpdfs(theta)
    lp = log_likelihood(measured, *theta.T) + log_priors.sum(axis=1)
    moments = [marginal.stats() for marginal in PRIOR.marginals.values()]
    mean, variance = np.transpose(moments)
    return as_idata(
        NAMES, theta, lp, log_priors, (mean, np.sqrt(variance)), PRIOR.bounds
    )
