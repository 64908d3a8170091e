"""The problems of the few-solves benchmark are those that they are said to be."""

import numpy as np
import pytest
from support.examples import load

import emcee_femu as ef

PROBLEMS = load("few_solves_problems")


@pytest.mark.parametrize("name", PROBLEMS.PROBLEMS)
def test_few_solves_problems(name):
    problem = PROBLEMS.PROBLEMS[name]()
    theta = problem.posterior.prior.sample(np.random.default_rng(1), 4)
    rows = problem.posterior(theta)
    assert np.isfinite(rows[:, 0]).all()
    assert problem.box.solves == 4  # the black box counts by itself
    assert not problem.posterior.differentiable


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("beck_au", lambda: PROBLEMS.beck_au_exactly().posterior),
        ("h_500", lambda: ef.paper.h_structure(500.0).posterior),
        ("h_50000", lambda: ef.paper.h_structure(5e4).posterior),
    ],
)
def test_their_posteriors_are_the_published_ones(name, given):
    theta = given().prior.sample(np.random.default_rng(2), 5)
    exact = given()(theta)[:, 0]
    found = PROBLEMS.PROBLEMS[name]().posterior(theta)[:, 0]
    np.testing.assert_allclose(np.diff(found), np.diff(exact), rtol=1e-9)


def test_few_solves_references():
    module = load("few_solves_references")
    problem = PROBLEMS.beck_au()
    known = module.load("beck_au")  # beside the quadrature of tests/test_beck_au.py
    assert abs(known.mean[0] - 1.11700) < 0.01 * known.sd[0]
    assert abs(known.sd[0] / 0.66237 - 1) < 0.01
    assert abs(known.first - 0.53079) < 0.003
    rng = np.random.default_rng(1)  # about as the two modes are
    modes = rng.choice(2, 2_000)
    centre = np.array([[0.50, 0.90], [1.81, 0.25]])[modes]
    spread = np.array([[0.038, 0.070], [0.142, 0.019]])[modes]
    chain = centre + spread * rng.normal(size=(2_000, 2))
    (found,) = module.weigh([problem.posterior], chain, problem.first, 10_000, seed=1)
    mean, sd, weight = found.compare(known)
    assert max(mean, sd, weight) < 0.03
    assert found.pareto_k < 0.7
    for name in PROBLEMS.PROBLEMS:
        low, high = PROBLEMS.PROBLEMS[name]().posterior.prior.bounds.T
        mean = module.load(name).mean
        assert ((mean > low) & (mean < high)).all()


def test_few_solves_peers(monkeypatch, capsys):
    module = load("few_solves_peers")
    monkeypatch.setattr(module, "PEERS", {"no_such_package": None})
    monkeypatch.setattr("sys.argv", ["few_solves_peers.py"])
    module.main()
    assert "no_such_package is not installed" in capsys.readouterr().out
    (low, high), (soft_low, soft_high) = module.boxes(PROBLEMS.beck_au())
    assert (low < soft_low).all() and (soft_high < high).all()


@pytest.mark.slow
def test_few_solves(monkeypatch, capsys):
    options = ["--seeds", "1", "--first", "7", "--problem", "beck_au"]
    monkeypatch.setattr("sys.argv", ["few_solves.py", *options])
    (one,) = load("few_solves").main()["beck_au"]
    assert one.good("beck_au") and one.solves == 30
    assert one.efficiency > 0.9 and one.verdict == "certified"
    assert "1 of 1" in capsys.readouterr().out


@pytest.mark.slow
def test_sorted_modes(capsys):
    """Modes that cross are known better by their shapes than as sorted numbers."""
    table = load("sorted_modes").main(solves=75, nsteps=200, seed=2)
    modes, numbers = table.column("error")
    assert table.column("solves") == [75, 75]
    assert modes < 0.8 * numbers
    assert str(table) in capsys.readouterr().out
