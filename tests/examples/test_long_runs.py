"""The examples of long runs and of the order of modes keep their promises."""

import subprocess
import sys

import pytest
from support.calibration import shorten_search
from support.examples import EXAMPLES, load


@pytest.mark.slow
def test_resume():
    # As a command: what a child process samples must be importable there.
    command = [sys.executable, str(EXAMPLES / "resume.py"), "--generations", "400"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    stored = int(shown.split()[2])
    assert 0 < stored <= 800
    assert "never stopped: True" in shown
    assert "terms.frequency.measured[2]: was 7.083, is 7.09" in shown
    assert "Failed solves, taken for impossible: {'exception': " in shown
    assert "ms per generation" in shown


@pytest.mark.slow
def test_mode_order(capsys, monkeypatch):
    shorten_search(monkeypatch)
    shares = load("mode_order").main(500, 150)["shares"]
    any_mode = shares.column("any")
    assert shares.column("region")[0] == "box of the bounds"
    assert 55 < any_mode[0] < 67  # 61 % of 4,000 points
    assert any_mode[3] > 95  # the posterior of beta = 5e4
    assert "paired, beta = 50000" in capsys.readouterr().out
