"""What goes wrong in a pool says so, and nothing hangs."""

import multiprocessing
import os
import pickle
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.pool import ThreadPool

import numpy as np
import pytest
from support import pool_problems
from support.pool_problems import (
    POSTERIOR,
    Ballast,
    Immediate,
    chain,
    finishes,
    forks,
    posterior_of,
)

import emcee_femu as ef
from emcee_femu.sampling.pools.evaluation_pool import EvaluationPool
from emcee_femu.sampling.pools.process_watch import ProcessWatch


@pytest.fixture(scope="module")
def spawned():
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        yield pool


# --- what goes wrong --------------------------------------------------------------


def test_the_error_of_a_model_arrives_with_its_parameters_by_name(spawned):
    pool = EvaluationPool(spawned)
    points = np.repeat([[4000.0, 2200.0, 2120.0, 2600.0, 2400.0]], 8, axis=0)
    points[5, 2] = 2_500.0
    with pytest.raises(ArithmeticError, match="did not converge") as caught:
        pool.map(posterior_of(pool_problems.failing), points)
    note = caught.value.__notes__[-1]
    assert "'k4': 2500.0" in note and "'k4': 2120.0" not in note
    assert "in failing" in note  # the worker's traceback
    with pytest.raises(RuntimeError, match="Awkward: 1 and 2") as caught:
        pool.map(pool_problems.awkward, [np.array([7.0, 8.0])])
    assert "[7.0, 8.0]" in caught.value.__notes__[-1]
    with pytest.raises(RuntimeError, match="sys.exit.*licence server"):
        pool.map(pool_problems.leave, points)
    with pytest.raises(ImportError, match="no such solver") as caught:
        pool.map(pool_problems.Unloadable(), points)
    assert "could not load" in caught.value.__notes__[-1]
    assert np.isfinite(pool.map(POSTERIOR, points)).all()  # and the pool still works


def test_a_model_that_solves_one_set_at_a_time_is_not_asked_again():
    solved = []

    def solver(parameters):
        solved.append(parameters["k4"])
        return pool_problems.failing(parameters)

    points = np.repeat([[4000.0, 2200.0, 2120.0, 2600.0, 2400.0]], 4, axis=0)
    points[2, 2] = 2_500.0
    with ThreadPoolExecutor(1) as executor, pytest.raises(ArithmeticError) as caught:
        EvaluationPool(executor).map(posterior_of(solver), points)
    assert solved == [2120.0, 2120.0, 2500.0]
    assert "'k4': 2500.0" in caught.value.__notes__[-1]


def test_emcee_prints_nothing_of_an_error_that_arrives_anyway(capfd):
    with ThreadPoolExecutor(2) as executor, pytest.raises(ArithmeticError):
        chain(EvaluationPool(executor), posterior=posterior_of(pool_problems.failing))
    assert capfd.readouterr().out == ""


def test_an_error_of_a_batch_that_no_row_repeats_names_all_rows():
    def model(parameters):
        if len(parameters["k1"]) > 1:
            raise OSError("disk full")
        return POSTERIOR.model(parameters)

    fickle = ef.LogPosterior(model, POSTERIOR.terms, POSTERIOR.prior)
    points = POSTERIOR.start(2, 1)
    with ThreadPoolExecutor(1) as executor, pytest.raises(OSError) as caught:
        EvaluationPool(executor).map(fickle, points)
    for point in points:
        assert f"'k1': {point[0]}" in caught.value.__notes__[-1]


def test_what_cannot_be_pickled_is_named_before_anything_is_evaluated(spawned):
    posterior = posterior_of(lambda parameters: [1.0, 2.0, 3.0, 4.0, 5.0])
    with pytest.raises(TypeError, match=r"model\.function cannot.*a lambda.*line \d+"):
        ef.run(posterior, nsteps=1, seed=1, pool=EvaluationPool(spawned))
    holder = Ballast()
    holder.parts = [0, {"lock": threading.Lock()}]
    with pytest.raises(TypeError, match=r"\.parts\[1\]\['lock'\].*a lock"):
        EvaluationPool(spawned).map(holder.__call__, [np.zeros(2)])
    for threads in (ThreadPoolExecutor(2), ThreadPool(2)):  # they share it
        with threads:
            assert EvaluationPool(threads).map(lambda x: x + 1, [1, 2]) == [2, 3]


@pytest.mark.parametrize("executor", [None, 2, "dask", [1], ThreadPoolExecutor])
def test_what_is_no_pool_is_refused(executor):
    with pytest.raises(TypeError, match="executor: expected"):
        EvaluationPool(executor)


def test_bad_chunksizes_are_refused():
    for bad in (1.5, True, "2"):
        with pytest.raises(TypeError, match="chunksize"):
            EvaluationPool(Immediate(), bad)
    with pytest.raises(ValueError, match="chunksize: expected at least 1"):
        EvaluationPool(Immediate(), 0)
    unknown = Immediate()
    del unknown._max_workers
    with pytest.raises(ValueError, match="chunksize.*how many workers"):
        EvaluationPool(unknown)
    assert len(EvaluationPool(unknown, 2).map(POSTERIOR, POSTERIOR.start(3, 1))) == 3


