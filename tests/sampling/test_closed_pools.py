"""A pool that its owner has closed says so: nothing hangs, and nothing is started."""

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing.pool import ThreadPool

import pytest
from support.mpi import leaves_sockets
from support.pool_problems import POSTERIOR, Immediate, chain, finishes, forks
from test_bare_clusters import Client, FakeRay, leaves_files, replace, started_ray
from test_pools import cluster

import emcee_femu as ef

OPENED = {
    "processes": lambda: multiprocessing.get_context("fork").Pool(1),
    "thread pool": lambda: ThreadPool(1),
    "executor": lambda: ProcessPoolExecutor(1, multiprocessing.get_context("fork")),
    "threads": lambda: ThreadPoolExecutor(1),
}
CLOSED = {
    "processes": lambda pool: pool.close(),
    "thread pool": lambda pool: pool.close(),
    "executor": lambda pool: pool.shutdown(),
    "threads": lambda pool: pool.shutdown(),
}
WAYS = {
    "as it is": lambda pool: pool,
    "in an EvaluationPool": ef.EvaluationPool,
    "in one of single walkers": lambda pool: ef.EvaluationPool(pool, 1),
}
every_way = pytest.mark.parametrize("way", WAYS)


def refusal(given):
    """Return what a run with it raises, at once."""
    begin = time.perf_counter()
    error = finishes(lambda: ef.run(POSTERIOR, nsteps=2, seed=1, pool=given))
    assert time.perf_counter() - begin < 5
    assert type(error) is RuntimeError and not hasattr(error, "samplers")
    return str(error)


def says_so(message):
    assert message.startswith("pool: ")
    return "make a new one" in message and ("closed" in message or "shut" in message)


@forks
@every_way
@pytest.mark.parametrize("kind", OPENED)
@pytest.mark.parametrize("used", [False, True])
def test_a_closed_pool_is_refused_by_name(kind, used, way):
    with OPENED[kind]() as pool:
        given = WAYS[way](pool)
        if used:
            chain(given, steps=1)
        CLOSED[kind](pool)
        assert says_so(refusal(given))
    assert says_so(refusal(given))  # and when the block has terminated it


@forks
@every_way
@pytest.mark.parametrize("kind", ["processes", "thread pool"])
def test_a_terminated_pool_is_refused_by_name(kind, way):
    with OPENED[kind]() as pool:
        given = WAYS[way](pool)
    assert says_so(refusal(given))
    assert says_so(refusal(WAYS[way](pool)))  # wrapped only now


@forks
@pytest.mark.parametrize("kind", ["processes", "thread pool"])
def test_the_threads_of_a_closed_pool_are_not_taken_for_dead_processes(kind):
    with OPENED[kind]() as pool:
        given = ef.EvaluationPool(pool)
        pool.close()
        pool.join()  # its threads and processes have ended, as they should
        assert says_so(refusal(given))


def test_an_executor_that_takes_no_tasks_says_why():
    class Refusing(Immediate):
        def submit(self, *arguments):
            raise RuntimeError("no more of that")

    assert "takes no tasks (no more of that); make a new one" in refusal(Refusing())


@every_way
@pytest.mark.parametrize("status", ["closed", "closing"])
def test_a_closed_dask_client_is_refused_by_name(monkeypatch, status, way):
    client = replace(monkeypatch, Client())
    given = WAYS[way](client)
    assert chain(given, steps=1) == chain(steps=1)
    client.status, client.scattered = status, 0
    assert refusal(given) == "pool: the dask Client was closed; make a new one"
    assert not client.scattered


def test_a_dask_cluster_without_workers_is_given_up(monkeypatch):
    class Deserted(Client):
        def scatter(self, payload, hash):
            raise TimeoutError("No valid workers found")

    client = replace(monkeypatch, Deserted())
    assert refusal(client).startswith("pool: a worker of the dask cluster died")


@every_way
def test_ray_that_was_shut_down_is_refused_and_not_started_again(monkeypatch, way):
    module = replace(
        monkeypatch, FakeRay()
    )  # which fails if a task is sent to no cluster
    given = WAYS[way](module)
    assert chain(given, steps=1) == chain(steps=1)
    module.started = False
    if way == "as it is":
        with pytest.raises(ValueError, match=r"^pool: ray was not started.*ray\.init"):
            ef.run(POSTERIOR, nsteps=2, seed=1, pool=given)
    else:
        assert refusal(given) == "pool: ray was shut down; call ray.init() again"


@pytest.mark.slow
@leaves_sockets
def test_a_real_dask_client_that_was_closed_is_refused_by_name():
    with cluster() as (_, client):
        given = [way(client) for way in WAYS.values()]
        chain(given[-1], steps=1)
    for pool in given:
        assert refusal(pool) == "pool: the dask Client was closed; make a new one"


@pytest.mark.slow
@leaves_files
def test_the_real_ray_is_not_started_again(monkeypatch):
    with started_ray(monkeypatch) as ray:
        given = [WAYS[way](ray) for way in WAYS if way != "as it is"]
        chain(given[-1], steps=1)
    for pool in given:
        assert refusal(pool) == "pool: ray was shut down; call ray.init() again"
    with pytest.raises(ValueError, match="^pool: ray was not started"):
        ef.run(POSTERIOR, nsteps=2, seed=1, pool=ray)
    assert not ray.is_initialized()
