"""What runs and conversions hold in memory.

Run as a script, ``test_memory.py GENERATIONS THIN_BY FILE``, it samples and prints what
is resident on the way; an empty FILE keeps the chain in memory.
"""

import json
import os
import subprocess
import sys
import tracemalloc
from mmap import PAGESIZE
from pathlib import Path

import emcee
import numpy as np
import pytest

import emcee_femu as ef
from emcee_femu.results import chains as stored_chains
from emcee_femu.results.inference_data import GROUPS, dataset

NWALKERS = 256
STATM = Path("/proc/self/statm")
needs_proc = pytest.mark.skipif(not STATM.exists(), reason="no /proc on this system")


def resident():
    return int(STATM.read_text(encoding="ascii").split()[1]) * PAGESIZE


class Model:
    """Frequencies that follow the first parameters; notes what is resident."""

    def __init__(self, n_modes, calls_a_note=0):
        self.n_modes = n_modes
        self.calls_a_note = calls_a_note
        self.calls = 0
        self.resident = []

    def __call__(self, parameters):
        first = next(iter(parameters.values()))
        self.calls += 1
        if self.calls_a_note and self.calls % self.calls_a_note == 0:
            self.resident.append(resident())
        return ef.ModalSolution(np.arange(1, self.n_modes + 1) + 0.01 * first[:, None])


class Prior:
    """Independent standard Gaussians; sampling takes no more than the result."""

    def __init__(self, ndim):
        self.names = tuple(f"k{i}" for i in range(ndim))
        self.bounds = np.tile([-np.inf, np.inf], (ndim, 1))
        self.mean = np.zeros(ndim)

    def logpdf(self, theta):
        return -0.5 * np.einsum("nd,nd->n", theta, theta)

    def sample(self, rng, n):
        return rng.standard_normal((n, len(self.names)))


def problem(ndim, n_modes, prior=None, calls_a_note=0):
    term = ef.FrequencyTerm(np.arange(1, n_modes + 1), beta=1e2)
    return ef.LogPosterior(Model(n_modes, calls_a_note), term, prior or Prior(ndim))


