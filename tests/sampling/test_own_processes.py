"""run(..., workers=2): its processes begin and end with it, whatever ends it."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from support import pool_problems
from support.examples import TESTS
from support.pool_problems import (
    POSTERIOR,
    chain,
    finishes,
    posterior_of,
)
from support.systems import KILL, inherits, need_start_method, posix

import emcee_femu as ef
from emcee_femu.sampling.pools.executors import dump
from emcee_femu.sampling.pools.own_processes import OwnProcesses, open_pool

anew = [pytest.param(name, marks=pytest.mark.slow) for name in ("spawn", "forkserver")]
methods = pytest.mark.parametrize("method", ["fork", *anew], indirect=True)


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


@methods
def test_the_chain_is_that_of_a_serial_run_to_the_bit(method):
    for workers, posterior in [(3, POSTERIOR), (2, posterior_of(linear))]:
        serial = chain(posterior=posterior, steps=3)
        assert chain(posterior=posterior, steps=3, workers=workers) == serial


@inherits
def test_forked_processes_inherit_what_cannot_be_pickled_even_beside_threads(tmp_path):
    lock = threading.Lock()
    posterior = posterior_of(lambda p: [p["k"], 2 * p["m"]] if lock else None)
    going = threading.Thread(target=time.sleep, args=[5], daemon=True)
    going.start()
    file = {"backend": tmp_path / "run.chain", "resume": True, "on_failure": "reject"}
    for options in ({"nsteps": 5}, {"nsteps": 5, **file}, {"nsteps": 8, **file}):
        options |= {"nwalkers": 12, "seed": 1, "ensembles": 2}
        with warnings.catch_warnings(record=True) as shown:
            warnings.simplefilter("always")
            pooled = ef.run(posterior, workers=2, **options)
        # Python 3.12 and newer warn of forks beside threads.
        assert not [one for one in shown if "fork" in str(one.message)]
        serial = ef.run(posterior, **options | {"backend": None, "resume": False})
        for one, other in zip(pooled, serial, strict=True):
            assert np.array_equal(one.get_chain(), other.get_chain())


@pytest.mark.slow
@pytest.mark.parametrize("method", ["spawn"], indirect=True)
def test_spawned_processes_must_be_sent_the_posterior(method):
    lock = threading.Lock()  # which not even cloudpickle sends
    with pytest.raises(TypeError, match="^workers: .*lock.*top level of a module"):
        ef.run(posterior_of(lambda p: [1.0, 2.0] if lock else None), seed=1, workers=2)


@inherits
def test_an_error_names_the_place_and_ends_a_solve_that_takes_a_minute():
    def solver(p):
        if p["k"] == 1.0:
            raise ArithmeticError("the solver did not converge")
        time.sleep(60)

    def work():
        with open_pool(None, 2, one_by_one=True) as pool:
            pool.map(posterior_of(solver), np.array([[1.0, 1.0], [0.9, 1.0]]))

    begin = time.perf_counter()
    error = finishes(work)
    assert time.perf_counter() - begin < 20
    assert "'k': 1.0" in error.__notes__[-1]
    assert not multiprocessing.active_children()


@inherits
@pytest.mark.parametrize("raised", [ArithmeticError, KeyboardInterrupt, SystemExit])
def test_an_error_before_many_tasks_leaves_no_trace_and_no_process(raised):
    def solver(p):
        if p["k"] == 1.0:
            raise raised
        time.sleep(0.2)  # while the others wait
        return [1.0, 2.0]

    points = np.ones((64, 2))
    points[1:, 0] = 0.9
    with (
        pytest.raises((raised, RuntimeError)),
        open_pool(None, 2, one_by_one=True) as pool,
    ):
        pool.map(posterior_of(solver), points)
    assert not multiprocessing.active_children()


@posix
def test_the_keyboard_is_the_business_of_the_run():
    with open_pool(None, 2, one_by_one=True) as pool:
        for pid in {*pool.map(pool_problems.where, np.full((4, 1), 0.1))}:
            os.kill(pid, signal.SIGINT)
        assert len(pool.map(pool_problems.where, np.full((4, 1), 0.1))) == 4


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"workers": 0}, ValueError),
        ({"workers": 1.5}, TypeError),
        ({"workers": True}, TypeError),
        ({"workers": "2"}, TypeError),
        ({"workers": 2, "pool": pool_problems.Immediate()}, ValueError),
    ],
)
def test_bad_numbers_of_workers_are_refused(options, error):
    with pytest.raises(error, match="^workers: expected"):
        ef.run(POSTERIOR, seed=1, **options)
    with pytest.raises(ValueError, match="^vectorize: "):
        ef.run(POSTERIOR, seed=1, workers=2, vectorize=True)


# --- scripts ----------------------------------------------------------------------


def start(*arguments):
    paths = os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, *arguments],
        env=os.environ | {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


UNGUARDED = """
import multiprocessing, sys
from support.pool_problems import chain, posterior_of

