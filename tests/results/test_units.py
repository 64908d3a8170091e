"""Units of parameters: given once, with the posterior, and seen wherever values are."""

import arviz
import pytest
import xarray
from matplotlib import pyplot as plt
from support.chains import dataset

import emcee_femu as ef
from emcee_femu.results.arviz_objects import unit_of

MODEL = ef.FunctionModel(lambda p: [p["k"] ** 0.5 + 0 * p["a"]], n_modes=1)
TERM = ef.FrequencyTerm([3.0], relative_sd=0.01)
PRIOR = ef.GaussianPrior(["k", "a"], [9.0, 1.0], 1.0, [(5.0, 13.0), (0.1, 2.0)])
POSTERIOR = ef.LogPosterior(MODEL, TERM, PRIOR, units={"k": "N/m"})


def short_run(posterior):
    return ef.run(posterior, ef.DEMCMove(), 16, 60, ensembles=1, seed=1)


@pytest.fixture(scope="module")
def idata():
    return ef.to_inference_data(short_run(POSTERIOR))


@pytest.mark.parametrize("group", ["posterior", "prior"])
def test_a_file_keeps_the_units_of_parameters_and_frequencies(idata, group, tmp_path):
    idata.to_netcdf(tmp_path / "run.nc")
    again = arviz.from_netcdf(tmp_path / "run.nc")
    assert dataset(again, group)["k"].attrs["units"] == "N/m"
    assert not dataset(again, group)["a"].attrs["units"]
    assert dataset(again, "response")["frequency"].attrs["units"] == "Hz"
    assert unit_of(again, "k") == "N/m"
    assert unit_of(again, "a") == ""


def test_tables_have_a_column_only_where_there_are_units(idata):
    assert ef.parameter_table(idata).column("unit") == ["N/m", ""]
    assert ef.find_map(POSTERIOR, 2, seed=1, check=0).table.column("unit") == [
        "N/m",
        "",
    ]
    assert ef.anneal(POSTERIOR, 100, seed=1).table.column("unit") == ["N/m", ""]
    assert "N/m" in str(POSTERIOR)
    without = ef.LogPosterior(MODEL, TERM, PRIOR)
    assert "unit" not in str(without)
    assert "unit" not in ef.parameter_table(short_run(without)).columns


def test_a_derived_quantity_has_the_unit_that_it_was_given(idata):
    derived = idata.copy()
    posterior = derived["posterior"]
    posterior["EI"] = (2 * posterior["k"]).assign_attrs(units="N m^2")
    table = ef.parameter_table(derived, var_names=["EI", "a"])
    assert table.column("unit") == ["N m^2", ""]


def test_a_unit_that_xarray_handed_on_is_none(idata):
    derived = idata.copy()
    posterior = derived["posterior"]
    with xarray.set_options(keep_attrs=True):
        posterior["fall %"] = 100 * (1 - posterior["k"] / 9.0)
    table = ef.parameter_table(derived, var_names=["fall %", "k"])
    assert table.column("unit") == ["", "N/m"]
    assert unit_of(derived, "fall %") == ""


def test_units_outlive_what_is_made_of_a_posterior(idata):
    joint = ef.LogPosterior.joint(
        {"empty": (MODEL, TERM), "loaded": (MODEL, TERM)}, PRIOR, {"a": "kg"}
    )
    assert joint.units == {"a": "kg"}
    assert joint.with_models(lambda model: model).units == {"a": "kg"}
    certificate = ef.certify(idata, POSTERIOR, solves=60, seed=1)
    assert unit_of(certificate.idata, "k") == "N/m"
    assert certificate.table.column("unit") == ["N/m", ""]
    tests = {"May": idata, "June": idata}
    pooled = ef.pool_tests(
        tests, ef.population.NormalPopulation(["k"]), seed=1, steps=50, ensembles=1
    )
    assert unit_of(pooled.idata, "mean k") == unit_of(pooled.idata, "sd k") == "N/m"
    assert pooled.under_population("May", POSTERIOR).units == {"k": "N/m"}
    assert ef.figures.plot_population(pooled).axes[0].get_xlabel() == "k [N/m]"
    plt.close("all")


def test_axes_have_units_unless_others_are_asked_for(idata):
    figure = ef.figures.plot_scatter(idata)
    assert figure.axes[2].get_xlabel() == "k [N/m]"
    assert figure.axes[3].get_xlabel() == "a"
    figure = ef.figures.plot_scatter(idata, units={"k": "kN/m"})
    assert figure.axes[2].get_xlabel() == "k [kN/m]"
    plt.close("all")


def test_a_run_goes_on_after_units_were_added(tmp_path):
    file = tmp_path / "run.db"
    without = ef.LogPosterior(MODEL, TERM, PRIOR)
    settings = {"moves": ef.DEMCMove(), "nwalkers": 16, "ensembles": 1, "seed": 1}
    ef.run(without, steps=10, backend=file, **settings)
    run = ef.run(POSTERIOR, steps=20, backend=file, resume=True, **settings)
    assert run[0].iteration == 20


@pytest.mark.parametrize(
    "units, error, message",
    [
        ({"K": "N/m"}, ValueError, r"units: no parameter \['K'\]; there are \['k'"),
        ({"k": 3}, TypeError, r"units\['k'\]: expected a non-empty string, got 3"),
        ("N/m", TypeError, r"units: expected \{name: value\}, got str"),
    ],
)
def test_what_is_no_unit_of_a_parameter_is_refused(units, error, message):
    with pytest.raises(error, match=message):
        ef.LogPosterior(MODEL, TERM, PRIOR, units)
