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

import emcee_femu as ef
from emcee_femu.moves import MetropolisMove
from emcee_femu.results.arviz_objects import dataset, effective_sizes, rhat, samples
from emcee_femu.sampling.run_file import RunFile

NAMES = ["stiff", "alpha", "mass"]  # not in alphabetical order
BOUNDS = [(0.5, 1.6), (-1.0, 1.0), (0.6, 3.0)]
MEAN, SD = [1.0, 0.1, 1.5], [0.2, 0.3, 0.4]
MEASURED = [10.2, 25.5]  # two of the model's four modes
SAMPLED = ("posterior", "sample_stats", "log_likelihood", "response")
GROUPS = (*SAMPLED, "posterior_predictive", "prior", "observed_data", "constant_data")
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
    moves = [(ef.DEMCMove(), 0.75), (MetropolisMove(sd=0.05), 0.25)]
    return ef.run(POSTERIOR, moves, WALKERS, STEPS, ensembles=3, seed=7)


@pytest.fixture(scope="module")
def idata(runs):
    return ef.to_inference_data(runs, POSTERIOR, discard=4)


def test_a_tempered_run_read_from_its_file_has_its_cold_walkers_only(tmp_path):
    path, betas = tmp_path / "run.chain", [1.0, 0.2, 0.0]
    moves = [
        (ef.TemperedMove(m, betas), 0.5) for m in (ef.DEMCMove(), MetropolisMove(sd=1))
    ]
    for move in (moves, moves[0][0]):
        ran = ef.run(POSTERIOR, move, 30, 12, seed=1, ensembles=2, backend=path)
        bare = [
            emcee.EnsembleSampler(30, 3, POSTERIOR, backend=own)
            for own in RunFile.open(path)
        ]
        expected = ef.to_inference_data(ran, POSTERIOR)
        for runs in (RunFile.open(path), bare):
            read = ef.to_inference_data(runs, POSTERIOR)
            assert read.posterior.sizes["chain"] == 20
            assert read.posterior.equals(expected.posterior)
            for name in ("acceptance", "tempered"):
                assert read.posterior.attrs[name] == expected.posterior.attrs[name]
            one, other = ef.diagnose(runs), ef.diagnose(ran)
            assert_array_equal(one.acceptance, other.acceptance)
            assert_array_equal(one.ess_bulk, other.ess_bulk)
        path.unlink()


def assert_is_the_chain(idata, runs, discard=0, thin=1):
    pairs = list(product(range(len(runs)), range(WALKERS)))
    for chain, (e, w) in enumerate(pairs):
        options = {"discard": discard, "thin": thin}
        blobs = runs[e].get_blobs(**options)[:, w]
        expected = {
            ("sample_stats", "lp"): runs[e].get_log_prob(**options)[:, w],
            ("sample_stats", "log_prior"): blobs[:, 0],
            ("log_likelihood", "ridge"): blobs[:, 2],
            ("response", "frequency"): blobs[:, 3:],
        }
        for k, name in enumerate(NAMES):
            expected["posterior", name] = runs[e].get_chain(**options)[:, w, k]
        for (group, name), value in expected.items():
            found = dataset(idata, group)[name]
            assert found.dims == ("chain", "draw", "mode")[: 1 + value.ndim]
            assert_array_equal(found.values[chain], value)
        factors = dataset(idata, "log_likelihood")["frequency"].values[chain]
        assert factors.shape == (len(blobs), len(MEASURED))
        assert_allclose(factors.sum(axis=1), blobs[:, 1], rtol=1e-11)
    for group in SAMPLED:
        found = dataset(idata, group)
        assert_array_equal(np.c_[found.ensemble, found.walker], pairs)
        assert found.ensemble.dims == found.walker.dims == ("chain",)
        assert_array_equal(found.chain, np.arange(len(pairs)))


@pytest.mark.parametrize("discard, thin", [(0, 1), (5, 1), (0, 4), (5, 3), (23, 1)])
@pytest.mark.parametrize("count", [1, 3])
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
    expected = {
        "posterior": (NAMES, {"chain": 30, "draw": 20}),
        "sample_stats": (["lp", "log_prior"], {"chain": 30, "draw": 20}),
        "log_likelihood": (
            ["frequency", "ridge"],
            {"chain": 30, "draw": 20, "mode": 2},
        ),
        "posterior_predictive": (["frequency"], {"chain": 30, "draw": 20, "mode": 2}),
        "prior": (NAMES, {"chain": 1, "draw": 1000}),
        "response": (["frequency"], {"chain": 30, "draw": 20, "mode": 4}),
        "observed_data": (["frequency"], {"mode": 2}),
        "constant_data": (
            [
                "lower",
                "upper",
                "initial",
                "prior_mean",
                "prior_sd",
                "is_error",
                "initial_frequency",
            ],
            {"parameter": 3, "mode": 4},
        ),
    }
    assert set(GROUPS) == set(expected)
    old = az.__version__.startswith("0.")
    assert type(idata) is (az.InferenceData if old else xarray.DataTree)
    for group, (names, sizes) in expected.items():
        found = dataset(idata, group)
        assert list(found.data_vars) == names
        assert dict(found.sizes) == sizes
        if "mode" in sizes:
            assert found.mode.values.tolist() == list(range(1, 1 + sizes["mode"]))


