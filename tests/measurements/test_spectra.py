"""Spectra of records: their scale, sign, lines, and what is refused."""

import numpy as np
import pytest

import emcee_femu as ef

RNG = np.random.default_rng(2)
RECORD = RNG.standard_normal((4_000, 2)) * [1.0, 3.0]
LINES, EYE = np.array([1.0, 1.5]), np.tile(np.eye(2), (2, 1, 1))


def test_white_noise_has_its_one_sided_density():
    """Its variance over half the rate, in Hz."""
    spectra = ef.Spectra.from_record(RECORD, 50.0, (0.1, 24.9))
    expected = np.array([1.0, 9.0]) / 25.0
    error = expected / np.sqrt(len(spectra.lines))
    assert (np.abs(spectra.psd.mean(axis=0) - expected) < 4 * error).all()


def test_lines_are_those_of_the_segments_inside_the_band():
    whole = ef.Spectra.from_record(RECORD, 50.0, (2.0, 3.0))
    np.testing.assert_allclose(whole.lines, np.arange(160, 241) / 80)
    parts = ef.Spectra.from_record(RECORD, 50.0, (0.0, 99.0), averages=4)
    np.testing.assert_allclose(parts.lines, np.arange(1, 500) / 20)
    assert parts.averages == 4 and parts.matrices.shape == (499, 2, 2)


def test_a_channel_that_lags_has_its_phase():
    """D = F1 conj(F2) of x1 = cos(w t), x2 = cos(w t - a) is that of exp(i a)."""
    t = np.arange(1_000) / 100
    x = np.cos(2 * np.pi * 5.0 * t[:, None] - [0.0, 0.7])
    x += 1e-9 * RNG.standard_normal(x.shape)
    spectra = ef.Spectra.from_record(x, 100.0, (4.8, 5.2))
    (at,) = np.flatnonzero(np.isclose(spectra.lines, 5.0))
    assert np.angle(spectra.matrices[at, 0, 1]) == pytest.approx(0.7)
    # A sine's power is 1 / 2: the density times the distance of lines.
    assert spectra.psd[at, 0] * 0.1 == pytest.approx(0.5)


def test_averages_are_the_mean_of_the_segments():
    four = ef.Spectra.from_record(RECORD, 50.0, (2.0, 3.0), averages=4)
    own = [
        ef.Spectra.from_record(part, 50.0, (2.0, 3.0)).matrices
        for part in np.split(RECORD, 4)
    ]
    np.testing.assert_allclose(four.matrices, np.mean(own, axis=0), atol=1e-15)


RECORDS = {
    r"record: expected \(samples, channels\), got \(2, 4000\); transpose": {
        "record": RECORD.T
    },
    "record: channel 2 does not move": {"record": RECORD * [1.0, 0.0]},
    "record: expected finite numbers, got nan": {"record": RECORD * [np.nan, 1.0]},
    "rate: expected samples per second": {"rate": -1.0},
    "band: expected at least 4 lines between 3 and 2 Hz, got 0": {"band": (3.0, 2.0)},
    "band: expected at least 4 lines between 30 and 40": {"band": (30.0, 40.0)},
    r"band: expected \(low, high\) in Hz": {"band": (1.0, 2.0, 3.0)},
    "averages: expected at least 1": {"averages": 0},
    "averages: expected a whole number": {"averages": 2.0},
    "sensors: expected a label for each of 2": {"sensors": ["roof"]},
    "kind: expected one of .'acceleration', 'velocity'": {"kind": "accelerance"},
}


@pytest.mark.parametrize("message", RECORDS)
def test_mistakes_in_a_record_are_named(message):
    with pytest.raises((TypeError, ValueError), match=message):
        ef.Spectra.from_record(
            **({"record": RECORD, "rate": 50.0, "band": (2.0, 3.0)} | RECORDS[message])
        )


MATRICES = {
    r"matrices: expected \(2, n_channels, n_channels\)": {"matrices": EYE[:1]},
    "matrices: expected Hermitian": {"matrices": EYE + [[0.0, 0.1], [0.0, 0.0]]},
    "with a diagonal above zero": {"matrices": -EYE},
    "matrices: expected finite numbers": {"matrices": np.full((2, 2, 2), np.nan)},
    "lines: expected frequencies in ascending": {"lines": LINES[::-1]},
}


@pytest.mark.parametrize("message", MATRICES)
def test_mistakes_in_matrices_are_named(message):
    given = {"lines": LINES, "matrices": EYE, "averages": 3}
    with pytest.raises((TypeError, ValueError), match=message):
        ef.Spectra(**(given | MATRICES[message]))
