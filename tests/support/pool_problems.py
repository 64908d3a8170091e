"""What tests of pools share: solvers that misbehave on workers, chains, executors."""

import multiprocessing
import os
import pickle
import re
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing.pool import ThreadPool

import numpy as np
import pytest

import emcee_femu as ef

from .examples import TESTS
from .systems import KILL, need_start_method

POSTERIOR = ef.paper.mass_spring().posterior
LIMIT = 1.3  # which no walker of START is beyond
HANGS = 300.0  # s, after which what a busy machine does in a second is said to hang
PRIOR = ef.GaussianPrior(["k", "m"], [1.0, 1.0], [0.2, 0.2], bounds=[(0.1, 2.0)] * 2)
START = np.random.default_rng(0).uniform(0.95, 1.05, (12, 2))

# Python 3.12 and newer warn of every fork in a process with threads, such as pytest's.
forks = pytest.mark.filterwarnings(
    "ignore:This process .* is multi-threaded:DeprecationWarning"
)


def killed(p):
    os.kill(os.getpid(), KILL)


def ended(p):
    os._exit(0)


def left(p):
    sys.exit("licence server not found")


class Awkward(Exception):
    """An exception that pickles but does not unpickle."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def awkward(p):
    raise Awkward(1, 2)


def ordinary(p):
    raise ArithmeticError("the solver did not converge")


def where(theta):
    time.sleep(theta[0])
    return os.getpid()


def stuck(p):
    print("working", flush=True)
    time.sleep(2 * HANGS)


class Beyond:
    """A solver with a fault beyond the limit."""

    def __init__(self, fault):
        self.fault, self.home = fault, os.getpid()

    def __call__(self, p):
        if p["k"] > LIMIT:
            at_home = os.getpid() == self.home
            assert not (at_home and self.fault in (killed, ended)), "it would end us"
            return self.fault(p)
        return [p["k"], 2 * p["m"]]


def posterior_of(function):
    term = ef.FrequencyTerm([1.0, 2.0], relative_sd=0.1)
    return ef.LogPosterior(ef.FunctionModel(function, n_modes=2), term, PRIOR)


def run(fault, posterior=None, **options):
    """Sample where the solver has that fault beyond the limit."""
    settings = {"nwalkers": len(options.get("starts", START)), "steps": 100}
    settings |= {"ensembles": 1, "seed": 1, "starts": START} | options
    posterior = posterior or posterior_of(Beyond(fault))
    return ef.run(posterior, ef.DEMCMove(), **settings)


def run_on(name, fault, **options):
    """Sample so on an executor of that name, or on a run's own processes."""
    if name == "workers":
        return run(fault, workers=2, **options)
    with open_executor(name) as pool:
        return run(fault, pool=pool, **options)


def places(error):
    """Return k of every parameter set that an error's message names, or its notes."""
    notes = [note.partition("\n")[0] for note in getattr(error, "__notes__", ())]
    for text in (str(error), "\n".join(notes)):
        found = re.findall(r"\{'k': ([0-9.]+), 'm': [0-9.]+\}", text)
        if found:
            return {float(k) for k in found}
    return set()


def names_the_place(error):
    """Return whether message and notes name one parameter set, one beyond the limit."""
    return len(places(error)) == 1 and min(places(error)) > LIMIT


def sample(pool=None, steps=8, posterior=POSTERIOR, moves=None, **options):
    """Return a run of which nothing goes wrong, somewhere."""
    options = {"nwalkers": 12, "ensembles": 1, "seed": 5, "pool": pool} | options
    return ef.run(posterior, moves or ef.DEMCMove(), steps=steps, **options)


def start_script(arguments):
    """Start Python with these arguments, in a session of its own."""
    paths = os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")])
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    return subprocess.Popen(
        [sys.executable, *arguments],
        env=os.environ | {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1"},
        text=True,
        start_new_session=True,
        **pipes,
    )


def open_executor(name):
    """Return two workers, by a start method or a kind of threads."""
    if name == "threads":
        return ThreadPoolExecutor(2)
    if name == "thread pool":
        return ThreadPool(2)
    need_start_method(name)
    return ProcessPoolExecutor(2, multiprocessing.get_context(name))


class Immediate(Executor):
    """Executes at once, in this process, and records what would travel."""

    def __init__(self, workers=2):
        self._max_workers = workers
        self.sizes = []

    def submit(self, function, *arguments):
        self.sizes.append(len(pickle.dumps((function, arguments))))
        future = Future()
        future.set_result(function(*pickle.loads(pickle.dumps(arguments))))
        return future
