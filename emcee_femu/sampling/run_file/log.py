"""An append-only log: a header as JSON, then fixed-size records with checksums.

Why a log: what is written is never touched again, so a kill can only cut the last
record short, which is written over when the run goes on. A record is one stored
generation of one ensemble, complete with its random state, so that the file needs no
index, no lock and no library; NumPy maps it into memory. Storing a generation of 16
walkers takes 0.03 ms (writing into HDF5 in place took 0.09), and 4 kB, of which 2.5 kB
are the random state.
"""

import json
import os
import struct
import zlib
from collections.abc import Mapping
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import NDArray

MAGIC = b"emcee_femu run 1"  # its last character is the version of the format
LEAD = struct.Struct("<16sII")  # magic, length and checksum of the JSON that follows
COUNTS = 5  # evaluations, and failures by cause
RANDOM = ("key", "place", "has_cached", "cached")  # NumPy's RandomState


class Log:
    """The records of a file, in streams: each ensemble's start, then its steps.

    What was written until now is seen. A file that is missing or damaged raises a
    ValueError, with the number of the record.
    """

    def __init__(self, path: str) -> None:
        self.path = os.path.abspath(path)  # a solver may change the directory
        self.header, self._begin = read_header(self.path)
        self._kind = record_type(self.header)
        # The numbers of each stream's records in the file.
        self._numbers: list[list[int]] = [[] for _ in range(self.header["streams"])]
        self._latest: dict[int, tuple[int, Any]] = {}
        self.counts = [0] * COUNTS  # in the last record of all
        self._size = os.path.getsize(self.path)  # which only this run may change
        self._scan()

    @property
    def _known(self) -> int:
        return sum(map(len, self._numbers))

    def _end(self) -> int:
        return self._begin + self._known * self._kind.itemsize

    def _scan(self) -> None:
        """Take in all records; the last one may be torn, and will be written over."""
        size = self._kind.itemsize
        count = (self._size - self._begin) // size
        with open(self.path, "rb") as file:
            file.seek(self._begin)
            for number in range(count):
                if self._take(file.read(size)):
                    continue
                if number < count - 1:
                    raise ValueError(
                        f"backend: {self.path} is damaged: record {number + 1} of "
                        f"{count} is not what was written, or two runs wrote to it. "
                        f"The {number} before it are whole: os.truncate({self.path!r}, "
                        f"{self._end()}) keeps them for resume=True; or give another "
                        "file name"
                    )
                warn(
                    f"backend: the last record of {self.path}, number {count}, is not "
                    "what was written, though none of it is missing: a power loss or a "
                    "fault of the disk. The run goes on from the record before it, and "
                    "computes this one again",
                    stacklevel=5,
                )
        if self._known < self.header["starts"]:
            raise ValueError(
                f"backend: {self.path} is truncated or damaged: start "
                f"{self._known + 1} of {self.header['starts']} is missing, and no step "
                "is there; restore it from a copy, or give another file name"
            )

    def _take(self, content: bytes) -> bool:
        """Take in a record, if it is whole and the next one of its ensemble."""
        record = np.frombuffer(content, self._kind)[0]
        if zlib.crc32(content[:-4]) != record["checksum"]:
            return False
        stream, number = int(record["stream"]), self._known
        if record["step"] != self.steps(stream) + 1:
            return False
        self._latest[stream] = number, record
        self.counts = record["counts"].tolist()
        self._numbers[stream].append(number)
        return True

    def steps(self, stream: int) -> int:
        """Return the number of steps; -1 if the start is still missing."""
        return len(self._numbers[stream]) - int(stream < self.header["starts"])

    def last(self, stream: int) -> Any:
        """Return the last record of a stream, which may be its start."""
        number = self._numbers[stream][-1]
        known, record = self._latest[stream]
        return record if known == number else self._map()[number]

    def read(self, stream: int, field: str, part: slice) -> NDArray[Any]:
        """Return a field of a part of the steps, and read no others."""
        steps = self._numbers[stream][stream < self.header["starts"] :]
        found: NDArray[Any] = self._map()[field][steps[part]]
        return found

    def _map(self) -> Any:
        return np.memmap(self.path, self._kind, "r", self._begin, (self._known,))

    def append(self, stream: int, state: Any, accepted: Any, counts: Any) -> None:
        """Store one step, all of it or nothing, if no other run writes to the file."""
        step = self.steps(stream) + 1
        content = pack(self._kind, stream, step, state, accepted, counts)
        with open(self.path, "r+b", buffering=0) as file:
            if file.seek(0, os.SEEK_END) != self._size:
                raise ValueError(
                    f"backend: {self.path} has {file.tell()} bytes, but this run knows "
                    f"of {self._size}: another run writes to it; stop one of the two "
                    "and go on by resume=True"
                )
            file.truncate(self._end())  # what is torn may be longer than a record
            file.seek(self._end())
            try:
                write(file, content)
                self._take(content)
                self._size = self._end()
            except BaseException as error:  # of the keyboard too
                self._size = self._end()
                file.truncate(self._size)
                if not isinstance(error, OSError):
                    raise
                raise OSError(
                    error.errno,
                    f"{error.strerror}; step {step} of ensemble {stream + 1} was not "
                    "stored, all before it are: make room and go on by resume=True",
                    self.path,
                ) from error


