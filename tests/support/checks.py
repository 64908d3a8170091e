"""Shared checker of moves: the exact-start test.

Ensembles are drawn from the target and moved a few steps. If the move keeps the target,
averages over ensembles have the exact moments: plain z-scores, of which twelve are
below 5 with a probability of 0.9999. A bias grows with every step, so 120 ensembles
of 12 steps see what 400 of 6 would, and cost less.
"""

import emcee
import numpy as np
from emcee.model import Model
from scipy.stats import chi2

LIMIT = 5.0
CORRELATION = np.array([[1.0, 0.9, -0.5], [0.9, 1.0, -0.3], [-0.5, -0.3, 1.0]])


class Gaussian:
    """A correlated 3-D Gaussian; ``scale`` stretches each axis."""

    def __init__(self, scale=(1.0, 1.0, 1.0), ndim=3):
        self.ndim = ndim
        self.scale = np.resize(np.asarray(scale, dtype=float), ndim)
        self.mean = 3.0 * self.scale
        correlation = CORRELATION
        if ndim != 3:
            index = np.arange(ndim)
            correlation = 0.8 ** np.abs(index[:, None] - index)
        self.factor = np.linalg.cholesky(correlation)
        self.precision = np.linalg.inv(correlation)
        self.median = chi2.median(ndim)

    def sample(self, rng, size):
        normal = rng.standard_normal((*size, self.ndim))
        return self.mean + self.scale * (normal @ self.factor.T)

    def __call__(self, theta):
        x = (theta - self.mean) / self.scale
        return -0.5 * np.einsum("ni,ij,nj->n", x, self.precision, x)

    def statistics(self, theta):
        """Statistics of expectation zero, (..., n_statistics)."""
        x = (theta - self.mean) / self.scale
        square = np.einsum("...i,ij,...j->...", x, self.precision, x)
        # The last one is bounded: it sees an explosion that hides in its own variance.
        core = (square < self.median) - 0.5
        return np.concatenate(
            [x, x * x - 1, np.stack([square - self.ndim, core], axis=-1)], axis=-1
        )


class BoundedTriangle:
    """Density prod 2 x_i on the unit box, stretched: bounded and asymmetric."""

    def __init__(self, scale=(1.0, 1.0, 1.0), ndim=3):
        self.ndim = ndim
        self.scale = np.resize(np.asarray(scale, dtype=float), ndim)

    def sample(self, rng, size):
        return self.scale * np.sqrt(rng.random((*size, self.ndim)))

    def __call__(self, theta):
        x = theta / self.scale
        inside = ((x > 0) & (x < 1)).all(axis=1)
        safe = np.where(inside[:, None], x, 0.5)
        return np.where(inside, np.log(safe).sum(axis=1), -np.inf)

    def statistics(self, theta):
        x = theta / self.scale
        outside = ((x <= 0) | (x >= 1)).any(axis=-1)
        product = 4 / 9 if self.ndim > 1 else 1 / 2
        moments = [x - 2 / 3, x * x - 1 / 2, x * np.roll(x, 1, axis=-1) - product]
        return np.concatenate([*moments, outside[..., None]], axis=-1)


def exact_start(move, target, nwalkers, ensembles=120, steps=12, seed=0):
    """Return the largest |z| of the target's statistics after a few steps.

    It is infinite if the state does not hold the rows that the target returns.
    """
    rng = np.random.default_rng(seed)
    random = np.random.RandomState(seed + 1)

    def solve(theta):
        values = target(theta)
        return (values[:, 0], values[:, 1:]) if values.ndim > 1 else (values, None)

    model = Model(target, solve, map, random)
    coords = target.sample(rng, (ensembles, nwalkers))
    for start in coords:
        state = emcee.State(start, *solve(start))
        for _ in range(steps):
            state, _ = move.propose(model, state)
        start[:] = state.coords
        log_prob, blobs = solve(start)
        if blobs is not None:
            kept = np.column_stack([state.log_prob, state.blobs])
            if not np.allclose(kept, np.column_stack([log_prob, blobs]), 1e-9, 1e-9):
                return np.inf
    averages = target.statistics(coords).mean(axis=1)
    mean, error = averages.mean(axis=0), averages.std(axis=0) / np.sqrt(ensembles)
    moved = error > 0
    if (np.abs(mean[~moved]) > 0).any():  # the same nonzero value in every ensemble
        return np.inf
    return float(np.abs(mean[moved] / error[moved]).max())
