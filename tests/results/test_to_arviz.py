"""The ArviZ object of a run: every number, where it came from, files and tables."""

import tracemalloc
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
from support.chains import dataset, stored_and_read

import emcee_femu as ef

NAMES = ["stiff", "alpha", "mass"]  # not in alphabetical order
BOUNDS = [(0.5, 1.6), (-1.0, 1.0), (0.6, 3.0)]
MEAN, SD = [1.0, 0.1, 1.5], [0.2, 0.3, 0.4]
MEASURED = [10.2, 25.5]  # two of the model's four modes
SAMPLED = ("posterior", "sample_stats", "log_likelihood", "response")
GROUPS = (*SAMPLED, "new_measurement", "posterior_predictive", "prior")
GROUPS += ("observed_data", "constant_data")
DATA = ["frequency[1]", "frequency[2]", "ridge"]
WALKERS, STEPS, MODES = 10, 24, 4


def model_of(n_modes=MODES):
    def model(p):
        f1 = 10 * np.sqrt(p["stiff"])
        f3 = 40 * p.get("mass", np.ones(len(f1)))
        rows = np.stack([f1, 25 + p["alpha"], f3, 90 + f1, 99 + f1], axis=1)
        return ef.ModalSolution(rows[:, :n_modes])

    model.variables = ef.modal_variables(n_modes)
    return model


def ridge(parameters, modes):
    return -2.0 * parameters["alpha"] ** 2


POSTERIOR = ef.LogPosterior(
    model_of(),
    [ef.FrequencyTerm(MEASURED, beta=1e3), ridge],
    ef.GaussianPrior(NAMES, MEAN, SD, BOUNDS),
    units={"stiff": "N/m"},
)


@pytest.fixture(scope="module")
def runs():
    moves = [(ef.DEMCMove(), 0.75), (ef.MetropolisMove(sd=0.05), 0.25)]
    return ef.run(POSTERIOR, moves, WALKERS, STEPS, ensembles=3, seed=7)


@pytest.fixture(scope="module")
def idata(runs):
    return ef.to_inference_data(runs, POSTERIOR, discard=4)


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
        densities = dataset(idata, "log_prior")[NAMES].isel(chain=chain)
        assert_allclose(densities.to_array().sum("variable"), blobs[:, 0], rtol=1e-11)
        factors = dataset(idata, "log_likelihood")["data"][chain]
        assert factors.datum.values.tolist() == DATA
        assert_array_equal(factors[:, 2], blobs[:, 2])
        assert_allclose(factors[:, :2].sum("datum"), blobs[:, 1], rtol=1e-11)
    for group in SAMPLED:
        found = dataset(idata, group)
        assert_array_equal(np.c_[found.ensemble, found.walker], pairs)


@pytest.mark.parametrize("count, discard, thin", [(3, 0, 1), (3, 5, 3), (1, 23, 1)])
def test_every_number_is_the_sampler_s(runs, count, discard, thin):
    idata = ef.to_inference_data(runs[:count], POSTERIOR, discard, thin)
    assert_is_the_chain(idata, runs[:count], discard, thin)
    posterior = dataset(idata, "posterior")
    steps = posterior.step.values
    assert_array_equal(steps, np.arange(STEPS)[discard + thin - 1 :: thin])
    whole = runs[0].get_chain()[:, 3, 1]
    assert_array_equal(posterior["alpha"].values[3], whole[steps])


def test_groups_their_data_and_how_they_were_made(idata):
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
    for group in GROUPS:
        attrs = dataset(idata, group).attrs
        assert (attrs["discard"], attrs["thin"]) == (4, 1)
        assert attrs["emcee_femu_version"] == version("emcee-femu")
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
    attrs = dataset(idata, "posterior").attrs
    first, second = attrs["moves"].split("; ")
    assert first.startswith("0.75 x DEMCMove(") and attrs["seed"] == "7"
    assert second.startswith("0.25 x MetropolisMove(") and attrs["sampled"] == NAMES
    # Predictive draws are new measurements of all chains, each once.
    new = dataset(idata, "new_measurement")["frequency"]
    some = dataset(idata, "posterior_predictive")["frequency"]
    places = np.nonzero(np.isin(new.values[..., 0], some.values[..., 0]))
    assert len(places[0]) == some.sizes["draw"]
    assert len({*places[0]}) == new.sizes["chain"]  # 500 of 600
    for dim in ("chain", "draw"):  # as ArviZ numbers those of others
        assert some[dim].values.tolist() == [*range(some.sizes[dim])]


