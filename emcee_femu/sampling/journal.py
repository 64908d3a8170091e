"""Evaluations of a search in a file, so that a search that was killed can go on.

A search is a function of its random stream and of what it evaluates. So nothing of its
state is stored: resumed, it runs again from the beginning, and what was evaluated
before comes from the file. A kill can only cut the last batch short.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from typing import Any, TypeAlias

import emcee
import numpy as np

from ..interfaces import Floats, Linearization
from ..posterior.linearize import unstack
from .evaluation import Evaluation
from .manifest import check_same
from .probe import probe
from .run_file import log

MAGIC = b"emcee_femu pts 1"  # its last character is the version of the format
LEAD = struct.Struct("<qqq")  # kind, points, columns of the result
MOST = 256  # points that a kill may lose
KINDS = ("rows", "linearize")
PROBED = 16  # points

# Kind, points, result, what was spent, bytes.
Record: TypeAlias = tuple[int, Floats, Floats, Any, int]


class Journal:
    """An evaluation that stores each batch, or finds it in the file.

    It serves a search in place of the :class:`Evaluation` that it wraps.

    Args:
        evaluation: What evaluates a batch that is not stored.
        path: The file; None to store nothing.
        header: What is searched, its "manifest", and more for JSON; of a file that is
            there it is read.

    Raises:
        ValueError: If the file is damaged or of another search, or from a batch if the
            search takes another way than the stored one: another version of a library
            computes otherwise.
    """

    def __init__(
        self, evaluation: Evaluation, path: str | None, header: dict[str, Any]
    ) -> None:
        self.evaluation, self.posterior = evaluation, evaluation.posterior
        self._path, self._place, self._end = path, 0, 0
        self.header = header
        if path is None:
            return
        if not os.path.lexists(path):
            log.check_new(path)
            log.publish(path, log.pack_header(MAGIC, header))
        self.header, self._place = log.read_header(path, MAGIC)
        self._end = os.path.getsize(path)
        check_same(path, self.header["manifest"], header["manifest"])

    @property
    def solves(self) -> int:
        """Model solves so far, those of the file included."""
        return self.evaluation.solves

    def rows(self, theta: Floats) -> Floats:
        """Return the rows of the posterior at ``theta (n, d)``, part by part."""
        if self._path is None or len(theta) <= MOST:
            return self._rows(theta)
        parts = [theta[i : i + MOST] for i in range(0, len(theta), MOST)]
        return np.concatenate([self._rows(part) for part in parts])

    def _rows(self, theta: Floats) -> Floats:
        stored = self._stored(0, theta)
        if stored is None:
            stored = self.evaluation.rows(theta)
            self._append(0, theta, stored)
        return stored

    def each(self, theta: Floats) -> Iterator[tuple[int, Floats]]:
        """Yield number and row of each point, in the order in which they came.

        Each is stored as it comes, so that a kill loses none; and points may be added
        to a batch of which a part is stored.
        """
        waiting = list(range(len(theta)))
        while waiting and (record := self._next()) is not None:
            kind, points, result, counts, size = record
            found = [i for i in waiting if np.array_equal(theta[i : i + 1], points)]
            if kind or not found:
                raise self._other_way()
            self._go_on(counts, size)
            waiting.remove(found[0])
            yield found[0], result[0]
        for number, row in self.evaluation.each(theta[waiting]):
            place = waiting[number]
            self._append(0, theta[place : place + 1], row[None])
            yield place, row

    def linearize(self, theta: Floats) -> Linearization:
        """Return rows, gradients and information."""
        stored = self._stored(1, theta)
        if stored is not None:
            return unstack(self.posterior, stored)
        found = self.evaluation.linearize(theta)
        n, d = theta.shape
        matrices = found.information
        if matrices is None:
            matrices = np.full((n, d, d), np.nan)
        parts = [found.rows, found.gradient, matrices.reshape(n, -1)]
        self._append(1, theta, np.hstack(parts))
        return found

    def probe(self, tolerance: float) -> None:
        """Refuse to go on if the first stored points have other rows by now."""
        record = None if self._path is None else self._read(self._place)
        if record is None:
            return
        _, theta, rows, _, _ = record
        width = len(self.posterior.rejected())
        state = emcee.State(theta[:PROBED], rows[:PROBED, 0], rows[:PROBED, 1:width])
        probe(self.evaluation, [state], str(self._path), tolerance)

    def _stored(self, kind: int, theta: Floats) -> Floats | None:
        """Return the result of the next batch of the file, None at its end."""
        record = self._next()
        if record is None:
            return None
        own, points, result, counts, size = record
        if own != kind or not np.array_equal(points, theta):
            raise self._other_way()
        self._go_on(counts, size)
        return result

    def _next(self) -> Record | None:
        """Return the next record of the file, None at its end."""
        if self._path is None or self._place >= self._end:
            return None
        record = self._read(self._place)
        if record is None:  # torn: written over
            self._end = self._place
        return record

    def _go_on(self, counts: Any, size: int) -> None:
        """Count what a record has spent, and pass it."""
        self._place += size
        self.evaluation.solves = int(counts[0])
        if self.evaluation.failures is not None:
            self.evaluation.failures.restore(counts[1:].tolist())

    def _other_way(self) -> ValueError:
        return ValueError(
            f"resume: the search does not take the way that {self._path} holds, "
            "though it is of the same posterior: another version of a library, or "
            "another machine, computes other digits. Go on where it began, or "
            "give another file name"
        )

    def _read(self, place: int) -> Record | None:
        """Return the record that begins there, None if the last one is torn."""
        with open(str(self._path), "rb") as file:
            file.seek(place)
            lead = file.read(LEAD.size)
            if len(lead) < LEAD.size:
                return None
            kind, n, width = LEAD.unpack(lead)
            d = self.posterior.ndim
            size = 8 * (n * (d + width) + 1 + log.COUNTS)
            whole = kind in range(len(KINDS)) and min(n, width) >= 0
            if whole and place + LEAD.size + size + 4 > self._end:
                return None
            body = file.read(size) if whole else b""
            checksum = int.from_bytes(file.read(4), "little")
        if not whole or zlib.crc32(lead + body) != checksum:
            raise ValueError(
                f"resume: {self._path} is damaged at byte {place}: it is not what was "
                f"written. os.truncate({self._path!r}, {place}) keeps what is before "
                "it; or give another file name"
            )
        numbers = np.frombuffer(body, "<f8", n * (d + width))
        counts = np.frombuffer(body, "<i8", offset=8 * n * (d + width))
        theta = numbers[: n * d].reshape(n, d)
        result = numbers[n * d :].reshape(n, width).copy()
        return kind, theta, result, counts, LEAD.size + size + 4

    def _append(self, kind: int, theta: Floats, result: Floats) -> None:
        if self._path is None:
            return
        failures = self.evaluation.failures
        counts = [0] * log.COUNTS if failures is None else failures.counts
        content = LEAD.pack(kind, len(theta), result.shape[1])
        content += np.ascontiguousarray(theta, "<f8").tobytes()
        content += np.ascontiguousarray(result, "<f8").tobytes()
        content += np.array([self.solves, *counts], "<i8").tobytes()
        content += zlib.crc32(content).to_bytes(4, "little")
        with open(self._path, "r+b", buffering=0) as file:
            file.truncate(self._place)  # what is torn
            file.seek(self._place)
            log.write(file, content)
        self._place += len(content)
        self._end = self._place
