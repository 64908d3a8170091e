"""A beam in three parts on a spring, and its reductions: shared by two test files."""

import warnings

import numpy as np
from scipy import sparse

import emcee_femu as ef
from emcee_femu.models.frame.beam_element import mass_matrices, stiffness_matrices

ELEMENTS = 100
BOUNDS = {"left": (0.6, 1.4), "middle": (0.7, 1.3), "spring": (0.0, 50.0)}
OPTIONS = {"n_modes": 5, "shapes": [10, 90, 150]}


def portion(matrix, kept, elements):
    dofs, size = [1, 5, 7, 11], 2 * ELEMENTS + 2
    block = matrix[np.ix_(dofs, dofs)]
    total = np.zeros((size, size))
    for e in elements:
        total[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += block
    return sparse.csc_array(total[np.ix_(kept, kept)])


def beam(free=False, lumped=False):
    """Return K0, M0, K of a beam in three parts on an elastic spring."""
    h = 1 / ELEMENTS
    held = [] if free else [0, 1]
    kept = np.delete(np.arange(2 * ELEMENTS + 2), held)
    k, m = stiffness_matrices(h)["EIz"], mass_matrices(h)["rhoA"]
    if lumped:
        m = np.diag([0, h / 2, 0, 0, 0, 0, 0, h / 2, 0, 0, 0, 0])
    thirds = np.array_split(np.arange(ELEMENTS), 3)
    K = {
        n: portion(k, kept, t) for n, t in zip(("left", "middle"), thirds, strict=False)
    }
    size = len(kept)
    if not free:
        K["spring"] = sparse.csc_array(([1.0], ([120], [120])), shape=(size, size))
    M0 = portion(m, kept, range(ELEMENTS))
    return portion(k, kept, thirds[2]), M0, K


def reduce(model, *args, **kwargs):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ef.reduce_model(model, *args, **kwargs)


def draws(n, bounds=BOUNDS, seed=77):
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(*pair, n) for name, pair in bounds.items()}


def error(model, other, parameters):
    return np.abs(
        model(parameters).frequencies / other(parameters).frequencies - 1
    ).max()
