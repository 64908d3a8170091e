"""One posterior a worker, only coordinates a step, and the chain of a serial run."""

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing.pool import ThreadPool

import emcee
import numpy as np
import pytest
from support.pool_problems import (
    POSTERIOR,
    Ballast,
    Immediate,
    chain,
    forks,
    plain_chain,
    posterior_of,
)

import emcee_femu as ef
from emcee_femu.sampling.pools import worker
from emcee_femu.sampling.pools.evaluation_pool import EvaluationPool


@pytest.fixture(scope="module")
def spawned():
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        yield pool


@pytest.fixture(autouse=True)
def forgetful():
    """Let the worker's memory of this process start empty."""
    worker._functions.clear()


# --- the same chain ---------------------------------------------------------------


def opened(name):
    context = multiprocessing.get_context
    return {
        "fork": lambda: context("fork").Pool(2),
        "short-lived": lambda: context("fork").Pool(2, maxtasksperchild=20),
        "processes": lambda: ProcessPoolExecutor(2, context("fork")),
        "threads": lambda: ThreadPoolExecutor(2),
        "thread pool": lambda: ThreadPool(2),
    }[name]()


@forks
@pytest.mark.parametrize(
    "name", ["fork", "short-lived", "processes", "threads", "thread pool"]
)
def test_every_pool_gives_the_serial_chain_to_the_bit(name):
    with opened(name) as pool:
        gives_the_serial_chain(pool)


def test_spawned_processes_give_the_serial_chain_to_the_bit(spawned):
    gives_the_serial_chain(spawned)


def gives_the_serial_chain(pool):
    assert chain(pool) == chain()
    assert plain_chain(pool) == plain_chain()
    for chunksize in (None, 1, 4):
        assert chain(EvaluationPool(pool, chunksize)) == chain()
    assert plain_chain(EvaluationPool(pool)) == plain_chain()


def test_results_keep_their_order_for_every_chunksize_and_number_of_workers():
    points = POSTERIOR.start(11, 2)
    expected = np.array([POSTERIOR(point) for point in points])
    for workers in (1, 2, 3, 7, 20):
        for chunksize in (None, 1, 2, 5, 11, 50):
            pool = EvaluationPool(Immediate(workers), chunksize)
            assert np.array(pool.map(POSTERIOR, points)).tobytes() == expected.tobytes()
            assert np.array(pool.map(POSTERIOR, iter(points))).shape == expected.shape
    assert EvaluationPool(Immediate()).map(POSTERIOR, []) == []


def test_arguments_that_emcee_binds_reach_the_workers(spawned):
    def run(pool):
        sampler = emcee.EnsembleSampler(
            8, 2, scaled, args=[3.0], kwargs={"power": 4}, pool=pool
        )
        start = np.random.default_rng(1).normal(size=(8, 2))
        sampler.random_state = np.random.RandomState(2).get_state()
        return sampler.run_mcmc(start, 5).coords

    assert np.array_equal(run(EvaluationPool(spawned)), run(None))


def scaled(theta, scale, power):
    return -float(np.sum(np.abs(theta / scale) ** power))


# --- what travels -----------------------------------------------------------------


@pytest.mark.parametrize("chunksize", [None, 3])
def test_a_worker_gets_the_function_once_and_then_coordinates_only(chunksize):
    executor = Immediate()
    pool = EvaluationPool(executor, chunksize)
    function, points = Ballast(125_000), np.zeros((12, 5))
    pool.map(function, points)
    assert sum(size > 1_000_000 for size in executor.sizes) == len(pool._parts(points))
    executor.sizes.clear()
    for _ in range(10):
        pool.map(function, points)
    assert len(executor.sizes) == 10 * len(pool._parts(points))
    assert max(executor.sizes) < 1_000  # 6 points of 5 numbers take 240


def test_several_samplers_of_a_function_send_it_once():
    executor = Immediate(1)
    pool = EvaluationPool(executor)
    for _ in range(3):  # every sampler wraps the function anew
        sampler = emcee.EnsembleSampler(12, 5, Ballast.__call__, pool=pool)
        sampler.log_prob_fn.f = BALLAST
        sampler.compute_log_prob(np.zeros((12, 5)))
    EvaluationPool(executor).map(pickle.loads(pickle.dumps(BALLAST)), np.zeros((2, 5)))
    assert sum(size > 1_000_000 for size in executor.sizes) == 1


BALLAST = Ballast(125_000)


def test_a_function_is_pickled_once():
    times = []

    class Counted(Ballast):
        def __reduce__(self):
            times.append(1)
            return Ballast, (3,)

    pool, function = EvaluationPool(Immediate()), Counted(3)
    for _ in range(5):
        pool.map(function, np.zeros((4, 2)))
    assert len(times) == 1


def test_a_worker_that_forgot_the_function_is_sent_it_again():
    executor = Immediate()
    pool = EvaluationPool(executor)
    points = POSTERIOR.start(6, 1)
    first = pool.map(POSTERIOR, points)
    worker._functions.clear()  # as in a new process
    executor.sizes.clear()
    assert np.array_equal(pool.map(POSTERIOR, points), first)
    assert len(executor.sizes) == 4  # both parts, and again with the function


def test_a_worker_keeps_few_functions_and_the_results_stay_right():
    pool = EvaluationPool(Immediate(1))
    functions = [posterior_of(Shifted(i)) for i in range(3 * worker.KEPT)]
    theta = POSTERIOR.start(1, 1)
    for _ in range(2):
        for number, function in enumerate(functions):
            (row,) = pool.map(function, theta)
            assert row[-5] == 1 + number
            assert len(worker._functions) <= worker.KEPT
    assert len(pool._pickles) <= worker.KEPT


class Shifted:
    def __init__(self, shift):
        self.shift = shift

    def __call__(self, parameters):
        return [1.0 + self.shift, 100.0, 200.0, 300.0, 400.0]


def test_a_share_is_one_call_of_a_log_posterior_and_many_of_another_function():
    calls = []

    def model(parameters):
        calls.append(len(parameters["k1"]))
        return POSTERIOR.model(parameters)

    counted = ef.LogPosterior(model, POSTERIOR.terms, POSTERIOR.prior)
    points = POSTERIOR.start(12, 1)
    with ThreadPoolExecutor(2) as executor:
        EvaluationPool(executor).map(counted, points)
        assert calls == [6, 6]
        calls.clear()
        EvaluationPool(executor, 5).map(counted, points)
        assert sorted(calls) == [2, 5, 5]
        calls.clear()
        EvaluationPool(executor).map(lambda theta: counted(theta), points)
        assert calls == [1] * 12
