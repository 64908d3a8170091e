"""Pools and a run's own processes: the serial chain, clear errors, and a clean end."""

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor

import emcee
import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import pool_problems
from support.pool_problems import POSTERIOR, Immediate, forks, posterior_of, run, sample
from support.runs import assert_same, failures
from support.systems import KILL, inherits, need_start_method, posix

import emcee_femu as ef
from emcee_femu import EvaluationPool

SLOW = pytest.mark.slow
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


@forks
@pytest.mark.parametrize("name", ["fork", "threads", "thread pool", spawn])
def test_every_executor_gives_the_serial_chain_and_a_closed_one_says_so(serial, name):
    with pool_problems.open_executor(name) as executor:
        for pool in (executor, EvaluationPool(executor, 1)):
            agree(sample(pool), serial)
    for pool in (executor, EvaluationPool(executor)):
        with pytest.raises(RuntimeError, match="^pool: .*was closed"):
            sample(pool)


class Mapper:
    """Anything with a map will do."""

    def map(self, function, tasks):
        return map(function, pickle.loads(pickle.dumps(tasks)))


def test_results_keep_their_order_for_every_chunksize_and_number_of_workers(serial):
    points = POSTERIOR.start(11, 2)
    expected = [POSTERIOR(point) for point in points]
    for workers in (1, 3, 20):
        for chunksize in (None, 1, 5, 50):
            pool = EvaluationPool(Immediate(workers), chunksize)
            assert_allclose(pool.map(POSTERIOR, iter(points)), expected, rtol=1e-11)
    assert EvaluationPool(Immediate()).map(POSTERIOR, []) == []
    agree(sample(Mapper()), serial)


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


def in_step(solver):
    """Return a posterior without bounds, so that each proposal is solved."""
    slopes = {"k": np.array([1.0, 0.0]), "m": np.array([0.0, 2.0])}
    model = ef.FunctionModel(
        solver, n_modes=2, jacobian=lambda p: (solver(p), {"frequency": slopes})
    )
    prior = ef.GaussianPrior(["k", "m"], [1.0, 1.0], [0.2, 0.2])
    term = ef.FrequencyTerm([1.0, 2.0], relative_sd=0.1)
    return ef.LogPosterior(model, term, prior)


def test_half_of_each_ensemble_is_on_the_pool_at_once():
    calls, nine = [], threading.Barrier(3 * 6 // 2, timeout=pool_problems.HANGS)

    def solver(p):
        calls.append(1)
        if len(calls) > 1 + 3 * 6:  # after the prior mean and the starts
            nine.wait()
        return linear(p)

    with ThreadPoolExecutor(9) as pool:
        ef.run(in_step(solver), ef.DEMCMove(), 6, 5, ensembles=3, seed=1, pool=pool)
    assert not nine.broken and len(calls) == 1 + 3 * 6 * 6


def test_together_ensembles_are_what_they_are_one_after_another():
    def solver(p):
        time.sleep(1e-3)  # the others have their turn
        return linear(p)

    posterior, guided = in_step(solver), ef.moves.HamiltonianMove([0.04, 0.04], steps=3)
    moves = [(guided, 0.6), (ef.DEMCMove(), 0.4)]
    with ThreadPoolExecutor(4) as threads:
        together, alone = (
            ef.run(posterior, moves, 6, 9, ensembles=3, seed=1, pool=pool)
            for pool in (threads, None)
        )
        for each in (together[0], alone[0]):  # by itself, on the same pool
            each.run_mcmc(None, 3)
    assert_same(together, alone)
    # Of gradients that the move keeps from step to step, none is asked for again.
    assert together.solves == alone.solves


def test_an_error_in_one_ensemble_ends_all_and_keeps_their_samples():
    calls = []

    def solver(p):
        calls.append(1)
        number = len(calls)
        time.sleep(1e-3)  # the others have their turn
        if number == 600:  # each ensemble has had many turns by then
            raise ArithmeticError("it did not converge")
        return linear(p)

    with ThreadPoolExecutor(4) as pool:
        options = dict(ensembles=3, seed=1, pool=pool)
        with pytest.raises(ArithmeticError, match="did not converge") as caught:
            ef.run(in_step(solver), ef.DEMCMove(), 6, 1_000, **options)
        stored, spent = [one.iteration for one in caught.value.run], len(calls)
        time.sleep(0.1)  # the others stop where they wait
    # What was on the pool, half of each ensemble, is solved as the pool is closed.
    assert len(calls) - spent <= 9 and spent < 9_000 and min(stored) >= 1
    assert [one.iteration for one in caught.value.run] == stored


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
    for _ in range(3):  # every sampler wraps the function anew
        pool.map(function, points)
        sampler = emcee.EnsembleSampler(12, 5, function, pool=pool)
        sampler.compute_log_prob(points)
    assert sum(executor.sizes) < 500_000


def test_what_cannot_be_pickled_is_named_and_goes_by_value_or_to_threads(monkeypatch):
    holder, factor = Ballast(threading.Lock()), 2.0
    with pytest.raises(TypeError, match="^pool: .*pickled.*lock"):
        EvaluationPool(Immediate()).map(holder, pool_problems.START)
    with pool_problems.open_executor("threads") as executor:
        assert len(EvaluationPool(executor).map(holder, pool_problems.START)) == 12
    posterior = posterior_of(lambda p: [p["k"], factor * p["m"]])
    expected = [posterior(point) for point in pool_problems.START]
    assert_allclose(
        EvaluationPool(Immediate()).map(posterior, pool_problems.START), expected
    )
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    with pytest.raises(TypeError, match=r"lambda.*pip install cloudpickle"):
        EvaluationPool(Immediate()).map(posterior, pool_problems.START)


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


@forks
@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("fork", "killed"),
        ("workers", "ended"),
        pytest.param("spawn", "killed", marks=spawn.marks),
    ],
)
def test_a_worker_that_dies_ends_the_run_and_keeps_the_samples(name, fault):
    if name != "workers":
        need_start_method(name)
    with pytest.raises(RuntimeError) as caught:
        pool_problems.run_on(name, getattr(pool_problems, fault))
    assert isinstance(caught.value.__cause__, BrokenExecutor)
    (sampler,) = caught.value.run
    assert 0 < sampler.iteration < 100


