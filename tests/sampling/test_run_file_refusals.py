"""RunFile: what it refuses, by name, and leaves as it was; what it costs."""

import io
import os
import shutil
import sys
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import emcee
import h5py
import numpy as np
import pytest
from emcee.backends import Backend, HDFBackend
from support.run_files import D, W, advance, assert_same, create, log_prob

from emcee_femu.sampling.run_file import RunFile, storage

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


def write_text(path):
    Path(path).write_text("k1, 4000\n" * 500, encoding="utf-8")


def write_nothing(path):
    Path(path).touch()


def write_emcee(path):
    advance(HDFBackend(path, name="ensemble_0"), 3)


def write_other(path):
    with h5py.File(path, "w") as h5:
        h5["stiffness"] = np.eye(3)


@pytest.mark.parametrize(
    ("write", "match"),
    [
        (write_text, "not HDF5, or truncated"),
        (write_nothing, "not HDF5, or truncated"),
        (write_emcee, r"another HDF5 file, which holds \['ensemble_0'\]"),
        (write_other, r"another HDF5 file, which holds \['stiffness'\]"),
    ],
)
def test_a_foreign_file_is_refused_and_left_as_it_is(path, write, match):
    write(path)
    refused(
        path, f"expected the file of a run of emcee_femu.*{match}.*another file name"
    )


def test_a_truncated_file_is_refused_and_left_as_it_is(written):
    size = os.path.getsize(written)
    for left in (size - 1, size // 2, 2048, 100, 8, 1):
        os.truncate(written, left)
        refused(written, "not HDF5, or truncated")


def test_a_damaged_structure_is_refused_and_left_as_it_is(written):
    with open(written, "r+b") as file:
        tree = file.read().index(b"TREE")  # the list of the groups
        storage.write_at(file, tree, b"XXXX")
    refused(written, "it is damaged.*It was left as it is")


def test_a_file_that_another_program_rewrote_is_refused(written):
    with h5py.File(written) as old, h5py.File(written + "2", "w") as new:
        for name, value in old.attrs.items():
            new.attrs[name] = value
        new["before"] = np.zeros(1000)
        old.copy("ensemble_0", new)
        del new["before"]
    os.replace(written + "2", written)
    refused(written, "another program rewrote this file")
    assert_same(HDFBackend(written, name="ensemble_0"), advance(Backend(), 6))
    with pytest.raises(ValueError, match="another program rewrote this file"):
        RunFile(written).grow(1, np.zeros((W, 2)))


def test_a_compressed_copy_is_refused(written):
    with h5py.File(written, "r+") as h5:
        chain = h5["ensemble_0/chain"][:]
        del h5["ensemble_0/chain"]
        h5["ensemble_0"].create_dataset("chain", data=chain, compression="gzip")
    refused(written, "another program rewrote this file")


@pytest.mark.parametrize("ensembles", [1, 3])
def test_another_number_of_ensembles_is_refused(path, ensembles):
    create(path, ensembles=2)
    refused(path, "holds 2 ensembles.*resume with ensembles=2", ensembles)


def test_a_missing_group_or_file_is_refused(written):
    with pytest.raises(ValueError, match=r"expected mcmc.*holds \['ensemble_0'\]"):
        RunFile(written, "mcmc").shape  # noqa: B018
    with pytest.raises(ValueError, match="there is none; start without resume"):
        RunFile.resume(written + "x")


def test_two_runs_cannot_write_to_one_file(path):
    one, other = create(path), RunFile.resume(path)[0]
    advance(one, 2)
    before = Path(path).read_bytes()
    state = one.get_last_sample()
    with pytest.raises(ValueError, match="holds 2 steps.*knows of 0.*another run"):
        other.save_step(state, np.zeros(W, bool))
    assert Path(path).read_bytes() == before


def test_readers_do_not_stop_the_run_and_see_whole_steps(path):
    backend = create(path)
    with h5py.File(path, "r"):  # holds a lock, as a notebook would
        for steps in range(1, 4):
            advance(backend, 1)
            assert RunFile(path).get_chain().shape == (steps, W, D)


def test_a_file_can_only_be_made_where_there_is_none_and_room_for_it(path, monkeypatch):
    with pytest.raises(ValueError, match="there is no directory"):
        create(os.path.join(path, "run.h5"))
    free = SimpleNamespace(free=10_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: free)
    # 8 bytes * 8 walkers * (3 + 1 + 2) numbers * 1e6 steps * 2 ensembles
    with pytest.raises(ValueError, match="needs 0.768 GB.*1e-05 GB left.*thin_by"):
        create(path, 1_000_000, ensembles=2)
    create(path)
    advance(RunFile(path), 10)
    free.free = 3_000
    with pytest.raises(ValueError, match="needs 3.84e-06 GB"):
        advance(RunFile(path), 5)  # the copy, while the old file is still there
    assert_same(RunFile.resume(path)[0], advance(Backend(), 10))


def test_what_fails_while_it_is_made_leaves_nothing_behind(path, monkeypatch):
    def fail(*_):
        raise OSError("no space left")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="no space left"):
        create(path)
    assert os.listdir(os.path.dirname(path)) == []


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"nsteps": 0}, ValueError, "nsteps"),
        ({"nsteps": 5.0}, TypeError, "nsteps"),
        ({"blobs": -1}, ValueError, "blobs"),
        ({"ensembles": 0}, ValueError, "ensembles"),
    ],
)
def test_counts_are_checked(path, options, error, match):
    with pytest.raises(error, match=match):
        create(path, **options)
    with pytest.raises(TypeError, match="ensembles"):
        RunFile.resume(path, 1.0)