if len(sys.argv) > 1:
    multiprocessing.set_start_method(sys.argv[1], force=True)

def solver(p):
    return [p["k"], 2 * p["m"]]

posterior = posterior_of(solver)
print(chain(posterior=posterior, workers=2) == chain(posterior=posterior))
"""


def run_unguarded(tmp_path, *arguments):
    """Return what it shows and reports as a file, a command and standard input."""
    path = tmp_path / "unguarded.py"
    path.write_text(UNGUARDED)
    begun = [start(str(path), *arguments), start("-c", UNGUARDED, *arguments)]
    found = [process.communicate(timeout=60) for process in begun]
    return [*found, start("-", *arguments).communicate(UNGUARDED, timeout=60)]


@inherits
def test_a_script_needs_no_guard_nor_a_file(tmp_path):
    assert run_unguarded(tmp_path) == [("True\n", "")] * 3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spawn", "forkserver"])
def test_spawned_processes_of_a_script_without_a_guard_ask_for_it(tmp_path, name):
    need_start_method(name)
    messages = [
        'put what the script does under `if __name__ == "__main__":`',
        "could not start (its output says why)",
    ]
    script, command, prompt = run_unguarded(tmp_path, name)
    for (shown, errors), message in zip([script, prompt], messages, strict=True):
        assert message in errors and not shown
    assert command == ("True\n", "")  # which has no file that workers would import


@pytest.mark.parametrize(
    ("kind", "argument", "remedy"),
    [
        (OwnProcesses, "workers", "or give pool=ThreadPoolExecutor"),
        (ProcessPoolExecutor, "pool", r"or give run\(..., workers=8\)"),
    ],
)
def test_what_cannot_be_pickled_is_refused_by_the_argument_that_was_given(
    kind, argument, remedy, monkeypatch
):
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    message = rf"^{argument}: the function .* pip install .* {remedy}"
    with kind(1) as executor, pytest.raises(TypeError, match=message):
        dump(executor, lambda p: p)


STUCK = """
import multiprocessing, sys
from concurrent.futures import ProcessPoolExecutor
from emcee_femu import EvaluationPool
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
        print("kept", error.samplers[0].iteration > 0)
"""


def end(tmp_path, name, mine, send):
    """Return what a run showed whose worker is in a long solve when it is ended."""
    need_start_method(name)
    path = tmp_path / "stuck.py"
    path.write_text(STUCK)
    process = start(str(path), name, mine)
    assert process.stdout.readline() == "working\n"
    begin = time.perf_counter()
    send(process)
    # This waits for every process that can write to the pipe, and so for the workers.
    shown, errors = process.communicate(timeout=30)
    assert time.perf_counter() - begin < 20  # of the minute that the solve takes
    return shown.replace("working\n", ""), errors


ways = pytest.mark.parametrize("name", ["fork", *anew])


@pytest.mark.parametrize("kind", [signal.SIGTERM, KILL])
@pytest.mark.parametrize("mine", ["workers", "executor"])
@ways
def test_no_process_outlives_a_run_that_is_killed(tmp_path, name, mine, kind):
    shown, _ = end(tmp_path, name, mine, lambda process: process.send_signal(kind))
    assert shown == ""


@posix
@ways
def test_the_keyboard_ends_a_run_at_once_and_keeps_the_samples(tmp_path, name):
    def press(process):  # as a terminal does: to all processes
        os.killpg(process.pid, signal.SIGINT)

    shown, _ = end(tmp_path, name, "workers", press)  # a process may be starting still
    assert shown == "kept True\n"
