"""Malformed files, their names, pools, and functions that no worker can be sent."""

import csv
import threading
import warnings
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.border import THROWN, Target, arguments, properties, same, stopped
from support.kinds import ascending, either, flag, floats, none, whole
from test_bad_input_data import dof_rows, labels
from test_identification import NODES, a_mode

import emcee_femu as ef
from emcee_femu import paper

FILES = 400  # damaged files of each kind
CSV = """quantity,sensor,dof,mode 1,mode 2
frequency [Hz],,,3.13,9.83
sd [Hz],,,0.01,0.02
phase collinearity,,,0.95,1.0
shape,roof,12,1.0,0.62
shape,floor 1,6,0.61,-1.0
shape sd,roof,,0.02,0.03
shape sd,floor 1,,0.02,0.03
"""
INSERTED = [
    "",
    ",",
    "\n",
    '"',
    "\0",
    "nan",
    "inf",
    "-",
    "1e999",
    "1e-999",
    "é",
    "=",
    " ",
]
INSERTED += ["\ufeff", "0", "9" * 400, "\r", ";", "shape,", "mode 1", "\udcff", "1_0"]
INSERTED += ["\nmass,,,1,2", "\nsd [Hz],,,0.03,0.04", ",5.0", "\nshape,a,,1,2", "a"]


@st.composite
def damaged(draw, text):
    """Cut a piece out of a text, and put another in its place."""
    ends = [i for i, letter in enumerate(text) if letter == "\n"]
    start = draw(st.integers(0, len(text)) | st.sampled_from(ends))
    end = min(len(text), start + draw(st.sampled_from([0, 1, 2, 5, 20, 10_000])))
    piece = draw(st.sampled_from([*INSERTED, text[: end - start], text[start:]]))
    return (text[:start] + piece + text[end:]).encode("utf-8", "surrogateescape")


def files(text, read, name, words):
    """Throw damaged files at a reader: it refuses, by the file's name, or reads."""

    @settings(
        max_examples=FILES,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=[*HealthCheck],
    )
    @given(damaged(text))
    def thrown(content):
        THROWN[name].add(content)
        with TemporaryDirectory() as folder:
            path = f"{folder}/modes"
            with open(path, "wb") as file:
                file.write(content)
            try:
                with stopped(10.0):
                    found = read(path)
            except (ValueError, TypeError, UserWarning) as error:
                assert str(error).startswith((path, *words)), repr(error)
                return
            again = f"{folder}/again"
            found.to_csv(again)
            assert same(found, ef.Measurements.from_csv(again))
            if read == ef.Measurements.from_csv:
                assert not cells(path) - cells(again), "cells of the file are lost"

    thrown()
    assert len(THROWN[name]) >= FILES / 2


def cells(path):
    """Return the cells below the titles, and how often each stands there."""
    with open(path, encoding="utf-8-sig", newline="") as file:
        (_, *rows) = csv.reader(file)
    return Counter(as_number(cell.strip()) for row in rows for cell in row) - Counter(
        [""] * sum(map(len, rows))
    )


def as_number(cell):
    try:
        return float(cell)
    except ValueError:
        return cell


WORDS = ("frequencies", "sd", "shapes", "shape_sd", "phase_coll", "dofs", "sensors")


def test_a_damaged_csv_file_is_refused_by_name_or_read():
    files(CSV, ef.Measurements.from_csv, "from_csv of damaged files", WORDS)


def test_a_damaged_universal_file_is_refused_by_name_or_read():
    name = "from_uff of damaged files"
    files(universal_file(), ef.Measurements.from_uff, name, WORDS)


@cache
def universal_file():
    """Return the text of a universal file with three modes."""
    pyuff = pytest.importorskip("pyuff")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "modes.uff"
        sets = [a_mode(pyuff, number) for number in (1, 2, 3)]
        pyuff.UFF(str(path)).write_sets(sets, "overwrite")
        return path.read_text()


def from_uff(**given):
    with TemporaryDirectory() as folder:
        path = Path(folder) / "modes.uff"
        path.write_text(universal_file())
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*zero in all modes", UserWarning)
            return ef.Measurements.from_uff(path, **given)


