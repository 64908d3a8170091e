"""The benchmark of hard targets: its truths, and what "auto" says of some of them."""

import numpy as np
import pytest
from support.examples import load

HARD = load("hard_targets")


@pytest.mark.parametrize("name", HARD.TARGETS)
def test_hard_posteriors(name):
    """A reversible step from exact draws may not change any mean or variance."""
    target = HARD.TARGETS[name]()
    x = HARD.inside(target, 20_000, seed=3)
    rng = np.random.default_rng(4)
    # Along differences of draws, so that ridges are followed, some of them short.
    pairs = x[rng.permutation(len(x))] - x[rng.permutation(len(x))]
    y = x + 10 ** -rng.uniform(0, 2.5, (len(x), 1)) * pairs
    y[((y < target.box[:, 0]) | (y > target.box[:, 1])).any(axis=1)] = x[0]
    log_ratio = target.log_density(y) - target.log_density(x)
    share = np.exp(np.minimum(log_ratio, 0))[:, None]
    share[(y == x[0]).all(axis=1)] = 0
    assert share.mean() > 0.02
    for power in (1, 2):
        change = share * ((y - x.mean(axis=0)) ** power - (x - x.mean(axis=0)) ** power)
        z = change.mean(axis=0) / change.std(axis=0) * np.sqrt(len(x))
        assert np.abs(z).max() < 4.5


def test_benchmark_posteriors_print(capsys):
    moments = load("hard_posteriors").main(1_000)
    assert "unknown noise: d = 4" in capsys.readouterr().out
    np.testing.assert_allclose(moments["unknown noise"][0], [0, 1.5] * 2, atol=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ridge .9999, d=4"])
def test_hard_targets(name, capsys):
    """What is called converged is right, and z says how far off it is."""
    runs = HARD.main(seeds=2, targets=name, steps=600)[name]
    assert "called converged" in capsys.readouterr().out
    for run in runs:
        assert run.short != "converged" or np.abs(run.mean_z).max() < 5
        assert run.short != "converged" or run.weight_error < 0.05
    assert HARD.rms(run.mean_z for run in runs) < 2
