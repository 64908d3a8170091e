"""RunFile: a run in a file that a kill at any moment leaves usable."""

import json
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import emcee
import numpy as np
import pytest
from emcee.backends import Backend, HDFBackend
from support import killed_runs
from support.run_files import D, W, advance, assert_same, create, first_state, log_prob
from support.systems import posix

import emcee_femu as ef
from emcee_femu.sampling.run_file import RunFile, log


@pytest.fixture
def path(tmp_path):
    return str(tmp_path / "run.chain")


@pytest.fixture
def written(path):
    advance(create(path), 6)
    return path


def kill(task, kind, nsteps, path, *arguments):
    call = [
        sys.executable,
        killed_runs.__file__,
        json.dumps([task, kind, nsteps, path, *arguments]),
    ]
    folders = [str(Path(killed_runs.__file__).parents[1]), *sys.path]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(folders)}
    done = subprocess.run(call, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@posix
@pytest.mark.parametrize(
    ("kind", "nsteps"),
    [pytest.param("tempered", 300, marks=pytest.mark.slow), ("reject", 60)],
)
def test_kills_at_random_times_leave_the_bits_of_a_whole_run(path, kind, nsteps):
    assert kill("random_kills", kind, nsteps, path, 6) >= 3


@posix
@pytest.mark.slow
@pytest.mark.parametrize("kind", killed_runs.MOVES)
def test_forty_kills_at_random_times(path, kind):
    assert kill("random_kills", kind, 1_500, path, 40) >= 20


@posix
@pytest.mark.parametrize("share", [0.5, 1])
def test_a_death_in_the_middle_of_any_write_is_harmless(path, share):
    assert kill("deaths_in_writes", "mixed", 2, path, share, 1) >= 6


@posix
@pytest.mark.slow
def test_a_death_in_the_writes_of_a_burn_in_is_harmless(path):
    assert kill("deaths_in_writes", "auto", 2, path, 0.5, 5) >= 3


@pytest.mark.parametrize("blobs", [0, 2])
@pytest.mark.parametrize("thin_by", [1, 3])
def test_it_holds_what_emcee_holds_in_memory(path, blobs, thin_by):
    own = advance(create(path, blobs), 10, blobs, thin_by)
    memory = advance(Backend(), 10, blobs, thin_by)
    for backend in (own, RunFile(path)):
        assert_same(backend, memory)
        for part in [(1, 0), (3, 0), (1, 9), (2, 5), (7, 8)]:
            for name in ("chain", "log_prob", "blobs"):
                for flat in (False, True):
                    expected = memory.get_value(name, flat, *part)
                    np.testing.assert_array_equal(
                        backend.get_value(name, flat, *part), expected
                    )
    sampler = emcee.EnsembleSampler(
        W, D, log_prob, args=[blobs], vectorize=True, backend=own
    )
    sampler.run_mcmc(None, 2)
    assert RunFile(path).iteration == 12


def test_ensembles_grow_in_any_order_and_are_written_for_emcee(path):
    create(path, ensembles=2)
    for steps in (3, 3, 1):
        for ensemble in range(2):
            advance(RunFile.open(path)[ensemble], steps)
    whole = advance(Backend(), 7)
    RunFile(path).to_hdf(path + ".h5")
    for k, own in enumerate(RunFile.open(path)):
        assert_same(own, whole)
        assert_same(HDFBackend(path + ".h5", name=f"ensemble_{k}"), whole)
    with pytest.raises(ValueError, match="exists"):
        RunFile(path).to_hdf(path + ".h5")
    with pytest.raises(ValueError, match="ensemble: .* holds 2, .* got 2"):
        RunFile(path, 2)


def test_without_h5py_the_message_names_the_remedy(written, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ImportError, match=r'pip install "emcee_femu\[hdf\]"'):
        RunFile(written).to_hdf(written + ".h5")


def test_a_file_without_steps_begins_at_its_start(path):
    create(path)
    (backend,) = RunFile.open(path)
    with pytest.raises(AttributeError, match="no step"):
        backend.get_chain()
    assert (backend.iteration, backend.random_state) == (0, None)
    assert backend.manifest == {"seed": 7} and backend.shape == (W, D)
    np.testing.assert_array_equal(
        backend.get_last_sample().coords, first_state().coords
    )


@pytest.mark.parametrize("lost", [1, 5, 2_500, 3_000])
def test_a_record_that_was_cut_short_costs_one_step_and_no_bit_of_the_end(
    written, lost
):
    os.truncate(written, os.path.getsize(written) - lost)
    assert RunFile(written).iteration == 5
    (backend,) = RunFile.open(written)
    assert backend.iteration == 5
    assert_same(advance(backend, 5), advance(Backend(), 10))


def flip(path, place):
    with open(path, "r+b") as file:
        file.seek(place, os.SEEK_SET if place >= 0 else os.SEEK_END)
        (byte,) = file.read(1)
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte ^ 1]))


