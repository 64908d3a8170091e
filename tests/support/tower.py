"""A tower of two unit masses, whose modes are known, and a test of it."""

import numpy as np

import emcee_femu as ef
from support.chains import dataset

# k1 = k2 = 10 N/m.
SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 10.0)}
GOLDEN = (1 + 5**0.5) / 2
SHAPES = np.array([[1.0, 1.0], [GOLDEN, 1 - GOLDEN]])
HERTZ = np.sqrt([10 / GOLDEN**2, 10 * GOLDEN**2]) / (2 * np.pi)
MEASURED = np.array([[1.0, -1.1], [1.7, 0.6]])  # the second turned round
PRIOR = ef.GaussianPrior(["k1", "k2"], [12.0, 8.0], 3.0, [(1, 30), (1, 30)])
MODEL = ef.MassSpringModel([1.0, 1.0], SPRINGS, shapes=True)


def solved(k1, k2):
    """Return the shapes, from closed forms."""
    return np.linalg.eigh([[k1 + k2, -k2], [-k2, k2]])[1]


def at_mean(run):
    """Return the shapes at the mean of the samples."""
    draws = dataset(ef.to_inference_data(run), "posterior")
    return solved(*(float(draws[name].mean()) for name in ("k1", "k2")))
