"""Modes that cross and nearly meet, from small matrices in closed form."""

import numpy as np


def matrices(x, coupling=0.3):
    """Return symmetric ``(n, 3, 3)`` whose eigenvalues meet as ``x (n, 2)`` changes."""
    n = len(x)
    A = np.zeros((n, 3, 3))
    A[:, 0, 0] = 100.0 + 8.0 * x[:, 0]
    A[:, 1, 1] = 100.0 - 6.0 * x[:, 0] + 3.0 * x[:, 1] + 0.5 * x[:, 1] ** 2
    A[:, 2, 2] = 101.0 + 5.0 * x[:, 1]
    for i, j in ((0, 1), (1, 2), (0, 2)):
        A[:, i, j] = A[:, j, i] = coupling * (1.0 + 0.2 * x[:, 0])
    return A


def respond(x, coupling=0.3, seed=None):
    """Return frequencies, and shapes at five sensors, with random signs if seeded."""
    values, vectors = np.linalg.eigh(matrices(x, coupling))
    base = np.random.default_rng(5).standard_normal((5, 3))
    shapes = base @ vectors * (1.0 + 0.05 * x[:, :1, None])
    if seed is not None:
        rng = np.random.default_rng(seed)
        shapes = shapes * rng.choice([-1.0, 1.0], size=(len(x), 1, 3))
    return {"frequency": np.sqrt(values) / (2 * np.pi), "shapes": shapes}
