"""Every script runs, shortened by its arguments, and says what its page says."""

import inspect
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

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


PROGRAMS = {"opensees": "openseespy", "pynite": "Pynite", "scikit_fem": "skfem"}


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_page_can_be_imported_without_its_program(name, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, PROGRAMS[name], None)
    load(f"how_to/{name}")
    assert capsys.readouterr().out == ""


@pytest.mark.slow
def test_mass_spring(tmp_path):
    """The README's first command: tables, verdict, files, and what to do next."""
    shown = subprocess.run(
        [sys.executable, str(EXAMPLES / "mass_spring.py"), "--output", str(tmp_path)],
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")},  # ArviZ is new
        capture_output=True,
        text=True,
        check=True,
    )
    assert shown.stderr == ""  # no bar in a pipe, no warning of a library
    text = shown.stdout
    listed = re.search(r"Written to .*:\n((?:    .*\n)+)", text)[1]
    assert {p.name for p in tmp_path.glob("*.*")} == {*listed.replace(",", "").split()}
    plain = text.replace(str(tmp_path), "figures").replace(sys.executable, "python")
    assert max(map(len, plain.splitlines())) <= 80
    before, after = re.findall(r"([\d.]+) % (?:before|after)", text)
    assert float(before) == pytest.approx(2.04) and float(after) < 0.03
    assert re.search(r"Chains: converged.*Search: .*Fit: ", text, re.S)
    page = re.search(r"python (examples/\S+)", plain)[1]
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
    """Its numbers are those of the captions; the committed one has its marks."""
    monkeypatch.chdir(tmp_path)  # the tutorial writes files
    front = load("front_picture")
    monkeypatch.setattr(front.runpy, "run_path", begin)
    committed = inspect.signature(front.main).parameters["output"].default
    front.main(tmp_path / "front.svg")
    drawn, kept = (
        [mark.tag for mark in ElementTree.parse(path).iter()]
        for path in (tmp_path / "front.svg", committed)
    )
    assert drawn == kept and sum(tag.endswith("animate") for tag in kept) > 10
    before, after = re.findall(r"([\d.]+) % (?:before|after)", capsys.readouterr().out)
    assert 0 < 5 * float(after) < float(before)


@pytest.mark.slow
@leaves_sockets
def test_cluster(capsys):
    """The law of the script: on a cluster of dask the serial chain."""
    pytest.importorskip("distributed", reason="dask is not installed")
    chain = load("cluster").main(steps=10, seconds=0.001, seed=2)
    structure = ef.paper.mass_spring()

    def solver(parameters):
        one = {name: np.array([value]) for name, value in parameters.items()}
        return structure.model(one).frequencies[0]

    given, model = structure.posterior, ef.FunctionModel(solver, n_modes=5)
    posterior = ef.LogPosterior(model, given.terms, given.prior)
    run = ef.run(posterior, ef.DEMCMove(), 16, steps=10, ensembles=1, seed=2)
    assert np.array_equal(chain, run[0].get_chain())
    shown = capsys.readouterr().out
    assert "2 workers: 16 walkers" in shown and "Updating parameters" in shown


# By 162 x 162 matrices that were assembled outside this package.
NOMINAL = [5.582335061, 15.44511530, 32.32350686, 32.37585002, 37.22241568]
NOMINAL += [44.59372994, 52.54484140, 54.57656609, 60.99930558, 70.49955246]


def test_garteur(capsys):
    example = load("garteur")
    model = example.garteur(n_modes=10)
    np.testing.assert_allclose(model({}).frequencies[0], NOMINAL, rtol=1e-6)
    factors = ["density", "wing small", "wing large", "wing torsion", "fin torsion"]
    scaled = example.garteur(factors, n_modes=10)
    ones = {name: np.ones(1) for name in factors}
    assert {*scaled.names} == {*factors}
    np.testing.assert_allclose(scaled(ones).frequencies[0], NOMINAL, rtol=1e-6)
    runpy.run_path(str(EXAMPLES / "garteur.py"), run_name="__main__")
    assert "162 DOFs, 41.7 kg" in capsys.readouterr().out


def test_a_stiff_joint_is_none_and_a_layer_without_stiffness_is_mass():
    example = load("garteur")
    joined = example.garteur(joint=True)({"joint": np.array([1e3])}).frequencies[0]
    np.testing.assert_allclose(joined, NOMINAL[:8], rtol=2e-3)
    covered = example.garteur(layer=True)({"layer": np.array([1e-6, 1.0])})
    assert (covered.frequencies[0] < NOMINAL[:8]).all()
    # Bonded, by hand: 1.3 times the bending stiffness of the wing.
    share = covered.frequencies[1, 0] / covered.frequencies[0, 0]
    assert 1.25 < share**2 < 1.45