def main(generations, thin_by, file):
    # Two calls a generation, and two hundred notes.
    posterior = problem(30, 5, calls_a_note=generations // 100)
    ef.run(posterior, nwalkers=NWALKERS, nsteps=5, seed=1)  # what is made but once
    before = resident()
    (sampler,) = ef.run(
        posterior,
        nwalkers=NWALKERS,
        nsteps=generations // thin_by,
        thin_by=thin_by,
        seed=1,
        backend=file or None,
    )
    notes = posterior.model.resident
    assert len(notes) >= 200
    stored = sampler.iteration * NWALKERS * (30 + 1 + 2 + 5) * 8
    print(json.dumps({"added": max(notes) - before, "stored": stored}))


def growth(generations, thin_by, file):
    """Return how many MB a run adds to memory at most, and how many it stores."""
    command = [sys.executable, __file__, str(generations), str(thin_by), str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    return found["added"] / 1e6, found["stored"] / 1e6


@needs_proc
def test_memory_stays_flat_while_a_file_grows(tmp_path):
    file = tmp_path / "run.h5"
    added, stored = growth(600, 1, file)
    assert stored > 40 and file.stat().st_size > 1e6 * stored
    assert added < 0.25 * stored  # 4 MB, the caches of HDF5


@needs_proc
def test_the_check_sees_a_chain_that_is_kept_in_memory():
    added, stored = growth(600, 1, "")
    assert added > 0.9 * stored


@pytest.mark.slow
@needs_proc
def test_memory_stays_flat_over_100_000_generations(tmp_path):
    file = tmp_path / "run.h5"
    added, stored = growth(100_000, 100, file)
    assert stored > 70 and file.stat().st_size > 1e6 * stored
    assert added < 0.1 * stored
    assert emcee.backends.HDFBackend(str(file), "ensemble_0").iteration == 1_000


SHORT = problem(5, 20)
STEPS = 90


@pytest.fixture(scope="module")
def samplers():
    return ef.run(SHORT, nwalkers=NWALKERS, nsteps=STEPS, ensembles=3, seed=1)


@pytest.fixture(scope="module")
def files(samplers, tmp_path_factory):
    """The same chains, read from a file."""
    path = tmp_path_factory.mktemp("memory") / "run.h5"
    ef.run(
        SHORT, nwalkers=NWALKERS, nsteps=STEPS, ensembles=3, seed=1, backend=str(path)
    )
    return [emcee.backends.HDFBackend(str(path), f"ensemble_{k}") for k in range(3)]


def peak_and_result(sources, posterior, **options):
    """Return bytes held at the peak of a conversion, and those that it returns."""
    ef.to_inference_data(sources[0], posterior, discard=sources[0].iteration - 1)
    tracemalloc.start()  # arviz has been imported by now
    idata = ef.to_inference_data(sources, posterior, **options)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak, sum(dataset(idata, group).nbytes for group in GROUPS)


@pytest.mark.parametrize("options", [{}, {"thin": 3}, {"discard": 60}], ids=str)
@pytest.mark.parametrize("ensembles", [1, 3])
@pytest.mark.parametrize("source", ["file", "memory"])
def test_a_conversion_holds_at_most_twice_what_it_returns(
    request, source, ensembles, options
):
    runs = request.getfixturevalue("files" if source == "file" else "samplers")
    peak, returned = peak_and_result(runs[:ensembles], SHORT, **options)
    kept = len(range(STEPS)[options.get("discard", 0) :: options.get("thin", 1)])
    numbers = ensembles * kept * NWALKERS * (5 + 1 + 2 + 20)
    assert returned == pytest.approx(8 * numbers, rel=0.03)  # and coordinates
    assert returned < peak < 2 * returned
    if ensembles == 3 or source == "memory":  # one ensemble is read at a time
        assert peak < 1.5 * returned


def test_the_prior_takes_some_4_mb_a_parameter_before_the_chains_are_read():
    prior = ef.GaussianPrior([f"k{i}" for i in range(10)], np.zeros(10), 1.0)
    posterior = problem(10, 2, prior)
    runs = ef.run(posterior, nwalkers=24, nsteps=2, seed=1)
    peak, _ = peak_and_result(runs, posterior)
    assert 20e6 < peak < 45e6


def tell(monkeypatch, path, text):
    path.write_text(text, encoding="ascii")
    monkeypatch.setattr(stored_chains, "MEMINFO", path)


class Unread:
    """A backend that must not be read."""

    def __init__(self, backend):
        self.iteration, self.shape = backend.iteration, backend.shape

    def get_chain(self, **options):
        raise AssertionError("it was read")


def test_what_does_not_fit_is_refused_before_it_is_read(files, tmp_path, monkeypatch):
    needed = 2 * 3 * STEPS * NWALKERS * (5 + 1 + 2 + 20) * 8
    unread = [Unread(file) for file in files]
    table = "MemTotal: 9 kB\nMemAvailable:{:9d} kB\nBuffers: 1 kB\n"
    tell(monkeypatch, tmp_path / "meminfo", table.format(needed // 1024 + 1))
    with pytest.raises(AssertionError, match="it was read"):  # it fits
        ef.to_inference_data(unread, SHORT)
    tell(monkeypatch, tmp_path / "meminfo", table.format(needed // 1024 - 1))
    message = r"takes 0.031 GB of memory, but 0.031 GB are available; use thin=2 or"
    with pytest.raises(MemoryError, match=message):
        ef.to_inference_data(unread, SHORT)
    idata = ef.to_inference_data(files, SHORT, thin=2)
    assert dataset(idata, "posterior")["k0"].size == 45 * 3 * NWALKERS


@pytest.mark.parametrize("share", [0.15, 0.3, 0.7])
@pytest.mark.parametrize("options", [{}, {"thin": 7}, {"discard": 17, "thin": 2}])
def test_the_thin_that_the_message_names_fits(
    files, tmp_path, monkeypatch, share, options
):
    numbers, step = 28, 2 * 8 * 3 * NWALKERS * 28
    discard, thin = options.get("discard", 0), options.get("thin", 1)
    available = int(share * step * (STEPS - discard) / thin / 1024)
    tell(monkeypatch, tmp_path / "meminfo", f"MemAvailable: {available} kB")
    with pytest.raises(MemoryError) as caught:
        stored_chains.check_memory(files, numbers, discard, thin)
    advice = int(str(caught.value).split("thin=")[1].split()[0])
    assert advice == pytest.approx(thin / share, abs=1.01)  # and no more than it must
    stored_chains.check_memory(files, numbers, discard, advice)


@pytest.mark.parametrize("share", [0.15, 0.5, 0.9])
@pytest.mark.parametrize("discard", [0, 17])
def test_what_diagnose_cannot_read_is_refused_with_the_discard_that_fits(
    files, tmp_path, monkeypatch, share, discard
):
    step = 2 * 8 * 3 * NWALKERS * 5
    available = int(share * step * (STEPS - discard) / 1024)
    tell(monkeypatch, tmp_path / "meminfo", f"MemAvailable: {available} kB")
    unread = [Unread(file) for file in files]
    with pytest.raises(MemoryError) as caught:
        ef.diagnose(unread, discard)
    advice = int(str(caught.value).split("discard=")[1].split()[0])
    fits = STEPS - share * (STEPS - discard)
    assert advice == pytest.approx(fits, abs=1.01)  # and no more than it must
    with pytest.raises(AssertionError, match="it was read"):  # it fits
        ef.diagnose(unread, advice)


def test_what_log_evidence_cannot_read_is_refused(tmp_path, monkeypatch):
    move = ef.TemperedMove(ef.DEMCMove(), [1.0, 0.0])
    runs = ef.run(SHORT, move, nwalkers=2 * NWALKERS, nsteps=10, seed=1)
    needed = 2 * 8 * 10 * 2 * NWALKERS * (1 + 2 + 20)
    tell(monkeypatch, tmp_path / "meminfo", f"MemAvailable: {needed // 1024 + 1} kB")
    ef.log_evidence(runs)
    tell(monkeypatch, tmp_path / "meminfo", f"MemAvailable: {needed // 1024 - 1} kB")
    with pytest.raises(MemoryError, match=r"are available; use discard=1 or more"):
        ef.log_evidence(runs)


@pytest.mark.parametrize("text", [None, "MemTotal: 1 kB\n"])
def test_where_the_system_does_not_tell_nothing_is_refused(
    files, tmp_path, monkeypatch, text
):
    if text is None:
        monkeypatch.setattr(stored_chains, "MEMINFO", tmp_path / "absent")
    else:
        tell(monkeypatch, tmp_path / "meminfo", text)
    assert stored_chains.available_memory() is None
    stored_chains.check_memory(files, 10**15, 0, 1)


@pytest.mark.skipif(not stored_chains.MEMINFO.exists(), reason="no /proc/meminfo")
def test_the_system_tells_bytes():
    total = os.sysconf("SC_PHYS_PAGES") * PAGESIZE
    assert 2**20 < stored_chains.available_memory() <= total


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