def test_a_tempered_run_read_from_its_file_has_its_cold_walkers_only(tmp_path):
    path, betas = tmp_path / "run.chain", [1.0, 0.2, 0.0]
    moves = ef.moves.TemperedMove(ef.DEMCMove(), betas)
    run = ef.run(POSTERIOR, moves, 30, 12, seed=1, ensembles=2, backend=path)
    expected = ef.to_inference_data(run)
    for source, discard in ((path, None), (list(run), run.burn_in)):
        read = ef.to_inference_data(source, POSTERIOR, discard)
        assert read["posterior"].sizes["chain"] == 20
        assert dataset(read, "posterior").equals(dataset(expected, "posterior"))
        for name in ("acceptance", "betas"):
            attrs = read["posterior"].attrs, expected["posterior"].attrs
            assert attrs[0][name] == attrs[1][name]
        found = ef.diagnose(source, discard)
        assert_array_equal(found.ess_bulk, ef.diagnose(run).ess_bulk)


def test_all_that_takes_an_arviz_object_takes_a_run(runs):
    idata = ef.to_inference_data(runs)
    assert ef.to_inference_data(idata) is idata
    backends = [s.backend for s in runs]
    backends = ef.to_inference_data(backends, POSTERIOR, runs.burn_in)
    for function in (ef.diagnose, ef.identifiability, ef.parameter_table):
        assert str(function(runs)) == str(function(idata))
    for source in (idata, backends):
        of_run = ef.predictive_table(runs), ef.frequency_table(runs, POSTERIOR)
        assert str(of_run[0]) == str(ef.predictive_table(source, POSTERIOR))
        assert str(of_run[1]) == str(ef.frequency_table(source, POSTERIOR))
    assert str(ef.frequency_table(runs)) == str(ef.frequency_table(idata))
    one, other = ef.figures.plot_tae(runs), ef.figures.plot_tae(idata, POSTERIOR)
    assert_array_equal(*(f.axes[0].get_lines()[0].get_ydata() for f in (one, other)))


def test_a_plain_emcee_sampler_and_its_backend_are_converted():
    plain = emcee.EnsembleSampler(WALKERS, 3, POSTERIOR, vectorize=True)
    plain.run_mcmc(POSTERIOR.start(WALKERS, seed=1), 6)
    for source in (plain, plain.backend):
        assert_is_the_chain(ef.to_inference_data(source, POSTERIOR), [plain])
    attrs = dataset(ef.to_inference_data(plain), "posterior").attrs
    assert attrs["seed"].startswith("unknown")
    assert attrs["moves"].startswith("1 x StretchMove(")


def test_the_prior_predicts_new_measurements(runs):
    """Those of the model at its first draws, with the error of the test."""
    count = 400
    before = ef.to_inference_data(POSTERIOR, prior_predictive=count)
    there = {"prior", "prior_predictive", "observed_data", "constant_data"}
    assert set(before.children if hasattr(before, "children") else before) == there
    prior = dataset(before, "prior")
    draws = np.stack([prior[name].values[0, :count] for name in NAMES], axis=1)
    exact = POSTERIOR(draws)[:, POSTERIOR.columns["frequency"]][:, :2]
    predicted = dataset(before, "prior_predictive")["frequency"]
    assert dict(predicted.sizes) == {"chain": 1, "draw": count, "mode": 2}
    z = (predicted.values[0] - exact) / (np.array(MEASURED) / np.sqrt(1e3))
    assert_allclose(z.mean(axis=0), 0, atol=4 / np.sqrt(count))
    assert_allclose(z.std(axis=0), 1, atol=4 / np.sqrt(2 * count))
    both = ef.to_inference_data(runs, prior_predictive=count)
    assert dataset(both, "prior_predictive")["frequency"].equals(predicted)


