"""Clusters: MPI, dask and ray give the chain of a serial run, to the bit."""

import contextlib
import os
import pickle
import signal
import threading
from concurrent.futures import CancelledError
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support import pool_problems
from support.mpi import leaves_sockets, mpiexec
from support.pool_problems import POSTERIOR, chain, posterior_of

from emcee_femu.sampling.pools import back_ends, cluster_tasks, worker
from emcee_femu.sampling.pools.evaluation_pool import EvaluationPool

HERE = Path(__file__).parents[1]


@pytest.mark.slow
def test_mpi_gives_the_serial_chain_and_brings_errors_to_the_master(tmp_path):
    mpiexec(HERE / "support" / "mpi_chain.py", tmp_path / "found.pickle")
    *chains, note = pickle.loads((tmp_path / "found.pickle").read_bytes())
    assert chains == [chain()] * 3
    assert "'k4': 2500.0" in note


@contextlib.contextmanager
def cluster(workers=2):
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    with (
        distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=None
        ) as local,
        distributed.Client(local) as client,
    ):
        yield local, client


@pytest.mark.slow
@leaves_sockets
def test_dask_gives_the_serial_chain_and_survives_its_workers():
    with cluster() as (local, client):
        assert chain(client.get_executor(), steps=2) == chain(steps=2)
        pool = EvaluationPool(client)
        assert chain(pool) == chain()
        assert chain(EvaluationPool(client, 1), steps=2) == chain(steps=2)

        scale = 2.0  # what is not importable goes by value

        def local_function(theta):
            return scale * theta[0]

        assert pool.map(local_function, np.ones((3, 2))) == [2.0] * 3

        points = POSTERIOR.start(8, 1)
        expected = np.array([POSTERIOR(point) for point in points])
        client.run(worker._functions.clear)  # as in processes started anew
        assert np.array_equal(pool.map(POSTERIOR, points), expected)
        local.scale(3)  # one more
        client.wait_for_workers(3)
        assert len(pool._parts(points)) == 3
        assert np.array_equal(pool.map(POSTERIOR, points), expected)

        points[:, 2] = 2_100.0
        points[5, 2] = 2_500.0
        with pytest.raises(ArithmeticError, match="converge") as caught:
            pool.map(posterior_of(pool_problems.failing), points)
        assert "'k4': 2500.0" in caught.value.__notes__[-1]


@leaves_sockets
@pytest.mark.slow  # starts processes anew
def test_dask_does_without_a_worker_that_is_killed_with_all_it_held():
    with cluster() as (_, client):
        pool = EvaluationPool(client, 1)
        expected = pool.map(pool_problems.wait, np.zeros((1, 1)))
        threading.Timer(0.7, os.kill, (expected[0], signal.SIGKILL)).start()
        found = pool.map(pool_problems.wait, np.full((8, 1), 0.4))
        assert len(found) == 8 and len({*found} - {*expected}) >= 1


@leaves_sockets
@pytest.mark.slow  # dask tries four workers before it gives up
def test_dask_gives_up_a_task_that_kills_its_workers():
    with cluster() as (_, client):
        pool = EvaluationPool(client, 1)
        with pytest.raises(RuntimeError, match="dask cluster died"):
            pool.map(pool_problems.kill_at_three, np.arange(8.0)[:, None])


class FakeDask:
    """A scheduler that loses its scattered data a number of times, then its worker."""

    asynchronous = False

    class KilledWorker(Exception):
        pass

    def __init__(self, losses=0, killed=False):
        self.losses, self.killed, self.scattered = losses, killed, 0

    def as_completed(self, with_results):
        self.queue = []
        return self

    def nthreads(self):
        return {"one": 1}

    def scatter(self, payload, hash):
        self.scattered += 1
        return SimpleNamespace(status="finished", payload=payload)

    def submit(self, function, digest, points, carrier, pure):
        future = SimpleNamespace(key=object())
        if carrier is None:
            result = function(digest, points)
        elif carrier.status == "finished" and not self.losses:
            result = function(digest, points, carrier.payload)
        else:
            self.losses -= carrier.status == "finished"
            carrier.status = "cancelled"
            result = CancelledError("lost")
        self.queue.append((future, result))
        return future

    def add(self, future):
        assert self.queue[-1][0] is future

    def clear(self):
        self.queue.clear()

    def __next__(self):
        if self.killed:
            raise self.KilledWorker("evaluate")
        return self.queue.pop(0)


@pytest.mark.parametrize("losses", [0, 1, 3])
def test_what_dask_lost_is_sent_again(monkeypatch, losses):
    dask = FakeDask(losses)
    monkeypatch.setattr(cluster_tasks, "import_module", lambda name: dask)
    monkeypatch.setattr(back_ends, "_cloudpickle", pickle.dumps)
    worker._functions.clear()
    points = POSTERIOR.start(4, 1)
    found = EvaluationPool(dask, 1).map(POSTERIOR, points)
    assert np.array_equal(found, [POSTERIOR(point) for point in points])
    assert dask.scattered == 1 + losses


@pytest.mark.parametrize("fault", [{"losses": 10**6}, {"killed": True}])
def test_dask_that_loses_everything_is_given_up(monkeypatch, fault):
    dask = FakeDask(**fault)
    monkeypatch.setattr(cluster_tasks, "import_module", lambda name: dask)
    monkeypatch.setattr(back_ends, "_cloudpickle", pickle.dumps)
    worker._functions.clear()
    with pytest.raises(RuntimeError, match="dask cluster died.*resume"):
        EvaluationPool(dask, 1).map(POSTERIOR, POSTERIOR.start(4, 1))


def test_an_asynchronous_client_is_refused():
    class Asynchronous:
        scatter = submit = nthreads = None
        asynchronous = True

    with pytest.raises(TypeError, match="asynchronous=False"):
        EvaluationPool(Asynchronous())


# ray leaves sockets and log files open when it shuts down, and reads an old setting.
@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore::ResourceWarning",
    "ignore::pytest.PytestUnraisableExceptionWarning",
    "ignore::FutureWarning:ray",
    "ignore::DeprecationWarning:ray",
)
def test_ray_gives_the_serial_chain_and_survives_its_workers(monkeypatch):
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")  # no token in the home directory
    monkeypatch.setenv("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    paths = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", paths)  # its workers import pool_problems
    ray = pytest.importorskip("ray", reason="ray is not installed")
    with pytest.raises(ValueError, match=r"ray\.init"):
        EvaluationPool(ray)
    from ray.util.multiprocessing import Pool

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        pool = EvaluationPool(ray)
        assert len(pool._parts(np.zeros((8, 5)))) == 2
        assert chain(pool) == chain()
        points = POSTERIOR.start(8, 1)
        points[:, 2] = 2_100.0
        points[5, 2] = 2_500.0
        with pytest.raises(ArithmeticError, match="converge") as caught:
            pool.map(posterior_of(pool_problems.failing), points)
        assert "'k4': 2500.0" in caught.value.__notes__[-1]
        with pytest.raises(RuntimeError, match="worker of ray died"):
            pool.map(pool_problems.kill_at_three, np.arange(8.0)[:, None])
        assert chain(pool) == chain()  # new processes are sent the posterior
        processes = Pool(2)
        assert chain(processes, steps=2) == chain(steps=2)
        assert chain(EvaluationPool(processes, 3)) == chain()
        processes.terminate()
    finally:
        ray.shutdown()
