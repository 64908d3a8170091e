import warnings
from importlib.metadata import version
from itertools import product

import arviz as az
import emcee
import numpy as np
import pytest
import xarray
from matplotlib import pyplot as plt
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.chains import dataset

import emcee_femu as ef

NAMES = ["stiff", "alpha", "mass"]  # not in alphabetical order
BOUNDS = [(0.5, 1.6), (-1.0, 1.0), (0.6, 3.0)]
MEAN, SD = [1.0, 0.1, 1.5], [0.2, 0.3, 0.4]
MEASURED = [10.2, 25.5]  # two of the model's four modes
SAMPLED = ("posterior", "sample_stats", "log_likelihood", "response")
GROUPS = (
    *SAMPLED,
    "new_measurement",
    "posterior_predictive",
    "prior",
    "observed_data",
    "constant_data",
)
DATA = ["frequency[1]", "frequency[2]", "ridge"]
WALKERS, STEPS, MODES = 10, 24, 4


class Model:
    def __init__(self, n_modes=MODES):
        self.n_modes, self.variables = n_modes, ef.modal_variables(n_modes)

    def __call__(self, p):
        f1 = 10 * np.sqrt(p["stiff"])
        f3 = 40 * p.get("mass", np.ones(len(f1)))
        rows = np.stack([f1, 25 + p["alpha"], f3, 90 + f1, 99 + f1], axis=1)
        return ef.ModalSolution(rows[:, : self.n_modes])


def ridge(parameters, modes):
    return -2.0 * parameters["alpha"] ** 2


POSTERIOR = ef.LogPosterior(
    Model(),
    [ef.FrequencyTerm(MEASURED, beta=1e3), ridge],
    ef.GaussianPrior(NAMES, MEAN, SD, BOUNDS),
)


@pytest.fixture(scope="module")
def runs():
    moves = [(ef.DEMCMove(), 0.75), (ef.MetropolisMove(sd=0.05), 0.25)]
    return ef.run(POSTERIOR, moves, WALKERS, STEPS, ensembles=3, seed=7)


@pytest.fixture(scope="module")
def idata(runs):
    return ef.to_inference_data(runs, POSTERIOR, discard=4)


def test_a_tempered_run_read_from_its_file_has_its_cold_walkers_only(tmp_path):
    path, betas = tmp_path / "run.chain", [1.0, 0.2, 0.0]
    moves = [
        (ef.moves.TemperedMove(m, betas), 0.5)
        for m in (ef.DEMCMove(), ef.MetropolisMove(sd=1))
    ]
    run = ef.run(POSTERIOR, moves, 30, 12, seed=1, ensembles=2, backend=path)
    expected = ef.to_inference_data(run)
    for source in (path, list(run)):
        read = ef.to_inference_data(source, POSTERIOR)
        assert read["posterior"].sizes["chain"] == 20
        assert dataset(read, "posterior").equals(dataset(expected, "posterior"))
        for name in ("acceptance", "betas"):
            attrs = read["posterior"].attrs, expected["posterior"].attrs
            assert attrs[0][name] == attrs[1][name]
        assert_array_equal(ef.diagnose(source).ess_bulk, ef.diagnose(run).ess_bulk)


def test_all_that_takes_an_arviz_object_takes_a_run():
    run = ef.run(POSTERIOR, ef.DEMCMove(), WALKERS, 60, ensembles=2, seed=7)
    idata = ef.to_inference_data(run)
    assert ef.to_inference_data(idata) is idata
    for function in (ef.diagnose, ef.identifiability, ef.parameter_table):
        assert str(function(run)) == str(function(idata))
    for function in (ef.frequency_table, ef.predictive_table):
        assert str(function(run)) == str(function(idata, POSTERIOR))
    samplers = [run[0], run[1]]
    assert str(ef.parameter_table(samplers)) == str(ef.parameter_table(idata))
    backends = ef.to_inference_data([s.backend for s in samplers], POSTERIOR)
    assert str(ef.predictive_table(backends)) == str(ef.predictive_table(idata))
    for plot in (ef.figures.plot_tae, ef.figures.plot_predictive):
        one, other = plot(run), plot(idata, POSTERIOR)
        lines = [figure.axes[0].get_lines()[0].get_ydata() for figure in (one, other)]
        assert_array_equal(*lines)
    assert ef.figures.plot_scatter(run).axes and ef.figures.plot_correlation(run).axes
    plt.close("all")


