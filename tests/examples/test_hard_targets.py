"""The benchmark of hard targets: its truths, and what "auto" says of some of them."""

import numpy as np
import pytest
from support.examples import load

HARD = load("hard_targets")


@pytest.mark.parametrize("name", HARD.TARGETS)
def test_hard_posteriors(name):
    """A reversible step from exact draws may not change centre, spread or density."""
    target = HARD.TARGETS[name]()
    x = HARD.inside(target, 600_000 // max(10, len(target.box)), seed=3)
    rng = np.random.default_rng(4)
    # Along differences of draws, so that ridges are followed, some of them short.
    pairs = x[rng.permutation(len(x))] - x[rng.permutation(len(x))]
    y = x + 10 ** -rng.uniform(0, 2, (len(x), 1)) * pairs
    inside = ((y >= target.box[:, 0]) & (y <= target.box[:, 1])).all(axis=1)
    y[~inside] = x[~inside]  # a step that is not taken
    before, after = (np.column_stack([a, target.log_density(a)]) for a in (x, y))
    share = np.exp(np.minimum(after[:, -1:] - before[:, -1:], 0))
    assert share.mean() > 0.02
    low, centre, high = np.quantile(before, [0.2, 0.5, 0.8], axis=0)
    before, after = (np.tanh((a - centre) / (high - low)) for a in (before, after))
    for power in (1, 2):  # of what is bounded: moments of heavy tails scatter
        change = share * (after**power - before**power)
        z = change.mean(axis=0) / change.std(axis=0) * np.sqrt(len(x))
        assert np.abs(z).max() < 4.5


def test_benchmark_posteriors_print(capsys):
    moments = load("hard_posteriors").main(1_000)
    assert "unknown noise: d = 4" in capsys.readouterr().out
    np.testing.assert_allclose(moments["unknown noise"][0], [0, 1.5] * 2, atol=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["needle, d=4, 5 sd", "needle, d=5, 20 sd", "banana"])
def test_hard_targets(name, capsys):
    """What is called converged is right, and z says how far off it is."""
    (runs,) = HARD.main(seeds=3, targets=name, steps=1_000).values()
    assert "called converged" in capsys.readouterr().out
    for run in runs:
        assert run.short != "converged" or np.abs(run.mean_z).max() < 5
        assert run.short != "converged" or run.weight_error < 0.05
    good = [run.mean_z for run in runs if run.short == "converged"]
    assert not good or HARD.rms(good) < 2
    assert len(good) > 1 or name == "banana"
