"""Making and enlarging the HDF5 file of a run: it appears whole, or not at all."""

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, BinaryIO

import emcee
import numpy as np

from . import storage
from .storage import ATTRIBUTES, FORMAT, Layout

BLOCK = 1 << 24  # bytes copied at once


def create(path: str, like: Layout, ensembles: int, fingerprint: str) -> None:
    """Make a file with room for all steps of all ensembles, none of them written.

    Raises:
        ValueError: If the file exists, its directory does not, or the disk is full.
    """
    check_new(path)
    _refuse_full_disk(path, _size(like, ensembles))
    names = [f"ensemble_{k}" for k in range(ensembles)]
    with _incomplete(path) as temporary:
        _build(temporary, like, names, fingerprint)
        with open(temporary, "r+b", buffering=0) as file:
            for name in names:
                layout = storage.read_layout(temporary, name)
                record = np.zeros((), layout.record)
                storage.commit(file, layout, record)
                storage.publish(file, layout, record)


def check_new(path: str) -> None:
    """Refuse a place where no file can be made, before anything is computed for it.

    Raises:
        ImportError: If h5py is not installed.
        ValueError: If the file exists, or its directory does not or takes no files.
    """
    storage.hdf5()
    if os.path.lexists(path):
        raise ValueError(
            f"backend: {path} exists; go on with it by resume=True, or give another "
            "file name"
        )
    folder, name = os.path.split(path)
    folder = folder or os.curdir
    if not name:
        raise ValueError(f"backend: expected the name of a file, got {path!r}")
    if not os.path.isdir(folder):
        raise ValueError(f"backend: there is no directory for {path}; make it")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(f"backend: no file can be written in the folder of {path}")


def extend(path: str, nsteps: int) -> None:
    """Replace the file by a copy with room for ``nsteps`` steps of each ensemble.

    Raises:
        ValueError: If the disk has no room for it.
    """
    path = os.path.realpath(path)  # a link goes on pointing to it
    with storage.opened(path) as h5:
        names, fingerprint = list(h5), h5.attrs["fingerprint"]
    layouts = {name: storage.read_layout(path, name) for name in names}
    first = layouts[names[0]]
    like = first._replace(nsteps=nsteps)
    now, then = _size(first, len(names)), _size(like, len(names))
    _refuse_full_disk(path, max(now, then - now))  # the old one goes after the copy
    with _incomplete(path) as temporary:
        _build(temporary, like, names, fingerprint)
        with (
            open(path, "rb", buffering=0) as source,
            open(temporary, "r+b", buffering=0) as target,
        ):
            for name, old in layouts.items():
                new = storage.read_layout(temporary, name)
                record = storage.latest(path, source, old).copy()
                _copy_rows(source, old, target, new, int(record["iteration"]))
                storage.commit(target, new, record)
                storage.publish(target, new, record)
            os.fsync(target.fileno())  # before the old file goes, lest power be lost
        shutil.copymode(path, temporary)


def _size(like: Layout, ensembles: int) -> int:
    """Return the size of the data in bytes; all else is some kB."""
    return ensembles * like.nsteps * sum(like.row_bytes.values())


def _refuse_full_disk(path: str, needed: int) -> None:
    free = shutil.disk_usage(os.path.dirname(os.path.abspath(path))).free
    if needed > free:
        raise ValueError(
            f"backend: {path} needs {needed / 1e9:.3g} GB, but its disk has "
            f"{free / 1e9:.3g} GB left; store fewer steps (thin_by), or choose "
            "another disk"
        )


@contextmanager
def _incomplete(path: str) -> Iterator[str]:
    """Give a name to write to; if all went well, that file becomes ``path``."""
    temporary = f"{path}.incomplete"
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException:  # an interrupt too
        if os.path.exists(temporary):
            os.remove(temporary)
        raise


def _build(path: str, like: Layout, names: Sequence[str], fingerprint: str) -> None:
    """Write the HDF5 structure, and room for the data."""
    h5py = storage.hdf5()
    # HDF5 reports where data are in the file, but not where attributes are: random
    # bytes stand in for them until they are found.
    rng = np.random.default_rng()
    marks = {
        name: {
            attribute: np.frombuffer(rng.bytes(kind.itemsize), kind)[0]
            for attribute, kind in ATTRIBUTES.items()
        }
        for name in names
    }
    # In the earliest format, since later ones protect attributes by checksums.
    with h5py.File(path, "w", libver="earliest") as h5:
        h5.attrs["format"] = FORMAT
        h5.attrs["fingerprint"] = fingerprint
        for name in names:
            attributes = h5.create_group(name).attrs
            attributes["version"] = emcee.__version__
            attributes["nwalkers"] = like.nwalkers
            attributes["ndim"] = like.ndim
            attributes["has_blobs"] = like.blobs > 0
            attributes["random_state_0"] = "MT19937"
            for attribute, mark in marks[name].items():
                attributes.create(attribute, mark)
    with open(path, "rb") as file:
        content = file.read()  # small, since there are no data yet
    with h5py.File(path, "r+", libver="earliest") as h5:
        for name in names:
            places = [content.index(mark.tobytes()) for mark in marks[name].values()]
            h5[name].create_dataset("attribute_places", data=np.array(places, "<i8"))
            _make_room(h5py, h5[name], like)
    for name in names:
        storage.check_places(path, name)


def _make_room(h5py: Any, group: Any, like: Layout) -> None:
    """Create the data sets of one ensemble, each in one piece and at once."""
    piece = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    piece.set_layout(h5py.h5d.CONTIGUOUS)
    piece.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    piece.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    steps = (like.nsteps, like.nwalkers)
    group.create_dataset("commit", (2,), like.record, dcpl=piece)
    group.create_dataset("accepted", (like.nwalkers,), "<f8", dcpl=piece)
    group.create_dataset("chain", (*steps, like.ndim), "<f8", dcpl=piece)
    group.create_dataset("log_prob", steps, "<f8", dcpl=piece)
    if like.blobs:
        kind = np.dtype(("<f8", like.blob_shape))  # as emcee stores them
        group.create_dataset("blobs", steps, kind, dcpl=piece)


def _copy_rows(
    source: BinaryIO, old: Layout, target: BinaryIO, new: Layout, steps: int
) -> None:
    """Copy the steps of one ensemble, in blocks, so that little memory is needed."""
    for dataset, length in old.row_bytes.items():
        end = steps * length
        for start in range(0, end, BLOCK):
            count = min(BLOCK, end - start)
            block = storage.read_at(source, old.places[dataset] + start, count)
            storage.write_at(target, new.places[dataset] + start, block)
