"""The driver of CalculiX, by programs of one line of shell; and the program itself."""

import os
import re
import runpy
import shlex
import subprocess
import sys

import numpy as np
import pytest
from support.examples import EXAMPLES, load
from support.systems import inherits, posix

import emcee_femu as ef

DAT = """
     E I G E N V A L U E   O U T P U T

 MODE NO    EIGENVALUE                       FREQUENCY
                                     REAL PART            IMAGINARY PART
                           (RAD/TIME)      (CYCLES/TIME     (RAD/TIME)

      1   0.1831938E+04   0.4280114E+02   0.6812013E+01   0.0000000E+00
      2   0.5680402E+04   0.7536844E+02   0.1199526E+02   0.0000000E+00
      3   0.8131771E+05   0.2851626E+03   0.4538504E+02   0.0000000E+00

     P A R T I C I P A T I O N   F A C T O R S

      1   0.4810757E-13   0.1081082E+02   0.1619135E-08   0.5405412E+00
"""
REJECT = {"ensembles": 1, "seed": 1, "on_failure": "reject"}
HIGH = "0.9387354E+06   0.9688836E+03   0.1542026E+03"  # a sound row, out of order


@pytest.fixture
def driver(monkeypatch):
    program = load("calculix_program")
    monkeypatch.setitem(sys.modules, "calculix_program", program)  # as for a script
    monkeypatch.setattr(program, "PAUSE", 0.01)
    return program


@pytest.fixture
def beam(driver):
    return load("calculix")


@pytest.fixture
def calculix(driver):
    try:
        return driver.find_command()
    except FileNotFoundError as error:
        pytest.skip(str(error))


def shell(script):
    """Return the command of a program that is a script: a stand-in for CalculiX."""
    return ["sh", "-c", script]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (DAT, "", "one table of eigenvalues, got 0"),
        ("0.8131771E+05", "*************", r"modes 1 to 3, got \[1, 2\]"),
        ("      2   0.56", "     12   0.56", r"modes 1 to 3, got \[1, 12, 3\]"),
        ("0.7536844E+02", "0.7536944E+02", "do not fit"),
        ("0.1831938E+04   0.4280114E+02   0.6812013E+01", HIGH, "do not fit"),
        (" 0.1831938E+04", "-0.1831938E+04", "positive eigenvalues"),
        ("0.1199526E+02   0.0000000", "0.1199526E+02   0.3000000", "positive"),
    ],
)
def test_a_damaged_dat_file_is_refused(driver, old, new, message):
    expected = np.sqrt([1831.938, 5680.402, 81317.71]) / (2 * np.pi)
    np.testing.assert_allclose(driver.read_frequencies(DAT, 3), expected, rtol=1e-9)
    with pytest.raises(ValueError, match=message):
        driver.read_frequencies(DAT.replace(old, new, 1), 3)


@posix
@pytest.mark.parametrize(
    ("script", "error", "message"),
    [
        ("echo no convergence; exit 3", RuntimeError, "status 3: no convergence"),
        ("echo to stderr >&2; kill -SEGV $$", RuntimeError, "status -11: to stderr"),
        (r"printf '\377 diverged'; exit 2", RuntimeError, "status 2: . diverged"),
        ("true", FileNotFoundError, "job.dat"),
        ("printf half > job.dat", ValueError, "one table"),
        ("sleep 600; touch ../late", subprocess.TimeoutExpired, "0.3 s"),
    ],
)
def test_a_solve_that_fails_says_why_and_leaves_nothing(
    driver, tmp_path, script, error, message
):
    limit = 0.3 if "sleep" in script else 600.0  # s, for a busy machine
    with pytest.raises(error, match=message):  # noqa: SIM117
        with driver.finished_job("", shell(script), limit, scratch=tmp_path) as folder:
            driver.read_frequencies((folder / "job.dat").read_text(), 1)
    assert not list(tmp_path.iterdir())


def posterior_of(solve):
    prior = ef.GaussianPrior(["k"], [1.0], [0.3], [(0.1, 2.0)])
    term = ef.FrequencyTerm([6.8], sd=[0.1])
    return ef.LogPosterior(ef.FunctionModel(solve, n_modes=1), term, prior)


@posix
def test_a_missing_licence_is_waited_for(driver, tmp_path):
    tries = tmp_path / "tries"
    script = f"""echo >> {shlex.quote(str(tries))}
        [ $(wc -l < {shlex.quote(str(tries))}) -ge 3 ] && exit 0
        echo 'No licence: all are in use'; exit 1"""
    with driver.finished_job("", shell(script)):
        pass
    assert tries.read_text().count("\n") == 3


