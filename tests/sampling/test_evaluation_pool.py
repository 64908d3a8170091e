"""One posterior per worker, then coordinates only, and the chain of a serial run."""

import multiprocessing
import pickle
import re
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from contextlib import suppress
from types import SimpleNamespace

import emcee
import numpy as np
import pytest
from support import pool_problems
from support.pool_problems import (
    LIMIT,
    POSTERIOR,
    START,
    Immediate,
    chain,
    finishes,
    forks,
    names_the_place,
    open_executor,
    posterior_of,
    run,
    run_on,
)
from support.systems import need_start_method

import emcee_femu as ef
from emcee_femu import EvaluationPool
from emcee_femu.sampling.pools import worker

spawn = pytest.param("spawn", marks=pytest.mark.slow)  # starts processes anew
executors = pytest.mark.parametrize("name", ["fork", "threads", "thread pool"])


@pytest.fixture(autouse=True)
def forgetful():
    """Let the worker's memory of this process start empty."""
    worker.functions.clear()


# --- the same chain ---------------------------------------------------------------


@forks
@pytest.mark.parametrize("name", ["fork", "threads", "thread pool", spawn])
def test_every_executor_gives_the_serial_chain_to_the_bit(name):
    with open_executor(name) as executor:
        for pool in (executor, *(EvaluationPool(executor, n) for n in (None, 1, 4))):
            assert chain(pool) == chain()


@forks
def test_a_plain_sampler_binds_arguments_and_keeps_its_chain():
    def sample(pool):
        sampler = emcee.EnsembleSampler(
            8, 2, scaled, args=[3.0], kwargs={"power": 4}, pool=pool
        )
        start = np.random.default_rng(1).normal(size=(8, 2))
        sampler.random_state = np.random.RandomState(2).get_state()
        return sampler.run_mcmc(start, 5).coords

    with open_executor("fork") as executor:
        assert np.array_equal(sample(EvaluationPool(executor)), sample(None))


def scaled(theta, scale, power):
    return -float(np.sum(np.abs(theta / scale) ** power))


def test_results_keep_their_order_for_every_chunksize_and_number_of_workers():
    points = POSTERIOR.start(11, 2)
    expected = np.array([POSTERIOR(point) for point in points])
    for workers in (1, 2, 3, 7, 20):
        for chunksize in (None, 1, 2, 5, 11, 50):
            pool = EvaluationPool(Immediate(workers), chunksize)
            assert np.array(pool.map(POSTERIOR, points)).tobytes() == expected.tobytes()
            assert np.array(pool.map(POSTERIOR, iter(points))).shape == expected.shape
    assert EvaluationPool(Immediate()).map(POSTERIOR, []) == []


def test_anything_with_a_map_will_do():
    class Mapper:
        def map(self, function, tasks):
            return map(function, pickle.loads(pickle.dumps(tasks)))

    assert chain(Mapper()) == chain(EvaluationPool(Mapper(), 5)) == chain()


# --- what travels -----------------------------------------------------------------


class Ballast:
    """A log-density with something to carry, which counts how often it is pickled."""

    def __init__(self, size=125_000, shift=0.0):
        self.ballast = np.random.default_rng(0).random(size)
        self.shift, self.pickled = shift, 0

    def __call__(self, theta):
        return self.shift - 0.5 * float(np.dot(theta, theta))

    def __getstate__(self):
        self.pickled += 1
        return self.__dict__


@pytest.mark.parametrize(("chunksize", "tasks"), [(None, 2), (3, 4)])
def test_a_worker_gets_the_function_once_and_then_coordinates_only(chunksize, tasks):
    executor, function, points = Immediate(), Ballast(), np.zeros((12, 5))
    pool = EvaluationPool(executor, chunksize)
    pool.map(function, points)
    assert sum(size > 1_000_000 for size in executor.sizes) == tasks
    executor.sizes.clear()
    for _ in range(10):
        pool.map(function, points)
    assert len(executor.sizes) == 10 * tasks
    assert max(executor.sizes) < 1_000  # 6 points of 5 numbers take 240
    assert function.pickled == 1


def test_several_samplers_of_a_function_send_it_once():
    executor, function = Immediate(1), Ballast()
    pool = EvaluationPool(executor)
    for _ in range(3):  # every sampler wraps the function anew
        sampler = emcee.EnsembleSampler(12, 5, function, pool=pool)
        sampler.compute_log_prob(np.zeros((12, 5)))
    assert function.pickled == 1
    assert sum(size > 1_000_000 for size in executor.sizes) == 1


