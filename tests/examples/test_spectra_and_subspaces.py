"""Spectra and subspaces on one simulated record."""

import logging

import numpy as np
import pytest
from support.examples import load


@pytest.mark.slow
def test_spectra(capsys):
    example, logger = load("spectra"), logging.getLogger("pyoma2")
    level = logger.level
    try:
        table = example.main(60, 7)
    finally:
        logger.setLevel(level)
    rows = np.array(table.rows, dtype=float)
    wide = rows.shape[1] == 10  # pyOMA2 is installed
    pairs = [(1, 3), (6, 8)] if wide else [(1,), (4,)]
    for truth, columns in zip((0, pairs[1][0] - 1), pairs, strict=True):
        for column in columns:
            z = (rows[:, column] - rows[:, truth]) / rows[:, column + 1]
            assert np.abs(z).max() < 3.5
        if wide:  # the same data: deviations alike
            own, other = (rows[:, column + 1] for column in columns)
            assert np.abs(np.log(own / other)).max() < 0.7
    assert "Identified from one record" in capsys.readouterr().out
