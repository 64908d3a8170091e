"""A bar, or lines, while a run goes on."""

import re
import sys

import pytest

import emcee_femu as ef
from emcee_femu.evaluation import progress

PROBLEM = ef.paper.mass_spring()


def run(**options):
    return ef.run(PROBLEM.posterior, ef.DEMCMove(), 12, seed=1, **options)


@pytest.mark.parametrize(
    "terminal, asked, shown",
    [(True, None, "bar"), (True, False, ""), (False, None, ""), (False, True, "lines")],
)
def test_a_bar_or_lines_are_shown(terminal, asked, shown, monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    run(steps=15, ensembles=2, progress=asked)
    said = capsys.readouterr().err
    assert ("sampling: 100%" in said and "30/30" in said) == bool(shown)
    assert ("\r" in said) == (shown == "bar")
    if shown == "lines":
        counts = [line.split()[2].split("/")[0] for line in said.splitlines()]
        assert [int(count) for count in counts] == [*range(3, 31, 3)]


@pytest.mark.slow
def test_the_bar_of_a_run_that_ends_by_itself_ends_full(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    made = ef.run(PROBLEM.posterior, seed=1)
    last = capsys.readouterr().err.rstrip().split("\r")[-1]
    assert "converged, ESS" in last and "100%" in last and len(last) <= 80
    assert f"{made.solves}/{made.solves}" in last


def test_a_notebook_without_widgets_shows_lines(monkeypatch, capsys):
    monkeypatch.setattr(progress, "_in_notebook", lambda: True)
    monkeypatch.setattr(progress, "find_spec", lambda name: None)
    run(steps=15, ensembles=2, progress=None)
    said = capsys.readouterr().err
    assert len(re.findall(r"^sampling: \d+% ", said, re.M)) == 10
    monkeypatch.setenv("TQDM_DISABLE", "1")
    run(steps=15, ensembles=2, progress=None)
    assert capsys.readouterr().err == ""