def test_arviz_says_where_its_samples_came_from():
    """Fault 10: of populations nothing was told."""
    annealed = ef.anneal(POSTERIOR, 100, seed=1)
    attrs = ef.to_inference_data(annealed, POSTERIOR)["posterior"].attrs
    powers = len(annealed.powers) - 1
    assert attrs["origin"].startswith(f"annealed through {powers} powers")
    assert attrs["kind"] == "population" and attrs["moves"] == "annealed"


def assert_is_the_chain(idata, runs, discard=0, thin=1):
    pairs = list(product(range(len(runs)), range(WALKERS)))
    for chain, (e, w) in enumerate(pairs):
        options = {"discard": discard, "thin": thin}
        blobs = runs[e].get_blobs(**options)[:, w]
        expected = {
            ("sample_stats", "lp"): runs[e].get_log_prob(**options)[:, w],
            ("sample_stats", "log_prior"): blobs[:, 0],
            ("response", "frequency"): blobs[:, 3:],
        }
        for k, name in enumerate(NAMES):
            expected["posterior", name] = runs[e].get_chain(**options)[:, w, k]
        for (group, name), value in expected.items():
            found = dataset(idata, group)[name]
            assert found.dims == ("chain", "draw", "mode")[: 1 + value.ndim]
            assert_array_equal(found.values[chain], value)
        factors = dataset(idata, "log_likelihood")["data"][chain]
        assert factors.datum.values.tolist() == DATA
        assert_array_equal(factors[:, 2], blobs[:, 2])
        assert_allclose(factors[:, :2].sum("datum"), blobs[:, 1], rtol=1e-11)
    for group in SAMPLED:
        found = dataset(idata, group)
        assert_array_equal(np.c_[found.ensemble, found.walker], pairs)
        assert found.ensemble.dims == found.walker.dims == ("chain",)
        assert_array_equal(found.chain, np.arange(len(pairs)))


@pytest.mark.parametrize("count, discard, thin", [(3, 0, 1), (3, 5, 3), (1, 23, 1)])
def test_every_number_is_the_sampler_s(runs, count, discard, thin):
    idata = ef.to_inference_data(runs[:count], POSTERIOR, discard, thin)
    assert_is_the_chain(idata, runs[:count], discard, thin)
    posterior = dataset(idata, "posterior")
    steps = posterior.step.values
    assert_array_equal(steps, np.arange(STEPS)[discard + thin - 1 :: thin])
    assert_array_equal(posterior.draw, np.arange(len(steps)))
    whole = runs[0].get_chain()[:, 3, 1]
    assert_array_equal(posterior["alpha"].values[3], whole[steps])


def test_container_groups_variables_and_dimensions(idata):
    old = az.__version__.startswith("0.")
    assert type(idata) is (az.InferenceData if old else xarray.DataTree)
    by_draw = {"chain": 30, "draw": 20}
    expected = {
        "posterior": (NAMES, by_draw),
        "sample_stats": (["lp", "log_prior"], by_draw),
        "log_likelihood": (["data"], by_draw | {"datum": 3}),
        "new_measurement": (["frequency"], by_draw | {"mode": 2}),
        "posterior_predictive": (["frequency"], {"chain": 1, "draw": 500, "mode": 2}),
        "prior": (NAMES, {"chain": 1, "draw": 1000}),
        "response": (["frequency"], by_draw | {"mode": 4}),
        "observed_data": (["frequency"], {"mode": 2}),
    }
    for group, (names, sizes) in expected.items():
        found = dataset(idata, group)
        assert (list(found.data_vars), dict(found.sizes)) == (names, sizes)
        if "mode" in sizes:
            assert found.mode.values.tolist() == list(range(1, 1 + sizes["mode"]))


