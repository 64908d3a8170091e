"""Beams of Euler-Bernoulli elements in a plane, by the textbook's matrices."""

import warnings

import numpy as np
from scipy import sparse

import emcee_femu as ef

ELEMENTS = 100
BOUNDS = {"left": (0.6, 1.4), "middle": (0.7, 1.3), "spring": (0.0, 50.0)}
OPTIONS = {"n_modes": 5, "shapes": [10, 90, 150]}


def bending(h):
    """Return the stiffness (w1, r1, w2, r2) of an element of length h and EI = 1."""
    return np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    ) / (h**3)


def inertia(h, lumped=False):
    """Return the mass of an element of rho A = 1."""
    if lumped:
        return np.diag([h / 2, 0.0, h / 2, 0.0])
    rows = [
        [156, 22 * h, 54, -13 * h],
        [22 * h, 4 * h**2, 13 * h, -3 * h**2],
        [54, 13 * h, 156, -22 * h],
        [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
    ]
    return np.array(rows) * h / 420


def assemble(block, n, elements=None):
    """Return some of the n elements of a beam together, ``(2 n + 2, 2 n + 2)``."""
    total = np.zeros((2 * n + 2, 2 * n + 2))
    for e in range(n) if elements is None else elements:
        total[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += block
    return total


def three_parts(free=False, lumped=False):
    """Return K0, M0 and K of a beam of three parts on a spring, clamped or free."""
    h, kept = 1 / ELEMENTS, slice(0 if free else 2, None)
    parts = [
        sparse.csc_array(assemble(bending(h), ELEMENTS, third)[kept, kept])
        for third in np.array_split(np.arange(ELEMENTS), 3)
    ]
    K = dict(zip(("left", "middle"), parts, strict=False))
    if not free:
        K["spring"] = sparse.csc_array(([1.0], ([120], [120])), shape=parts[0].shape)
    M0 = assemble(inertia(h, lumped), ELEMENTS)[kept, kept]
    return parts[2], sparse.csc_array(M0), K


def reduce(model, *args, **kwargs):
    """Reduce a model so small that it need not pay."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ef.reduce_model(model, *args, **kwargs)


def draws(n, bounds=BOUNDS, seed=77):
    """Return parameters inside the bounds."""
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(*pair, n) for name, pair in bounds.items()}


def error(model, other, parameters):
    """Return the largest relative difference of two models' frequencies."""
    return np.abs(
        model(parameters).frequencies / other(parameters).frequencies - 1
    ).max()
