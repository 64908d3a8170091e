"""Every script runs, shortened by its arguments, and says what its page says."""

import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from support.examples import EXAMPLES, TESTS, load
from support.systems import leaves_sockets

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


def run_mass_spring(folder, *options):
    """Return what the script prints, of which no library's warning may be a part."""
    shown = subprocess.run(
        [sys.executable, str(EXAMPLES / "mass_spring.py"), "--output", str(folder)]
        + list(options),
        env=os.environ | {"XDG_CACHE_HOME": str(folder / "cache")},  # ArviZ is new
        capture_output=True,
        text=True,
        check=True,
    )
    assert "Warning" not in shown.stderr
    listed = re.search(
        rf"Written to {re.escape(str(folder))}:\n((?:    .*\n)+)", shown.stdout
    )
    assert {path.name for path in folder.glob("*.*")} == {
        *listed[1].replace(",", "").split()
    }
    return shown


@pytest.mark.slow
def test_mass_spring(tmp_path):
    """The README's first command: sentences, tables, verdict, and what to do next."""
    shown = run_mass_spring(tmp_path)
    assert shown.stderr == ""  # no bar in a pipe
    text = shown.stdout.replace(str(tmp_path), "figures").replace(
        sys.executable, "python"
    )
    assert max(map(len, text.splitlines())) <= 80
    parameters, frequencies = text.split("\n\n")[1:3]
    assert " N/m " in parameters and "measured Hz" in frequencies
    before, after = re.findall(r"([\d.]+) % (?:before|after)", frequencies)
    assert float(before) == pytest.approx(2.04) and float(after) < 0.03
    assert re.search(r"Chains: converged.*Search: .*Fit: ", text, re.S)
    assert "scatter.png" in text and "parameters.csv" in text
    page = re.search(r"python (examples/\S+)", text)[1]
    assert (EXAMPLES.parent / page).exists()


def begin(path):
    """Return what a page has made when its samples are an ArviZ object."""
    found = {}
    for cell in re.split(r"\n# %%.*", Path(path).read_text(encoding="utf-8")):
        exec(cell, found)
        if "idata" in found:
            return found


@pytest.mark.slow
def test_front_picture(tmp_path, monkeypatch, capsys):
    """Its numbers are those of the captions; the committed one has its size."""
    monkeypatch.chdir(tmp_path)  # the tutorial writes files
    front = load("front_picture")
    monkeypatch.setattr(front.runpy, "run_path", begin)
    committed = plt.imread(inspect.signature(front.main).parameters["output"].default)
    with plt.rc_context():
        front.main(tmp_path / "front.png")
    assert plt.imread(tmp_path / "front.png").shape == committed.shape
    before, after = re.findall(r"([\d.]+) % (?:before|after)", capsys.readouterr().out)
    for page in ("README.md", "docs/index.md"):
        text = (EXAMPLES.parent / page).read_text(encoding="utf-8")
        assert f"falls from {before} % to {after} %" in text


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
    """The law of the script: on a cluster of dask the serial chain."""
    pytest.importorskip("distributed", reason="dask is not installed")
    chain = load("cluster").main(steps=10, seconds=0.001, seed=2)
    assert np.array_equal(chain, serial(10, 2))
    shown = capsys.readouterr().out
    assert "2 workers: 16 walkers" in shown and "Updating parameters" in shown
