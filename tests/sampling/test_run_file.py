"""RunFile: a run in a file that a kill at any moment leaves usable."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from emcee.backends import Backend, HDFBackend
from support import killed_runs
from support.run_files import D, W, advance, assert_same, create

from emcee_femu.sampling.run_file import RunFile, creation, storage

posix = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks and kills")


@pytest.fixture
def path(tmp_path):
    return str(tmp_path / "run.h5")


@pytest.fixture
def written(path):
    advance(create(path), 6)
    return path


def refused(path, match, ensembles=1):
    """Check that the file is refused, and left byte for byte as it was."""
    before = Path(path).read_bytes()
    with pytest.raises(ValueError, match=match):
        RunFile.resume(path, ensembles)
    with pytest.raises(ValueError, match="exists"):
        create(path)
    assert Path(path).read_bytes() == before
    assert os.listdir(os.path.dirname(path)) == [os.path.basename(path)]


@pytest.mark.parametrize("blobs", [0, 1, 4])
def test_it_holds_what_emcee_holds_in_memory_and_emcee_itself_reads_it(path, blobs):
    memory = advance(Backend(), 10, blobs, thin_by=3)
    assert_same(advance(create(path, 10, blobs), 10, blobs, thin_by=3), memory)
    assert_same(HDFBackend(path, name="ensemble_0"), memory)


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize(("thin", "discard"), [(1, 0), (3, 0), (1, 9), (2, 5), (7, 8)])
@pytest.mark.parametrize("blobs", [1, 2])
def test_parts_of_the_chain_are_those_of_emcee(path, flat, thin, discard, blobs):
    own = advance(create(path, 12, blobs), 10, blobs)
    emcees = HDFBackend(path, name="ensemble_0")
    for name in ("chain", "log_prob", "blobs"):
        expected = emcees.get_value(name, flat=flat, thin=thin, discard=discard)
        found = own.get_value(name, flat=flat, thin=thin, discard=discard)
        np.testing.assert_array_equal(found, expected)
        assert type(found) is np.ndarray and found.flags.writeable


def test_resuming_after_every_step_changes_nothing(path):
    create(path)
    for _ in range(10):
        advance(RunFile.resume(path)[0], 1)
    assert_same(RunFile(path), advance(Backend(), 10))


def killed(kind, path, *arguments):
    call = [sys.executable, killed_runs.__file__, json.dumps([kind, path, *arguments])]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@posix
def test_twenty_kills_at_random_times_leave_the_bits_of_an_uninterrupted_run(path):
    found = killed("random_kills", path, 400, 20)
    assert found == {"making": 10, "running": 20, "same": True}


@posix
def test_a_death_in_the_middle_of_any_write_is_harmless(path):
    found = killed("deaths_in_every_write", path, 2, 1, 0.5)
    assert found["failures"] == []
    assert found["deaths"] >= 30


@pytest.mark.slow
@posix
def test_a_death_before_any_line_that_may_write_is_harmless(path):
    found = killed("deaths_at_lines", path, 2, 1, 4)
    assert found["failures"] == []
    assert found["deaths"] >= 100


@pytest.mark.slow
@posix
def test_hundred_kills_at_random_times(path):
    found = killed("random_kills", path, 2_000, 100)
    assert found["same"] and found["running"] == 100


def test_a_step_touches_data_and_nothing_of_the_structure_of_the_file(path):
    backend = create(path, 5)
    before = np.fromfile(path, np.uint8)
    advance(backend, 5)
    after = np.fromfile(path, np.uint8)
    assert len(after) == len(before)
    layout = storage.read_layout(path, "ensemble_0")
    sizes = {name: 5 * size for name, size in layout.row_bytes.items()}
    sizes |= {name: kind.itemsize for name, kind in storage.ATTRIBUTES.items()}
    sizes |= {"accepted": 8 * W, "commit": 2 * layout.record.itemsize}
    for name, size in sizes.items():
        start = layout.places[name]
        assert not np.array_equal(
            *(x[start : start + size] for x in (before, after))
        ) or (
            name in ("random_state_3", "random_state_4")  # may well be the same
        )
        before[start : start + size] = after[start : start + size]
    assert np.array_equal(before, after)


def spoil(path, place, count):
    with open(path, "r+b") as file:
        content = storage.read_at(file, place, count)
        storage.write_at(file, place, bytes(255 - byte for byte in content))


@pytest.mark.parametrize("within", [0, 2500, -9, -1])
def test_a_torn_commit_record_costs_one_step_and_no_bit_of_the_end(written, within):
    layout = storage.read_layout(written, "ensemble_0")
    size = layout.record.itemsize
    spoil(written, layout.places["commit"] + within % size, 1)  # slot 0 holds step 6
    backend = RunFile.resume(written)[0]
    assert backend.iteration == 5
    assert HDFBackend(written, name="ensemble_0").iteration == 5
    assert_same(advance(backend, 5), advance(Backend(), 10))


def test_a_file_without_a_whole_commit_record_is_refused(written):
    layout = storage.read_layout(written, "ensemble_0")
    spoil(written, layout.places["commit"], 2 * layout.record.itemsize)
    refused(written, "damaged, since neither commit record is whole")


@pytest.mark.parametrize("name", ["chain", "log_prob", "blobs"])
def test_a_last_step_that_is_not_what_was_committed_is_refused(written, name):
    layout = storage.read_layout(written, "ensemble_0")
    size = layout.row_bytes[name]
    spoil(written, layout.places[name] + 6 * size - 1, 1)
    refused(written, "step 6 is not the one that was written")


def test_resuming_repairs_what_emcee_reads(written):
    layout = storage.read_layout(written, "ensemble_0")
    for name in ("accepted", *storage.ATTRIBUTES):
        spoil(written, layout.places[name], 8)
    assert RunFile(written).iteration == 6  # it reads the commit record alone
    RunFile.resume(written)
    assert_same(HDFBackend(written, name="ensemble_0"), advance(Backend(), 6))


def test_an_interrupt_within_a_step_leaves_a_sampler_that_can_go_on(path, monkeypatch):
    backend, write = create(path), storage.write_at
    for last in (1, 3, 5, 9):  # the write that the interrupt follows
        left = [10 + last]

        def interrupted(*arguments, left=left):
            write(*arguments)
            left[0] -= 1
            if not left[0]:
                raise KeyboardInterrupt

        monkeypatch.setattr(storage, "write_at", interrupted)
        with pytest.raises(KeyboardInterrupt):
            advance(backend, 10)
        monkeypatch.setattr(storage, "write_at", write)
    advance(backend, 10 - backend.iteration)
    assert_same(backend, advance(Backend(), 10))


def test_a_longer_run_moves_all_ensembles_to_a_larger_file(path):
    create(path, 4, ensembles=2, fingerprint={"seed": "1"})
    link = path + ".link"
    os.symlink(path, link)
    os.chmod(path, 0o640)
    first, second = RunFile.resume(link, 2)
    advance(second, 3)
    advance(first, 4)
    advance(first, 6)
    assert os.path.islink(link) and os.stat(path).st_mode & 0o777 == 0o640
    assert first.capacity == second.capacity == 10
    advance(second, 7)  # it knew the places in the file that was replaced
    whole = advance(Backend(), 10)
    for backend in (first, second, HDFBackend(path, name="ensemble_1")):
        assert_same(backend, whole)
    assert first.fingerprint == {"seed": "1"}


def test_copying_to_a_larger_file_works_in_blocks(written, monkeypatch):
    monkeypatch.setattr(creation, "BLOCK", 100)
    creation.extend(written, 20)
    assert_same(RunFile.resume(written)[0], advance(Backend(), 6))


def test_a_fingerprint_of_any_length_is_kept(path):
    fingerprint = {f"k{i}[µ]": "x" * 1000 for i in range(1000)}
    assert create(path, fingerprint=fingerprint).fingerprint == fingerprint


def test_a_file_without_steps_can_be_resumed(path):
    create(path)
    backend = RunFile.resume(path)[0]
    with pytest.raises(AttributeError, match="You must run the sampler"):
        backend.get_chain()
    assert (backend.iteration, backend.random_state, backend.capacity) == (0, None, 10)
    assert backend.shape == (W, D) and backend.has_blobs()
    assert_same(advance(backend, 10), advance(Backend(), 10))
