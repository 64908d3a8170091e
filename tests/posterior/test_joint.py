"""Several experiments that share parameters, against the posterior written by hand."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

import emcee_femu as ef
from emcee_femu.results.arviz_objects import dataset

F_EMPTY, F_LOADED, TIP = [1.6, 4.1], [1.2, 3.6], 0.017
SPRING = np.array([[1.0, -1.0], [-1.0, 1.0]])
K = {"k1": np.diag([1.0, 0.0]), "k2": SPRING}
PRIOR = ef.GaussianPrior(["k1", "k2", "error"], [200, 150, 0.01], [50, 40, 0.01],
                         [(50, 400), (50, 400), (1e-4, 0.1)])  # fmt: skip


def structure(added):
    """Two masses on two springs, the upper one heavier by what was added."""
    return ef.MatrixModel(np.zeros((2, 2)), np.diag([1.0, 1.0 + added]), K, n_modes=2)


def push(parameters):
    push.solves += len(parameters["k1"])
    return {"tip": 1 / parameters["k1"] + 1 / parameters["k2"]}


push.solves = 0
push.names = ("k1", "k2")
push.variables = {"tip": ef.Variable({}, "m")}


def tip_term(parameters, response):
    return stats.norm.logpdf(TIP, response["tip"], 0.001)


def frequency_term(measured, **options):
    return ef.FrequencyTerm(measured, **({"relative_sd": 0.02} | options))


EXPERIMENTS = {
    "empty": (structure(0.0), frequency_term(F_EMPTY, discrepancy="error")),
    "loaded": (structure(0.6), [frequency_term(F_LOADED)]),
    "static": (push, tip_term),
}
JOINT = ef.LogPosterior.joint(EXPERIMENTS, PRIOR)


def by_hand(theta):
    k1, k2, error = theta.T
    frequencies = []
    for added in (0.0, 0.6):
        stiffness = k1[:, None, None] * K["k1"] + k2[:, None, None] * K["k2"]
        scale = np.sqrt(np.outer([1.0, 1.0 + added], [1.0, 1.0 + added]))
        frequencies.append(np.sqrt(np.linalg.eigvalsh(stiffness / scale)) / 2 / np.pi)
    sds = np.sqrt(0.02**2 + error**2)[:, None], 0.02
    likelihoods = [
        stats.norm.logpdf(f, measured, sd * np.array(measured)).sum(axis=1)
        for f, measured, sd in zip(frequencies, (F_EMPTY, F_LOADED), sds, strict=True)
    ]
    tip = 1 / k1 + 1 / k2
    likelihoods.append(stats.norm.logpdf(TIP, tip, 0.001))
    log_prior = PRIOR.logpdf(theta)
    total = log_prior + np.sum(likelihoods, axis=0)
    return np.column_stack([total, log_prior, *likelihoods, *frequencies, tip])


def test_rows_are_those_written_by_hand_and_each_model_is_solved_once():
    theta = PRIOR.sample(np.random.default_rng(1), 40)
    push.solves = 0
    rows = JOINT(theta)
    assert push.solves == 40
    assert_allclose(rows, by_hand(theta), rtol=1e-12)
    outside = JOINT(np.array([[1.0, 100, 0.01], theta[0]]))
    assert push.solves == 41 and outside[0, 0] == -np.inf
    assert_array_equal(outside[1], rows[0])
    assert JOINT.term_names == (
        "empty.frequency",
        "loaded.frequency",
        "static.tip_term",
    )
    assert JOINT.labels[5:] == (
        *(f"{name}.frequency[{i}]" for name in ("empty", "loaded") for i in (1, 2)),
        "static.tip",
    )
    assert JOINT.error_names == ("error",)


def test_a_model_that_overwrites_its_parameters_changes_no_other():
    def scaled(parameters):
        k1 = parameters["k1"]
        k1 *= 1e6
        return {"k": np.sqrt(k1)}

    def term(parameters, response):
        return stats.norm.logpdf(response["k"], 1e3, parameters["k1"])

    scaled.variables = {"k": ef.Variable({})}
    prior = ef.IndependentPrior({"k1": ef.uniform_between(0.5, 2)})
    both = ef.LogPosterior.joint({"a": (scaled, term), "b": (scaled, term)}, prior)
    expected = stats.norm.logpdf(0, 0, 1.0)
    np.testing.assert_allclose(both([1.0])[2:], [expected, expected, 1e3, 1e3])


def test_what_a_model_reads_too_is_no_error():
    model = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), K, n_modes=2)
    term = frequency_term(F_EMPTY, discrepancy="k2")
    prior = ef.IndependentPrior(dict.fromkeys(K, ef.uniform_between(50, 400)))
    assert ef.LogPosterior(model, term, prior).error_names == ()


@pytest.mark.parametrize("pool", [None, "threads"])
def test_samples_carry_the_experiments_names_with_and_without_a_pool(pool):
    options = {"nwalkers": 12, "nsteps": 30, "seed": 3}
    serial = ef.run(JOINT, **options)
    if pool is not None:
        with ThreadPoolExecutor(2) as workers:
            pooled = ef.run(JOINT, pool=workers, **options)
        assert_array_equal(pooled[0].get_chain(), serial[0].get_chain())
        assert_array_equal(pooled[0].get_blobs(), serial[0].get_blobs())
    idata = ef.to_inference_data(serial, JOINT)
    response = dataset(idata, "response")
    assert response["loaded.frequency"].dims == ("chain", "draw", "loaded.mode")
    assert response["static.tip"].dims == ("chain", "draw")
    assert (response["loaded.frequency"].values < response["empty.frequency"]).all()
    logs = dataset(idata, "log_likelihood")
    assert logs["empty.frequency"].dims == ("chain", "draw", "empty.mode")
    total = sum(
        value.sum([dim for dim in value.dims if dim not in ("chain", "draw")])
        for value in logs.data_vars.values()
    )
    stats_group = dataset(idata, "sample_stats")
    assert_allclose(stats_group["lp"], stats_group["log_prior"] + total, rtol=1e-10)
    assert dataset(idata, "constant_data")["is_error"].values.tolist() == [0, 0, 1]
    observed = dataset(idata, "observed_data")
    assert observed["loaded.frequency"].values.tolist() == F_LOADED
    assert set(dataset(idata, "posterior_predictive").data_vars) == set(observed)


def test_a_reduced_model_and_a_full_one_share_a_prior_within_its_bounds():
    bounds = {"k1": (50, 400), "k2": (50, 400)}
    options = {"test_points": 4}
    with pytest.warns(UserWarning, match="does not pay"):
        reduced = ef.reduce_model(structure(0.6), bounds, **options)
        narrow = ef.reduce_model(structure(0.6), bounds | {"k1": (90, 300)}, **options)
    joint = ef.LogPosterior.joint(
        {**EXPERIMENTS, "loaded": (reduced, frequency_term(F_LOADED))}, PRIOR
    )
    theta = PRIOR.sample(np.random.default_rng(2), 8)
    assert_allclose(joint(theta), JOINT(theta), rtol=1e-3)
    with pytest.raises(ValueError, match=r"'k1' has bounds .* within \(90, 300\)"):
        ef.LogPosterior.joint({"loaded": (narrow, tip_term)}, PRIOR)


def stiff_only(parameters):
    if parameters["k1"] < 200:
        raise ArithmeticError("no equilibrium")
    return 0.01


def failing(on_failure):
    model = ef.FunctionModel(stiff_only, variables=push.variables)
    joint = ef.LogPosterior.joint({**EXPERIMENTS, "static": (model, tip_term)}, PRIOR)
    options = {"on_failure": on_failure, "max_failures": 0.9}
    return joint, ef.run(joint, nwalkers=12, nsteps=20, seed=1, **options)


def test_a_failure_names_its_experiment_and_can_be_taken_for_impossible():
    with pytest.raises(ArithmeticError) as caught:
        failing("raise")
    assert "in the experiment 'static'" in caught.value.__notes__
    assert any(
        note.startswith("raised by the model") for note in caught.value.__notes__
    )
    joint, samplers = failing("reject")
    assert samplers[0].failures.causes["exception"] > 0
    assert (samplers[0].get_chain()[..., 0] >= 200).all()
    assert (
        dataset(ef.to_inference_data(samplers, joint), "posterior").sizes["draw"] == 20
    )


@pytest.mark.parametrize(
    ("experiments", "error", "message"),
    [
        ([EXPERIMENTS["empty"]], TypeError, "^experiments: expected {name: "),
        ({}, ValueError, "^experiments: expected at least one"),
        ({"a.b": EXPERIMENTS["empty"]}, ValueError, "names without dots"),
        ({1: EXPERIMENTS["empty"]}, ValueError, "names without dots"),
        ({"empty": structure(0.0)}, TypeError, r"\(model, terms\) for 'empty'"),
        ({"empty": (3.0, tip_term)}, TypeError, "^model: expected a callable"),
        ({"static": (push, [])}, ValueError, "^terms: expected at least one"),
    ],
)
def test_malformed_experiments_are_refused(experiments, error, message):
    with pytest.raises(error, match=message):
        ef.LogPosterior.joint(experiments, PRIOR)


def test_the_model_of_a_joint_posterior_must_be_named():
    with pytest.raises(ValueError, match=r"one for each of \['empty', 'loaded'"):
        _ = JOINT.model
