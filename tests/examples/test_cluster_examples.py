"""The examples that use a cluster, on two workers of this machine."""

import importlib
import re

import numpy as np
import pytest
from scipy import integrate, stats
from support.examples import EXAMPLES, load
from support.mpi import leaves_sockets, mpiexec
from support.pool_problems import forks

import emcee_femu as ef


def serial(generations, seed):
    """Return the chain of the posterior that both examples sample, without a pool."""
    structure = ef.paper.mass_spring()

    def solver(parameters):
        one = {name: np.array([value]) for name, value in parameters.items()}
        return structure.model(one).frequencies[0]

    posterior = ef.LogPosterior(
        ef.FunctionModel(solver, n_modes=5),
        structure.posterior.terms,
        structure.posterior.prior,
    )
    (sampler,) = ef.run(posterior, nwalkers=16, nsteps=generations, seed=seed)
    return sampler.get_chain()


@pytest.mark.slow
@leaves_sockets
def test_cluster_dask(capsys):
    pytest.importorskip("distributed", reason="dask is not installed")
    chain = load("cluster_dask").main(generations=10, seconds=0.001, seed=2)
    assert np.array_equal(chain, serial(10, 2))
    shown = capsys.readouterr().out
    assert "2 workers at tcp://" in shown and "176 points by 16 walkers" in shown
    assert "Updating parameters" in shown


@pytest.mark.slow
def test_cluster_mpi():
    shown = mpiexec(
        EXAMPLES / "cluster_mpi.py", "--generations", 10, "--seconds", 0.001
    )
    assert shown.count("2 workers: 176 points by 16 walkers") == 1  # of one rank only
    mean = float(re.search(r"^k1 .*", shown, re.MULTILINE)[0].split()[4])
    expected = serial(10, 1)[5:, :, 0].mean()
    assert abs(mean - expected) < 0.1  # what the table rounds


@forks
@pytest.mark.slow
def test_cluster_scaling(capsys, monkeypatch):
    monkeypatch.syspath_prepend(
        EXAMPLES / "benchmarks"
    )  # the worker processes import it
    example = importlib.import_module("cluster_scaling")
    tables = example.main(rounds=1, most=8, seconds=0.005)
    measured, *simulated = tables
    assert measured.column("model") == [
        "5 ms busy",
        "5 ms waiting",
        "free",
        "free, 1 MB",
    ]
    shown = capsys.readouterr().out
    assert all(str(table) in shown for table in tables)
    assert [table.column("workers") for table in simulated] == [[1, 2, 8]] * 4
    for table in simulated:
        for row in table.rows:
            assert (np.diff(row[1:]) > -1).all()  # a larger ensemble is used better


def test_simulated_scaling_has_the_closed_forms():
    scaling = load("cluster_scaling")
    # Equal times: as many rounds as it takes.
    for workers, jobs in [(1, 5), (4, 4), (4, 5), (7, 30), (1_000, 1_500)]:
        rounds = -(-jobs // workers)
        expected = jobs / (workers * rounds)
        assert scaling.efficiency(workers, jobs, 0.0) == pytest.approx(expected)
    # One job a worker: the mean time over the expected longest one.
    sigma = np.sqrt(np.log1p(0.5**2))
    law = stats.lognorm(sigma, scale=np.exp(-0.5 * sigma**2))
    for workers in (2, 20, 200):
        longest, _ = integrate.quad(
            lambda t, n=workers: -np.expm1(n * law.logcdf(t)), 0, 60, limit=200
        )
        found = scaling.efficiency(workers, workers, 0.5, repeats=4_000)
        assert found == pytest.approx(1 / longest, rel=0.03)
    # A master that hands out nothing else: its own time is the limit.
    assert scaling.efficiency(1_000, 4_000, 0.0, dispatch=0.1) == pytest.approx(
        4_000 / (1_000 * (4_000 * 0.1 + 1))
    )
    assert scaling.makespan([3.0, 1.0, 1.0, 2.0], 2) == 4.0  # 3 | 1, 1, 2 in turn