def test_anything_with_a_map_will_do():
    class Mapper:
        size = 0

        def map(self, function, tasks):
            return map(function, pickle.loads(pickle.dumps(tasks)))

    assert chain(EvaluationPool(Mapper())) == chain()
    assert chain(EvaluationPool(Mapper(), 2)) == chain()


def test_waiting_tasks_are_dropped_after_an_error():
    with ThreadPoolExecutor(1) as executor:
        begin = time.perf_counter()
        with pytest.raises(ZeroDivisionError):
            EvaluationPool(executor, 1).map(slow_reciprocal, [0, *[1] * 200])
    assert time.perf_counter() - begin < 5  # of the 10 s that the rest would take


def slow_reciprocal(x):
    time.sleep(0.05 * x)
    return 1 / x


# --- a worker dies ----------------------------------------------------------------


@forks
@pytest.mark.parametrize(
    ("method", "maxtasks"),
    [
        ("fork", None),
        ("fork", 100),
        pytest.param("spawn", None, marks=pytest.mark.slow),
    ],
)
def test_a_worker_killed_at_work_ends_the_run_of_a_pool(method, maxtasks):
    def work():
        context = multiprocessing.get_context(method)
        with context.Pool(2, maxtasksperchild=maxtasks) as processes:
            pool = EvaluationPool(processes, 1)
            with pytest.raises(RuntimeError, match=r"process \d+ died \(signal 9"):
                pool.map(pool_problems.kill_at_three, np.arange(8.0)[:, None])
            with pytest.raises(RuntimeError, match="new pool"):
                pool.map(POSTERIOR, POSTERIOR.start(4, 1))  # the pool stays useless
        return "ended"  # leaving the block did not hang either

    assert finishes(work) == "ended"


@forks
@pytest.mark.parametrize("victims", [[0], [1], [0, 1]])
def test_a_worker_killed_at_rest_may_hold_a_lock_and_ends_it_too(victims):
    def work():
        with multiprocessing.get_context("fork").Pool(2) as processes:
            pool = EvaluationPool(processes)
            pids = {*pool.map(pool_problems.wait, np.full((4, 1), 0.05))}
            assert pids <= {process.pid for process in processes._pool}
            for victim in [processes._pool[i] for i in victims]:
                os.kill(victim.pid, signal.SIGKILL)
                while victim.exitcode is None:
                    time.sleep(0.01)
            with pytest.raises(RuntimeError, match=r"died \(signal 9"):
                pool.map(pool_problems.wait, np.zeros((4, 1)))
        return "ended"

    assert finishes(work) == "ended"


def test_a_pool_that_lost_a_worker_is_refused_though_it_would_answer(monkeypatch):
    class Process:  # as hashable as a real one
        exitcode, pid = None, 77

    class Answering:
        _processes, _pool = 1, [Process()]

        def apply_async(self, function, arguments, callback, error_callback):
            callback(function(*arguments))

    monkeypatch.setattr(ProcessWatch, "_dismantle", lambda self: None)
    pool = EvaluationPool(Answering())
    assert len(pool.map(POSTERIOR, POSTERIOR.start(3, 1))) == 3
    Answering._pool[0].exitcode = 1
    with pytest.raises(RuntimeError, match=r"process 77 died \(exit code 1"):
        pool.map(POSTERIOR, POSTERIOR.start(3, 1))


@forks
@pytest.mark.parametrize("maxtasks", [None, 5])
def test_a_worker_that_dies_later_in_a_slow_evaluation_is_noticed(maxtasks):
    def work():
        context = multiprocessing.get_context("fork")
        with context.Pool(2, maxtasksperchild=maxtasks) as processes:
            pool = EvaluationPool(processes, 1)
            for _ in range(4):  # 16 tasks a worker: with maxtasks all are new ones
                pool.map(pool_problems.wait, np.zeros((8, 1)))

            def kill():
                os.kill(processes._pool[0].pid, signal.SIGKILL)

            threading.Timer(0.5, kill).start()
            begin = time.perf_counter()
            with pytest.raises(RuntimeError, match=r"process \d+ died"):
                pool.map(pool_problems.wait, np.full((2, 1), 60.0))
            return time.perf_counter() - begin

    assert 0.4 < finishes(work) < 10


@forks
def test_a_worker_killed_in_an_executor_says_what_to_do():
    def work():
        context = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(2, context) as executor:
            pool = EvaluationPool(executor, 1)
            for _ in range(2):  # at work, and when the executor is known as broken
                with pytest.raises(RuntimeError, match="resume") as caught:
                    pool.map(pool_problems.kill_at_three, np.arange(8.0)[:, None])
                assert isinstance(caught.value.__cause__, BrokenProcessPool)
        return "ended"

    assert finishes(work) == "ended"