def test_lp_is_log_prior_plus_log_likelihoods_and_frequency_is_the_model(idata):
    stored, terms = dataset(idata, "sample_stats"), dataset(idata, "log_likelihood")
    total = stored["log_prior"] + terms["frequency"].sum("mode") + terms["ridge"]
    assert_allclose(stored["lp"], total, rtol=1e-13)
    assert np.unique(stored["lp"]).size > 100
    posterior = dataset(idata, "posterior")
    draws = {name: posterior[name].values.ravel() for name in NAMES}
    predicted = dataset(idata, "response")["frequency"].values
    assert_allclose(predicted.reshape(-1, MODES), Model()(draws).frequencies, 1e-14)
    assert_allclose(terms["ridge"].values.ravel(), ridge(draws, None), 1e-14)


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
    assert_allclose(constants["initial_frequency"], expected, rtol=1e-14)


@pytest.mark.parametrize("group", GROUPS)
def test_attributes_tell_how_the_chain_was_made(idata, group):
    found = dataset(idata, group).attrs
    assert (found["discard"], found["thin"]) == (4, 1)
    if group == "posterior":
        first, second = found["moves"].split("; ")
        assert first.startswith("0.75 x DEMCMove(")
        assert second.startswith("0.25 x MetropolisMove(")
        assert found["seed"] == "7" and found["sampled"] == NAMES
    else:
        assert "moves" not in found
    assert found["inference_library"] == "emcee"
    assert found["inference_library_version"] == version("emcee")
    assert found["emcee_femu_version"] == version("emcee-femu")
    assert found["numpy_version"] == version("numpy")


@pytest.mark.parametrize("vectorize", [True, False])
def test_a_plain_emcee_sampler_and_its_backend_are_converted(vectorize):
    plain = emcee.EnsembleSampler(WALKERS, 3, POSTERIOR, vectorize=vectorize)
    plain.run_mcmc(POSTERIOR.start(WALKERS, seed=1), 6)
    for source in (plain, plain.backend):
        assert_is_the_chain(ef.to_inference_data(source, POSTERIOR), [plain])
    idata = ef.to_inference_data(plain, POSTERIOR)
    assert dataset(idata, "posterior").attrs["seed"].startswith("unknown")
    assert dataset(idata, "posterior").attrs["moves"].startswith("1 x <emcee.moves")
    idata = ef.to_inference_data(plain.backend, POSTERIOR)
    assert dataset(idata, "posterior").attrs["moves"].startswith("unknown")


def test_arviz_judges_and_plots_the_result(idata):
    names, chains = samples(idata)
    assert names == NAMES
    found_rhat, found_ess = az.rhat(idata), az.ess(idata, method="bulk")
    for k, name in enumerate(names):
        one = chains[:, :, [k]]
        assert_allclose(float(found_rhat[name]), rhat(one)[0], rtol=1e-12)
        assert_allclose(float(found_ess[name]), effective_sizes(one)[0][0], rtol=1e-12)
    assert list(az.summary(idata).index) == names
    az.plot_trace(idata, var_names=names[:2])
    assert plt.get_fignums()
    plt.close("all")


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
        assert_allclose(*(table.column(column) for table in tables), rtol=1e-12)
    if hasattr(again, "close"):
        again.close()


def no_blobs(theta):
    return -0.5 * float(theta @ theta)


def finished(n=3, n_modes=MODES, nsteps=3):
    prior = ef.GaussianPrior(NAMES[:n], MEAN[:n], 0.1)
    term = ef.FrequencyTerm(MEASURED, beta=1e3)
    posterior = ef.LogPosterior(Model(n_modes), term, prior)
    return ef.run(posterior, None, WALKERS, nsteps, seed=1)


def of_two_lengths():
    return finished() + finished(nsteps=4)


def without_blobs():
    sampler = emcee.EnsembleSampler(WALKERS, 3, no_blobs)
    sampler.run_mcmc(POSTERIOR.start(WALKERS, seed=1), 3)
    return sampler


@pytest.mark.parametrize(
    "error, message, options, make",
    [
        (ValueError, "discard: no steps are left", {"discard": STEPS}, None),
        (ValueError, "no steps are left", {"discard": 20, "thin": 5}, None),
        (TypeError, "discard: expected a whole number", {"discard": 2.0}, None),
        (ValueError, "discard: expected at least 0", {"discard": -1}, None),
        (ValueError, "thin: expected at least 1", {"thin": 0}, None),
        (ValueError, "samplers: expected at least one", {}, lambda: []),
        (TypeError, "samplers: expected EnsembleSamplers", {}, lambda: [3.0]),
        (TypeError, "samplers: expected EnsembleSamplers", {}, lambda: "chain.h5"),
        (ValueError, "samplers: no blobs stored", {}, without_blobs),
        (ValueError, "expected chains of one shape", {}, of_two_lengths),
        (ValueError, r"of 2 param.* which has 3", {}, lambda: finished(2, 5)),
        (ValueError, r"\(5,\) are not of this .*\(7,\)", {}, lambda: finished(3, 3)),
    ],
)
def test_wrong_samplers_and_counts_are_refused(runs, error, message, options, make):
    with pytest.raises(error, match=message):
        ef.to_inference_data(make() if make else runs, POSTERIOR, **options)


def test_a_group_is_asked_for_by_name_from_a_container(idata):
    with pytest.raises(ValueError, match="no group 'warmup'"):
        dataset(idata, "warmup")
    with pytest.raises(TypeError, match="what to_inference_data returns, got dict"):
        dataset({"posterior": 1}, "posterior")
