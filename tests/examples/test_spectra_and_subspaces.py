"""Spectra and subspaces on simulated records, as their page identifies them."""

import logging

import numpy as np
import pytest
from support.examples import load


@pytest.fixture
def quiet_pyoma2():
    pytest.importorskip("pyoma2", reason="pip install 'emcee_femu[oma]'")
    logger = logging.getLogger("pyoma2")
    level = logger.level
    yield
    logger.setLevel(level)


@pytest.mark.slow
def test_spectra_records(quiet_pyoma2):
    table = load("benchmarks/spectra_records").main(records=2, generations=60)
    rows = np.array(table.rows, dtype=float)
    over_stated = rows[:, [1, 2, 4, 5]]  # root mean squares, of two records
    assert over_stated.max() < 3 and np.sqrt((over_stated**2).mean()) < 1.8


@pytest.mark.slow
def test_ambient_records(quiet_pyoma2):
    table = load("benchmarks/ambient_records").main(records=3)
    found = dict(zip(table.column("of all records"), table.column("mean"), strict=True))
    assert found["chi-square of 5 stiffnesses, delta fixed"] < 14  # of 5, by 3 records
