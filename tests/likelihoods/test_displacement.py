"""Displacements and FRFs against scipy.stats, and errors that are zero or doubted."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
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
def test_values_of_displacements_are_those_of_scipy(errors, discrepancy):
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


LINES, CHANNELS = np.array([1.0, 2.0, 3.0]), [(0, 1), (1, 1)]
VALUES = RNG.normal(size=(2, 3)) + 1j * RNG.normal(size=(2, 3))
TESTED = ef.frf.FRFMeasurements(
    LINES,
    VALUES,
    CHANNELS,
    kind="receptance",
    coherence=RNG.uniform(0.8, 0.99, (2, 3)),
    averages=20,
)
H = VALUES + 0.2 * (RNG.normal(size=(5, 2, 3)) + 1j * RNG.normal(size=(5, 2, 3)))
RESPONSE = {"receptance": np.stack([H.real, H.imag], axis=-1)}
ERROR = RNG.uniform(0.05, 0.3, 5)


@pytest.mark.parametrize("discrepancy", [None, "sigma"])
@pytest.mark.parametrize("amplitude", [True, False])
def test_values_of_frfs_are_those_of_scipy(amplitude, discrepancy):
    term = ef.frf.FRFTerm(TESTED, amplitude=amplitude, discrepancy=discrepancy)
    own = ERROR[:, None, None] if discrepancy else 0.0
    if amplitude:
        sd = np.sqrt((TESTED.sd / np.abs(VALUES)) ** 2 + own**2)
        parts = [stats.norm.logpdf(np.log(np.abs(H / VALUES)), 0, sd)]
    else:
        sd = np.sqrt(TESTED.sd**2 + (own * np.abs(VALUES)) ** 2)
        r = H - VALUES
        parts = [stats.norm.logpdf(part, 0, sd) for part in (r.real, r.imag)]
    found = term({"sigma": ERROR}, RESPONSE)
    assert_allclose(found, np.sum(parts, axis=0).sum(axis=(1, 2)))


def test_errors_that_are_given():
    known = ef.frf.FRFTerm(TESTED, sd=TESTED.sd)
    assert_allclose(known({}, RESPONSE), ef.frf.FRFTerm(TESTED)({}, RESPONSE))
    per_channel = ef.frf.FRFTerm(TESTED, sd=[[0.1], [0.2]])
    assert_array_equal(per_channel.sd, [[0.1] * 3, [0.2] * 3])


def test_magnitudes_are_no_complex_values():
    sizes = ef.frf.FRFMeasurements(LINES, np.abs(VALUES), CHANNELS, kind="receptance")
    with pytest.raises(ValueError, match="measured: expected complex values"):
        ef.frf.FRFTerm(sizes, sd=0.1)
    both = [ef.frf.FRFTerm(own, sd=0.1, amplitude=True) for own in (sizes, TESTED)]
    values = [term({}, RESPONSE) for term in both]
    assert_allclose(*values)


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