def test_what_does_not_fit_is_refused(path):
    backend = create(path)
    for blobs in (None, np.zeros((W, 3)), np.zeros((W, 2), np.float32)):
        with pytest.raises(
            ValueError, match=r"room for float64 blobs of shape \(8, 2\), got"
        ):
            backend.grow(1, blobs)
    with pytest.raises(ValueError, match="room for no blobs, got float64 ones"):
        create(path + "2", blobs=0).grow(1, np.zeros((W, 2)))
    state = advance(backend, 10).get_last_sample()
    with pytest.raises(ValueError, match="is full"):
        backend.save_step(state, np.zeros(W, bool))
    state.coords = state.coords.astype(np.float32)
    with pytest.raises(TypeError, match="expected float64 coordinates, got float32"):
        backend.save_step(state, np.zeros(W, bool))


def test_steps_are_never_cleared(path):
    with pytest.raises(ValueError, match="make it by RunFile.create"):
        emcee.EnsembleSampler(W, D, log_prob, backend=RunFile(path))
    backend = advance(create(path), 2)
    with pytest.raises(ValueError, match="never cleared"):
        backend.reset(W, D)
    write_text(path)
    with pytest.raises(ValueError, match="not HDF5"):
        emcee.EnsembleSampler(W, D, log_prob, backend=backend)


def test_without_h5py_the_message_names_the_remedy(path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    for call in (RunFile, create, RunFile.resume):
        with pytest.raises(ImportError, match=r'pip install "emcee_femu\[hdf\]"'):
            call(path)


def test_all_is_written_even_if_the_system_takes_it_in_pieces():
    class Piecewise(io.BytesIO):
        def write(self, content):
            return super().write(content[:3])

    file = Piecewise(bytes(12))
    storage.write_at(file, 2, b"abcdefgh")
    assert file.getvalue() == b"\0\0abcdefgh\0\0"


def test_memory_does_not_grow_with_the_number_of_steps(path):
    backend = create(path, 501, blobs=0)
    state = emcee.State(
        np.zeros((W, D)),
        np.zeros(W),
        None,
        np.random.RandomState(0).get_state(),  # noqa: NPY002
    )
    rejected = np.zeros(W, bool)
    backend.save_step(state, rejected)
    tracemalloc.start()
    for _ in range(500):
        backend.save_step(state, rejected)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 50_000  # these steps have 128,000 bytes