def record_type(header: Mapping[str, Any]) -> np.dtype[Any]:
    """Return the type of a record, in which all numbers are aligned."""
    walkers = header["nwalkers"]
    return np.dtype(
        [
            ("stream", "<i8"),
            ("step", "<i8"),  # 0 for the start
            ("chain", "<f8", (walkers, header["ndim"])),
            ("log_prob", "<f8", (walkers,)),
            ("blobs", "<f8", (walkers, header["blobs"])),
            ("accepted", "<f8", (walkers,)),
            ("counts", "<i8", (COUNTS,)),
            ("cached", "<f8"),
            ("key", "<u4", (624,)),
            ("place", "<u4"),
            ("has_cached", "<u4"),
            ("reserved", "<u4"),
            ("checksum", "<u4"),
        ]
    )


def pack(
    kind: np.dtype[Any], stream: int, step: int, state: Any, accepted: Any, counts: Any
) -> bytes:
    """Return the bytes of a record of emcee's ``state``."""
    record = np.zeros((), kind)
    record["stream"], record["step"] = stream, step
    record["chain"], record["log_prob"] = state.coords, state.log_prob
    if state.blobs is not None:
        record["blobs"] = state.blobs
    record["accepted"], record["counts"] = accepted, counts
    for name, value in zip(RANDOM, state.random_state[1:], strict=True):
        record[name] = value
    content = record.tobytes()[:-4]
    return content + zlib.crc32(content).to_bytes(4, "little")


def create(path: str, header: Mapping[str, Any], starts: Any, counts: Any) -> None:
    """Make a file with the starts of the ensembles; it appears whole, or not at all."""
    check_new(path)
    content = pack_header(MAGIC, header)
    for stream, state in enumerate(starts):
        content += pack(record_type(header), stream, 0, state, 0, counts)
    publish(path, content)


def pack_header(magic: bytes, header: Mapping[str, Any]) -> bytes:
    """Return the beginning of a file."""
    text = json.dumps(header).encode()
    text += b" " * (-(LEAD.size + len(text)) % 64)  # so that the records are aligned
    return LEAD.pack(magic, len(text), zlib.crc32(text)) + text


def publish(path: str, content: bytes) -> None:
    """Make a file that appears with this content, or not at all."""
    temporary = f"{path}.new"
    try:
        with open(temporary, "wb", buffering=0) as file:
            write(file, content)
    except OSError as error:
        os.remove(temporary)
        message = f"{error.strerror}; the file could not be made"
        raise OSError(error.errno, message, path) from error
    os.replace(temporary, path)


def write(file: Any, content: bytes) -> None:
    """Write to the end, though the system may take it in pieces."""
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) :]


def check_new(path: str) -> None:
    """Refuse a place where there is a file, or none can be made."""
    folder = os.path.dirname(path) or os.curdir
    if not os.path.basename(path) or os.path.isdir(path):
        raise ValueError(f"backend: expected the name of a file, got {path!r}")
    if os.path.lexists(path):
        raise ValueError(
            f"backend: {path} exists; go on with it by resume=True, or give a new file "
            "name"
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(
            f"backend: there is no directory for {path}, or none that takes files; "
            "make it"
        )


def read_header(path: str, expected: bytes = MAGIC) -> tuple[dict[str, Any], int]:
    """Return the header of a run, checked, and where the records begin."""
    if not os.path.exists(path):
        raise ValueError(f"backend: expected the file of a run, but there is no {path}")
    with open(path, "rb") as file:
        lead = file.read(LEAD.size).ljust(LEAD.size, b"\0")
        magic, length, checksum = LEAD.unpack(lead)
        text = file.read(length) if magic == expected else b""
    if magic[:-1] != expected[:-1]:
        fault = "this is another file, or its beginning is damaged"
    elif magic != expected:
        fault = "another version of emcee_femu wrote it: go on with that"
    elif zlib.crc32(text) != checksum:
        fault = "its header is truncated or damaged: restore it from a copy"
    else:
        header: dict[str, Any] = json.loads(text)
        return header, LEAD.size + length
    raise ValueError(
        f"backend: expected the file of a run of emcee_femu, got {path}: {fault}, or "
        "give a new file name. It was left as it is"
    )
