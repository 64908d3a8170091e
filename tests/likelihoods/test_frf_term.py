"""The likelihood of FRFs, against scipy and calibration."""

import numpy as np
import pytest
from scipy import stats
from support.calibration import auto_ranks, p_values, shorten_search

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


def chain():
    ends = [np.array([1.0, 0, 0]), np.array([-1.0, 1, 0]), np.array([0, -1.0, 1])]
    K = {f"k{i}": np.outer(e, e) for i, e in enumerate(ends, 1)}
    M = np.diag([2.0, 1.5, 1.0])
    return ef.MatrixModel(np.zeros((3, 3)), M, K, n_modes=3, shapes=True)


GRID = np.linspace(0.8, 8.0, 24)
PAIRS = [(0, 2), (2, 2)]
PRIOR = ef.GaussianPrior(
    ["k1", "k2", "k3", "zeta"],
    [600.0, 600.0, 600.0, 0.03],
    [120.0, 120.0, 120.0, 0.01],
    [(200.0, 1_000.0), (200.0, 1_000.0), (200.0, 1_000.0), (0.002, 0.08)],
)
MODEL = ef.frf.FRFModel(chain(), GRID, PAIRS, damping="zeta")
SD = 0.002  # m/N, of each part; peaks are ten times that


def simulated(rng):
    """Return the posterior of a simulated data set, and the truth ``(1, 4)``."""
    truth = PRIOR.sample(rng, 1)
    true = MODEL(dict(zip(PRIOR.names, truth.T, strict=True)))["receptance"][0]
    noisy = true + SD * rng.standard_normal(true.shape)
    measured = ef.frf.FRFMeasurements(
        GRID, noisy[..., 0] + 1j * noisy[..., 1], PAIRS, kind="receptance"
    )
    term = ef.frf.FRFTerm(measured, sd=SD)
    return ef.LogPosterior(MODEL, term, PRIOR), truth


@pytest.mark.slow
def test_the_truth_ranks_uniformly_among_the_draws(monkeypatch):
    shorten_search(monkeypatch)
    assert p_values(auto_ranks(simulated, 48, seed=31)).min() > 0.001 / 5


def test_magnitudes_are_no_complex_values():
    sizes = ef.frf.FRFMeasurements(LINES, np.abs(VALUES), CHANNELS, kind="receptance")
    with pytest.raises(ValueError, match="measured: expected complex values"):
        ef.frf.FRFTerm(sizes, sd=0.1)
    both = [ef.frf.FRFTerm(own, sd=0.1, amplitude=True) for own in (sizes, MEASURED)]
    values = [term({}, RESPONSE) for term in both]
    np.testing.assert_allclose(*values)
