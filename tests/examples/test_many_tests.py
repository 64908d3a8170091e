import numpy as np
import pytest
from support.examples import load


@pytest.mark.slow
def test_many_tests(tmp_path, capsys):
    """Slope and scatter come back, and tests with two solutions are decided."""
    example = load("many_tests")
    found = example.main(generations=500, out=str(tmp_path))
    pooled = found["pooled"]
    truth = {
        "mean frame": example.FRAME,
        "sd frame": example.SCATTER_FRAME,
        "sd soil": example.SCATTER_SOIL,
        "frame per T": example.SLOPE,
    }
    for name, value in truth.items():
        drawn = pooled.hyperdraws[name]
        assert abs(drawn.mean() - value) < 3 * drawn.std(), name
    alone = np.array([own.theta.std(axis=0) for own in pooled.model.draws])
    assert (alone[:, 1] > 0.1).any()  # a second solution
    assert (pooled.theta.std(axis=0)[:, 1] < 0.04).all()
    assert pooled.unreached == ()
    shown = capsys.readouterr().out
    assert "Population of 24 tests" in shown and "at 40 degrees" in shown
    assert {path.name for path in tmp_path.iterdir()} == {
        "tests.png",
        "temperature.png",
    }
