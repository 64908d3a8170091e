"""Central differences: exact for polynomials of second degree, whatever the step."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from emcee_femu.models.differences import derive_along

RNG = np.random.default_rng(1)
A, B = RNG.normal(size=(4, 2)), RNG.normal(size=(4, 3, 2))
TANGENTS = RNG.normal(size=(2, 4, 2)), RNG.normal(size=(2, 4, 3, 2))


def function(a, b):
    return {"square": a**2, "product": np.einsum("nij,nj->ni", b, a)}


@pytest.mark.parametrize("size", [1e-3, 1.0])
def test_quadratics_are_differentiated_exactly_along_every_direction(size):
    steps = size * np.array([[1.0, 2.0, 0.5, 1.0], [3.0, 1.0, 1.0, 0.2]])
    found = derive_along(function, (A, B), TANGENTS, steps, ["x", "y"])
    for name, da, db in zip("xy", *TANGENTS, strict=True):
        assert_allclose(found["square"][name], 2 * A * da, atol=1e-9)
        product = np.einsum("nij,nj->ni", db, A) + np.einsum("nij,nj->ni", B, da)
        assert_allclose(found["product"][name], product, atol=1e-9)
