"""The likelihood of displacements, against scipy.stats."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.contracts import assert_term

import emcee_femu as ef

RNG = np.random.default_rng(2)
MEASURED = RNG.normal(size=(2, 3))
SD = RNG.uniform(0.1, 0.3, (2, 3))
U = MEASURED + 0.3 * RNG.normal(size=(5, 2, 3))
SIGMA = RNG.uniform(0.05, 0.5, 5)
ERRORS = {
    "one number": ({"sd": 0.2}, np.full((2, 3), 0.2)),
    "one per point": ({"sd": SD[0]}, np.tile(SD[0], (2, 1))),
    "each": ({"sd": SD}, SD),
    "relative": ({"relative_sd": 0.1}, 0.1 * np.abs(MEASURED)),
    "discrepancy alone": ({}, np.zeros((2, 3))),
}
CASES = [(e, d) for e in ERRORS for d in (None, "sigma") if ERRORS[e][0] or d]


@pytest.mark.parametrize(("errors", "discrepancy"), CASES)
def test_values_are_those_of_scipy(errors, discrepancy):
    options, sd = ERRORS[errors]
    term = ef.DisplacementTerm(MEASURED, discrepancy=discrepancy, **options)
    parameters = {"sigma": SIGMA} if discrepancy else {}
    model_sd = SIGMA[:, None, None] * MEASURED if discrepancy else 0.0
    exact = stats.norm.logpdf(U, MEASURED, np.sqrt(sd**2 + model_sd**2))
    assert_allclose(term(parameters, {"displacement": U}), exact.sum(axis=(1, 2)))
    single = term.pointwise(parameters, {"displacement": U})["displacement"]
    assert_allclose(single, exact)
    assert_term(term, parameters, {"displacement": U}, exact.sum(axis=(1, 2)))


def test_replicates_have_all_errors():
    term = ef.DisplacementTerm(MEASURED, sd=SD, discrepancy="sigma")
    n = 40_000
    stored = {"displacement": np.broadcast_to(U[:1], (n, 2, 3))}
    new = term.replicate(RNG, {"sigma": np.full(n, 0.3)}, stored)["displacement"]
    sd = np.sqrt(SD**2 + (0.3 * MEASURED) ** 2)
    assert np.abs((new.mean(axis=0) - U[0]) / sd * np.sqrt(n)).max() < 4
    assert_allclose(new.std(axis=0), sd, rtol=0.02)
