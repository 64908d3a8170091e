"""A dask Client, the module ray and MPI given to run as they are."""

import os
import pickle
import re
import types
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
from support.mpi import leaves_sockets, mpiexec
from support.pool_problems import POSTERIOR, Awkward, chain
from test_bare_pools import awkward, killed, left, names_the_place, ordinary, run
from test_pools import HERE, FakeDask, cluster

import emcee_femu as ef
from emcee_femu.sampling.pools import back_ends, cluster_tasks, worker


class Client(FakeDask):
    """A dask client, whose own map returns what emcee cannot use."""

    status = "running"

    def nthreads(self):
        assert self.status == "running", "nobody answers"
        return super().nthreads()

    def map(self, function, points):
        raise AssertionError("the map of a dask client returns futures")


class FakeRay(types.ModuleType):
    """The module ray, which would start a cluster where there is none."""

    class exceptions:
        class RayError(Exception):
            pass

    def __init__(self, started=True):
        super().__init__("ray")
        self.started, self.results = started, {}

    def is_initialized(self):
        return self.started

    def init(self):
        raise AssertionError("it started a cluster of its own")

    def cluster_resources(self):
        return {"CPU": 2.0} if self.started else self.init()

    def put(self, value):
        return value if self.started else self.init()

    def remote(self, function):
        def submit(*arguments):
            if not self.started:
                self.init()
            self.results[reference := object()] = function(*arguments)
            return reference

        return types.SimpleNamespace(remote=submit)

    def wait(self, references, num_returns):
        return references[-1:], references[:-1]

    def get(self, reference):
        return self.results[reference]

    def cancel(self, reference):
        pass


def replace(monkeypatch, cluster):
    """Put it in the place of dask or ray; the worker's memory starts empty."""
    monkeypatch.setattr(cluster_tasks, "import_module", lambda name: cluster)
    monkeypatch.setattr(back_ends, "_cloudpickle", pickle.dumps)
    worker._functions.clear()
    return cluster


@pytest.mark.parametrize("cluster", [Client, FakeRay])
def test_a_bare_cluster_gives_the_serial_chain(monkeypatch, cluster):
    assert chain(replace(monkeypatch, cluster())) == chain()


def test_what_run_cannot_use_is_refused_by_its_name(monkeypatch):
    monkeypatch.setattr(FakeDask, "asynchronous", True)
    with pytest.raises(TypeError, match="^pool: .* asynchronous=False"):
        ef.run(POSTERIOR, nsteps=1, seed=1, pool=Client())
    with pytest.raises(ValueError, match=r"^pool: ray was not started.*ray\.init"):
        ef.run(POSTERIOR, nsteps=1, seed=1, pool=FakeRay(started=False))
    for bad in (os, types.ModuleType("raylib"), ThreadPoolExecutor, 2):
        with pytest.raises(TypeError, match="^pool: expected"):
            ef.run(POSTERIOR, nsteps=1, seed=1, pool=bad)


def gives_the_chain_and_named_errors(pool):
    assert chain(pool) == chain()
    errors = {
        ordinary: ArithmeticError,
        left: RuntimeError,
        awkward: (RuntimeError, Awkward),  # dask's tblib lets some of them travel
    }
    for fault, kind in errors.items():
        with pytest.raises(kind) as caught:
            run(pool, fault)
        assert names_the_place(caught.value)


@pytest.mark.slow
@leaves_sockets
def test_a_real_dask_client_may_be_given_as_it_is(monkeypatch):
    paths = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", paths)  # its workers import this file
    with cluster() as (_, client):
        gives_the_chain_and_named_errors(client)


@contextmanager
def started_ray(monkeypatch):
    """The module ray, with two processes."""
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")  # no token in the home directory
    monkeypatch.setenv("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    paths = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", paths)  # its workers import this file
    module = pytest.importorskip("ray", reason="ray is not installed")
    module.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        yield module
    finally:
        module.shutdown()


def leaves_files(test):
    """Ray leaves sockets and log files open, and reads an old setting."""
    return pytest.mark.filterwarnings(
        "ignore::ResourceWarning",
        "ignore::pytest.PytestUnraisableExceptionWarning",
        "ignore::FutureWarning:ray",
        "ignore::DeprecationWarning:ray",
    )(test)


@pytest.mark.slow
@leaves_files
def test_the_real_module_ray_may_be_given_as_it_is(monkeypatch):
    with started_ray(monkeypatch) as ray:
        gives_the_chain_and_named_errors(ray)
        with pytest.raises(RuntimeError, match="^pool: a worker of ray died"):
            run(ray, killed)


MPI = """
import sys
sys.path.insert(0, HERE)
import test_bare_pools
from schwimmbad import MPIPool

with MPIPool() as pool:
    test_bare_pools.run(pool, getattr(test_bare_pools, sys.argv[1]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("ordinary", "ArithmeticError: the solver did not converge"),
        ("left", "RuntimeError: .*SystemExit.*licence server not found"),
        ("awkward", "RuntimeError: Awkward: 1 and 2"),
    ],
)
def test_an_error_on_a_worker_of_mpi_fails_the_job(tmp_path, monkeypatch, fault, error):
    script = tmp_path / "job.py"
    script.write_text(MPI.replace("HERE", repr(str(HERE / "sampling"))))
    paths = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", paths)
    # mpiexec() asserts that the exit code is 0; else it says what the job wrote.
    with pytest.raises(AssertionError, match=error) as caught:
        mpiexec(script, fault)
    assert re.search(r"Raised on a worker at \{'k': 1\.", str(caught.value))
