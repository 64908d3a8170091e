"""Rows and derivatives through guard and pool: the same bits, each solve counted."""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import emcee
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import emcee_femu as ef
from emcee_femu.sampling.evaluation import Evaluation
from emcee_femu.sampling.pools.own_processes import open_pool
from tests.support.gradients import MEASURED, SHAPES, Derived, Solver, modes
from tests.support.pool_problems import forks
from tests.support.systems import inherits

PRIOR = ef.GaussianPrior(["a", "b"], [1, 1], [0.2, 0.2], [(0.5, 1.5)] * 2)
TERMS = [ef.FrequencyTerm(MEASURED, sd=0.05), ef.ShapeTerm(SHAPES, delta=0.2)]
LIMIT = 1.3
THETA = PRIOR.sample(np.random.default_rng(0), 12)
THETA[0], THETA[1], THETA[2] = [1.4, 1.0], [1.0, 9.0], [LIMIT - 1e-6, 1.0]
FAILING, OUTSIDE = THETA[:, 0] > LIMIT, THETA[:, 1] > 1.5


class Failing(Derived):
    def __call__(self, parameters):
        if (parameters["a"] > LIMIT).any():
            raise RuntimeError("no licence")
        return super().__call__(parameters)


def black_box(p):
    if p["a"] > LIMIT:
        raise RuntimeError("no licence")
    frequencies, shapes = modes(np.array([p["a"]]), np.array([p["b"]]))
    return ef.ModalSolution(frequencies[0], shapes[0])


MODELS = {
    "jacobian": Failing(),
    "black box": ef.FunctionModel(black_box, n_modes=3),
    "not to be pickled": ef.FunctionModel(lambda p: black_box(p), n_modes=3),
}
POOLED = [
    pytest.param(model, id=name, marks=[inherits] if name[:3] == "not" else [])
    for name, model in MODELS.items()
]


def evaluate(posterior, theta=THETA, pool=None, workers=None, on_failure="reject"):
    with open_pool(pool, workers, posterior.one_by_one) as evaluators:
        evaluation = Evaluation.of(posterior, evaluators, on_failure, 1.0)
        rows = evaluation.rows(theta)
        return evaluation, rows, evaluation.linearize(theta)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_what_failed_has_no_row_and_no_gradient_and_is_counted(model):
    posterior = ef.LogPosterior(model, TERMS, PRIOR)
    evaluation, rows, found = evaluate(posterior)
    assert_array_equal(found.rows, rows)
    assert_array_equal(rows[:, 0] == -np.inf, FAILING | OUTSIDE)
    no_gradient = np.isnan(found.gradient).all(axis=1)
    failed = np.count_nonzero(FAILING)
    points = len(THETA) - np.count_nonzero(OUTSIDE)
    if posterior.differentiable:
        assert_array_equal(no_gradient, FAILING | OUTSIDE)
        assert evaluation.solves == 2 * points + failed  # these again without jacobian
        assert evaluation.failures.causes == {"exception": 2 * failed}
    else:  # each with both of its differences, and one of the third point's
        beside = np.arange(len(THETA)) == 2
        assert_array_equal(no_gradient, FAILING | OUTSIDE | beside)
        assert evaluation.solves == 4 * points
        assert evaluation.failures.causes == {"exception": 4 * failed + 1}
    assert_array_equal(np.isnan(found.information).all(axis=(1, 2)), no_gradient)


class WithoutDerivatives(Derived):
    """Its jacobian fails where a is large; its solves do not."""

    def __init__(self, limit, raises):
        super().__init__()
        self.limit, self.raises = limit, raises

    def jacobian(self, parameters):
        response, derivatives = super().jacobian(parameters)
        wrong = parameters["a"] > self.limit
        if self.raises and wrong.any():
            raise np.linalg.LinAlgError("singular")
        derivatives["frequency"]["a"][wrong] = np.nan
        return response, derivatives


@pytest.mark.parametrize("raises", [True, False])
@pytest.mark.parametrize("limit", [LIMIT, 0.0])
def test_a_jacobian_that_fails_is_done_without(limit, raises):
    posterior = ef.LogPosterior(WithoutDerivatives(limit, raises), TERMS, PRIOR)
    evaluation, rows, found = evaluate(posterior)
    exact = ef.LogPosterior(Derived(), TERMS, PRIOR).linearize(THETA)
    assert_array_equal(found.rows, rows)
    assert not evaluation.failures.causes and (rows[~OUTSIDE, 0] > -np.inf).all()
    by_differences = (THETA[:, 0] > limit) & ~OUTSIDE
    scale = np.abs(exact.gradient[~OUTSIDE]).max()
    for part, expected, size in (
        (found.gradient, exact.gradient, scale),
        (found.information, exact.information, np.nanmax(exact.information)),
    ):
        same = ~by_differences & ~OUTSIDE
        assert_array_equal(part[same], expected[same])
        off = np.abs(part[by_differences] - expected[by_differences])
        assert off.max() < 0.05 * size
    n = np.count_nonzero(by_differences)
    assert evaluation.solves == 2 * np.count_nonzero(~OUTSIDE) + n + 3 * n
    assert evaluation.failures.evaluations == 2 * len(THETA) + 3 * n


