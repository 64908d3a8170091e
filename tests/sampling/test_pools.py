"""Pools and a run's own processes: the serial chain, clear errors, and a clean end."""

import multiprocessing
import os
import pickle
import re
import signal
import sys
import threading
import time
import warnings
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from contextlib import suppress

import emcee
import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import pool_problems
from support.pool_problems import (
    HANGS,
    POSTERIOR,
    START,
    Immediate,
    finishes,
    forks,
    names_the_place,
    open_executor,
    posterior_of,
    run,
    run_on,
    sample,
    start_script,
)
from support.runs import assert_same, failures
from support.systems import KILL, inherits, need_start_method, posix

import emcee_femu as ef
from emcee_femu import EvaluationPool
from emcee_femu.evaluation.samplers import Sampler
from emcee_femu.moves import HamiltonianMove

SLOW = pytest.mark.slow
SLOPES = {"k": np.array([1.0, 0.0]), "m": np.array([0.0, 2.0])}  # of the frequencies
spawn = pytest.param("spawn", marks=SLOW)  # starts processes anew
anew = [spawn, pytest.param("forkserver", marks=SLOW)]


def agree(samplers, others):
    """Compare chains, which may differ by rounding."""
    for first, second in zip(samplers, others, strict=True):
        assert_allclose(first.get_chain(), second.get_chain(), rtol=1e-9)
        assert_allclose(first.get_blobs(), second.get_blobs(), rtol=1e-9)


@pytest.fixture(scope="module")
def serial():
    return sample()


# --- the same chain ---------------------------------------------------------------


@forks
@pytest.mark.parametrize("name", ["fork", "threads", "thread pool", spawn])
def test_every_executor_gives_the_serial_chain(serial, name):
    with open_executor(name) as executor:
        for pool in (executor, *(EvaluationPool(executor, n) for n in (None, 1, 4))):
            agree(sample(pool), serial)


@pytest.fixture
def method(request):
    need_start_method(request.param)
    before = multiprocessing.get_start_method(allow_none=True)
    multiprocessing.set_start_method(request.param, force=True)
    yield request.param
    multiprocessing.set_start_method(before, force=True)
    assert not multiprocessing.active_children()


def linear(p):
    return [p["k"], 2 * p["m"]]


@pytest.mark.parametrize("method", ["fork", *anew], indirect=True)
def test_the_number_of_workers_changes_nothing(method):
    posterior = posterior_of(linear)
    first, three = (sample(posterior=posterior, steps=5, workers=n) for n in (1, 3))
    assert_same(first, three)
    agree(first, sample(posterior=posterior, steps=5))


def test_results_keep_their_order_for_every_chunksize_and_number_of_workers():
    points = POSTERIOR.start(11, 2)
    expected = [POSTERIOR(point) for point in points]
    for workers in (1, 2, 3, 7, 20):
        for chunksize in (None, 1, 2, 5, 11, 50):
            pool = EvaluationPool(Immediate(workers), chunksize)
            for argument in (points, iter(points)):
                assert_allclose(pool.map(POSTERIOR, argument), expected, rtol=1e-11)
    assert EvaluationPool(Immediate()).map(POSTERIOR, []) == []


def test_anything_with_a_map_will_do(serial):
    class Mapper:
        def map(self, function, tasks):
            return map(function, pickle.loads(pickle.dumps(tasks)))

    agree(sample(Mapper()), serial)
    agree(sample(EvaluationPool(Mapper(), 5)), serial)
    with suppress(ImportError):
        from schwimmbad import SerialPool

        agree(sample(SerialPool()), serial)


# --- ensembles together -----------------------------------------------------------


class InStep:
    """A solver that waits until as many are at work, once it is told to."""

    def __init__(self, parties):
        self.barrier, self.waiting = threading.Barrier(parties, timeout=HANGS), False

    def __call__(self, p):
        if self.waiting:
            self.barrier.wait()
        return [p["k"], 2 * p["m"]]


def in_step(solver):
    """Return a posterior without bounds, so that each proposal is solved."""
    model = ef.FunctionModel(
        solver, n_modes=2, jacobian=lambda p: (solver(p), {"frequency": SLOPES})
    )
    prior = ef.GaussianPrior(["k", "m"], [1.0, 1.0], [0.2, 0.2])
    term = ef.FrequencyTerm([1.0, 2.0], relative_sd=0.1)
    return ef.LogPosterior(model, term, prior)


