"""The figure of FRFs, and the information of their lines."""

import numpy as np
import pytest
from matplotlib import pyplot as plt
from support.gradients import linear_posterior

import emcee_femu as ef
from emcee_femu.results.line_information import find_frf, inform_lines

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
    return ef.FRFModel(two, LINES, CHANNELS, damping="zeta")


@pytest.fixture(scope="module", params=[True, False])
def sampled(request):
    """Return idata and posterior; of amplitudes alone or not."""
    frf, rng = model(), np.random.default_rng(2)
    true = frf({"k1": [550.0], "k2": [380.0], "zeta": [0.015]})["receptance"][0]
    noisy = true + 1e-4 * rng.standard_normal(true.shape)
    measured = ef.FRFMeasurements(LINES, noisy @ [1, 1j], CHANNELS, kind="receptance")
    term = ef.FRFTerm(measured, sd=1e-4, amplitude=request.param)
    posterior = ef.LogPosterior(frf, term, PRIOR)
    runs = ef.run(posterior, "auto", nwalkers=16, nsteps=100, seed=1)
    return ef.to_inference_data(runs, posterior), posterior


def test_the_information_of_all_lines_is_the_number_of_parameters(sampled):
    idata, posterior = sampled
    theta = np.stack([idata["posterior"][n].values.ravel() for n in PRIOR.names], 1)
    told = inform_lines(posterior, *find_frf(posterior, None), theta)
    assert told.shape == (80,) and (told >= 0).all()
    assert told.sum() == pytest.approx(3, rel=0.1)  # the prior tells next to nothing
    mean = posterior.parameters(theta.mean(axis=0, keepdims=True))
    first = posterior.model(mean)["frequency"][0, 0]
    assert told[np.abs(LINES - first) < 0.3].sum() > 0.2 * told.sum()


def test_measured_and_predicted_amplitudes_and_what_lines_tell(sampled):
    idata, posterior = sampled
    figure = ef.plot_frf(idata, posterior)
    assert [axes.get_ylabel().split("\n")[0] for axes in figure.axes] == [
        "0/1",
        "1/1",
        "information",
    ]
    assert "(m/N)" in figure.axes[0].get_ylabel()
    points = figure.axes[1].lines[0].get_ydata()
    measured = posterior.terms[0].measured
    np.testing.assert_allclose(points, np.abs(measured.values[1]))
    plt.close(figure)


def test_without_derivatives_there_is_no_panel_of_information(sampled):
    idata, posterior = sampled
    plain = ef.LogPosterior(
        ef.FRFModel(
            ef.FunctionModel(lambda p: None, variables=ef.modal_variables(2, [0, 1])),
            LINES, CHANNELS, damping="zeta",
        ),
        posterior.terms, PRIOR,
    )  # fmt: skip
    assert inform_lines(plain, *find_frf(plain, None), np.ones((5, 3))) is None
    assert idata is not None


def test_a_posterior_without_frfs_is_refused(sampled):
    linear = linear_posterior()[0]
    idata = ef.to_inference_data(ef.run(linear, nsteps=16, seed=1), linear)
    with pytest.raises(ValueError, match="expected one FRFTerm, found 0"):
        ef.plot_frf(idata, linear)
    with pytest.raises(TypeError, match="posterior: expected a LogPosterior, got int"):
        ef.plot_frf(sampled[0], 3)
