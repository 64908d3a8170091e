"""The likelihood of FRFs, against scipy."""

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef

RNG = np.random.default_rng(6)
LINES, CHANNELS = np.array([1.0, 2.0, 3.0]), [(0, 1), (1, 1)]
VALUES = RNG.normal(size=(2, 3)) + 1j * RNG.normal(size=(2, 3))
MEASURED = ef.frf.FRFMeasurements(
    LINES,
    VALUES,
    CHANNELS,
    kind="receptance",
    coherence=RNG.uniform(0.8, 0.99, (2, 3)),
    averages=20,
)
H = VALUES + 0.2 * (RNG.normal(size=(5, 2, 3)) + 1j * RNG.normal(size=(5, 2, 3)))
RESPONSE = {"receptance": np.stack([H.real, H.imag], axis=-1)}
SIGMA = RNG.uniform(0.05, 0.3, 5)


@pytest.mark.parametrize("discrepancy", [None, "sigma"])
@pytest.mark.parametrize("amplitude", [True, False])
def test_values_are_those_of_scipy(amplitude, discrepancy):
    term = ef.frf.FRFTerm(MEASURED, amplitude=amplitude, discrepancy=discrepancy)
    own = SIGMA[:, None, None] if discrepancy else 0.0
    if amplitude:
        sd = np.sqrt((MEASURED.sd / np.abs(VALUES)) ** 2 + own**2)
        parts = [stats.norm.logpdf(np.log(np.abs(H / VALUES)), 0, sd)]
    else:
        sd = np.sqrt(MEASURED.sd**2 + (own * np.abs(VALUES)) ** 2)
        r = H - VALUES
        parts = [stats.norm.logpdf(part, 0, sd) for part in (r.real, r.imag)]
    found = term({"sigma": SIGMA}, RESPONSE)
    np.testing.assert_allclose(found, np.sum(parts, axis=0).sum(axis=(1, 2)))


def test_errors_that_are_given():
    known = ef.frf.FRFTerm(MEASURED, sd=MEASURED.sd)
    np.testing.assert_allclose(
        known({}, RESPONSE), ef.frf.FRFTerm(MEASURED)({}, RESPONSE)
    )
    per_channel = ef.frf.FRFTerm(MEASURED, sd=[[0.1], [0.2]])
    np.testing.assert_array_equal(per_channel.sd, [[0.1] * 3, [0.2] * 3])


def test_magnitudes_are_no_complex_values():
    sizes = ef.frf.FRFMeasurements(LINES, np.abs(VALUES), CHANNELS, kind="receptance")
    with pytest.raises(ValueError, match="measured: expected complex values"):
        ef.frf.FRFTerm(sizes, sd=0.1)
    both = [ef.frf.FRFTerm(own, sd=0.1, amplitude=True) for own in (sizes, MEASURED)]
    values = [term({}, RESPONSE) for term in both]
    np.testing.assert_allclose(*values)
