"""The likelihood of frequencies, against scipy.stats."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.contracts import assert_term

import emcee_femu as ef

MEASURED = np.array([3.18, 28.54, 1.1e3, 5e-3])
BETA = np.array([10.0, 6.8e5, 1e4, 4.0])
RNG = np.random.default_rng(5)
PREDICTED = MEASURED * (1 + 0.02 * RNG.standard_normal((20, 4)))
MODES = {"frequency": PREDICTED}
ORDER = np.argsort(MEASURED)  # Measurements are ascending
SIGMA = {"sigma": np.linspace(0.005, 0.1, 20)}
ROOT = np.random.default_rng(1).normal(size=(4, 4)) + 2 * np.eye(4)
COVARIANCE = 1e-4 * np.outer(MEASURED, MEASURED) * (ROOT @ ROOT.T)
SD = np.array([0.01, 0.2, 3.0, 1e-4])
ERRORS = {  # how the error is given, and what covariance that is
    "beta": ({"beta": BETA}, np.diag(MEASURED**2 / BETA)),
    "one beta": ({"beta": 6.8e5}, np.diag(MEASURED**2 / 6.8e5)),
    "relative_sd": ({"relative_sd": 0.01}, np.diag((0.01 * MEASURED) ** 2)),
    "sd": ({"sd": SD}, np.diag(SD**2)),
    "covariance": ({"covariance": COVARIANCE}, COVARIANCE),
    "nothing": ({}, np.zeros((4, 4))),
}
CASES = [(e, d) for e in ERRORS for d in (None, "sigma") if ERRORS[e][0] or d]


def log_density(covariance, predicted):
    """Return the multivariate normal density, in relative units for its accuracy."""
    relative = covariance / np.outer(MEASURED, MEASURED)
    density = stats.multivariate_normal(np.ones(4), relative)
    return density.logpdf(predicted / MEASURED) - np.log(MEASURED).sum()


@pytest.mark.parametrize(("errors", "discrepancy"), CASES)
def test_it_is_the_normal_density_of_the_frequencies(errors, discrepancy):
    options, covariance = ERRORS[errors]
    term = ef.FrequencyTerm(MEASURED, discrepancy=discrepancy, **options)
    variances = SIGMA["sigma"] ** 2 if discrepancy else np.zeros(20)
    expected = np.array([
        log_density(covariance + np.diag(variance * MEASURED**2), row)
        for variance, row in zip(variances, PREDICTED, strict=True)
    ])  # fmt: skip
    parameters = SIGMA if discrepancy else {}
    assert term.names == tuple(parameters)
    assert_allclose(term(parameters, MODES), expected, rtol=1e-9)  # constants too
    assert_term(term, parameters, MODES, expected)


@pytest.mark.parametrize("errors", ["sd", "covariance"])
def test_measurements_bring_their_errors_in_their_order(errors):
    options, covariance = ERRORS[errors]
    ((name, value),) = options.items()
    value = value[ORDER] if value.ndim == 1 else value[np.ix_(ORDER, ORDER)]
    test = ef.Measurements(MEASURED[ORDER], **{name: value})
    found = ef.FrequencyTerm(test)({}, {"frequency": PREDICTED[:, ORDER]})
    assert_allclose(found, log_density(covariance, PREDICTED), rtol=1e-9)
    stated = ef.FrequencyTerm(test, relative_sd=0.02)  # which goes before
    expected = ef.FrequencyTerm(MEASURED, relative_sd=0.02)({}, MODES)
    assert_allclose(stated({}, {"frequency": PREDICTED[:, ORDER]}), expected)


@pytest.mark.parametrize("kind", ["relative_sd", "covariance"])
@pytest.mark.parametrize("discrepancy", [None, "error"])
def test_replicates_have_the_covariance_of_all_errors(kind, discrepancy):
    measured = np.array([3.0, 8.0, 9.0])
    C = np.array([[0.04, 0.05, 0.01], [0.05, 0.25, 0.1], [0.01, 0.1, 0.36]])
    given = {"covariance": C, "relative_sd": [0.1, 0.05, 0.02]}[kind]
    term = ef.FrequencyTerm(measured, **{kind: given}, discrepancy=discrepancy)
    expected = C if kind == "covariance" else np.diag((measured * given) ** 2)
    if discrepancy:
        expected = expected + np.diag((0.08 * measured) ** 2)
    n = 40_000
    stored = {"frequency": np.tile([2.0, 7.0, 9.5, 11.0], (n, 1))}
    parameters = {"error": np.full(n, 0.08)}
    drawn = term.replicate(np.random.default_rng(1), parameters, stored)["frequency"]
    assert drawn.shape == (n, 3)
    error = np.sqrt(np.diag(expected) / n)
    spread = 5 * np.sqrt(2 * n) * np.outer(error, error)
    assert (np.abs(np.cov(drawn.T) - expected) < spread).all()
    assert (np.abs(drawn.mean(axis=0) - [2, 7, 9.5]) < 5 * error).all()


def test_a_mode_of_unknown_error_has_the_discrepancy_alone():
    measured = ef.Measurements([3.0, 9.0], sd=[0.03, None])
    for unknown in (MEASURED, measured):
        with pytest.raises((TypeError, ValueError), match="discrepancy="):
            ef.FrequencyTerm(unknown)
    term = ef.FrequencyTerm(measured, discrepancy="sigma")
    sigma, predicted = np.array([0.02]), np.array([[3.1, 9.2]])
    sd = np.array([np.hypot(0.03, 0.02 * 3.0), 0.02 * 9.0])
    expected = stats.norm([3.0, 9.0], sd).logpdf(predicted).sum()
    assert_allclose(term({"sigma": sigma}, {"frequency": predicted}), expected)
    assert term.error_sd["frequency"].round(12).tolist() == [0.03, 0.0]


@pytest.mark.parametrize("sd", [0.51, 7.07])
def test_an_error_above_half_is_refused_however_it_is_given(sd):
    for given in ({"relative_sd": sd}, {"beta": sd**-2}, {"beta": [1e4, sd**-2]}):
        with pytest.raises(
            ValueError, match=f"{[*given][0]}: expected at (least|most)"
        ):
            ef.FrequencyTerm([3.0, 9.0], **given)
    assert_allclose(
        ef.FrequencyTerm([3.0], beta=10.0).stated_sd, 10**-0.5
    )  # the paper's