def test_arviz_takes_the_result_and_compares_each_datum_of_a_term(runs, idata):
    assert list(az.summary(idata).index) == NAMES
    az.plot_trace(idata, var_names=NAMES[:2])
    assert plt.get_fignums()
    one = ef.to_inference_data(runs, discard=4, term="frequency")
    likelihood = dataset(one, "log_likelihood")["frequency"]
    whole = dataset(idata, "log_likelihood")["data"].values
    assert_array_equal(likelihood.values, whole[..., :2])
    new = dataset(one, "posterior_predictive")["frequency"]
    assert new.dims == likelihood.dims and new.shape == likelihood.shape
    old = az.__version__ < "1"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # 600 draws of a short chain
        ranking = az.compare({"one": idata, "other": idata})
        assert az.loo(idata).n_data_points == len(DATA) and len(ranking) == 2
        shares = az.loo_pit(one, **{"y" if old else "var_names": "frequency"})
    values = shares if old else shares["frequency"].values
    assert values.shape == (2,) and ((values > 0) & (values < 1)).all()


def test_netcdf_round_trip_keeps_every_number_and_the_tables(idata, tmp_path):
    idata.to_netcdf(str(tmp_path / "run.nc"))
    again = az.from_netcdf(str(tmp_path / "run.nc"))
    for group in GROUPS:
        before, after = dataset(idata, group), dataset(again, group).load()
        assert after.equals(before)
        assert list(after.data_vars) == list(before.data_vars)
        assert before.attrs.items() <= after.attrs.items()
    assert str(ef.parameter_table(again)) == str(ef.parameter_table(idata))
    frames = [ef.parameter_table(each).to_frame() for each in (again, idata)]
    assert frames[0].equals(frames[1])
    assert ef.parameter_table(again).column("unit") == ["N/m", "", ""]
    tables = [ef.frequency_table(each, POSTERIOR) for each in (again, idata)]
    for column in tables[0].columns[1:]:
        assert_allclose(*(table.column(column) for table in tables), rtol=1e-9)


def finished(n=3, n_modes=MODES, steps=3, seed=1):
    prior = ef.GaussianPrior(NAMES[:n], MEAN[:n], 0.1)
    term = ef.FrequencyTerm(MEASURED, beta=1e3)
    posterior = ef.LogPosterior(model_of(n_modes), term, prior)
    shape = WALKERS, steps
    return list(ef.run(posterior, ef.DEMCMove(), *shape, seed=seed, ensembles=1))