@pytest.mark.parametrize("search", ["auto", "find_map"])
def test_a_search_goes_on_without_a_jacobian_that_fails(search):
    model = WithoutDerivatives(0.0, raises=True)
    posterior = ef.LogPosterior(model, TERMS, PRIOR)
    if search == "find_map":
        found = ef.find_map(posterior, 4, seed=1, on_failure="reject")
        assert found.lost == () and found.maxima[0].converged
    else:
        settings = {"nwalkers": 8, "nsteps": 20, "seed": 1, "on_failure": "reject"}
        (sampler,) = ef.run(posterior, "auto", **settings)
        assert not sampler.failures.causes
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        ef.find_map(posterior, 4, seed=1)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_nothing_but_failures(model):
    posterior = ef.LogPosterior(model, TERMS, PRIOR)
    _, rows, found = evaluate(posterior, THETA[[0, 0]])
    assert (rows[:, 0] == -np.inf).all()
    assert_array_equal(found.rows, rows)
    assert np.isnan(found.gradient).all()
    assert found.gradient.shape == (2, 2)
    assert found.information.shape == (2, 2, 2)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_failures_may_be_raised_with_their_parameters(model):
    posterior = ef.LogPosterior(model, TERMS, PRIOR)
    evaluation = Evaluation.of(posterior, None, "raise", 0.1)
    with pytest.raises(RuntimeError, match="no licence") as error:
        evaluation.linearize(THETA)
    assert "'a': 1.4" in "".join(error.value.__notes__)
    with pytest.raises(RuntimeError, match="no licence"):
        evaluation.rows(THETA)


@forks
@pytest.mark.parametrize("on_failure", ["reject", "raise"])
@pytest.mark.parametrize("model", POOLED)
def test_a_pool_gives_the_same_bits(model, on_failure):
    posterior = ef.LogPosterior(model, TERMS, PRIOR)
    theta = THETA if on_failure == "reject" else THETA[~FAILING][2:]
    serial = evaluate(posterior, theta, on_failure=on_failure)
    with ThreadPoolExecutor(2) as threads:
        pooled = [
            evaluate(posterior, theta, workers=2, on_failure=on_failure),
            evaluate(posterior, theta, pool=threads, on_failure=on_failure),
        ]
    if posterior.differentiable:
        with ProcessPoolExecutor(2) as executor:
            pool = ef.EvaluationPool(executor)
            pooled.append(evaluate(posterior, theta, pool, on_failure=on_failure))
    for evaluation, rows, found in pooled:
        assert_array_equal(rows, serial[1])
        for one, other in zip(found, serial[2], strict=True):
            assert_array_equal(one, other)
        assert evaluation.solves == serial[0].solves
        if on_failure == "reject":
            log = serial[0].failures
            assert evaluation.failures.counts == log.counts


@forks
@inherits
def test_the_solver_is_sent_once_for_rows_and_derivatives():
    """Also if the derivatives come first."""
    posterior = ef.LogPosterior(MODELS["not to be pickled"], TERMS, PRIOR)
    with open_pool(None, 2, True) as pool:
        evaluation = Evaluation.of(posterior, pool, "reject", 1.0)
        found = evaluation.linearize(THETA)
        assert_array_equal(evaluation.rows(THETA), found.rows)


@forks
def test_failures_on_a_worker_are_raised_with_their_parameters():
    posterior = ef.LogPosterior(MODELS["black box"], TERMS, PRIOR)
    with open_pool(None, 2, True) as pool:
        evaluation = Evaluation.of(posterior, pool, "raise", 0.1)
        with pytest.raises(RuntimeError, match="no licence") as error:
            evaluation.linearize(THETA[3:][::-1] + [[0.2, 0]])
        assert "Raised on a worker at {'a': 1." in "".join(error.value.__notes__)


def test_what_emcee_holds_has_gradients():
    """The guard of a run, with a count, and what a move sends to its pool."""
    posterior = ef.LogPosterior(MODELS["jacobian"], TERMS, PRIOR)
    expected = ef.LogPosterior(Derived(), TERMS, PRIOR).gradient(THETA)
    counted = Evaluation.of(posterior, None, "reject", 1.0)
    rows, gradient = counted.function.gradient(THETA)
    for one, other in ((rows, expected[0]), (gradient, expected[1])):
        assert_array_equal(one[~FAILING], other[~FAILING])
    assert (rows[FAILING, 0] == -np.inf).all()
    assert np.isnan(gradient[FAILING]).all()
    assert counted.failures.counts[0] == len(THETA)
    row, own = counted.function.gradient(THETA[5])
    assert_array_equal(np.hstack([row, own]), np.hstack([rows[5], gradient[5]]))
    with ThreadPoolExecutor(2) as threads, open_pool(threads, None, False) as pool:
        pooled = Evaluation.of(posterior, pool, "reject", 1.0)
        stacked = pooled.pool.map(pooled.function.stack_gradient, THETA)
        assert_array_equal(stacked, np.hstack([rows, gradient]))
        assert pooled.failures.counts == [len(THETA), *counted.failures.counts[1:]]


def test_the_rows_of_a_run_are_those_of_emcee():
    posterior = ef.LogPosterior(Solver(), TERMS, PRIOR)
    sampler = emcee.EnsembleSampler(12, 2, posterior, vectorize=True)
    theta = THETA[~OUTSIDE]
    log_prob, blobs = sampler.compute_log_prob(theta)
    rows = Evaluation.of(posterior, None, "raise", 0.1).rows(theta)
    assert_array_equal(rows, np.column_stack([log_prob, blobs]))
