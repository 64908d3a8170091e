"""Posterior draws whose mean and covariance are exact, as ArviZ holds them."""

import numpy as np
import xarray

from support.chains import wrap

PRIOR_SD = np.array([3.0, 2e-8, 0.5])
NAMES = ("stiff", "area", "x")  # not in alphabetical order
# Change of ln(lambda) of four modes with one prior sd; nothing changes the third.
GRADIENT = np.array(
    [[0.3, 0.0, 0.1], [-0.2, 0.05, 0.0], [0.0, 0.0, 0.0], [0.1, 0.2, 0]]
)
CURVATURE = np.array([0.0, 0.1, 0.0, 0.0])


def exact_draws(covariance, mean=None, n=400, seed=0):
    """Return draws with exactly this mean and covariance, ``(4, n / 4, d)``."""
    d = len(covariance)
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((n, d))
    white -= white.mean(axis=0)
    white = np.linalg.qr(white)[0] * np.sqrt(n - 1)
    draws = white @ np.linalg.cholesky(covariance).T
    return (draws + (np.zeros(d) if mean is None else mean)).reshape(4, -1, d)


def linear_frequencies(z, gradient=GRADIENT, curvature=CURVATURE):
    """Return ``(chain, draw, mode)`` with ln(lambda) a known function of z."""
    log_eigenvalue = z @ gradient.T + curvature * (z**2).sum(axis=-1, keepdims=True)
    return 10 * np.exp(0.5 * log_eigenvalue)


def made(z, frequencies, prior_sd=PRIOR_SD, names=NAMES, **constants):
    """Return what to_inference_data would; z is theta in prior sds."""
    d = len(names)
    constants = {
        "prior_mean": np.zeros(d),
        "prior_sd": prior_sd,
        "is_error": np.zeros(d, dtype=bool),
        "lower": np.full(d, -np.inf),
        "upper": np.full(d, np.inf),
        **constants,
    }
    by_name = zip(names, np.moveaxis(z * prior_sd, -1, 0), strict=True)
    draws = {name: (("chain", "draw"), values) for name, values in by_name}
    by_mode = {"frequency": (("chain", "draw", "mode"), frequencies)}
    sampled = {"sample_dims": ["chain", "draw"]}
    return wrap(
        {
            "posterior": xarray.Dataset(draws, attrs=sampled),
            "response": xarray.Dataset(by_mode, attrs=sampled),
            "constant_data": xarray.Dataset(
                {key: ("parameter", value) for key, value in constants.items()}
            ),
        }
    )


def gaussian_posterior(design, noise):
    """Return the covariance of z ~ N(0, I) given design @ z with errors of sd noise."""
    design = np.atleast_2d(design)
    precision = np.eye(design.shape[1]) + design.T @ design / noise**2
    return np.linalg.inv(precision)