def evaluated(executor, chunksize):
    pool = ef.EvaluationPool(executor, chunksize)
    return pool.map(np.sum, np.arange(6.0).reshape(3, 2))


def has_map(value):
    """Whatever has a map is a pool, by the letter."""
    return hasattr(value, "map")


def a_name(value):
    """A name may be that of a file."""
    return isinstance(value, str) and bool(value)


def refused(value):
    return False


def measured(value):
    """Any sensors of the file, which has three directions at each node."""
    found = labels()(value)
    if found:
        every = {f"{node}:{axis}" for node in NODES for axis in "xyz"}
        return {*value} <= every and None
    return found


TARGET = [4000.0, 2200.0, 2120.0, 2600.0, 2400.0]
THREADS = ThreadPoolExecutor(1)
TARGETS = {
    "EvaluationPool": Target(
        evaluated,
        arguments(
            executor=(THREADS, lambda v: v is THREADS, has_map),
            chunksize=(2, either(none, whole(1))),
        ),
        examples=40,
    ),
    "Measurements.from_csv": Target(
        ef.Measurements.from_csv, arguments(path=(None, refused, a_name))
    ),
    "Measurements.from_uff": Target(
        ef.Measurements.from_uff,
        arguments(path=(None, refused, a_name)),
    ),
    "Measurements.from_uff of sensors": Target(
        from_uff,
        arguments(sensors=(["7:y", "4:x", "4:z"], either(none, measured))),
        words=("shapes",),
    ),
    "Measurements.from_uff of dofs": Target(
        from_uff,
        arguments(dofs=([3, 1, 2], either(none, dof_rows))),
        fixed={"sensors": ["7:y", "4:x", "4:z"]},
        tied=("sensors", "dofs"),
    ),
    "Measurements.to_csv": Target(
        ef.Measurements([1.0]).to_csv, arguments(path=(None, refused, a_name))
    ),
    "paper.mass_spring": Target(
        paper.mass_spring,
        arguments(beta=(6.8e5, floats((), (5,), above=0.0))),
        probe=lambda problem: problem.posterior(TARGET),
    ),
    "paper.h_structure": Target(
        paper.h_structure,
        arguments(beta=(10.0, floats((), (5,), above=0.0))),
        probe=lambda problem: problem.posterior.terms[0].beta,
        examples=30,
    ),
    "paper.h_frame": Target(
        paper.h_frame,
        arguments(modes=((1, 2, 4), ascending(18)), shapes=(False, flag)),
        probe=lambda model: (model.modes, model.names),
        words=("n_modes",),
        examples=30,
    ),
}


test_a_malformed_argument = properties(TARGETS)


class Lock:
    """A model that holds what no process can be sent."""

    def __init__(self):
        self.lock = threading.Lock()

    def __call__(self, parameters):
        return [1.0]


def unsendable():
    def local(parameters):
        return [1.0]

    bound = partial(Lock().__call__)
    return [lambda p: [1.0], local, Lock(), Lock().__call__, bound]


@pytest.mark.parametrize("wrap", [lambda pool: pool, ef.EvaluationPool])
@pytest.mark.parametrize("which", range(5))
def test_a_model_that_no_process_can_be_sent_is_refused_by_name(which, wrap):
    model = ef.FunctionModel(unsendable()[which], n_modes=1)
    prior = ef.GaussianPrior(["k1"], [1.0], 1.0)
    posterior = ef.LogPosterior(model, ef.FrequencyTerm([1.0], beta=1.0), prior)
    with get_context("fork").Pool(1) as pool, stopped(20.0):
        with pytest.raises(TypeError, match=r"^pool: .*function.* cannot be pickled"):
            ef.run(posterior, nwalkers=4, nsteps=2, seed=1, pool=wrap(pool))
    with ThreadPoolExecutor(1) as threads, stopped(20.0):  # has no need to
        ef.run(posterior, nwalkers=4, nsteps=2, seed=1, pool=threads)
