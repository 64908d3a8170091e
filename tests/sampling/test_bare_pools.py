"""A bare pool given to run: the serial chain, and nothing that hangs."""

import multiprocessing
import os
import re
import signal
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing.pool import ThreadPool

import numpy as np
import pytest
from support.pool_problems import Awkward, Immediate, chain, finishes, forks

import emcee_femu as ef
from emcee_femu.sampling.pools import worker

LIMIT = 1.3  # which no walker is beyond at first
PRIOR = ef.GaussianPrior(["k", "m"], [1.0, 1.0], [0.2, 0.2], bounds=[(0.1, 2.0)] * 2)
START = np.random.default_rng(0).uniform(0.95, 1.05, (12, 2))


def killed(p):
    os.kill(os.getpid(), signal.SIGKILL)


def ended(p):
    os._exit(0)


def left(p):
    sys.exit("licence server not found")


def awkward(p):
    raise Awkward(1, 2)


def ordinary(p):
    raise ArithmeticError("the solver did not converge")


class Beyond:
    """A solver that does something else beyond the limit."""

    def __init__(self, fault):
        self.fault, self.home = fault, os.getpid()

    def __call__(self, p):
        if p["k"] > LIMIT:
            at_home = os.getpid() == self.home
            assert not (at_home and self.fault in (killed, ended)), "it would end us"
            self.fault(p)
        return [p["k"], 2 * p["m"]]


def run(pool, fault, **options):
    model = ef.FunctionModel(Beyond(fault), n_modes=2)
    term = ef.FrequencyTerm([1.0, 2.0], relative_sd=0.2)
    posterior = ef.LogPosterior(model, term, PRIOR)
    settings = {"nwalkers": 12, "nsteps": 100, "seed": 1, "initial": START}
    return ef.run(posterior, pool=pool, **settings | options)


def opened(name):
    context = multiprocessing.get_context
    return {
        "fork": lambda: context("fork").Pool(2),
        "short-lived": lambda: context("fork").Pool(2, maxtasksperchild=50),
        "spawn": lambda: context("spawn").Pool(2),
        "executor": lambda: ProcessPoolExecutor(2, context("fork")),
        "thread pool": lambda: ThreadPool(2),
        "threads": lambda: ThreadPoolExecutor(2),
    }[name]()


spawn = pytest.param("spawn", marks=pytest.mark.slow)  # starts processes anew


def error_of(name, fault):
    """Return what a run with a bare pool raises; fail if it hangs, or raises nothing.

    What hangs may be the end of the block, too.
    """

    def work():
        with opened(name) as pool:
            run(pool, fault)

    error = finishes(work)
    assert isinstance(error, Exception), f"the run ended with {error!r}"
    return error


def names_the_place(error):
    """Return whether message and notes name one parameter set, one beyond the limit."""
    text = "\n".join([str(error), *error.__notes__])
    places = {*re.findall(r"\{'k': ([0-9.]+), 'm': [0-9.]+\}", text)}
    return len(places) == 1 and float(places.pop()) > LIMIT


# --- what goes wrong --------------------------------------------------------------


@forks
@pytest.mark.parametrize(
    ("fault", "cause"), [(killed, "signal 9"), (ended, "exit code 0")]
)
@pytest.mark.parametrize("name", ["fork", spawn])
def test_a_worker_that_dies_ends_the_run_of_a_bare_pool(name, fault, cause):
    error = error_of(name, fault)
    assert type(error) is RuntimeError
    assert re.match(rf"pool: worker process \d+ died \({cause}", str(error))
    (sampler,) = error.samplers
    assert 0 < sampler.iteration < 100  # what was sampled is kept


@forks
@pytest.mark.parametrize("fault", [killed, ended])
def test_a_worker_that_dies_ends_the_run_of_a_bare_executor(fault):
    error = error_of("executor", fault)
    assert type(error) is RuntimeError
    assert str(error).startswith("pool: a worker of the executor died")


@forks
@pytest.mark.parametrize(
    ("fault", "kind", "message"),
    [
        (left, RuntimeError, "SystemExit.*licence server not found"),
        # Where dask was imported, its tblib lets such an exception travel.
        (awkward, (RuntimeError, Awkward), "1 and 2"),
        (ordinary, ArithmeticError, "^the solver did not converge$"),
    ],
)
@pytest.mark.parametrize(
    "name", ["fork", "short-lived", spawn, "executor", "thread pool", "threads"]
)
def test_an_error_on_a_worker_of_a_bare_pool_names_the_parameters(
    name, fault, kind, message
):
    error = error_of(name, fault)
    assert isinstance(error, kind) and re.search(message, str(error))
    assert names_the_place(error)
    assert f"in {fault.__name__}" in error.__notes__[-1]  # the worker's traceback


def leaving_term(parameters, modes):
    sys.exit("no such measurement")


@forks
def test_a_term_that_leaves_on_a_worker_ends_the_run_of_a_bare_pool():
    model = ef.FunctionModel(Beyond(ordinary), n_modes=2)
    posterior = ef.LogPosterior(model, leaving_term, PRIOR)

    def work():
        with opened("fork") as pool:
            ef.run(posterior, nsteps=1, seed=1, pool=pool, initial=START, nwalkers=12)

    error = finishes(work)
    assert type(error) is RuntimeError and "no such measurement" in str(error)
    assert re.search(r"at \{'k': [0-9.]+, 'm': [0-9.]+\}", error.__notes__[-1])


@forks
@pytest.mark.parametrize("fault", [left, awkward, ordinary])
def test_errors_on_workers_of_a_bare_pool_can_be_rejected(fault):
    options = {"nsteps": 20, "on_failure": "reject", "max_failures": 1.0}

    def work():
        with opened("fork") as pool:
            return run(pool, fault, **options)

    (sampler,) = finishes(work)
    (serial,) = run(None, fault, **options)
    assert np.array_equal(sampler.get_chain(), serial.get_chain())
    assert sampler.failures.causes == serial.failures.causes
    assert sampler.failures.causes["exception"] > 0


# --- the same chain ---------------------------------------------------------------


@forks
@pytest.mark.parametrize(
    "name", ["fork", "short-lived", spawn, "executor", "thread pool", "threads"]
)
def test_a_bare_pool_gives_the_serial_chain_to_the_bit(name):
    with opened(name) as pool:
        assert chain(pool) == chain()


def test_a_bare_pool_evaluates_walker_by_walker():
    bare, other = Immediate(), Immediate()
    worker._functions.clear()
    assert chain(bare) == chain(ef.EvaluationPool(other, 6)) == chain()
    # Start and 8 steps of 12 walkers, which do not have the posterior at first.
    assert len(bare.sizes) == 12 + 9 * 12
    assert len(other.sizes) == 9 * 2  # a pool of ours stays as it is
