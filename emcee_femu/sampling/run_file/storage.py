"""The HDF5 file of a run: all data at fixed places, so that a kill does no harm.

HDF5 makes the file and reads it. A step is written past the library, at places that it
reported: a library that is killed while it changes the structure of a file leaves one
that nobody can open. Bytes handed to the operating system survive the process, in their
order, so a step exists once its commit record is whole. There are two records, written
in turn, each with a checksum: the one being written is never the one that counts.
"""

import os
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, BinaryIO, NamedTuple

import numpy as np

FORMAT = "emcee_femu run, version 2"
COUNTS = 5  # evaluations, and failures by cause
# What emcee keeps in attributes: the state of RandomState, and the iteration as last.
ATTRIBUTES = {
    "random_state_1": np.dtype(("<u4", (624,))),
    "random_state_2": np.dtype("<i8"),
    "random_state_3": np.dtype("<i8"),
    "random_state_4": np.dtype("<f8"),
    "iteration": np.dtype("<i8"),
}


class Layout(NamedTuple):
    """Where in the file the numbers of one ensemble stand.

    Attributes:
        nwalkers: Walkers.
        ndim: Parameters.
        nsteps: Steps for which there is room.
        blobs: Blobs a walker, 0 for none.
        places: Offsets in bytes, by data set or attribute.
        identity: Of the file on disk; another one if it was replaced.
    """

    nwalkers: int
    ndim: int
    nsteps: int
    blobs: int
    places: Mapping[str, int] = {}
    identity: tuple[int, ...] = ()

    @property
    def blob_shape(self) -> tuple[int, ...]:
        """Shape of a walker's blobs: emcee squeezes a single one."""
        return (self.blobs,) if self.blobs > 1 else ()

    @property
    def row_bytes(self) -> dict[str, int]:
        """Size of a step in bytes, by data set."""
        numbers = {"chain": self.ndim, "log_prob": 1, "blobs": self.blobs}
        return {k: 8 * self.nwalkers * n for k, n in numbers.items() if n}

    @property
    def record(self) -> np.dtype[Any]:
        """The commit record: with the last rows, all that a run needs to go on."""
        fields = {
            **ATTRIBUTES,
            "accepted": np.dtype(("<f8", (self.nwalkers,))),
            "counts": np.dtype(("<i8", (COUNTS,))),
            "rows_checksum": np.dtype("<u4"),
            "checksum": np.dtype("<u4"),
        }
        return np.dtype([*fields.items()])


def hdf5() -> Any:
    """Return h5py.

    Raises:
        ImportError: If h5py is not installed.
    """
    try:
        import h5py
    except ImportError:
        raise ImportError(
            'a run in a file needs h5py: pip install "emcee_femu[hdf]"'
        ) from None
    return h5py


@contextmanager
def opened(path: str) -> Iterator[Any]:
    """Open the file of a run for reading by h5py.

    Raises:
        ValueError: If it is not there, truncated, or not made by this package.
    """
    h5py = hdf5()
    expected = f"backend: {path}: expected the file of a run of emcee_femu"
    remedy = "It was left as it is; to start anew give another file name"
    if not os.path.exists(path):
        raise ValueError(f"{expected}, but there is none; start without resume=True")
    try:
        # By another driver than the usual one, with which HDF5 would share, and show,
        # what this process read from the file earlier if it has it open elsewhere.
        h5 = h5py.File(path, "r", driver="stdio")
    except OSError as error:
        if type(error) is not OSError:  # a PermissionError speaks for itself
            raise
        raise ValueError(
            f"{expected}, but it is not HDF5, or truncated ({error}). {remedy}"
        ) from error
    with h5:
        try:
            if h5.attrs.get("format") != FORMAT:
                raise ValueError(
                    f"{expected}, got another HDF5 file, which holds {list(h5)[:5]}. "
                    f"{remedy}; emcee.backends.HDFBackend reads chains of plain emcee"
                )
            yield h5
        except (KeyError, OSError, RuntimeError) as error:  # of h5py
            raise ValueError(
                f"{expected}, but it is damaged ({error}). {remedy}"
            ) from error


