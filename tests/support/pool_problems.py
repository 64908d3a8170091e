"""What tests of pools share: functions that workers import, chains, an executor."""

import os
import pickle
import signal
import sys
import threading
import time
from concurrent.futures import Executor, Future

import emcee
import numpy as np
import pytest

import emcee_femu as ef

STRUCTURE = ef.paper.mass_spring()
POSTERIOR = STRUCTURE.posterior


class Ballast:
    """A log-density with something to carry."""

    def __init__(self, size=0):
        self.ballast = np.random.default_rng(0).random(size)

    def __call__(self, theta):
        return -0.5 * float(np.dot(theta, theta))


def sleeper(theta):
    time.sleep(0.05)
    return -0.5 * float(theta @ theta)


def wait(theta):
    time.sleep(theta[0])
    return os.getpid()


def kill_at_three(theta):
    if theta[0] == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 1.0


class Awkward(Exception):
    """An exception that pickles but does not unpickle."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def failing(parameters):
    stiff = parameters["k4"] > 2_400
    if stiff:
        raise ArithmeticError("the solver did not converge")
    return [1.0, 2.0, 3.0, 4.0, 5.0]


def awkward(theta):
    raise Awkward(1, 2)


def leave(theta):
    sys.exit("licence server not found")


def refuse():
    raise ImportError("no such solver here")


class Unloadable:
    """Pickles here, but cannot be loaded."""

    def __call__(self, theta):
        return 0.0

    def __reduce__(self):
        return refuse, ()


def posterior_of(function):
    model = ef.FunctionModel(function, n_modes=5)
    return ef.LogPosterior(model, POSTERIOR.terms, POSTERIOR.prior)


def chain(pool=None, steps=8, posterior=POSTERIOR):
    """Return what emcee stores of a run, as one array of bytes."""
    (sampler,) = ef.run(posterior, nwalkers=12, nsteps=steps, seed=5, pool=pool)
    return stored(sampler)


def plain_chain(pool=None, steps=8, posterior=POSTERIOR):
    """Return the same of a plain sampler with another move."""
    move = emcee.moves.StretchMove()
    sampler = emcee.EnsembleSampler(12, 5, posterior, pool=pool, moves=move)
    random = np.random.RandomState(3).get_state()
    start = emcee.State(posterior.start(12, 1), random_state=random)
    sampler.run_mcmc(start, steps)
    return stored(sampler)


def stored(sampler):
    parts = (sampler.get_chain(), sampler.get_log_prob(), sampler.get_blobs())
    return pickle.dumps([np.ascontiguousarray(part).tobytes() for part in parts])


# Python 3.12 and newer warn of every fork in a process with threads, such as pytest's.
forks = pytest.mark.filterwarnings(
    "ignore:This process .* is multi-threaded:DeprecationWarning"
)


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


def finishes(function, seconds=30):
    """Return what it returns or raises; fail if it hangs."""
    found = []

    def call():
        try:
            found.append(function())
        except Exception as error:
            found.append(error)

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(seconds)
    assert found, "it hangs"
    return found[0]