def test_what_is_of_no_one_shape_or_not_there_is_refused_but_a_length_is_cut(
    runs, idata
):
    bare = ef.LogPosterior.from_function(lambda x: -(x @ x), {"a": (-1, 1)})
    for source, options, message in (
        (finished() + finished(2), {"posterior": POSTERIOR}, "source"),
        (finished(3, 3), {"posterior": POSTERIOR}, r"\(5,\) .*\(7,\)"),
        (runs, {"discard": STEPS}, "^discard"),
        (finished() * 2, {}, "source.*same chain"),
        (emcee.EnsembleSampler(4, 1, len), {}, "source.*run the sampler"),
        (POSTERIOR, {"discard": 10}, "no samples.*discard"),
        (runs, {"term": "ridge"}, "^term"),
        (runs, {"term": "stiff"}, "^term"),
        (idata, {"term": "frequency"}, "term"),
        (idata, {"names": NAMES}, "^names"),  # it has them already
        (idata, {"prior_predictive": 3}, "^posterior"),
        (POSTERIOR, {"prior_predictive": 1_001}, "^prior_predictive"),
        (bare, {"prior_predictive": 10}, "prior_predictive"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            ef.to_inference_data(source, **options)
    both = ef.to_inference_data(finished() + finished(steps=5, seed=2))
    assert dict(both["posterior"].sizes) == {"chain": 2 * WALKERS, "draw": 3}


STRUCTURED = [("step", float), ("twice", float, 2)]


@pytest.mark.parametrize(
    ("function", "dtype", "names"),
    [  # what a function returns beside its log-probability
        (lambda x: (x.sum(),), None, ["blob"]),
        (lambda x: (2 * x,), None, ["blob"]),
        (lambda x: (x.sum(), 2 * x), None, ["blob0", "blob1"]),
        (lambda x: (x.sum(), 2 * x), STRUCTURED, ["blob_step", "twice"]),
    ],
)
def test_blobs_of_any_sampler_are_kept(function, dtype, names, tmp_path):
    sampler = emcee.EnsembleSampler(
        8, 2, lambda x: (-0.5 * x @ x, *function(x)), blobs_dtype=dtype
    )
    sampler.run_mcmc(np.random.default_rng(1).normal(size=(8, 2)), 12)
    idata = ef.to_inference_data(sampler, discard=2, thin=2)
    kept = dataset(stored_and_read(idata, tmp_path / "run.nc"), "blobs")
    assert [*map(str, kept.data_vars)] == names
    rows = sampler.get_chain(discard=2, thin=2).swapaxes(0, 1).reshape(-1, 2)
    for name, values in zip(names, zip(*map(function, rows), strict=True), strict=True):
        assert_allclose(kept[name].values.reshape(np.shape(values)), values)


def test_parameters_are_named_and_so_are_blobs_that_no_file_can_hold():
    sampler = emcee.EnsembleSampler(8, 2, lambda x: (-0.5 * x @ x, {"x": x}))
    sampler.run_mcmc(np.random.default_rng(1).normal(size=(8, 2)), 12)
    for source in (sampler, sampler.backend):
        with pytest.warns(UserWarning, match="blob"):
            idata = ef.to_inference_data(source, discard=5, names=["a", "b"])
        found = dataset(idata, "posterior")
        assert [*found] == found.attrs["sampled"] == ["a", "b"]
        expected = sampler.get_chain(discard=5)[:, 3, 1]
        assert_array_equal(found["b"].values[3], expected)


SHAPES = np.linalg.qr(np.random.default_rng(0).standard_normal((5, 5)))[0]
PRIOR = ef.GaussianPrior(["k"], [1.0], [0.1], [(0.5, 2.0)])
TERMS = [
    ef.FrequencyTerm([1.01, 2.01], relative_sd=0.02, name="short"),
    ef.FrequencyTerm([1.0, 2.0, 3.0, 4.0, 5.0], relative_sd=0.1, name="long"),
]


class Five:
    variables = ef.modal_variables(5, range(5))

    def __call__(self, parameters):
        frequencies = np.sqrt(parameters["k"])[:, None] * np.arange(1.0, 6)
        return ef.ModalSolution(frequencies, np.ones((len(frequencies), 1, 1)) * SHAPES)


@pytest.mark.parametrize(("terms", "prefix"), [(TERMS, ""), (TERMS[::-1], "test.")])
def test_terms_on_different_numbers_of_modes_stay_apart(terms, prefix):
    target = ef.LogPosterior(Five(), terms, PRIOR)
    if prefix:
        target = ef.LogPosterior.joint({"test": (Five(), terms)}, PRIOR)
    run = ef.run(target, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)
    idata = ef.to_inference_data(run)
    stored = {*dataset(idata, "log_likelihood")["data"].datum.values.tolist()}
    for term, name in zip(terms, ("", f"[{terms[1].name}]"), strict=True):
        observed = dataset(idata, "observed_data")[f"{prefix}frequency{name}"]
        assert_array_equal(observed, term.measured)
        modes = range(1, len(term.measured) + 1)
        assert {f"{prefix}{term.name}[{mode}]" for mode in modes} <= stored
    for group in ("log_likelihood", "new_measurement", "observed_data"):
        assert not any(v.isnull().any() for v in dataset(idata, group).values())
    measured = [*terms[0].measured, *terms[1].measured]
    assert ef.predictive_table(idata, target).column("measured") == measured


def test_a_shape_term_may_compare_fewer_modes_than_are_paired():
    measured = ef.Measurements([1.0, 2.0, 3.0], shapes=SHAPES[:, :3], dofs=range(5))
    model = ef.PairedModel(Five(), measured, candidates=5)
    posterior = ef.LogPosterior(model, ef.ShapeTerm(SHAPES[:, :2], delta=0.1), PRIOR)
    run = ef.run(posterior, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)
    stored = dataset(ef.to_inference_data(run), "log_likelihood")
    assert stored["mode"].values.tolist() == [1, 2]


def memory_of(function, *arguments, **options):
    """Return what a call holds in the end and at most, in bytes, and its result."""
    tracemalloc.start()
    result = function(*arguments, **options)
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return held, peak, result


TWENTY = ef.LogPosterior(
    lambda p: ef.ModalSolution(np.arange(1, 21) + 0.01 * p["k"][:, None]),
    ef.FrequencyTerm(np.arange(1, 21), beta=1e2),
    PRIOR,
)


@pytest.mark.slow
def test_memory_stays_flat_while_a_file_grows_and_a_conversion_takes_little(tmp_path):
    options = {"nwalkers": 128, "ensembles": 1, "seed": 1}
    for steps in (2, 50):  # the first one pays for imports
        options |= {"steps": steps, "backend": tmp_path / f"{steps}.run"}
        held, _, run = memory_of(ef.run, TWENTY, ef.DEMCMove(), **options)
    assert held < 0.25 * 50 * 128 * (1 + 1 + 2 + 20) * 8
    ef.to_inference_data(run, discard=49)  # imports
    _, least, _ = memory_of(ef.to_inference_data, run, discard=49)  # of the prior
    _, peak, idata = memory_of(ef.to_inference_data, run)
    kept = sum(dataset(idata, group).nbytes for group in ("posterior", "response"))
    assert kept < peak < 1.5 * least + 10 * kept  # 5 times it with NumPy 2.4


class Term(ef.FrequencyTerm):
    """A term that is asked for nothing but its likelihood."""

    def pointwise(self, parameters, response):
        raise AssertionError("no table prints the likelihood of each datum")

    def replicate(self, rng, parameters, response):
        raise AssertionError("no new measurement is needed")


def test_a_table_asks_for_no_more_than_it_prints():
    term = Term(MEASURED, beta=1e3)
    posterior = ef.LogPosterior(model_of(), term, POSTERIOR.prior)
    run = ef.run(posterior, ef.DEMCMove(), WALKERS, 40, seed=1)
    assert len(ef.parameter_table(run).column("mean")) == 3
    assert len(ef.identifiability(run).names) == 3
    ef.figures.plot_scatter(run)
    with pytest.raises(AssertionError, match="likelihood of each datum"):
        ef.to_inference_data(run)


def test_a_table_of_parameters_reads_no_response():
    """It is many times as large as the chain."""
    wide, points = np.linspace(1.0, 2.0, 400), [*range(400)]

    class Line:
        names = ("a",)
        dims = {"load_case": ["own weight"], "point": points}
        variables = {"displacement": ef.Variable(dims, "mm")}

        def __call__(self, parameters):
            return {"displacement": parameters["a"][:, None, None] * wide}

    term = ef.DisplacementTerm(wide[None], sd=0.1)
    prior = ef.IndependentPrior({"a": stats.norm(1.0, 0.5)})
    posterior = ef.LogPosterior(Line(), term, prior)
    run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
    blobs = run[0].get_blobs().nbytes
    ef.parameter_table(run)  # imports what it needs
    tracemalloc.start()
    ef.parameter_table(run)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.5 * blobs


def test_chains_of_another_posterior_are_refused_by_a_table_of_parameters(runs):
    """Though it reads none of what differs."""
    two = ef.LogPosterior(model_of(2), POSTERIOR.terms, POSTERIOR.prior)
    plain = [sampler.backend for sampler in runs]
    with pytest.raises(ValueError, match="not of this posterior"):
        ef.identifiability(ef.to_inference_data(plain, two))
    with pytest.raises(ValueError, match="not of this posterior"):
        ef.predictive_table(plain, two)