def test_a_worker_that_forgot_the_function_is_sent_it_again():
    executor = Immediate()
    first = chain(executor)  # walker by walker: the start and 8 steps
    assert len(executor.sizes) == 12 + 9 * 12
    worker.functions.clear()  # as in a new process
    assert chain(executor) == first == chain()
    assert len(executor.sizes) == 2 * (12 + 9 * 12)


def test_a_worker_keeps_few_functions_and_the_results_stay_right():
    pool = EvaluationPool(Immediate(1))
    functions = [Ballast(1, shift) for shift in range(3 * worker.KEPT)]
    for _ in range(2):
        for shift, function in enumerate(functions):
            assert pool.map(function, np.zeros((1, 2))) == [shift]
            assert len(worker.functions) <= worker.KEPT


def test_a_share_is_one_call_of_a_log_posterior_and_many_of_another_function():
    calls = []

    def model(parameters):
        calls.append(len(parameters["k1"]))
        return POSTERIOR.model(parameters)

    model.variables = POSTERIOR.model.variables
    counted = ef.LogPosterior(model, POSTERIOR.terms, POSTERIOR.prior)
    points = POSTERIOR.start(12, 1)
    with ThreadPoolExecutor(2) as executor:
        for function, chunksize, expected in [
            (counted, None, [6, 6]),
            (counted, 5, [2, 5, 5]),
            (lambda theta: counted(theta), None, [1] * 12),
        ]:
            EvaluationPool(executor, chunksize).map(function, points)
            assert sorted(calls) == expected
            calls.clear()


# --- what goes wrong --------------------------------------------------------------


@forks
@pytest.mark.parametrize("fault", ["killed", "ended"])
@pytest.mark.parametrize("name", ["fork", "workers", spawn])
def test_a_worker_that_dies_ends_the_run_and_keeps_the_samples(name, fault):
    if name != "workers":
        need_start_method(name)
    error = finishes(lambda: run_on(name, getattr(pool_problems, fault)))
    assert type(error) is RuntimeError
    assert re.match("pool: .*Process.* could not do its work: a.*samplers", str(error))
    assert isinstance(error.__cause__, BrokenExecutor)
    (sampler,) = error.samplers
    assert 0 < sampler.iteration < 100


@forks
@pytest.mark.parametrize(
    ("fault", "kind", "message"),
    [
        ("left", RuntimeError, "sys.exit.*licence|SystemExit.*licence"),
        # Where dask was imported, its tblib lets such an exception travel.
        ("awkward", (RuntimeError, pool_problems.Awkward), "1 and 2"),
        ("ordinary", ArithmeticError, "^the solver did not converge"),
    ],
)
@pytest.mark.parametrize("name", ["fork", "workers", "threads", "thread pool"])
def test_an_error_of_the_solver_arrives_with_parameters_and_traceback(
    capfd, name, fault, kind, message
):
    with pytest.raises(kind, match=message) as caught:
        run_on(name, getattr(pool_problems, fault))
    assert names_the_place(caught.value)
    assert f"in {fault}" in caught.value.__notes__[-1]  # the worker's traceback
    assert "Exception while calling" not in capfd.readouterr().out  # emcee's report


@forks
@pytest.mark.parametrize("name", ["fork", "workers"])
@pytest.mark.parametrize("fault", ["left", "awkward", "ordinary"])
def test_failures_on_workers_are_counted_as_in_a_serial_run(name, fault):
    fault = getattr(pool_problems, fault)
    options = {"nsteps": 20, "on_failure": "reject", "max_failures": 1.0}
    (sampler,), (serial,) = run_on(name, fault, **options), run(fault, **options)
    assert np.array_equal(sampler.get_chain(), serial.get_chain())
    assert sampler.failures.causes == serial.failures.causes
    assert sampler.failures.causes["exception"] > 0


def test_a_model_that_solves_one_set_at_a_time_is_not_asked_again():
    solved = []

    def solver(p):
        solved.append(p["k"])
        return pool_problems.Beyond(pool_problems.ordinary)(p)

    points = np.array([[1.0, 1.0], [LIMIT + 0.1, 1.0], [0.9, 1.0]])
    with ThreadPoolExecutor(1) as executor, pytest.raises(ArithmeticError) as caught:
        EvaluationPool(executor).map(posterior_of(solver), points)
    assert solved == [1.0, LIMIT + 0.1]
    assert names_the_place(caught.value)


