"""The example of a large model, on a small one."""

import numpy as np
import pytest
from support.examples import load


@pytest.mark.slow
def test_large_model(capsys):
    result = load("large_model").main(storeys=3, segments=1, rounds=2, nsteps=150)
    reduced = result["reduced"]
    assert reduced.full_size == 3 * 16 * 6 and reduced.size < 150
    assert reduced.max_error <= 1e-4
    assert min(result["ratios"]) > 1.0
    draws = result["draws"]
    error = (draws.mean(axis=0) - result["true"]) / draws.std(axis=0)
    assert np.abs(error).max() < 4.0
    shown = capsys.readouterr().out
    assert str(reduced) in shown and "columns_lower" in shown
    assert "which by eigsh would take" in shown
