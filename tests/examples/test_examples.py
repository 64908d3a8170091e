"""Every example runs, shortened by its arguments, and says what its page says."""

import os
import subprocess
import sys

import numpy as np
import pytest
from support.examples import EXAMPLES, TESTS, load

import emcee_femu as ef

SECTIONS = {"start", "tutorials", "how_to", "explanation"}  # of the site: tests/docs
PAGES = sorted(p for p in EXAMPLES.rglob("*.py") if p.parent.name not in SECTIONS)


def test_every_example_is_a_page_with_a_command_and_has_a_test():
    tests = "".join(
        p.read_text(encoding="utf-8") for p in (TESTS / "examples").glob("test_*.py")
    )
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        assert (
            text.startswith('"""')
            and f"python {path.relative_to(TESTS.parent).as_posix()}" in text
        )
        assert f"def test_{path.stem}(" in tests, path.name


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


@pytest.mark.slow
def test_h_structure(tmp_path, capsys):
    tables = load("h_structure").main(120, 2, 1, str(tmp_path))
    assert [table.column("move") for table in tables.values()] == [
        ["DE-MC", "M-H untuned", "M-H tuned"]
    ] * 2
    shown = capsys.readouterr().out
    assert "beta = 10" in shown and "beta = 50000" in shown and "paper M-H" in shown
    assert len(list(tmp_path.glob("*.png"))) == 10


@pytest.mark.slow
def test_benchmark(capsys):
    found = load("benchmark").main(steps=400, repeats=1, only="bim5")
    auto = found["bim5", "auto (ours)"]
    assert auto[0] > 60  # ESS per 1000 evaluations; emcee's DEMove has 17
    assert abs(auto[5] - 0.3) < 0.03  # the weight of the left mode
    assert "end to end" in capsys.readouterr().out


@pytest.mark.slow
def test_compare_moves(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(ef.sampling.auto, "FEWEST", 200)  # or it would take seconds
    results = load("compare_moves").main(60, 2, 1, str(tmp_path))
    shown = capsys.readouterr()
    for name, compared in results.items():
        assert len(compared.idata) == 7 and "auto" in compared.idata
        assert str(compared) in shown.out and f"===== {name} =====" in shown.out
        assert compared.table.column("before chain")[-1] > 1_000  # its search
        for suffix in ("csv", "png"):
            assert (tmp_path / f"{name}.{suffix}").exists()
    assert shown.out.count("M-H was tuned to a DE-MC run of") == 2
    assert "emcee StretchMove:" in shown.err  # above its progress bars


def test_stock_moves():
    for ratio in load("stock_moves").main(1_500, 1).values():
        assert (np.abs(ratio - 1) < 0.15).all()


@pytest.mark.slow
def test_overhead(capsys):
    load("overhead").main(blocks=2, n=20)
    assert capsys.readouterr().out.count("x faster") == 18


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.stem)
def test_examples_do_nothing_on_import(path, capsys):
    load(path.relative_to(EXAMPLES).with_suffix("").as_posix())
    assert capsys.readouterr().out == ""
