"""Draws of modes near several peaks become one record of measurements."""

import numpy as np
import xarray as xr
from support.ambient import draw_spectra, widely
from support.repeated import wrap

import emcee_femu as ef

RNG = np.random.default_rng(8)


def drawn(f, sensors=("a", "b")):
    """Return an ArviZ object with draws of modes about frequencies."""
    k = len(f)
    mixing = np.array([[1.0, 0.6], [0.0, 0.8]])[:k, :k]
    hertz = f + 0.01 * RNG.standard_normal((4, 500, k)) @ mixing
    shapes = 0.6 + 0.02 * RNG.standard_normal((4, 500, len(sensors), k))
    data = {
        "frequency": (("chain", "draw", "mode"), hertz),
        "damping_ratio": (("chain", "draw", "mode"), 0.01 + 0.05 * hertz),
        "shapes": (("chain", "draw", "sensor", "mode"), shapes),
    }
    coords = {"mode": range(1, k + 1), "sensor": [*sensors]}
    group = xr.Dataset(data, coords, {"sample_dims": ["chain", "draw"]})
    return wrap({"posterior": group, "response": group}), data


def test_modes_of_all_bands_ascend_with_their_covariance():
    upper, high = drawn([3.0, 3.05])
    lower, low = drawn([1.0])
    found = ef.spectra.modes_from_spectra({"up": upper, "low": lower}, dofs=[4, 2])
    f = [values["frequency"][1].reshape(2_000, -1) for values in (low, high)]
    np.testing.assert_allclose(found.frequencies, np.hstack([x.mean(0) for x in f]))
    expected = np.zeros((3, 3))
    expected[0, 0], expected[1:, 1:] = f[0].var(ddof=1), np.cov(f[1], rowvar=False)
    np.testing.assert_allclose(found.covariance, expected)
    np.testing.assert_allclose(found.damping, 0.01 + 0.05 * found.frequencies)
    np.testing.assert_allclose(
        found.damping_sd, 0.05 * np.sqrt(np.diag(found.covariance))
    )
    own = high["shapes"][1].reshape(2_000, 2, 2)
    np.testing.assert_allclose(found.shapes[:, 1:], own.mean(0))
    np.testing.assert_allclose(found.shape_sd[:, 1:], own.std(0, ddof=1))
    assert found.sensors == ("a", "b") and found.dofs.tolist() == [4, 2]


def test_a_run_enters_an_update(tmp_path):
    """From spectra to modes to the likelihood of a frequency, and through a file."""
    lines = np.arange(80, 121) / 100
    blank = ef.spectra.Spectra(lines, np.tile(np.eye(2), (41, 1, 1)), averages=1)
    model = ef.spectra.SpectrumModel(blank, reference="s1")
    truth = {"f": 1.0, "zeta": 0.02, "ln_S": -4.0, "ln_S_e": -3.0, "phi_s2": 0.5}
    spectra = draw_spectra(RNG, model, truth, lines)
    post = ef.LogPosterior(model, ef.spectra.SpectrumTerm(spectra), widely(model))
    idata = ef.to_inference_data(
        ef.run(post, "auto", steps=20, seed=1, ensembles=1), post
    )
    found = ef.spectra.modes_from_spectra({"first": idata})
    assert found.sensors == ("s1", "s2") and found.n_modes == 1
    term = ef.FrequencyTerm(found)
    assert np.isfinite(term({}, ef.ModalSolution(np.array([[1.0]])))).all()
    found.to_csv(tmp_path / "modes.csv")
    again = ef.Measurements.from_csv(tmp_path / "modes.csv")
    np.testing.assert_array_equal(again.damping, found.damping)
    np.testing.assert_array_equal(again.damping_sd, found.damping_sd)