def refused(path, match):
    """Check that the file is refused, and left byte for byte as it was."""
    before = Path(path).read_bytes()
    with pytest.raises(ValueError, match=match):
        RunFile.open(path)
    assert Path(path).read_bytes() == before


def test_a_flipped_byte_is_found_and_the_remedy_keeps_the_steps_before_it(written):
    size = RunFile(written)._log._kind.itemsize
    end = os.path.getsize(written)
    for number in (6, 4, 1):  # of 7 records, the first one of which is the start
        for place in (end - (8 - number) * size, end - (7 - number) * size - 1):
            flip(written, place)
            refused(written, f"damaged: record {number} of 7 is not what was written")
            flip(written, place)
    flip(written, end - 3 * size)
    with pytest.raises(ValueError) as caught:
        RunFile(written)
    remedy = str(caught.value).split("whole: ")[1].split(" keeps")[0]
    exec(remedy, {"os": os})
    assert RunFile(written).iteration == 3
    assert_same(advance(RunFile.open(written)[0], 7), advance(Backend(), 10))


@pytest.mark.parametrize("torn", [0, 100])
def test_a_last_record_that_is_damaged_is_said_and_computed_again(written, torn):
    flip(written, -500)
    with open(written, "ab") as file:
        file.write(b"x" * torn)
    with pytest.warns(
        UserWarning, match="record of .*, number 7, .* computes this one"
    ):
        (backend,) = RunFile.open(written)
    assert backend.iteration == 5
    assert_same(advance(backend, 5), advance(Backend(), 10))
    assert_same(RunFile(written), advance(Backend(), 10))


@pytest.mark.parametrize("kept", [0, 0.5, 1, 1.5])
def test_a_file_that_ends_within_its_starts_is_refused(path, kept):
    log = create(path, ensembles=2)._log
    os.truncate(path, log._begin + int(kept * log._kind.itemsize))
    refused(path, f"damaged: start {int(kept) + 1} of 2 is missing")


@pytest.mark.parametrize(
    ("spoil", "match"),
    [
        (lambda path: os.truncate(path, 40), "header is truncated or damaged"),
        (lambda path: flip(path, 30), "header is truncated or damaged"),
        (lambda path: flip(path, 15), "another version of emcee_femu wrote it"),
        (lambda path: flip(path, 3), "another file, or its beginning is damaged"),
        (lambda path: os.truncate(path, 0), "another file"),
        (
            lambda path: Path(path).write_text("k1, 4000\n" * 500, encoding="utf-8"),
            "another file",
        ),
    ],
)
def test_what_is_no_whole_file_of_a_run_is_refused(written, spoil, match):
    spoil(written)
    refused(written, f"expected the file of a run.*{match}.*left as it is")


