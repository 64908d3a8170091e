"""An inferred error of zero, on the bound of a prior, is impossible, not undefined."""

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef

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
    assert term(zero, response) == -np.inf
    assert -1e8 < term({"s": np.array([1e-3])}, response) < 0


def test_searches_may_stand_on_the_bound():
    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5, (3 * p["k"]) ** 0.5], n_modes=2)
    law = stats.halfnorm(scale=0.01)
    prior = ef.IndependentPrior({"k": ef.uniform_between(5.0, 12.0), "s": law})
    term = ef.FrequencyTerm([3.0, 5.25], discrepancy="s")
    posterior = ef.LogPosterior(model, term, prior)
    on_the_bound = np.array([[9.0, 0.0], [9.1, 0.01]])
    found = posterior.linearize(on_the_bound)
    assert found.rows[0, 0] == -np.inf and np.isfinite(found.gradient[1]).all()
    best = ef.find_map(posterior, on_the_bound, seed=1)
    assert best.maxima[0].theta[1] > 1e-4