@posix
@pytest.mark.parametrize(
    ("workers", "command", "options", "message"),
    [
        (None, shell("echo License is not available; exit 1"), {}, "no licence in 0.1"),
        pytest.param(2, ["no-such-program"], {}, "no-such-program", marks=inherits),
        (None, shell("true"), {"scratch": "/no/such/disk"}, "no scratch folder"),
    ],
)
def test_a_machine_that_cannot_solve_rejects_no_point_but_stops_the_run(
    driver, tmp_path, command, options, message, workers
):
    options = {"scratch": tmp_path, **options}  # workers may end within a solve

    def solve(p):
        with driver.finished_job("", command, patience=0.1, **options):
            raise AssertionError("it was solved")

    posterior = posterior_of(solve)
    with pytest.raises(driver.Unavailable, match=message):
        ef.run(posterior, ef.DEMCMove(), 8, 2, **REJECT, workers=workers)


@posix
@pytest.mark.parametrize("workers", [None, pytest.param(2, marks=inherits)])
def test_every_solve_has_its_folder_and_those_that_fail_are_rejected(
    driver, tmp_path, workers
):
    (tmp_path / "good.dat").write_text(DAT)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    script = f"""pwd >> {shlex.quote(str(tmp_path / "folders"))}
        grep -q wrong job.inp && exit 1
        cp {shlex.quote(str(tmp_path / "good.dat"))} job.dat"""

    def solve(p):
        deck = "wrong" if abs(p["k"] - 1.1) > 0.3 else "good"
        with driver.finished_job(deck, shell(script), scratch=scratch) as folder:
            return driver.read_frequencies((folder / "job.dat").read_text(), 1)

    options = REJECT | {"workers": workers, "max_failures": 1.0}
    starts = [[0.9], [1.0], [1.1], [1.4]]
    run = ef.run(posterior_of(solve), ef.DEMCMove(), 4, 4, starts=starts, **options)
    causes = run.failures.causes
    assert causes["exception"] == causes.total() > 0
    assert (np.abs(run[0].get_chain() - 1.1) <= 0.3).all()
    folders = (tmp_path / "folders").read_text().split()
    assert len(set(folders)) == len(folders) > causes.total()
    processes = {re.search(r"worker-(\d+)-", folder)[1] for folder in folders}
    assert len(processes) == (workers or 1)
    assert (str(os.getpid()) in processes) == (workers is None)
    assert not list(scratch.iterdir())


@posix
def test_calculix_program(driver, tmp_path, monkeypatch, capsys):
    """The command of the page, by a program of that name that has one thread."""
    fake = tmp_path / "ccx"
    once = '[ "$* $OMP_NUM_THREADS" = "-i job 1" ] && cp job.inp job.dat'
    fake.write_text(f"#!/bin/sh\n{once}\n")
    fake.chmod(0o755)
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    (tmp_path / "own.inp").write_text(DAT)
    monkeypatch.setattr(sys, "argv", ["calculix_program.py", str(tmp_path / "own.inp")])
    runpy.run_path(str(EXAMPLES / "calculix_program.py"), run_name="__main__")
    assert re.match(r"\[6\.81\d*\] Hz", capsys.readouterr().out)


def test_frequencies_of_calculix_are_those_of_beam_theory(beam, calculix, tmp_path):
    ones = dict.fromkeys(beam.TRUTH, 1.0)
    length, width, height = beam.SIZE
    speed = np.sqrt(beam.E / beam.RHO) / (2 * np.pi * length**2 * np.sqrt(12))
    for bearing, roots in ((1e-6, (1.8751, 4.6941)), (1e4, (3.9266,))):
        f = beam.solve({**ones, "bearing": bearing}, calculix, tmp_path)
        vertical = np.square(roots) * speed * height
        lateral = np.square([1.8751, 4.6941]) * speed * width
        for expected in (*vertical, *lateral):  # solids are softer: shear
            assert np.abs(f / expected - 1).min() < 0.005
    assert not list(tmp_path.iterdir())


def test_exported_matrices_have_the_frequencies_that_calculix_prints(
    beam, calculix, tmp_path, monkeypatch
):
    monkeypatch.setattr(beam, "ELEMENTS", (6, 2, 2))
    model = beam.by_matrices(calculix, tmp_path)
    found = model({name: np.array([x]) for name, x in beam.TRUTH.items()}).frequencies
    printed = beam.solve(beam.TRUTH, calculix, tmp_path)
    np.testing.assert_allclose(found[0], printed, rtol=2e-6)
    assert not list(tmp_path.iterdir())
