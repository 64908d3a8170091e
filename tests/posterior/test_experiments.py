"""Several experiments that share parameters, against the posterior written by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import emcee_femu as ef

F_EMPTY, F_LOADED, TIP = [1.6, 4.1], [1.2, 3.6], 0.017
K = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
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


EMPTY = ef.FrequencyTerm(F_EMPTY, relative_sd=0.02, discrepancy="error")
LOADED = ef.FrequencyTerm(F_LOADED, relative_sd=0.02)
EXPERIMENTS = {
    "empty": (structure(0.0), EMPTY),
    "loaded": (structure(0.6), [LOADED]),
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
    assert_allclose(outside[1], rows[0])
    terms = ("empty.frequency", "loaded.frequency", "static.tip_term")
    assert JOINT.term_names == terms
    assert JOINT.labels[5:] == (
        *(f"{name}.frequency[{i}]" for name in ("empty", "loaded") for i in (1, 2)),
        "static.tip",
    )


def test_an_error_is_what_no_model_reads():
    assert JOINT.error_names == ("error",)
    term = ef.FrequencyTerm(F_EMPTY, relative_sd=0.02, discrepancy="k2")
    prior = ef.IndependentPrior(dict.fromkeys(K, (50, 400)))
    assert ef.LogPosterior(structure(0.0), term, prior).error_names == ()


def test_samples_carry_the_names_of_the_experiments():
    run = ef.run(JOINT, ef.DEMCMove(), 12, 10, ensembles=2, seed=3)
    idata = ef.to_inference_data(run, JOINT)
    response = idata["response"]
    assert response["loaded.frequency"].dims == ("chain", "draw", "loaded.mode")
    assert response["static.tip"].dims == ("chain", "draw")
    loaded, empty = (response[f"{name}.frequency"] for name in ("loaded", "empty"))
    assert (loaded.values < empty.values).all()
    logs = idata["log_likelihood"]["data"]
    assert "empty.frequency[1]" in logs.datum.values
    sampled = idata["sample_stats"]
    total = sampled["log_prior"] + logs.sum("datum")
    assert_allclose(sampled["lp"], total, rtol=1e-10)
    assert idata["constant_data"]["is_error"].values.tolist() == [0, 0, 1]
    observed = idata["observed_data"]
    assert observed["loaded.frequency"].values.tolist() == F_LOADED
    assert {*idata["posterior_predictive"].data_vars} == {*observed.data_vars}


def test_a_failure_names_its_experiment_and_names_are_plain():
    def stiff_only(parameters):
        raise ArithmeticError("no equilibrium")

    model = ef.FunctionModel(stiff_only, variables=push.variables)
    joint = ef.LogPosterior.joint({**EXPERIMENTS, "static": (model, tip_term)}, PRIOR)
    with pytest.raises(ArithmeticError) as caught:
        joint([150.0, 100.0, 0.01])
    assert "'static'" in "\n".join(caught.value.__notes__)
    with pytest.raises(ValueError, match="^experiments"):
        ef.LogPosterior.joint({"a.b": EXPERIMENTS["empty"]}, PRIOR)
    with pytest.raises(ValueError, match=r"\['empty', 'loaded'"):
        _ = JOINT.model
