"""Runs of a solver that fails: stopped, rejected, counted, and what is kept."""

import subprocess
import warnings
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support import gradients, pool_problems
from support.pool_problems import LIMIT, START, Beyond, Immediate, forks, left, places
from support.runs import Still, failures

import emcee_femu as ef
from emcee_femu.evaluation.evaluator import Evaluation, Solver
from emcee_femu.posterior.log_posterior import LOG_POSTERIOR

OPTIONS = {"nwalkers": 12, "steps": 15, "ensembles": 1, "seed": 1, "starts": START}
REJECT = {"on_failure": "reject", "max_failures": 1.0}


def run(target, moves=None, **options):
    return ef.run(target, moves or ef.DEMCMove(), **OPTIONS | options)


def bad(value, p):
    return [value, 2.0]


def exhausted(p):
    raise StopIteration("no more output")


def noted(p):
    error = ArithmeticError("the solver did not converge")
    error.add_note("iteration 50")
    raise error


FAULTS = {  # a solver's, and what becomes of it
    "-inf": (partial(bad, -np.inf), ValueError, "finite"),
    "+inf": (partial(bad, np.inf), ValueError, "finite"),
    "NaN": (partial(bad, np.nan), ValueError, "finite"),
    "SystemExit": (left, RuntimeError, r"SystemExit\('licence server"),
    "StopIteration": (exhausted, RuntimeError, r"StopIteration\('no more"),
    "an error with notes": (noted, ArithmeticError, "iteration 50"),
}


class Vectorised:
    """What a solver returns, of all walkers at once."""

    variables = ef.modal_variables(2)

    def __init__(self, solver):
        self.solver = solver

    def __call__(self, parameters):
        pairs = zip(parameters["k"], parameters["m"], strict=True)
        rows = [self.solver({"k": k, "m": m}) for k, m in pairs]
        return ef.ModalSolution(np.array(rows))


def limited(model, prior=pool_problems.PRIOR):
    term = ef.FrequencyTerm([1.0, 2.0], relative_sd=0.1)
    return ef.LogPosterior(model, term, prior)


@pytest.fixture(scope="module")
def up_to_limit():
    """The chain of a prior that ends where the solver does."""
    bounds = [(0.1, LIMIT), (0.1, 2.0)]
    prior = ef.GaussianPrior(["k", "m"], [1.0, 1.0], [0.2, 0.2], bounds)
    return run(limited(Vectorised(Beyond(None)), prior))[0].get_chain()


@pytest.mark.parametrize("pool", [None, Immediate()], ids=["serial", "on a pool"])
@pytest.mark.parametrize("vectorised", [False, True])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_has_its_place_or_is_counted(vectorised, fault, pool, up_to_limit):
    function, kind, said = FAULTS[fault]
    solver = Beyond(function)
    model = Vectorised(solver) if vectorised else ef.FunctionModel(solver, n_modes=2)
    with pytest.raises(kind, match=said) as caught:
        run(limited(model), pool=pool)
    (sampler,) = caught.value.run
    kept = sampler.get_chain()
    assert len(kept) > 0 and (kept[..., 0] <= LIMIT).all()
    values = places(caught.value)
    assert 1 <= len(values) <= 6 and max(values) > LIMIT  # half an ensemble, or one
    assert len(values) == 1 or (vectorised and pool is None)
    samplers = run(limited(model), **REJECT, pool=pool)
    assert_allclose(samplers[0].get_chain(), up_to_limit, rtol=1e-9)
    total, causes = failures(samplers)
    assert total == 12 * 16
    cause = "not finite" if kind is ValueError else "exception"
    assert causes.keys() == {cause} and causes[cause] > 5


PRIOR = ef.IndependentPrior({"a": stats.norm(0, 1), "b": stats.norm(0, 1)})
TERM = ef.FrequencyTerm([10.0, 20.0], sd=[0.5, 0.5])
INSIDE = np.random.default_rng(0).uniform(-1, 1, (16, 2))


def solves(p):
    return [10.0 + p["a"], 20.0 + p["b"]]


CAUSES = {"exception", "time-out", "not finite", "wrong shape"}


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
    return solves(p)


def posterior_of(function, prior=PRIOR):
    return ef.LogPosterior(ef.FunctionModel(function, n_modes=2), TERM, prior)


@forks
@pytest.mark.parametrize("workers", [None, 2])
def test_causes_are_told_apart_and_no_set_is_solved_twice(workers):
    options = {"nwalkers": 16, "starts": INSIDE, "workers": workers, "steps": 40}
    calls = []

    def counted(p):
        calls.append((p["a"], p["b"]))
        return fails(p)

    samplers = run(posterior_of(counted), **REJECT, **options)
    chain = samplers[0].get_chain()
    diagnosis = ef.diagnose(samplers)
    assert {*diagnosis.failures} == CAUSES
    if workers is None:
        # One at the prior mean, before what failures are counted of.
        assert len(calls) == len({*calls}) == 1 + 16 * 41
        assert failures(samplers) == (len(calls) - 1, dict(diagnosis.failures))
        rejected = (np.abs(calls).max(axis=1) > 1.2).sum()
        assert sum(diagnosis.failures.values()) == rejected > 30
    # The same chain as that of a prior that ends where the solver does.
    bounded = ef.GaussianPrior(["a", "b"], [0, 0], [1, 1], bounds=[(-1.2, 1.2)] * 2)
    (same,) = run(posterior_of(solves, bounded), **options)
    assert_allclose(chain[:20], same.get_chain()[:20], rtol=1e-9)