def test_an_error_of_a_batch_that_no_row_repeats_names_all_rows():
    class Fickle:
        takes_batches, names = True, ["k", "m"]

        def __call__(self, theta):
            if theta.ndim == 2:
                raise OSError("disk full")
            return 0.0

    with ThreadPoolExecutor(1) as executor, pytest.raises(OSError) as caught:
        EvaluationPool(executor).map(Fickle(), np.array([[1.0, 2.0], [3.0, 4.0]]))
    for k, m in ([1.0, 2.0], [3.0, 4.0]):
        assert f"{{'k': {k}, 'm': {m}}}" in caught.value.__notes__[-1]


class Unloadable(Ballast):
    def __setstate__(self, state):
        raise ImportError("no such solver here")


def test_a_function_that_a_worker_cannot_load_says_what_to_do():
    with pytest.raises(ImportError, match="no such solver") as caught:
        EvaluationPool(Immediate()).map(Unloadable(), START)
    assert "could not load the function" in caught.value.__notes__[-1]


def test_what_cannot_be_pickled_is_named_by_python_and_threads_need_not():
    holder = Ballast(1)
    holder.lock = threading.Lock()
    with pytest.raises(TypeError, match="^pool: .*pickled.*lock.*top level"):
        EvaluationPool(Immediate()).map(holder, START)
    for name in ("threads", "thread pool"):
        with open_executor(name) as executor:
            assert len(EvaluationPool(executor).map(holder, START)) == 12


def test_a_lambda_goes_by_value_or_is_refused_where_there_is_no_cloudpickle(
    monkeypatch,
):
    factor = 2.0
    posterior = posterior_of(lambda p: [p["k"], factor * p["m"]])
    expected = [posterior(point) for point in START]
    np.testing.assert_array_equal(
        EvaluationPool(Immediate()).map(posterior, START), expected
    )
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    with pytest.raises(TypeError, match=r"lambda.*pip install 'emcee-femu\[notebooks"):
        EvaluationPool(Immediate()).map(posterior, START)


def test_waiting_tasks_are_dropped_after_an_error():
    with ThreadPoolExecutor(1) as executor:
        begin = time.perf_counter()
        with pytest.raises(ZeroDivisionError):
            EvaluationPool(executor, 1).map(slow_reciprocal, [0, *[1] * 200])
    assert time.perf_counter() - begin < 5  # of the 10 s that the rest would take


def slow_reciprocal(x):
    time.sleep(0.05 * x)
    return 1 / x


@forks
@pytest.mark.parametrize("wrap", [lambda pool: pool, EvaluationPool])
@executors
def test_a_closed_pool_says_so(name, wrap):
    with open_executor(name) as executor:
        given = wrap(executor)
        chain(given, steps=1)
    error = finishes(lambda: chain(given))
    assert type(error) is RuntimeError and not hasattr(error, "samplers")
    assert "the pool was closed" in str(error) and "make a new pool" in str(error)


@forks
def test_a_pool_that_waits_for_ever_for_the_dead_is_refused_with_a_remedy():
    need_start_method("fork")
    refusal = "multiprocess.*waits for ever.*workers=8.*ProcessPoolExecutor"
    with multiprocessing.get_context("fork").Pool(1) as pool:
        with pytest.raises(TypeError, match=f"^executor: {refusal}"):
            EvaluationPool(pool)
        with pytest.raises(TypeError, match=f"^pool: {refusal}"):
            ef.run(POSTERIOR, seed=1, pool=pool)
    with suppress(ImportError):
        from schwimmbad import MultiPool, SerialPool

        with MultiPool(1) as pool, pytest.raises(TypeError, match=refusal):
            EvaluationPool(pool)
        assert chain(SerialPool()) == chain()


ASYNCHRONOUS = SimpleNamespace(map=map, asynchronous=True)  # a dask Client may be


@pytest.mark.parametrize(
    "executor", [None, 2, "dask", [1], ThreadPoolExecutor, time, ASYNCHRONOUS]
)
def test_what_is_no_pool_is_refused(executor):
    with pytest.raises(TypeError, match="^executor: expected"):
        EvaluationPool(executor)
    if executor is not None:
        with pytest.raises(TypeError, match="^pool: expected"):
            ef.run(POSTERIOR, seed=1, pool=executor)


@pytest.mark.parametrize("bad", [1.5, True, "2", 0])
def test_bad_chunksizes_are_refused(bad):
    with pytest.raises((TypeError, ValueError), match="^chunksize: expected"):
        EvaluationPool(Immediate(), bad)
