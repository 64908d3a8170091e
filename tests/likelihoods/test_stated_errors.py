"""Errors that are stated or inferred: zero, in percent, of the wrong kind."""

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef

SHAPES = np.array([[1.0, 0.5], [0.4, -1.0], [0.2, 0.3]])
FRF = ef.frf.FRFMeasurements(
    [1.0, 2.0], [[1.0 + 1.0j, 2.0 - 1.0j]], channels=[("1", "1")], kind="receptance"
)
TERMS = {
    "frequency": lambda **e: ef.FrequencyTerm([2.0, 3.0], **e),
    "shapes": lambda **e: ef.ShapeTerm(SHAPES, **e),
    "displacement": lambda **e: ef.DisplacementTerm([[1.0, 2.0]], **e),
    "receptance": lambda **e: ef.frf.FRFTerm(FRF, **e),
}
NEAR = {
    "frequency": [[2.1, 3.2]],
    "shapes": SHAPES[None] + 0.1 * np.array([[[1.0, 0.0]] * 3]),
    "displacement": [[[1.1, 2.1]]],
    "receptance": [[[[1.1, 1.0], [2.0, -1.2]]]],
}


@pytest.mark.parametrize("name", NEAR)
def test_no_error_at_all_is_impossible(name):
    term, response = TERMS[name](discrepancy="s"), {name: np.array(NEAR[name])}
    assert term({"s": np.zeros(1)}, response) == -np.inf
    assert -1e8 < term({"s": np.array([1e-3])}, response) < 0


def test_searches_may_stand_on_the_bound():
    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5, (3 * p["k"]) ** 0.5], n_modes=2)
    prior = ef.IndependentPrior({"k": (5.0, 12.0), "s": stats.halfnorm(scale=0.01)})
    term = ef.FrequencyTerm([3.0, 5.25], discrepancy="s")
    posterior = ef.LogPosterior(model, term, prior)
    on_the_bound = np.array([[9.0, 0.0], [9.1, 0.01]])
    local = posterior.linearize(on_the_bound)
    assert local.rows[0, 0] == -np.inf and np.isfinite(local.gradient[1]).all()
    best = ef.find_map(posterior, on_the_bound, seed=1)
    assert best.maxima[0].theta[1] > 1e-4


@pytest.mark.parametrize(
    ("name", "errors", "words"),
    [
        ("frequency", {"relative_sd": 0.2}, "relative_sd: .* 20 %"),
        ("frequency", {"sd": [0.1, 1.0]}, "sd: .* 33.3 %"),
        ("shapes", {"delta": 2.0}, "delta: .* 200 %"),
        ("displacement", {"relative_sd": 0.3}, "relative_sd: .* 30 %"),
    ],
)
def test_errors_that_may_be_in_percent_are_doubted(name, errors, words):
    with pytest.warns(UserWarning, match=words) as caught:
        TERMS[name](**errors)
    assert [warning.filename for warning in caught] == [__file__]
