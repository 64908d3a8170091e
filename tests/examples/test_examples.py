"""Every script runs, shortened by its arguments, and says what its page says."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
from support.examples import EXAMPLES, TESTS, load
from support.mpi import leaves_sockets, mpiexec

import emcee_femu as ef

SECTIONS = {"start", "tutorials", "how_to", "explanation"}  # of the site: tests/docs
PAGES = sorted(p for p in EXAMPLES.rglob("*.py") if p.parent.name not in SECTIONS)


def test_every_script_has_a_command_and_a_test():
    tests = "".join(
        p.read_text(encoding="utf-8") for p in (TESTS / "examples").glob("test_*.py")
    )
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        assert text.startswith('"""') and "python examples/" in text
        assert f"def test_{path.stem}(" in tests, path.name


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.stem)
def test_scripts_do_nothing_on_import(path, capsys):
    load(path.relative_to(EXAMPLES).with_suffix("").as_posix())
    assert capsys.readouterr().out == ""


def test_mass_spring(tmp_path):
    """As the README's first command: it also prints no warning of a library."""
    options = ["--generations", "1000", "--ensembles", "2", "--output", str(tmp_path)]
    shown = subprocess.run(
        [sys.executable, str(EXAMPLES / "mass_spring.py"), *options],
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")},  # ArviZ is new
        capture_output=True,
        text=True,
        check=True,
    )
    assert all(text in shown.stdout for text in ("TAE", "k8", str(tmp_path.resolve())))
    assert "ensemble 2/2" in shown.stderr  # the progress bar
    assert "Warning" not in shown.stderr
    files = {path.name for path in tmp_path.glob("*.*")}
    assert files == {
        *(f"{name}.png" for name in ("scatter", "tae", "correlation", "proposals")),
        *(f"{name}.csv" for name in ("parameters", "frequencies")),
    }


def serial(steps, seed):
    """Return the chain of the posterior of the cluster script, without a pool."""
    structure = ef.paper.mass_spring()

    def solver(parameters):
        one = {name: np.array([value]) for name, value in parameters.items()}
        return structure.model(one).frequencies[0]

    model = ef.FunctionModel(solver, n_modes=5)
    given = structure.posterior
    posterior = ef.LogPosterior(model, given.terms, given.prior)
    move = ef.DEMCMove()
    run = ef.run(posterior, move, nwalkers=16, steps=steps, ensembles=1, seed=seed)
    return run[0].get_chain()


@pytest.mark.slow
@leaves_sockets
def test_cluster(capsys):
    pytest.importorskip("distributed", reason="dask is not installed")
    chain = load("cluster").main(steps=10, seconds=0.001, seed=2)
    assert np.array_equal(chain, serial(10, 2))
    shown = capsys.readouterr().out
    assert "2 workers: 16 walkers" in shown and "Updating parameters" in shown


@pytest.mark.slow
def test_cluster_by_mpi():
    options = ("--mpi", "--steps", 10, "--seconds", 0.001)
    shown = mpiexec(EXAMPLES / "cluster.py", *options)
    assert shown.count("2 workers: 16 walkers") == 1  # of one rank only
    mean = float(re.search(r"^k1 .*", shown, re.MULTILINE)[0].split()[4])
    expected = serial(10, 1)[5:, :, 0].mean()
    assert abs(mean - expected) < 0.1  # what the table rounds