@forks
@pytest.mark.parametrize(
    ("name", "fault", "kind"),
    [
        ("workers", "left", RuntimeError),
        # Where dask was imported, its tblib lets such an exception travel.
        ("workers", "awkward", (RuntimeError, pool_problems.Awkward)),
        ("fork", "ordinary", ArithmeticError),
        ("threads", "ordinary", ArithmeticError),
    ],
)
def test_an_error_of_the_solver_arrives_with_its_place_or_is_counted(name, fault, kind):
    solver = getattr(pool_problems, fault)
    with pytest.raises(kind) as caught:
        pool_problems.run_on(name, solver)
    assert pool_problems.names_the_place(caught.value)
    assert f"in {fault}" in caught.value.__notes__[-1]  # the worker's traceback
    options = {"steps": 20, "on_failure": "reject", "max_failures": 1.0}
    pooled, serial = (
        pool_problems.run_on(name, solver, **options),
        run(solver, **options),
    )
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
        time.sleep(2 * pool_problems.HANGS)

    starts = np.full((64, 2), 0.9)
    starts[:, 1] += np.linspace(0.0, 0.01, 64)
    starts[0, 0] = 1.0
    with pytest.raises((raised, RuntimeError)) as caught:
        run(solver, posterior=posterior_of(solver), starts=starts, workers=2)
    if raised is ArithmeticError:
        assert "'k': 1.0" in "".join(caught.value.__notes__)
    assert not multiprocessing.active_children()


@forks
def test_a_pool_that_waits_for_ever_for_the_dead_is_refused_with_a_remedy():
    need_start_method("fork")
    with multiprocessing.get_context("fork").Pool(1) as pool:
        for call in (EvaluationPool, sample):
            with pytest.raises(TypeError, match="^pool.*workers=.*ProcessPoolExecutor"):
                call(pool)


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


@SLOW
@pytest.mark.parametrize("method", [pytest.param((), marks=inherits), ("spawn",)])
def test_a_script_needs_a_guard_only_where_none_forks(tmp_path, method):
    """As a file, a command and standard input."""
    path = tmp_path / "unguarded.py"
    path.write_text(UNGUARDED)
    ways = (str(path), *method), ("-c", UNGUARDED, *method), ("-", *method)
    scripts = [pool_problems.start_script(way) for way in ways]
    pairs = zip(scripts, (None, None, UNGUARDED), strict=True)
    file, command, prompt = (
        s.communicate(text, timeout=pool_problems.HANGS) for s, text in pairs
    )
    assert command == ("True\n", "")  # it has no file that workers would import
    if not method:
        assert file == prompt == ("True\n", "")
    else:
        assert "__main__" in file[1] and prompt[1] and file[0] == prompt[0] == ""


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
        print("kept", error.run[0].iteration > 0, multiprocessing.active_children())
        print(pool_problems.sample(steps=2, workers=2)[0].iteration)  # it works again
"""


@pytest.mark.parametrize("name", ["fork", spawn])
@pytest.mark.parametrize(
    ("mine", "kind", "expected"),
    [
        ("workers", KILL, ""),
        pytest.param("executor", signal.SIGTERM, "", marks=SLOW),
        pytest.param("workers", signal.SIGINT, "kept True []\n2\n", marks=posix),
    ],
)
def test_no_process_outlives_a_killed_run(tmp_path, name, mine, kind, expected):
    need_start_method(name)
    path = tmp_path / "stuck.py"
    path.write_text(STUCK)
    process = pool_problems.start_script((str(path), name, mine))
    assert process.stdout.readline() == "working\n"
    if kind == signal.SIGINT:  # as a terminal does: to all processes
        os.killpg(process.pid, kind)
    else:
        process.send_signal(kind)
    # This waits for every process that can write to the pipe, and so for the workers.
    shown, said = process.communicate(
        timeout=pool_problems.HANGS
    )  # half of what the solve takes
    assert shown.replace("working\n", "") == expected
    assert said == "" or name != "fork"  # Ctrl-C is the run's business alone