def test_observed_and_constant_data(idata):
    assert dataset(idata, "observed_data")["frequency"].values.tolist() == MEASURED
    constants = dataset(idata, "constant_data")
    assert constants.parameter.values.tolist() == NAMES
    assert_array_equal(np.stack([constants["lower"], constants["upper"]], 1), BOUNDS)
    assert constants["initial"].values.tolist() == MEAN
    ends = (np.transpose(BOUNDS) - MEAN) / SD
    cut = stats.truncnorm.std(*ends, scale=SD)  # less than SD
    assert_allclose(constants["prior_sd"], cut, rtol=0.02)  # 4 Monte Carlo errors
    expected = [10, 25.1, 60, 100]
    assert_allclose(constants["initial_frequency"], expected, rtol=1e-12)


def test_attributes_tell_how_the_chain_was_made(idata):
    for group in GROUPS:
        attrs = dataset(idata, group).attrs
        assert (attrs["discard"], attrs["thin"]) == (4, 1)
        assert attrs["emcee_femu_version"] == version("emcee-femu")
    attrs = dataset(idata, "posterior").attrs
    first, second = attrs["moves"].split("; ")
    assert first.startswith("0.75 x DEMCMove(")
    assert second.startswith("0.25 x MetropolisMove(")
    assert attrs["seed"] == "7" and attrs["sampled"] == NAMES


def test_a_plain_emcee_sampler_and_its_backend_are_converted():
    plain = emcee.EnsembleSampler(WALKERS, 3, POSTERIOR, vectorize=True)
    plain.run_mcmc(POSTERIOR.start(WALKERS, seed=1), 6)
    for source in (plain, plain.backend):
        assert_is_the_chain(ef.to_inference_data(source, POSTERIOR), [plain])
    idata = ef.to_inference_data(plain)  # which knows its posterior
    assert dataset(idata, "posterior").attrs["seed"].startswith("unknown")
    assert dataset(idata, "posterior").attrs["moves"].startswith("1 x StretchMove(")
    idata = ef.to_inference_data(plain.backend, POSTERIOR)
    assert dataset(idata, "posterior").attrs["moves"].startswith("unknown")


def test_arviz_judges_and_plots_the_result(idata):
    assert list(az.summary(idata).index) == NAMES
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # 600 draws of a short chain
        loo = az.loo(idata)
        ranking = az.compare({"one": idata, "other": idata})
    assert loo.n_data_points == len(DATA) and len(ranking) == 2
    az.plot_trace(idata, var_names=NAMES[:2])
    assert plt.get_fignums()
    plt.close("all")


def test_the_predictive_draws_are_new_measurements_of_all_chains(idata):
    new = dataset(idata, "new_measurement")["frequency"]
    some = dataset(idata, "posterior_predictive")["frequency"]
    places = np.nonzero(np.isin(new.values[..., 0], some.values[..., 0]))
    assert len(places[0]) == some.sizes["draw"]  # each once
    assert len({*places[0]}) == new.sizes["chain"]  # 500 of 600
    assert_array_equal(some.mode, new.mode)


@pytest.mark.parametrize("plain", [True, False])
def test_parameters_of_a_plain_sampler_are_named(plain):
    sampler = emcee.EnsembleSampler(8, 2, lambda x: -0.5 * float(x @ x))
    sampler.run_mcmc(np.random.default_rng(1).normal(size=(8, 2)), 10)
    source = sampler if plain else sampler.backend
    idata = ef.to_inference_data(source, discard=5, names=["k", "m"])
    assert dataset(idata, "posterior").attrs["sampled"] == ["k", "m"]
    expected = sampler.get_chain(discard=5)[:, 3, 1]
    assert_array_equal(dataset(idata, "posterior")["m"].values[3], expected)
    with pytest.raises(ValueError, match=r"names: expected one for each of 2 param"):
        ef.to_inference_data(source, names=["k"])
    with pytest.raises(ValueError, match=r"names: there are \['k', 'm'\] already"):
        ef.to_inference_data(idata, names=["k", "m"])


def test_a_posterior_has_its_own_names(runs):
    with pytest.raises(ValueError, match=r"names: there are \['stiff', 'alpha'"):
        ef.to_inference_data(runs, names=NAMES)


