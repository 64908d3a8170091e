"""Spectra of records: their scale, sign, lines, and what is refused."""

import numpy as np
import pytest

import emcee_femu as ef

RNG = np.random.default_rng(2)
RECORD = RNG.standard_normal((4_000, 2)) * [1.0, 3.0]
LINES, EYE = np.array([1.0, 1.5]), np.tile(np.eye(2), (2, 1, 1))


def test_white_noise_has_its_one_sided_density():
    """Its variance over half the rate, in Hz."""
    spectra = ef.spectra.Spectra.from_record(RECORD, 50.0, (0.1, 24.9))
    expected = np.array([1.0, 9.0]) / 25.0
    error = expected / np.sqrt(len(spectra.lines))
    assert (np.abs(spectra.psd.mean(axis=0) - expected) < 4 * error).all()


def test_lines_are_those_of_the_segments_inside_the_band():
    whole = ef.spectra.Spectra.from_record(RECORD, 50.0, (2.0, 3.0))
    np.testing.assert_allclose(whole.lines, np.arange(160, 241) / 80)
    parts = ef.spectra.Spectra.from_record(RECORD, 50.0, (0.0, 99.0), averages=4)
    np.testing.assert_allclose(parts.lines, np.arange(1, 500) / 20)
    assert parts.averages == 4 and parts.matrices.shape == (499, 2, 2)


def test_a_channel_that_lags_has_its_phase():
    """D = F1 conj(F2) of x1 = cos(w t), x2 = cos(w t - a) is that of exp(i a)."""
    t = np.arange(1_000) / 100
    x = np.cos(2 * np.pi * 5.0 * t[:, None] - [0.0, 0.7])
    x += 1e-9 * RNG.standard_normal(x.shape)
    spectra = ef.spectra.Spectra.from_record(x, 100.0, (4.8, 5.2))
    (at,) = np.flatnonzero(np.isclose(spectra.lines, 5.0))
    assert np.angle(spectra.matrices[at, 0, 1]) == pytest.approx(0.7)
    # A sine's power is 1 / 2: the density times the distance of lines.
    assert spectra.psd[at, 0] * 0.1 == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"record": RECORD.T}, r"got \(2, 4000\); transpose"),
        ({"record": RECORD * [1.0, 0.0]}, "channel 2 does not move"),
        ({"band": (30.0, 40.0)}, "at least 4 lines between 30 and 40"),
    ],
)
def test_records_that_tell_nothing_are_refused(wrong, message):
    given = {"record": RECORD, "rate": 50.0, "band": (2.0, 3.0)} | wrong
    with pytest.raises(ValueError, match=message):
        ef.spectra.Spectra.from_record(**given)
