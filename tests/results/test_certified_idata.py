"""Tables, figures and files of what a certificate has corrected, and say so."""

import arviz
import numpy as np
import pytest
import xarray
from support.printed import unwrapped

import emcee_femu as ef

SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
PRIOR = ef.GaussianPrior(["k1", "k2"], [10.0, 5.0], 2.0, [(2.0, 20.0), (1.0, 12.0)])
MODEL = ef.MassSpringModel([1.0, 2.0], SPRINGS)
TERM = ef.FrequencyTerm(MODEL({}).frequencies[0] * [1.01, 0.99], relative_sd=0.02)
TRUE = ef.LogPosterior(MODEL, TERM, PRIOR)


def emulated(masses):
    return ef.LogPosterior(ef.MassSpringModel(masses, SPRINGS), TERM, PRIOR)


def certificate(masses, solves=300):
    wrong = emulated(masses)
    samplers = ef.run(
        wrong, nwalkers=20, steps=500, seed=1, moves=ef.DEMCMove(), ensembles=1
    )
    idata = ef.to_inference_data(samplers, wrong, discard=200)
    return idata, ef.certify(idata, TRUE, solves, seed=2)


@pytest.fixture(scope="module")
def corrected():
    return certificate([1.015, 2.03])


@pytest.fixture(scope="module")
def certified():
    return certificate([1.0005, 2.001], 60)


def stored_and_read(idata, path):
    idata.to_netcdf(str(path))
    if hasattr(idata, "children"):
        return xarray.open_datatree(path)
    return arviz.from_netcdf(str(path))


def test_tables_show_the_weighted_draws_and_say_so(corrected, tmp_path):
    idata, found = corrected
    assert found.short == "corrected", found.verdict
    exact = found.weights @ found.theta / len(found.theta)
    for sealed in (found.idata, stored_and_read(found.idata, tmp_path / "weighted.nc")):
        table = ef.parameter_table(sealed)
        assert "corrected by the weights of" in table.title
        np.testing.assert_allclose(table.column("mean"), exact, rtol=1e-4)
        order = np.argsort(found.theta[:, 0])
        shares = np.cumsum(found.weights[order]) / found.weights.sum()
        quantile = found.theta[order, 0][np.searchsorted(shares, 0.975)]
        assert table.column("97.5 %")[0] == pytest.approx(quantile, rel=0.01)
        frequencies = ef.frequency_table(sealed)
        assert "corrected" in frequencies.title
        true = TRUE(found.theta)[:, TRUE.columns["frequency"]]
        means = found.weights @ true / len(found.theta)
        np.testing.assert_allclose(
            frequencies.column("sample mean Hz")[:2], means, rtol=1e-4
        )
        assert "corrected" in ef.predictive_table(sealed).title
        assert "orrected" in str(ef.identifiability(sealed))
        diagnosis = ef.diagnose(sealed)
        assert diagnosis.chains.status == "none" and not diagnosis.converged
        assert diagnosis.chains.sentence.endswith(found.verdict)
        assert diagnosis.search.status == "searched"
        assert diagnosis.search.sentence == found.findings[-1]
        assert diagnosis.fit.status == "fits"
        assert unwrapped(diagnosis) == diagnosis.verdict  # without a table of nothing
    assert str(ef.diagnose(found)) == str(ef.diagnose(found.idata))
    emulated_mean = ef.parameter_table(idata).column("mean")
    assert np.abs(emulated_mean / exact - 1).max() > 0.01


def test_predictive_draws_of_arviz_are_taken_by_weight(corrected):
    _, found = corrected
    new = found.idata["new_measurement"]["frequency"][0]
    some = found.idata["posterior_predictive"]["frequency"][0]
    weights = found.weights[found.weights > 0]
    exact = weights @ new.values / weights.sum()
    far = abs(new.values.mean(axis=0) - exact)
    error = 4 * some.std("draw").values / np.sqrt(len(some))
    assert (abs(some.mean("draw").values - exact) < error).all()
    assert (far > error).any()  # what it would be without the weights


def test_the_object_of_a_certified_posterior_is_its_chain_with_a_seal(
    certified, tmp_path
):
    idata, found = certified
    assert found.short == "certified", found.verdict
    for sealed in (found.idata, stored_and_read(found.idata, tmp_path / "sealed.nc")):
        table = ef.parameter_table(sealed)
        assert table.rows == ef.parameter_table(idata).rows
        assert "certified by 60 full solves" in table.title
        group = sealed["certificate"]
        assert group.attrs["verdict"] == found.verdict
        np.testing.assert_array_equal(group["weight"].values, found.weights)
        true = TRUE(found.theta)[:, 0]
        np.testing.assert_allclose(group["lp"].values, true, rtol=1e-9)
        ef.diagnose(sealed)
    assert "certificate" not in ef.parameter_table(idata).title  # given as it was
    assert "certified" not in ef.parameter_table(idata).title