def test_two_runs_cannot_write_to_one_file(path):
    one = create(path)
    (other,) = RunFile.open(path)
    advance(one, 2)
    before = Path(path).read_bytes()
    with pytest.raises(ValueError, match="another run writes to it; stop one"):
        other.save_step(one.get_last_sample(), np.zeros(W, bool))
    assert Path(path).read_bytes() == before
    with open(path, "ab") as file:  # had both written at the same moment
        file.write(before[-one._log._kind.itemsize :])
        file.write(before[-one._log._kind.itemsize :])
    refused(path, "record 4 of 5 is not .*, or two runs wrote to it")


def test_a_run_can_be_read_while_it_goes_on(path):
    writer = create(path)
    for steps in range(1, 4):
        advance(writer, 1)
        reader = RunFile(path)
        assert reader.iteration == steps
        assert_same(reader, writer)


@posix
def test_a_full_disk_is_named_and_loses_nothing(path):
    import resource

    backend = advance(create(path), 4)
    size, limits = os.path.getsize(path), resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        for room in (0, 100):
            resource.setrlimit(resource.RLIMIT_FSIZE, (size + room, limits[1]))
            with pytest.raises(
                OSError, match="step 5 .* was not stored.*make room"
            ) as e:
                advance(backend, 1)
            assert e.value.filename == path and os.path.getsize(path) == size
            with pytest.raises(OSError, match="could not be made"):
                resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
                create(path + "2")
            assert os.listdir(os.path.dirname(path)) == [os.path.basename(path)]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert_same(advance(backend, 6), advance(Backend(), 10))


def test_an_interrupt_within_a_step_leaves_a_backend_that_can_go_on(path, monkeypatch):
    backend, write = create(path), log.write
    for share in (0, 0.3, 1):

        def interrupted(file, content, share=share):
            write(file, content[: int(share * len(content))])
            raise KeyboardInterrupt

        advance(backend, 2)
        monkeypatch.setattr(log, "write", interrupted)
        with pytest.raises(KeyboardInterrupt):
            advance(backend, 10)
        monkeypatch.setattr(log, "write", write)
    assert_same(advance(backend, 4), advance(Backend(), 10))


def test_all_is_written_even_if_the_system_takes_it_in_pieces(path, monkeypatch):
    class Piecewise:
        content = b""

        def write(self, content):
            self.content += bytes(content[:3])
            return min(3, len(content))

    file = Piecewise()
    log.write(file, b"abcdefgh")
    assert file.content == b"abcdefgh"


def test_memory_holds_neither_the_steps_nor_more_than_is_asked_for(path):
    backend = advance(create(path), 20)
    state, accepted = backend.get_last_sample(), np.zeros(W, bool)
    tracemalloc.start()
    for _ in range(500):
        backend.save_step(state, accepted)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    assert backend.get_chain(thin=10, discard=10).shape == (51, W, D)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 60_000 and peak - grown < 60_000  # the steps are 1.4 MB


def test_what_does_not_fit_is_refused(path, tmp_path):
    backend = advance(create(path), 2)
    for blobs in (None, np.zeros((W, 3))):
        with pytest.raises(ValueError, match=r"blobs: .*stores .* \(8, 2\), got"):
            backend.grow(1, blobs)
    with pytest.raises(ValueError, match="never cleared; give a new file name"):
        backend.reset(W, D)
    with pytest.raises(ValueError, match="there is no .*none"):
        RunFile(tmp_path / "none")


@pytest.mark.parametrize("moves", [None, "auto"])
@pytest.mark.parametrize(
    ("name", "message"),
    [("none/run.chain", "no directory for .* make it"), ("sub/", "name of a file")],
)
def test_a_place_for_no_file_is_refused_before_anything_is_solved(
    tmp_path, moves, name, message
):
    def unsolved(p):
        raise AssertionError("it was solved")

    (tmp_path / "sub").mkdir()
    known = killed_runs.FAILING
    posterior = ef.LogPosterior(
        ef.FunctionModel(unsolved, n_modes=2), known.terms, known.prior
    )
    for resume in (False, True):
        with pytest.raises(ValueError, match=message):
            file = os.path.join(tmp_path, name)
            ef.run(posterior, moves, seed=1, backend=file, resume=resume)
