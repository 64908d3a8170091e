"""Repeated tests of a two-parameter structure, and their population by quadrature.

Two equal storeys of unit mass on springs k1 and k2, which differ from test to test;
two frequencies are measured. Each test is drawn exactly, by rejection, under
a lognormal prior, whose mean is not that of the population and whose spread is not
much larger.
"""

from types import SimpleNamespace

import numpy as np
import xarray
from scipy import stats

import emcee_femu as ef

from .chains import wrap

NAMES = ("k1", "k2")
MEAN, SPREAD = np.array([1.0, 1.1]), np.array([0.06, 0.04])
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


def simulate(rng, tests):
    """Return the measured frequencies ``(tests, 2)``, and the true parameters."""
    theta = MEAN + SPREAD * rng.standard_normal((tests, 2))
    noise = NOISE * rng.standard_normal((tests, 2))
    return frequencies(*theta.T) * np.exp(noise), theta


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


def quadrature(measured, hyperpriors, points=25):
    """Return means and sds of ``mean k1, mean k2, sd k1, sd k2``, and of each test.

    Each test's likelihood is integrated on a grid against the population's normal
    laws, for a grid of these.
    """
    tests = len(measured)
    reach = 6.5 * (SPREAD + 0.03) / np.sqrt(tests)
    means = [
        np.linspace(m - r, m + r, points) for m, r in zip(MEAN, reach, strict=True)
    ]
    widest = SPREAD * (1 + 8 / np.sqrt(tests)) + 0.03
    spreads = [w * (np.arange(points) + 0.5) / points for w in widest]
    edges = np.append(GRID, 2 * GRID[-1] - GRID[-2]) - (GRID[1] - GRID[0]) / 2
    laws, log_prior = [], 0.0
    for i, name in enumerate(NAMES):
        mean, sd = np.meshgrid(means[i], spreads[i], indexing="ij")
        mean, sd = mean.reshape(-1, 1), sd.reshape(-1, 1)
        laws.append(np.diff(stats.norm(mean, sd).cdf(edges), axis=1))  # of each cell
        own = hyperpriors[f"mean {name}"].logpdf(mean)
        own = own + hyperpriors[f"sd {name}"].logpdf(sd)
        log_prior = own if i == 0 else log_prior + own.T
    k1, k2 = np.meshgrid(GRID, GRID, indexing="ij")
    likelihoods = [np.exp(log_likelihood(m, k1, k2)) for m in measured]
    marginals = [laws[0] @ own @ laws[1].T for own in likelihoods]
    total = log_prior + sum(np.log(np.maximum(own, 1e-300)) for own in marginals)
    weights = np.exp(total - total.max())
    weights /= weights.sum()
    # How much of the grid's edges matters must be nothing.
    shaped = weights.reshape([points] * 4)
    ends = [shaped.take(e, axis).sum() for axis in (0, 2) for e in (0, -1)]
    ends += [shaped.take(-1, axis).sum() for axis in (1, 3)]
    assert max(ends) < 1e-3, ends
    found = []
    for axis, values in (
        (0, means[0]),
        (2, means[1]),
        (1, spreads[0]),
        (3, spreads[1]),
    ):
        others = tuple({*range(4)} - {axis})
        found.append(moments(values, shaped.sum(axis=others)))
    each = []
    for own, marginal in zip(likelihoods, marginals, strict=True):
        part = laws[0].T @ (weights / np.maximum(marginal, 1e-300)) @ laws[1] * own
        each.append([moments(GRID, part.sum(axis=1)), moments(GRID, part.sum(axis=0))])
    mean, sd = np.transpose(found)
    return SimpleNamespace(mean=mean, sd=sd, tests=np.array(each))


def moments(values, weights):
    weights = weights / weights.sum()
    mean = weights @ values
    return mean, np.sqrt(weights @ (values - mean) ** 2)
