"""The benchmarks of evidence, annealing and Hamiltonian moves, at their smallest."""

import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from support.examples import load


@pytest.mark.slow
def test_evidence(monkeypatch, capsys):
    options = ["--seeds", "2", "--processes", "1", "--problem", "Gaussian, d=2"]
    monkeypatch.setattr(sys, "argv", ["evidence.py", *options, "--method", "auto"])
    module = load("evidence")  # whose functions no other process could import
    monkeypatch.setattr(module, "ProcessPoolExecutor", ThreadPoolExecutor)
    module.main()
    shown = capsys.readouterr().out
    assert "Gaussian, d=2" in shown and "2 seeds each" in shown


@pytest.mark.slow
def test_frf(capsys):
    ratios = load("benchmarks/frf").main(repeats=1)
    assert ratios["direct, line by line"] > 5  # 80 on a quiet machine
    assert capsys.readouterr().out.count("times faster") == 2


@pytest.mark.slow
def test_hamiltonian():
    found = load("benchmarks/hamiltonian").main((20,), 4_000, 1)
    assert found[20, "HMC 1/k"] > 5 * found[20, "DE-MC"]
    assert found[20, "HMC"] > 5 * found[20, "DE-MC"]


@pytest.mark.slow
def test_subchains():
    found = load("benchmarks/subchains").main("beck_au", 20, (1, 10), 800)
    assert min(found[1], found[10]) > 0  # too short to rank them


@pytest.mark.slow
def test_certificates():
    table = load("benchmarks/certificates").main(chains=4)
    judged = zip(table.column("certified"), table.column("refused"), strict=True)
    near, _, narrow = judged
    assert near[0] >= 2 and narrow == (0, 4)


@pytest.mark.slow
def test_tmcmc(capsys):
    module = load("tmcmc")
    springs, needles = module.main((200, 800), 3, ((0.5, 10.0, 1_000),))
    means, solves = springs.column("error of the mean"), springs.column("solves")
    assert means[1] < means[0] < 0.5 and solves[1] > 2 * solves[0]
    assert needles.column("above 0.02") == [1]
    assert "Share of the needle" in capsys.readouterr().out
