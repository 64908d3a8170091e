"""The figure of FRFs."""

import numpy as np
import pytest
from matplotlib import pyplot as plt

import emcee_femu as ef

LINES, CHANNELS = np.linspace(0.5, 6.0, 80), [(0, 1), (1, 1)]
PRIOR = ef.GaussianPrior(
    ["k1", "k2", "zeta"],
    [500.0, 400.0, 0.02],
    [200.0, 200.0, 0.02],
    [(100.0, 2_000.0), (100.0, 2_000.0), (0.001, 0.2)],
)


def model():
    ends = [np.array([1.0, 0.0]), np.array([-1.0, 1.0])]
    K = {f"k{i}": np.outer(e, e) for i, e in enumerate(ends, 1)}
    two = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), K, n_modes=2, shapes=True)
    return ef.frf.FRFModel(two, LINES, CHANNELS, damping="zeta")


@pytest.fixture
def sampled():
    frf, rng = model(), np.random.default_rng(2)
    true = frf({"k1": [550.0], "k2": [380.0], "zeta": [0.015]})["receptance"][0]
    noisy = true + 1e-4 * rng.standard_normal(true.shape)
    measured = ef.frf.FRFMeasurements(
        LINES, noisy @ [1, 1j], CHANNELS, kind="receptance"
    )
    term = ef.frf.FRFTerm(measured, sd=1e-4)
    posterior = ef.LogPosterior(frf, term, PRIOR)
    run = ef.run(posterior, ef.DEMCMove(), nwalkers=16, steps=50, seed=1, ensembles=1)
    return run, posterior


def test_measured_and_predicted_amplitudes(sampled):
    run, posterior = sampled
    figure = ef.frf.plot_frf(run)
    assert [axes.get_ylabel().split("\n")[0] for axes in figure.axes] == [
        "0/1",
        "1/1",
    ]
    assert "(m/N)" in figure.axes[0].get_ylabel()
    points = figure.axes[1].lines[0].get_ydata()
    measured = posterior.terms[0].measured
    np.testing.assert_allclose(points, np.abs(measured.values[1]))
    plt.close(figure)