def test_netcdf_round_trip_keeps_every_number_and_the_tables(idata, tmp_path):
    idata.to_netcdf(str(tmp_path / "run.nc"))
    again = az.from_netcdf(str(tmp_path / "run.nc"))
    for group in GROUPS:
        before, after = dataset(idata, group), dataset(again, group).load()
        assert after.equals(before)
        assert list(after.data_vars) == list(before.data_vars)
        assert before.attrs.items() <= after.attrs.items()
    assert ef.parameter_table(again) == ef.parameter_table(idata)
    tables = [ef.frequency_table(each, POSTERIOR) for each in (again, idata)]
    assert str(tables[0]) == str(tables[1])
    for column in tables[0].columns[1:]:
        assert_allclose(*(table.column(column) for table in tables), rtol=1e-9)
    if hasattr(again, "close"):
        again.close()


def finished(n=3, n_modes=MODES, steps=3):
    prior = ef.GaussianPrior(NAMES[:n], MEAN[:n], 0.1)
    term = ef.FrequencyTerm(MEASURED, beta=1e3)
    posterior = ef.LogPosterior(Model(n_modes), term, prior)
    return list(ef.run(posterior, ef.DEMCMove(), WALKERS, steps, seed=1, ensembles=1))


def of_two_shapes():
    return finished() + finished(2)


@pytest.mark.parametrize(
    "error, message, options, make",
    [
        (ValueError, "discard: no steps are left", {"discard": STEPS}, None),
        (TypeError, "source: expected what run returned", {}, lambda: [3.0]),
        (ValueError, "expected ensembles of one shape", {}, of_two_shapes),
        (ValueError, r"\(5,\) are not of this .*\(7,\)", {}, lambda: finished(3, 3)),
    ],
)
def test_wrong_samplers_and_counts_are_refused(runs, error, message, options, make):
    with pytest.raises(error, match=message):
        ef.to_inference_data(make() if make else runs, POSTERIOR, **options)


def test_ensembles_of_different_lengths_are_cut_to_the_shortest():
    both = ef.to_inference_data(finished() + finished(steps=5))
    assert dict(both["posterior"].sizes) == {"chain": 2 * WALKERS, "draw": 3}


BLOBS = {  # what a function returns beside its log-probability, and emcee's dtype
    "one": (lambda x: (x.sum(),), None),
    "array": (lambda x: (2 * x,), None),
    "mixed": (lambda x: (x.sum(), 2 * x), None),
    "structured": (
        lambda x: (x.sum(), 2 * x),
        [("step", float), ("twice", float, 2)],
    ),
}


@pytest.mark.parametrize("kind", BLOBS)
def test_blobs_of_any_sampler_are_kept(kind, tmp_path):
    function, dtype = BLOBS[kind]
    sampler = emcee.EnsembleSampler(
        8, 2, lambda x: (-0.5 * x @ x, *function(x)), blobs_dtype=dtype
    )
    sampler.run_mcmc(np.random.default_rng(1).normal(size=(8, 2)), 12)
    idata = ef.to_inference_data(sampler, discard=2, thin=2)
    idata.to_netcdf(tmp_path / "run.nc")
    kept = dataset(az.from_netcdf(tmp_path / "run.nc"), "blobs")
    x = sampler.get_chain(discard=2, thin=2).swapaxes(0, 1)
    names = {"one": ["blob"], "array": ["blob"], "mixed": ["blob0", "blob1"]}
    expected = {"blob_step": x.sum(axis=2), "twice": 2 * x}
    if kind in names:
        values = [2 * x] if kind == "array" else [x.sum(axis=2), 2 * x]
        expected = dict(zip(names[kind], values, strict=False))
    assert {*map(str, kept.data_vars)} == {*expected}
    for name, values in expected.items():
        np.testing.assert_allclose(kept[name], values)


def test_blobs_that_no_file_can_hold_are_named():
    sampler = emcee.EnsembleSampler(8, 2, lambda x: (-0.5 * x @ x, {"x": x}))
    sampler.run_mcmc(np.random.default_rng(1).normal(size=(8, 2)), 12)
    with pytest.warns(UserWarning, match="blob"):
        idata = ef.to_inference_data(sampler, names=["a", "b"])
    assert [*dataset(idata, "posterior")] == ["a", "b"]
