"""Modes near a peak from parameters: scaling, derivatives, and what is refused."""

import numpy as np
import pytest

import emcee_femu as ef

LINES = np.array([0.9, 1.0, 1.1])
D = np.tile(np.diag([1.0, 4.0, 2.0]), (3, 1, 1))
SPECTRA = ef.spectra.Spectra(LINES, D, averages=2, sensors=["roof", "two", "one"])
RNG = np.random.default_rng(3)


def draw(model, n=4):
    ranges = np.array([*model.ranges.values()])
    theta = ranges[:, 0] + np.ptp(ranges, axis=1) * RNG.uniform(
        0.4, 0.6, (n, len(ranges))
    )
    return dict(zip(model.names, theta.T, strict=True))


def test_shapes_have_unit_length_and_the_strongest_sensor_is_the_reference():
    model = ef.spectra.SpectrumModel(SPECTRA)
    assert model.reference == ("two",)
    assert model.names == ("f", "zeta", "ln_S", "phi_roof", "phi_one", "ln_S_e")
    given = dict.fromkeys(model.names, np.array([0.5]))
    shapes = model(given | {"phi_one": np.array([-1.0])})["shapes"]
    np.testing.assert_allclose(shapes[0, :, 0], np.array([0.5, 1.0, -1.0]) / 1.5)


def test_a_pair_has_the_coherence_of_its_forces():
    model = ef.spectra.SpectrumModel(SPECTRA, 2, reference=["two", "roof"])
    values = draw(model)
    psd = model(values)["force_psd"] @ [1, 1j]
    chi = psd[:, 0, 1] / np.sqrt(psd[:, 0, 0] * psd[:, 1, 1])
    np.testing.assert_allclose(
        chi, values["coherence_re"] + 1j * values["coherence_im"]
    )
    np.testing.assert_array_equal(psd, psd.conj().swapaxes(1, 2))
    np.testing.assert_allclose(psd[:, 1, 1], np.exp(values["ln_S2"]))
    assert "phi2_two" in model.names and "phi2_roof" not in model.names


@pytest.mark.parametrize("n_modes", [1, 2])
def test_derivatives_are_those_of_differences(n_modes):
    model = ef.spectra.SpectrumModel(SPECTRA, n_modes)
    values = draw(model)
    response, slopes = model.jacobian(values)
    assert response.keys() == slopes.keys() == model.variables.keys()
    for name in model.names:
        ahead = model(values | {name: values[name] + 1e-6})
        behind = model(values | {name: values[name] - 1e-6})
        for key, own in slopes.items():
            expected = (ahead[key] - behind[key]) / 2e-6
            found = np.broadcast_to(own.get(name, 0.0), expected.shape)
            # Differences of numbers up to 100 round by 1e-8.
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