def test_half_of_each_ensemble_is_on_the_pool_at_once(monkeypatch):
    solver = InStep(parties=3 * 6 // 2)
    advance = Sampler.advance

    def advance_waiting(self, *arguments):
        solver.waiting = True  # not of the starts
        advance(self, *arguments)

    monkeypatch.setattr(Sampler, "advance", advance_waiting)
    with ThreadPoolExecutor(9) as pool:
        ef.run(in_step(solver), ef.DEMCMove(), 6, 5, ensembles=3, seed=1, pool=pool)
    assert not solver.barrier.broken


def test_together_ensembles_are_what_they_are_one_after_another():
    def solver(p):
        time.sleep(1e-3)  # the others have their turn
        return linear(p)

    posterior = in_step(solver)
    moves = [(HamiltonianMove([0.04, 0.04], steps=3), 0.6), (ef.DEMCMove(), 0.4)]
    with ThreadPoolExecutor(4) as threads:
        together, alone = (
            ef.run(posterior, moves, 6, 9, ensembles=3, seed=1, pool=pool)
            for pool in (threads, None)
        )
    assert_same(together, alone)
    # Of gradients that the move keeps from step to step, none is asked for again.
    assert together.solves == alone.solves


LONG = 1_000  # steps, of which the error ends all but a few, on a busy machine too
WHOLE = 3 * 6 * LONG  # solves that it would take


def failing_later(error):
    """Return a solver that raises once the starts are there, and counts its calls."""
    lock, calls = threading.Lock(), []

    def solver(p):
        with lock:
            calls.append(1)
            number = len(calls)
        time.sleep(2e-3)
        if number == 60:
            error()
        return linear(p)

    return solver, calls


def test_an_error_in_one_ensemble_ends_all_and_keeps_their_samples():
    solver, calls = failing_later(lambda: pool_problems.ordinary(None))
    with ThreadPoolExecutor(4) as pool:
        options = dict(ensembles=3, seed=1, pool=pool)
        with pytest.raises(ArithmeticError, match="did not converge") as caught:
            ef.run(in_step(solver), ef.DEMCMove(), 6, LONG, **options)
        stored, spent = [one.iteration for one in caught.value.run], len(calls)
        time.sleep(0.1)  # the others stop where they wait
    # What was on the pool, half of each ensemble, is solved as the pool is closed.
    assert len(calls) - spent <= 9 and spent < 0.5 * WHOLE and min(stored) >= 1
    assert [one.iteration for one in caught.value.run] == stored


@posix
def test_the_keyboard_ends_ensembles_that_are_under_way_together():
    solver, calls = failing_later(lambda: os.kill(os.getpid(), signal.SIGINT))
    with ThreadPoolExecutor(4) as pool:
        options = dict(ensembles=3, seed=1, pool=pool)
        with pytest.raises(KeyboardInterrupt) as caught:
            ef.run(in_step(solver), ef.DEMCMove(), 6, LONG, **options)
        spent = len(calls)
        time.sleep(0.1)
    assert len(calls) - spent <= 9 and spent < 0.5 * WHOLE
    assert min(sampler.iteration for sampler in caught.value.run) >= 1


# --- what travels -----------------------------------------------------------------


class Ballast:
    """A log-density with a megabyte to carry, and perhaps something else."""

    def __init__(self, extra=None):
        self.ballast, self.extra = np.random.default_rng(0).random(125_000), extra

    def __call__(self, theta):
        return -0.5 * float(np.dot(theta, theta))


def test_a_worker_gets_the_function_once_and_then_coordinates_only():
    executor = Immediate()
    function, points = Ballast(), np.zeros((12, 5))
    pool = EvaluationPool(executor)
    pool.map(function, points)
    assert sum(executor.sizes) > 1_000_000
    executor.sizes.clear()
    for _ in range(10):
        pool.map(function, points)
    for _ in range(3):  # every sampler wraps the function anew
        sampler = emcee.EnsembleSampler(12, 5, function, pool=pool)
        sampler.compute_log_prob(points)
    assert sum(executor.sizes) < 500_000


def meet(directory):
    """Wait until as many workers are at it as the directory's name says."""
    (directory / str(os.getpid())).touch()
    end = time.monotonic() + HANGS
    while len([*directory.iterdir()]) < int(directory.name):
        assert time.monotonic() < end, "the other worker is sent nothing"
        time.sleep(0.01)


@forks
@pytest.mark.parametrize("name", ["fork", spawn])
def test_a_worker_that_lacks_the_function_gets_it_while_others_are_at_work(
    tmp_path, name
):
    with open_executor(name) as executor:
        pool = EvaluationPool(executor, chunksize=1)
        for workers in (1, 2):  # of which one has the function before the others
            (tmp_path / str(workers)).mkdir()
            pool.map(meet, [tmp_path / str(workers)] * workers)


def test_what_cannot_be_pickled_is_named_by_python_and_threads_need_not():
    holder = Ballast(threading.Lock())
    with pytest.raises(TypeError, match="^pool: .*pickled.*lock"):
        EvaluationPool(Immediate()).map(holder, START)
    for name in ("threads", "thread pool"):
        with open_executor(name) as executor:
            assert len(EvaluationPool(executor).map(holder, START)) == 12


def test_a_lambda_goes_by_value_or_is_refused_without_cloudpickle(monkeypatch):
    factor = 2.0
    posterior = posterior_of(lambda p: [p["k"], factor * p["m"]])
    expected = [posterior(point) for point in START]
    assert_allclose(EvaluationPool(Immediate()).map(posterior, START), expected)
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    with pytest.raises(TypeError, match=r"lambda.*pip install 'emcee-femu\[notebooks"):
        EvaluationPool(Immediate()).map(posterior, START)


@inherits
def test_forked_processes_inherit_what_cannot_be_pickled_beside_threads(tmp_path):
    lock = threading.Lock()
    posterior = posterior_of(lambda p: [p["k"], 2 * p["m"]] if lock else None)
    threading.Thread(target=time.sleep, args=[5], daemon=True).start()
    file = {"backend": tmp_path / "run.chain", "resume": True, "on_failure": "reject"}
    for steps in (5, 8):
        with warnings.catch_warnings(record=True) as shown:
            warnings.simplefilter("always")
            pooled = sample(posterior=posterior, steps=steps, workers=2, **file)
        # Python 3.12 and newer warn of forks beside threads.
        assert not [warning for warning in shown if "fork" in str(warning.message)]
    agree(pooled, sample(posterior=posterior, steps=8))


@SLOW
@pytest.mark.parametrize("method", ["spawn"], indirect=True)
def test_spawned_processes_must_be_sent_the_posterior(method):
    lock = threading.Lock()  # which not even cloudpickle sends
    posterior = posterior_of(lambda p: [1.0, 2.0] if lock else None)
    with pytest.raises(TypeError, match="^workers: .*lock.*top level of a module"):
        sample(posterior=posterior, workers=2)


# --- what goes wrong --------------------------------------------------------------


@forks
@pytest.mark.parametrize("fault", ["killed", "ended"])
@pytest.mark.parametrize("name", ["fork", "workers", spawn])
def test_a_worker_that_dies_ends_the_run_and_keeps_the_samples(name, fault):
    if name != "workers":
        need_start_method(name)
    error = finishes(lambda: run_on(name, getattr(pool_problems, fault)))
    assert type(error) is RuntimeError
    assert re.match("pool: .*Process", str(error))
    assert isinstance(error.__cause__, BrokenExecutor)
    (sampler,) = error.run
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
    options = {"steps": 20, "on_failure": "reject", "max_failures": 1.0}
    pooled, serial = run_on(name, fault, **options), run(fault, **options)
    agree(pooled, serial)
    assert failures(pooled) == failures(serial)
    assert failures(pooled)[1]["exception"] > 0


@inherits
@pytest.mark.parametrize("raised", [ArithmeticError, KeyboardInterrupt])
def test_an_error_names_the_place_and_ends_solves_that_take_long(raised):
    def solver(p):
        if p["k"] == 1.0:
            time.sleep(0.1)  # while the others have begun, or wait
            raise raised("no licence")
        time.sleep(2 * HANGS)

    starts = np.full((64, 2), 0.9)
    starts[0, 0] = 1.0
    begin = time.perf_counter()
    with pytest.raises((raised, RuntimeError)) as caught:
        run(solver, posterior=posterior_of(solver), starts=starts, workers=2)
    assert time.perf_counter() - begin < HANGS
    if raised is ArithmeticError:
        assert "'k': 1.0" in "".join(caught.value.__notes__)
    assert not multiprocessing.active_children()


@posix
def test_the_keyboard_is_the_business_of_the_run():
    def interrupted(p):
        if os.getpid() != home:
            os.kill(os.getpid(), signal.SIGINT)
        return linear(p)

    home = os.getpid()
    posterior = posterior_of(interrupted)
    agree(sample(posterior=posterior, workers=2), sample(posterior=posterior))


@forks
@pytest.mark.parametrize("wrap", [lambda pool: pool, EvaluationPool])
@pytest.mark.parametrize("name", ["fork", "threads", "thread pool"])
def test_a_closed_pool_says_so(name, wrap):
    with open_executor(name) as executor:
        argument = wrap(executor)
        sample(argument, steps=1)
    error = finishes(lambda: sample(argument))
    assert type(error) is RuntimeError and not hasattr(error, "run")
    assert "the pool was closed" in str(error)


@forks
def test_a_pool_that_waits_for_ever_for_the_dead_is_refused_with_a_remedy():
    need_start_method("fork")
    refusal = "multiprocess.*workers=.*ProcessPoolExecutor"
    with multiprocessing.get_context("fork").Pool(1) as pool:
        with pytest.raises(TypeError, match=f"^pool, executor: {refusal}"):
            EvaluationPool(pool)
        with pytest.raises(TypeError, match=f"^pool, executor: {refusal}"):
            sample(pool)


# --- scripts ----------------------------------------------------------------------


UNGUARDED = """
import multiprocessing, sys
import numpy as np
from support.pool_problems import posterior_of, sample

if len(sys.argv) > 1:
    multiprocessing.set_start_method(sys.argv[1], force=True)

def solver(p):
    return [p["k"], 2 * p["m"]]

posterior = posterior_of(solver)
one, other = (sample(posterior=posterior, workers=n)[0].get_chain() for n in (2, None))
print(np.allclose(one, other, rtol=1e-9))
"""


def run_unguarded(tmp_path, *arguments):
    """Return what it shows and reports as a file, a command and standard input."""
    path = tmp_path / "unguarded.py"
    path.write_text(UNGUARDED)
    ways = (str(path), *arguments), ("-c", UNGUARDED, *arguments)
    scripts = [start_script(way) for way in (*ways, ("-", *arguments))]
    texts = None, None, UNGUARDED
    pairs = zip(scripts, texts, strict=True)
    return [script.communicate(text, timeout=HANGS) for script, text in pairs]


@SLOW
@inherits
def test_a_script_needs_no_guard_nor_a_file(tmp_path):
    assert run_unguarded(tmp_path) == [("True\n", "")] * 3


@SLOW
def test_spawned_processes_of_a_script_without_a_guard_ask_for_it(tmp_path):
    script, command, prompt = run_unguarded(tmp_path, "spawn")
    for (shown, errors), message in [
        (script, 'if __name__ == "__main__":'),
        (prompt, "could not start"),
    ]:
        assert message in errors and not shown
    assert command == ("True\n", "")  # which has no file that workers would import


STUCK = """
import multiprocessing, sys
from concurrent.futures import ProcessPoolExecutor
import emcee_femu as ef
from emcee_femu import EvaluationPool
from emcee_femu.evaluation.samplers import Sampler
from emcee_femu.moves import HamiltonianMove
from support import pool_problems

if __name__ == "__main__":
    multiprocessing.set_start_method(sys.argv[1])
    try:
        if sys.argv[2] == "workers":
            pool_problems.run(pool_problems.stuck, workers=2)
        with ProcessPoolExecutor(2) as executor:
            pool = EvaluationPool(executor, 1)
            while len({*pool.map(pool_problems.where, [[0.1]] * 8)}) < 2:
                pass  # until both have begun
            pool_problems.run(pool_problems.stuck, pool=pool)
    except KeyboardInterrupt as error:
        print("kept", error.run[0].iteration > 0)
"""


def end(tmp_path, name, mine, send):
    """Return what a run showed whose worker is in a long solve when it is ended."""
    need_start_method(name)
    path = tmp_path / "stuck.py"
    path.write_text(STUCK)
    process = start_script((str(path), name, mine))
    assert process.stdout.readline() == "working\n"
    send(process)
    # This waits for every process that can write to the pipe, and so for the workers.
    shown, _ = process.communicate(timeout=HANGS)  # half of what the solve takes
    return shown.replace("working\n", "")


ways = pytest.mark.parametrize("name", ["fork", spawn])


@pytest.mark.parametrize(
    ("mine", "kind"), [("workers", KILL), ("executor", signal.SIGTERM)]
)
@ways
def test_no_process_outlives_a_run_that_is_killed(tmp_path, name, mine, kind):
    assert end(tmp_path, name, mine, lambda script: script.send_signal(kind)) == ""


@posix
@ways
def test_the_keyboard_ends_a_run_at_once_and_keeps_the_samples(tmp_path, name):
    def press(process):  # as a terminal does: to all processes
        os.killpg(process.pid, signal.SIGINT)

    shown = end(tmp_path, name, "workers", press)  # a process may be starting still
    assert shown == "kept True\n"