@pytest.mark.parametrize(("first", "stop"), [(16, 104), (96, 136)])
def test_the_fraction_is_exact_but_not_of_few_solves(first, stop):
    """All fail after the first: 3/4 of 100 or more, then 1/4 of 128 is just allowed."""
    calls = []

    def failing(p):
        calls.append(1)
        if len(calls) > 1 + first:  # the prior mean comes before these
            raise ArithmeticError("no equilibrium")
        return solves(p)

    options = REJECT | {"max_failures": 0.25, "nwalkers": 16, "starts": INSIDE}
    with pytest.raises(RuntimeError, match="max_failures"):
        run(posterior_of(failing), **options)
    assert len(calls) - 1 == stop  # they are counted by batches of eight


def test_a_jacobian_that_fails_is_an_error_too():
    """Differences take its place where modes coincide, not where a program fails."""

    class Broken(gradients.Derived):
        def jacobian(self, parameters):
            raise ArithmeticError("no licence")

    posterior = ef.LogPosterior(Broken(), gradients.TERM, gradients.PRIOR)
    with pytest.raises(ArithmeticError, match="no licence"):
        ef.run(posterior, steps=2, seed=1)


def test_starts_are_drawn_from_the_prior_where_it_can_be_solved():
    options = REJECT | {"nwalkers": 200, "steps": 1, "ensembles": 2, "starts": None}
    samplers = run(posterior_of(fails), Still(), **options)
    whole = run(posterior_of(solves), Still(), **options)
    distribution = stats.truncnorm(-1.2, 1.2)
    for sampler, other in zip(samplers, whole, strict=True):
        starts, before = sampler.get_chain()[0], other.get_chain()[0]
        assert np.isfinite(sampler.get_log_prob()).all()
        assert all(stats.kstest(x, distribution.cdf).pvalue > 1e-3 for x in starts.T)
        kept = (np.abs(before) <= 1.2).all(axis=1)  # these stay where they were
        assert 0 < kept.sum() < 200
        assert_array_equal(starts[kept], before[kept])
    total, causes = failures(samplers)
    assert total > 2 * 200 and {*causes} == CAUSES


def test_a_start_of_zero_probability_is_refused():
    def term(parameters, modes):
        return np.where(parameters["a"] > 0, 0.0, -np.inf)

    model = ef.FunctionModel(solves, n_modes=2)
    with pytest.raises(ValueError, match="walker .* -inf"):
        run(ef.LogPosterior(model, term, PRIOR), nwalkers=16, starts=INSIDE)


@pytest.mark.slow
@pytest.mark.parametrize("far", [-1e30, -1e300])
@pytest.mark.filterwarnings("always:posterior:UserWarning")
def test_a_log_posterior_that_no_data_can_make_is_impossible_and_that_is_said_once(far):
    """The search climbs and fits as if it were -inf: to the bit."""
    prior = ef.IndependentPrior({name: stats.uniform(-5, 10) for name in "ab"})

    def cut(low):
        def log_density(x):
            return np.where((np.abs(x) < 1).all(axis=1), -0.5 * (x**2).sum(axis=1), low)

        return ef.LogPosterior.from_function(log_density, prior, vectorize=True)

    with pytest.warns(UserWarning, match="impossible") as said:
        found = ef.run(cut(far), steps=20, ensembles=2, seed=1)
    assert len(said) == 1
    exact = ef.run(cut(-np.inf), steps=20, ensembles=2, seed=1)
    for one, other in zip(found, exact, strict=True):
        assert_array_equal(one.get_chain(), other.get_chain())


@pytest.mark.parametrize("function", [False, True])
def test_a_likelihood_of_data_that_is_zero_is_no_news_but_of_a_function_it_is(function):
    """Both are impossible there, as beside hardly any noise."""
    prior = ef.IndependentPrior({"k": stats.uniform(0, 4), "s": stats.halfnorm()})
    term = ef.FrequencyTerm([1.0], discrepancy="s")
    also = [lambda p, modes: 0.0 * p["k"]] if function else []
    model = ef.FunctionModel(lambda p: [p["k"]], n_modes=1)
    evaluator = Evaluation(Solver(ef.LogPosterior(model, [term, *also], prior), False))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        rows = evaluator.rows(np.array([[2.0, 1e-50], [1.0, 0.1]]))
    heights = rows[:, LOG_POSTERIOR]
    assert np.isneginf(heights[0]) and np.isfinite(heights[1])
    assert len(said) == function


def test_few_lines_are_logged_however_many_solves_fail(caplog):
    def seldom(p):
        return noted(p) if p["k"] > 1 else [p["k"], 2.0]

    caplog.set_level("WARNING", "emcee_femu")
    model = ef.FunctionModel(seldom, n_modes=2)
    prior = ef.IndependentPrior({"k": stats.uniform(0, 4)})
    target = ef.LogPosterior(model, ef.FrequencyTerm([1.0, 2.0], beta=4.0), prior)
    options = {"nwalkers": 12, "steps": 15, "ensembles": 1, "seed": 1}
    found = ef.run(target, ef.DEMCMove(), **options | REJECT)
    failed = sum(found.failures.causes.values())
    assert failed > 50 and len(caplog.messages) < 10
    with pytest.raises(ArithmeticError) as error:
        ef.run(target, ef.DEMCMove(), **options)
    assert "on_failure" in "".join(error.value.__notes__)
