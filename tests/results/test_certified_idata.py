"""Tables, figures and files of what a certificate has corrected, and say so."""

import arviz
import numpy as np
import pytest
import xarray

import emcee_femu as ef

SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
PRIOR = ef.GaussianPrior(["k1", "k2"], [10.0, 5.0], 2.0, [(2.0, 20.0), (1.0, 12.0)])
MODEL = ef.MassSpringModel([1.0, 2.0], SPRINGS)
TERM = ef.FrequencyTerm(MODEL({}).frequencies[0] * [1.01, 0.99], relative_sd=0.02)
TRUE = ef.LogPosterior(MODEL, TERM, PRIOR)


def certificate(masses, solves):
    """Return a run of a model with other masses, and its certificate."""
    wrong = ef.LogPosterior(ef.MassSpringModel(masses, SPRINGS), TERM, PRIOR)
    run = ef.run(wrong, ef.DEMCMove(), 20, 400, seed=1, ensembles=1)
    idata = ef.to_inference_data(run, discard=200)
    return idata, ef.certify(idata, TRUE, solves, seed=2)


def stored_and_read(idata, path):
    idata.to_netcdf(str(path))
    if hasattr(idata, "children"):
        return xarray.open_datatree(path)
    return arviz.from_netcdf(str(path))


def test_tables_show_the_weighted_draws_and_say_so(tmp_path):
    idata, found = certificate([1.01, 2.02], 300)
    assert found.short == "corrected", found.verdict
    exact = found.weights @ found.theta / len(found.theta)
    true = TRUE(found.theta)[:, TRUE.columns["frequency"]]
    order = np.argsort(found.theta[:, 0])
    shares = np.cumsum(found.weights[order]) / found.weights.sum()
    quantile = found.theta[order, 0][np.searchsorted(shares, 0.975)]
    sealed = stored_and_read(found.idata, tmp_path / "weighted.nc")
    parameters, frequencies = ef.parameter_table(sealed), ef.frequency_table(sealed)
    np.testing.assert_allclose(parameters.column("mean"), exact, rtol=1e-4)
    assert parameters.column("97.5 %")[0] == pytest.approx(quantile, rel=0.01)
    means = frequencies.column("sample mean Hz")[:2]
    expected = found.weights @ true / len(found.theta)
    np.testing.assert_allclose(means, expected, rtol=1e-4)
    said = parameters, frequencies, ef.predictive_table(sealed)
    assert all("corrected" in table.title for table in said)
    diagnosis = ef.diagnose(sealed)
    assert diagnosis.chains.status == "none" and not diagnosis.converged
    assert diagnosis.search == found.search
    emulated_mean = ef.parameter_table(idata).column("mean")
    assert np.abs(emulated_mean / exact - 1).max() > 0.01
    # Predictive draws are taken by weight.
    new = found.idata["new_measurement"]["frequency"][0]
    some = found.idata["posterior_predictive"]["frequency"][0]
    weights = found.weights[found.weights > 0]
    exact = weights @ new.values / weights.sum()
    error = 4 * some.std("draw").values / np.sqrt(len(some))
    assert (abs(some.mean("draw").values - exact) < error).all()
    assert (abs(new.values.mean(axis=0) - exact) > error).any()  # without weights


def test_the_object_of_a_certified_posterior_is_its_chain_with_a_seal(tmp_path):
    idata, found = certificate([1.0005, 2.001], 60)
    assert found.short == "certified", found.verdict
    sealed = stored_and_read(found.idata, tmp_path / "sealed.nc")
    table = ef.parameter_table(sealed)
    assert table.rows == ef.parameter_table(idata).rows
    assert f"certified by {found.solves}" in table.title
    group = sealed["certificate"]
    assert group.attrs["verdict"] == found.verdict
    np.testing.assert_array_equal(group["weight"].values, found.weights)
    true = TRUE(found.theta)[:, 0]
    np.testing.assert_allclose(group["lp"].values, true, rtol=1e-9)
    assert ef.diagnose(sealed).chains.status != "none"
    assert "certified" not in ef.parameter_table(idata).title  # given as it was
