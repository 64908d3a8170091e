"""A solver that fails: what is raised, what is rejected, counted and kept."""

import logging
import subprocess
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef
from emcee_femu.posterior.failures import FailureLog, SolveError, describe_failure
from emcee_femu.posterior.rejecting import GuardedPosterior

PRIOR = ef.IndependentPrior({"a": stats.norm(0, 1), "b": stats.norm(0, 1)})
TERM = ef.FrequencyTerm([10.0, 20.0], sd=[0.5, 0.5])


def fails(p):
    """Fail in four ways, each beyond a line that a few percent of the draws cross."""
    if p["a"] > 1.2:
        raise RuntimeError("no licence")
    if p["a"] < -1.2:
        raise subprocess.TimeoutExpired("solver", 30)
    if p["b"] > 1.2:
        return [10.0, np.nan]
    if p["b"] < -1.2:
        return [10.0]
    return [10.0 + p["a"], 20.0 + p["b"]]


def solves(p):
    return [10.0 + p["a"], 20.0 + p["b"]]


def allowed(theta):
    return (np.abs(theta) <= 1.2).all(axis=-1)


def posterior(function=fails):
    return ef.LogPosterior(ef.FunctionModel(function, n_modes=2), TERM, PRIOR)


START = np.random.default_rng(0).uniform(-1, 1, (16, 2))
OPTIONS = {"nwalkers": 16, "seed": 1, "initial": START, "max_failures": 1.0}


class Batched:
    """A model of all walkers at once, of which one fails."""

    variables = ef.modal_variables(2)

    def __call__(self, parameters):
        a, b = parameters["a"], parameters["b"]
        if (a > 1.2).any():
            raise np.linalg.LinAlgError("singular")
        return ef.ModalSolution(np.column_stack([10 + a, 20 + b]))


def test_a_failure_stops_the_run_with_its_parameters_and_keeps_the_chain():
    def no_licence(p):
        return fails(p) if p["a"] > 1.7 else solves(p)

    with pytest.raises(RuntimeError, match="no licence") as caught:
        ef.run(posterior(no_licence), nsteps=200, **OPTIONS)
    (note,) = caught.value.__notes__
    assert note.startswith("raised by the model at {'a': 1.") and "'b': " in note
    (sampler,) = caught.value.samplers
    kept = sampler.get_chain()
    assert 0 < len(kept) < 200 and (kept[..., 0] <= 1.7).all()


def test_a_batch_that_fails_names_its_parameter_sets():
    bad = ef.LogPosterior(Batched(), TERM, PRIOR)
    with pytest.raises(np.linalg.LinAlgError, match="singular") as caught:
        bad([[0.0, 0.0], [1.5, 0.25]])
    assert "'a': 1.5, 'b': 0.25" in caught.value.__notes__[0]


class Typo:
    variables = ef.modal_variables(2)

    def __call__(self, parameters):
        return parameters["A"]


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (ef.FunctionModel(lambda p: p["A"]), True),
        (Typo(), True),
        (ef.FunctionModel(lambda p: {}["a"]), False),  # a fault of another kind
        (ef.FunctionModel(lambda p: {}[3]), False),
    ],
)
def test_a_model_that_asks_for_a_wrong_name_is_told_the_right_ones(model, said):
    with pytest.raises(KeyError) as caught:
        ef.LogPosterior(model, TERM, PRIOR)([1.0, 1.0])
    place, *names = caught.value.__notes__
    assert place.startswith("raised by the model at") and "'a': 1.0" in place
    assert names == ["the parameters are a, b"] * said


