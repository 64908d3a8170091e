"""Prior beside posterior: densities, axes, and what is marked."""

import numpy as np
import pytest
from matplotlib.patches import StepPatch
from numpy.testing import assert_allclose
from scipy import stats
from support.chains import dataset
from support.figures import assert_no_texts_overlap, assert_nothing_is_clipped, legend

import emcee_femu as ef

MARGINALS = {"k": stats.norm(10.0, 2.0), "sigma": stats.halfnorm(scale=1e-3)}
MARGINALS |= {"m": stats.lognorm(0.5, scale=3e6)}


@pytest.fixture(scope="module")
def run():
    """Only k is learned."""
    model = ef.FunctionModel(lambda p: [p["k"]], n_modes=1)
    term = ef.FrequencyTerm([10.5], sd=0.1)
    posterior = ef.LogPosterior(model, term, ef.IndependentPrior(MARGINALS))
    return ef.run(posterior, ef.DEMCMove(), 24, 300, ensembles=1, seed=1)


def histograms(axes):
    return [p.get_data() for p in axes.patches if isinstance(p, StepPatch) and p.fill]


def test_each_panel_has_the_priors_density_and_a_histogram_of_the_samples(run):
    figure = ef.figures.plot_prior_posterior(run)
    group = dataset(ef.to_inference_data(run), "posterior")
    scales = [1.0, 1e-3, 1e7]
    for axes, name, scale in zip(figure.axes, MARGINALS, scales, strict=True):
        x, y = axes.lines[0].get_data()
        density = MARGINALS[name].pdf(x * scale)
        assert_allclose(y, density / density.max(), rtol=1e-9)
        (bars,) = histograms(axes)
        draws = group[name].values.ravel() / scale
        counts = np.histogram(draws, bars.edges)[0]
        assert_allclose(bars.values, counts / counts.max())
        assert counts.sum() >= 0.99 * len(draws) and (counts > 0).sum() >= 20
    shown = np.ptp(figure.axes[0].get_xlim())
    assert shown > 8  # as wide as the prior, twenty times wider than the samples


def test_axes_of_positive_parameters_stay_positive_and_have_units(run):
    units = {"sigma": "m", "m": "kg"}
    figure = ef.figures.plot_prior_posterior(run, units=units)
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert labels[0] == "k" and labels[1].endswith("10^{-3}$ m]")
    assert [axes.get_xlim()[0] for axes in figure.axes[1:]] == [0.0, 0.0]
    assert figure.get_size_inches()[0] == pytest.approx(7, abs=0.1)
    assert_nothing_is_clipped(figure, labels[0])
    assert_no_texts_overlap(figure)
    assert legend(figure) == ["prior", "posterior"]


def test_truths_are_marked_and_variables_chosen(run):
    marked = {"truths": {"k": 25.0}, "var_names": ["m", "k"]}
    figure = ef.figures.plot_prior_posterior(run, **marked)
    m, k = figure.axes
    assert m.get_xlabel().startswith("m ") and k.get_xlim()[1] == 25.0
    assert k.lines[-1].get_xdata() == [25.0, 25.0]
    assert legend(figure) == ["prior", "posterior", "reference"]


def test_without_the_posterior_the_prior_is_a_histogram_of_its_draws(run):
    idata = ef.to_inference_data(run)
    idata.posterior["ratio"] = idata.posterior["m"] / idata.posterior["k"]
    names = ["k", "ratio"]  # the second has no prior
    first, second = ef.figures.plot_prior_posterior(idata, var_names=names).axes
    before, after = histograms(first)
    middle = before.edges[:-1] + np.diff(before.edges) / 2
    assert np.average(middle, weights=before.values) == pytest.approx(10.0, abs=0.3)
    middle = after.edges[:-1] + np.diff(after.edges) / 2
    assert np.average(middle, weights=after.values) == pytest.approx(10.5, abs=0.05)
    assert len(histograms(second)) == 1
    known = ef.figures.plot_prior_posterior(idata, run.posterior, var_names=["k"])
    assert len(histograms(known.axes[0])) == 1