def read_layout(path: str, name: str) -> Layout:
    """Return where the numbers of the ensemble ``name`` are.

    Raises:
        ValueError: If the file is not one of this package, has no such ensemble, or
            was rewritten by another program.
    """
    with opened(path) as h5:
        if name not in h5:
            raise ValueError(
                f"backend: {path}: expected {name}, but it holds {sorted(h5)}; give "
                "the number of ensembles that it was started with"
            )
        group = h5[name]
        found = group["attribute_places"][:].tolist()
        places = dict(zip(ATTRIBUTES, found, strict=True))
        data = {"chain", "log_prob", "blobs", "accepted", "commit"} & set(group)
        places |= {dataset: group[dataset].id.get_offset() for dataset in data}
        nsteps, nwalkers, ndim = group["chain"].shape
        blobs = 0
        if "blobs" in data:
            blobs = int(np.prod(group["blobs"].dtype.shape, dtype=int))
    if None in places.values():
        raise _moved(path)
    return Layout(nwalkers, ndim, nsteps, blobs, places, identity(os.stat(path)))


def check_places(path: str, name: str) -> None:
    """Refuse a file whose attributes were moved: writing would destroy it.

    Raises:
        ValueError: If they are not where they were when the file was made.
    """
    layout = read_layout(path, name)
    with opened(path) as h5, open(path, "rb") as file:
        for attribute, kind in ATTRIBUTES.items():
            value = np.asarray(h5[name].attrs[attribute], kind.base).tobytes()
            if read_at(file, layout.places[attribute], len(value)) != value:
                raise _moved(path)


def _moved(path: str) -> ValueError:
    return ValueError(
        f"backend: {path}: another program rewrote this file (h5repack?), or writes to "
        "it now; go on with the original. It was left as it is, and "
        "emcee.backends.HDFBackend reads it"
    )


def identity(status: os.stat_result) -> tuple[int, ...]:
    """Return what tells a file from the one that replaces it."""
    return status.st_dev, status.st_ino, status.st_size


def latest(path: str, file: BinaryIO, layout: Layout) -> Any:
    """Return the commit record of the last whole step.

    Raises:
        ValueError: If neither record is whole.
    """
    record = layout.record
    slots = read_at(file, layout.places["commit"], 2 * record.itemsize)
    whole = [r for r in np.frombuffer(slots, record) if r["checksum"] == _checksum(r)]
    if not whole:
        raise ValueError(
            f"backend: {path}: damaged, since neither commit record is whole. It was "
            "left as it is; emcee.backends.HDFBackend may still read the chain"
        )
    return max(whole, key=lambda r: int(r["iteration"]))


def check_last_rows(path: str, file: BinaryIO, layout: Layout, record: Any) -> None:
    """Raise ValueError if the last step is not the one that was committed."""
    step, checksum = int(record["iteration"]), 0
    if not step:
        return
    for dataset, length in layout.row_bytes.items():
        row = read_at(file, layout.places[dataset] + (step - 1) * length, length)
        checksum = zlib.crc32(row, checksum)
    if checksum != record["rows_checksum"]:
        raise ValueError(
            f"backend: {path}: step {step} is not the one that was written (was the "
            "file copied while a run wrote to it, or the power lost?). It was left as "
            "it is; go on with the original"
        )


def write_rows(file: BinaryIO, layout: Layout, last: Any, state: Any) -> Any:
    """Write the numbers of the next step; return its record, still to be filled."""
    step, checksum = int(last["iteration"]), 0
    values = {"chain": state.coords, "log_prob": state.log_prob, "blobs": state.blobs}
    for dataset, length in layout.row_bytes.items():
        row = np.asarray(values[dataset], "<f8").tobytes()
        write_at(file, layout.places[dataset] + step * length, row)
        checksum = zlib.crc32(row, checksum)
    record = last.copy()
    record["iteration"], record["rows_checksum"] = step + 1, checksum
    return record


def commit(file: BinaryIO, layout: Layout, record: Any) -> None:
    """Write the commit record: from then on its step exists."""
    record["checksum"] = _checksum(record)
    slot = int(record["iteration"]) % 2
    place = layout.places["commit"] + slot * record.nbytes
    write_at(file, place, record.tobytes())


def publish(file: BinaryIO, layout: Layout, record: Any) -> None:
    """Bring what emcee's own backend reads up to date with the record."""
    for name in ("accepted", *ATTRIBUTES):
        write_at(file, layout.places[name], record[name].tobytes())


def read_at(file: BinaryIO, place: int, count: int) -> bytes:
    """Return ``count`` bytes from ``place`` on."""
    file.seek(place)
    return file.read(count)


def write_at(file: BinaryIO, place: int, content: bytes) -> None:
    """Write all of ``content`` from ``place`` on."""
    file.seek(place)
    rest = memoryview(content)
    while rest:  # a call need not write all
        rest = rest[file.write(rest) :]


def _checksum(record: Any) -> int:
    return zlib.crc32(record.tobytes()[:-4])  # of all but itself
