"""Failed solves of resumed runs: counts survive, "reject" goes on after "raise"."""

import os

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef
from emcee_femu.posterior.failures import CAUSES, FailureLog, describe_failure

PRIOR = ef.IndependentPrior({"a": stats.norm(0, 1), "b": stats.norm(0, 1)})
TERM = ef.FrequencyTerm([10.0, 20.0], sd=[0.5, 0.5])
OPTIONS = {"nwalkers": 16, "ensembles": 2, "seed": 1, "max_failures": 1.0}


def fails(p):
    """Fail in three ways, which depend on the parameters alone."""
    if p["a"] > 0.9:
        raise RuntimeError("no licence")
    if p["a"] < -0.9:
        raise TimeoutError("too slow")
    if p["b"] > 0.9:
        return [10.0, np.inf]
    return [10.0 + p["a"], 20.0 + p["b"]]


POSTERIOR = ef.LogPosterior(ef.FunctionModel(fails, n_modes=2), TERM, PRIOR)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.chain"


def rejected(**options):
    return ef.run(POSTERIOR, on_failure="reject", **{**OPTIONS, **options})


def counts(samplers):
    return samplers[0].failures.counts


def test_the_counts_of_a_resumed_run_are_those_of_one_that_was_never_stopped(path):
    whole = rejected(nsteps=40)
    assert counts(whole)[0] >= 2 * 16 * 41 and min(counts(whole)[1:4:2]) > 0
    for nsteps in (1, 13, 40):
        samplers = rejected(nsteps=nsteps, backend=path, resume=True)
    assert counts(samplers) == counts(whole)
    again = rejected(nsteps=40, backend=path, resume=True)  # nothing is left to do
    assert counts(again) == counts(whole)
    assert ef.diagnose(again).failures == ef.diagnose(whole).failures
    assert str(ef.diagnose(again)).count("no licence") == 0
    assert "time-out" in str(ef.diagnose(again))
    np.testing.assert_array_equal(again[1].get_chain(), whole[1].get_chain())


def test_too_many_failures_are_too_many_after_a_resume_too(path):
    rejected(nsteps=4, backend=path)
    with pytest.raises(RuntimeError, match=r"of \d+ solves failed") as caught:
        rejected(nsteps=20, backend=path, resume=True, max_failures=0.01)
    assert "narrow the prior" in str(caught.value)
    assert caught.value.samplers[0].iteration == 4


def test_counts_written_down_and_restored_are_the_same():
    log = FailureLog(1.0)
    errors = TimeoutError("t"), ValueError("v")
    log.count(7, [describe_failure(error, {}) for error in errors])
    other = FailureLog(1.0)
    other.restore(log.counts)
    assert other.counts == log.counts == [7, 0, 0, 1, 1]
    assert other.causes == log.causes and set(log.causes) < set(CAUSES)


@pytest.mark.parametrize("seed", range(6))
def test_starts_that_cannot_be_solved_are_drawn_again(seed):
    first = POSTERIOR.start(16, np.random.SeedSequence(seed).spawn(2)[0].spawn(1)[0])
    samplers = rejected(nsteps=2, seed=seed)
    for sampler in samplers:
        assert np.isfinite(sampler.get_log_prob()).all()
        assert (np.abs(sampler.get_chain()[..., 0]) <= 0.9).all()
    solved = (np.abs(first[:, 0]) <= 0.9) & (first[:, 1] <= 0.9)
    assert 0 < solved.sum() < 16  # some are, and the others stay where they were
    assert counts(samplers)[0] > 2 * 16 * 3
    again = rejected(nsteps=2, seed=seed)
    np.testing.assert_array_equal(samplers[0].get_chain(), again[0].get_chain())


def test_starts_are_drawn_from_the_prior_where_it_can_be_solved():
    drawn = []

    def noted(p):
        drawn.append((p["a"], p["b"]))
        return fails(p)

    model = ef.FunctionModel(noted, n_modes=2)
    posterior = ef.LogPosterior(model, TERM, PRIOR)
    options = {**OPTIONS, "nwalkers": 4_000, "ensembles": 1}
    with pytest.raises(RuntimeError, match="enough"):
        ef.run(posterior, Stop(), nsteps=1, on_failure="reject", **options)
    a, b = np.array(drawn).T
    kept = (np.abs(a) <= 0.9) & (b <= 0.9)
    assert kept.sum() == 4_000
    law = stats.truncnorm(-0.9, 0.9)
    assert stats.kstest(a[kept], law.cdf).pvalue > 1e-3
    assert stats.kstest(b[kept], stats.truncnorm(-np.inf, 0.9).cdf).pvalue > 1e-3


class Stop(ef.DEMCMove):
    """A move that does not move: the starts alone are looked at."""

    def propose(self, model, state):
        raise RuntimeError("enough")


def test_given_starts_are_never_replaced():
    start = np.zeros((16, 2))
    start[3] = [2.0, 0.5]
    options = {**OPTIONS, "ensembles": 1, "initial": start}
    with pytest.raises(ValueError, match=r"walker 3 is -inf at \{'a': 2.0, 'b': 0.5\}"):
        ef.run(POSTERIOR, nsteps=2, on_failure="reject", **options)


def test_where_nothing_can_be_solved_the_run_is_refused():
    def never(p):
        raise RuntimeError("no licence")

    posterior = ef.LogPosterior(ef.FunctionModel(never, n_modes=2), TERM, PRIOR)
    with pytest.raises(ValueError, match="initial: the log-posterior of walker 0"):
        ef.run(posterior, nsteps=2, on_failure="reject", **OPTIONS)


def test_a_run_that_a_failure_stopped_goes_on_with_reject(path):
    start = np.random.default_rng(0).uniform(-0.05, 0.05, (2, 16, 2))
    options = {**OPTIONS, "initial": start, "nsteps": 30}
    with pytest.raises((RuntimeError, TimeoutError, ValueError)) as caught:
        ef.run(POSTERIOR, backend=path, **options)
    assert 0 < caught.value.samplers[0].iteration < 30
    found = ef.run(POSTERIOR, backend=path, resume=True, on_failure="reject", **options)
    whole = ef.run(POSTERIOR, on_failure="reject", **options)
    for one, other in zip(found, whole, strict=True):
        np.testing.assert_array_equal(one.get_chain(), other.get_chain())


def test_a_solver_may_change_the_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()

    def wanders(p):
        os.chdir(tmp_path / "sub")
        return [10.0 + p["a"], 20.0 + p["b"]]

    posterior = ef.LogPosterior(ef.FunctionModel(wanders, n_modes=2), TERM, PRIOR)
    ef.run(posterior, nsteps=3, backend="run.chain", **OPTIONS)
    assert [file.name for file in tmp_path.glob("**/*.chain")] == ["run.chain"]
    assert (tmp_path / "run.chain").exists()
