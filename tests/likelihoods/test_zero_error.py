"""An inferred error of zero, on the bound of a prior, is impossible, not undefined."""

import numpy as np
import pytest

import emcee_femu as ef
from emcee_femu.posterior.marginal import expand

SHAPES = np.array([[1.0, 0.5], [0.4, -1.0], [0.2, 0.3]])
FRF = ef.FRFMeasurements(
    [1.0, 2.0], [[1.0 + 1.0j, 2.0 - 1.0j]], channels=[("1", "1")], kind="receptance"
)
CASES = {
    "frequency": (
        ef.FrequencyTerm([2.0, 3.0], discrepancy="s"),
        {"frequency": np.array([[2.1, 3.2]])},
    ),
    "shape": (
        ef.ShapeTerm(SHAPES, discrepancy="s"),
        {"shapes": SHAPES[None] + 0.1 * np.array([[[1.0, 0.0]] * 3])},
    ),
    "displacement": (
        ef.DisplacementTerm([[1.0, 2.0]], discrepancy="s"),
        {"displacement": np.array([[[1.1, 2.1]]])},
    ),
    "frf": (
        ef.FRFTerm(FRF, discrepancy="s"),
        {"receptance": np.array([[[[1.1, 1.0], [2.0, -1.2]]]])},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_no_error_at_all_is_impossible(name):
    term, response = CASES[name]
    zero = {"s": np.zeros(1)}
    value = term(zero, response)
    assert np.isfinite(value) and value < -1e100
    tangents = {key: np.ones((*x.shape, 1)) for key, x in response.items()}
    moved = expand(term, zero, response, tangents | {"s": np.ones((1, 1))}, value)
    assert all(np.isfinite(part).all() for part in moved)
    # What is stated is as it was.
    some = {"s": np.array([1e-3])}
    assert -1e8 < term(some, response) < 0