@pytest.mark.parametrize("pool", [None, lambda own: own, ef.EvaluationPool])
def test_rejected_failures_leave_the_posterior_of_what_can_be_solved(pool):
    if pool is not None:
        with ProcessPoolExecutor(2) as workers:
            (sampler,) = ef.run(
                posterior(),
                nsteps=150,
                pool=pool(workers),
                on_failure="reject",
                **OPTIONS,
            )
    else:
        (sampler,) = ef.run(posterior(), nsteps=150, on_failure="reject", **OPTIONS)

    # The same chain as that of a prior that ends where the solver does.
    bounded = ef.GaussianPrior(["a", "b"], [0, 0], [1, 1], bounds=[(-1.2, 1.2)] * 2)
    (same,) = ef.run(
        ef.LogPosterior(ef.FunctionModel(solves, n_modes=2), TERM, bounded),
        nsteps=150,
        **OPTIONS,
    )
    np.testing.assert_array_equal(sampler.get_chain(), same.get_chain())
    causes = sampler.failures.causes
    assert set(causes) == {
        "exception",
        "time-out",
        "not finite",
        "wrong shape",
    }
    outside = sampler.failures.kept
    assert len(outside) == causes.total() > 100
    for failed in outside:
        theta = np.array([failed.parameters["a"], failed.parameters["b"]])
        assert not allowed(theta)
    assert sampler.failures.evaluations == 16 * 151
    diagnosis = ef.diagnose(sampler)
    assert diagnosis.failures == causes and "time-out" in str(diagnosis)
    assert diagnosis.names == ("a", "b")


def test_a_batch_with_a_failure_keeps_the_bits_of_the_others():
    bad = ef.LogPosterior(Batched(), TERM, PRIOR)
    theta = np.random.default_rng(1).uniform(-2, 2, (50, 2))
    fine = theta[:, 0] <= 1.2
    results = GuardedPosterior(bad)(theta)
    for ok, row, point in zip(fine, results, theta, strict=True):
        if ok:
            np.testing.assert_array_equal(row, bad(point))
        else:
            assert row.cause == "exception" and row.parameters["a"] == point[0]
    np.testing.assert_array_equal(GuardedPosterior(bad)(theta[fine]), bad(theta[fine]))


def test_a_one_by_one_model_is_not_solved_twice():
    calls = []

    def counted(p):
        calls.append(p["a"])
        return fails(p)

    theta = np.array([[0.0, 0.0], [1.5, 0.0], [0.5, 0.5]])
    GuardedPosterior(posterior(counted))(theta)
    assert calls == [0.0, 1.5, 0.5]


def test_too_many_failures_stop_the_run_and_keep_what_was_sampled(caplog):
    options = {**OPTIONS, "max_failures": 0.02}
    with caplog.at_level(logging.WARNING, "emcee_femu"):
        with pytest.raises(RuntimeError, match="max_failures = 0.02") as caught:
            ef.run(posterior(), nsteps=150, on_failure="reject", **options)
    assert "narrow the prior" in str(caught.value)
    assert caught.value.samplers[0].iteration >= 0
    assert caplog.records[0].getMessage().startswith("rejected: ")


def test_a_fraction_of_few_evaluations_stops_nothing():
    log = FailureLog(0.1)
    failed = describe_failure(ValueError("x"), {"a": 1.0})
    log.count(99, [failed] * 99)
    with pytest.raises(RuntimeError, match="99 of 199 solves"):
        log.count(100, [])


def test_the_fraction_is_exact():
    log, failed = FailureLog(0.1), describe_failure(ValueError("x"), {"a": 1.0})
    log.count(200, [failed] * 20)  # just allowed
    with pytest.raises(RuntimeError, match="21 of 201 solves"):
        log.count(1, [failed])


def test_causes_are_told_apart():
    found = {
        describe_failure(error, {}).cause: error
        for error in (
            TimeoutError("t"),
            subprocess.TimeoutExpired("x", 1),
            SolveError("not finite", "nan"),
            KeyError("k"),
        )
    }
    assert set(found) == {"time-out", "not finite", "exception"}
    assert (
        describe_failure(SolveError("c", "what came"), {}).message
        == "SolveError: what came"
    )


def test_the_keyboard_stops_the_run_and_keeps_the_chain():
    calls = []

    def interrupted(p):
        calls.append(1)
        if len(calls) == 16 * 20:
            raise KeyboardInterrupt
        return solves(p)

    with pytest.raises(KeyboardInterrupt) as caught:
        ef.run(posterior(interrupted), nsteps=150, on_failure="reject", **OPTIONS)
    assert caught.value.samplers[0].iteration == 18


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"on_failure": "ignore"}, ValueError, "on_failure: expected 'raise' or"),
        ({"max_failures": 1.5}, ValueError, "max_failures: expected at most 1"),
        ({"max_failures": -0.1}, ValueError, "max_failures: expected at least 0"),
    ],
)
def test_arguments_are_checked(options, error, message):
    with pytest.raises(error, match=message):
        ef.run(posterior(), nsteps=2, **{**OPTIONS, **options})
