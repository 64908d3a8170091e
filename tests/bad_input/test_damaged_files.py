"""Damaged files are refused by their name, or read in full."""

import csv
import sqlite3
from collections import Counter
from contextlib import closing

import numpy as np
import pytest
from support.universal_file import F, write_modes

import emcee_femu as ef

CSV = """\
quantity,sensor,dof,mode 1,mode 2
frequency [Hz],,,3.13,9.83
sd [Hz],,,0.01,0.02
shape,roof,12,1.0,0.62
shape,floor 1,6,0.61,-1.0
"""


def cut(path, text, step, tail, read):
    """Yield the texts that end anywhere and were read all the same, and as what."""
    for end in range(0, len(text), step):
        path.write_bytes((text[:end] + tail).encode("latin-1"))
        try:
            yield text[:end] + tail, read(path)
        except ValueError as error:
            arguments = ("frequencies", "sd", "shapes", "sensors", "dofs")
            assert str(error).startswith((str(path), *arguments)), error


def cells(text):
    """Return how often each filled cell below the titles is there."""
    rows = [*csv.reader(text.splitlines())][1:]
    filled = [c for row in rows for c in row if c.strip("-") not in ("", "nan")]
    return Counter(c.removesuffix("0").removesuffix(".") for c in filled)


@pytest.mark.parametrize("tail", ["", "nan\n", '"', "\0", "1e999\n"])
def test_a_csv_file_that_ends_anywhere_is_refused_or_read_in_full(tmp_path, tail):
    path = tmp_path / "modes"
    for text, found in cut(path, CSV, 3 if tail else 1, tail, ef.Measurements.from_csv):
        assert tail or found.shapes is None or np.isfinite(found.shapes).all()
        found.to_csv(path)
        assert not cells(text) - cells(path.read_text()), text


@pytest.mark.parametrize("tail", ["", "    -1\n", "\0", "1e999\n"])
def test_a_universal_file_that_ends_anywhere_is_refused_or_read(tmp_path, tail):
    path = write_modes(tmp_path / "modes")
    for _, found in cut(path, path.read_text(), 97, tail, ef.Measurements.from_uff):
        np.testing.assert_array_equal(found.frequencies, F[: found.n_modes])


def test_a_file_that_is_not_there_is_no_damaged_one(tmp_path):
    path = tmp_path / "run.chain"
    with pytest.raises(ValueError, match="no file .*run.chain"):
        ef.diagnose(str(path))
    assert not path.exists()


@pytest.mark.parametrize("column", ["stream", "number", "points", "content"])
def test_a_missing_number_in_the_file_of_a_run_is_damage(tmp_path, column):
    path = str(tmp_path / "run.chain")
    posterior = ef.paper.mass_spring().posterior
    ef.run(posterior, ef.DEMCMove(), steps=9, ensembles=1, seed=1, backend=path)
    with closing(sqlite3.connect(path)) as file, file:
        file.execute(f"UPDATE record SET {column} = NULL WHERE number = 3")
    with pytest.raises(ValueError, match="run.chain .*damaged"):
        ef.diagnose(path)
