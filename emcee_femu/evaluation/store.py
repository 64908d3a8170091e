"""One file for a run: what was solved, and where each ensemble has been.

A record is a batch of points with what was found there: stream 0 has the evaluations of
a search, an annealing, an emulation or a certificate in their order, streams 1, 2, ...
the steps of the ensembles, number 0 being the start. The file is SQLite's: a
transaction is there wholly or not at all, whatever kills the run, others can read while
it goes on, and each record has a checksum.
"""

import errno
import itertools
import json
import os
import sqlite3
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import emcee
import numpy as np
from numpy.typing import NDArray

from ..contracts import Floats, split_rows
from ..posterior.log_posterior import Kind
from .evaluator import Evaluation
from .memory import Weighted, remember, restore

FORMAT = 1
ENTRY = "INSERT OR REPLACE INTO entry VALUES (?, ?, ?)"
RECORD = "INSERT INTO record VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
TABLES = (
    f"PRAGMA user_version = {FORMAT}",
    "CREATE TABLE entry (name TEXT PRIMARY KEY, content TEXT, checksum INTEGER)",
    "CREATE TABLE record (stream INTEGER, number INTEGER, kind TEXT, points INTEGER, "
    "ndim INTEGER, counts TEXT, content BLOB, checksum INTEGER, "
    "UNIQUE (stream, number))",
)
WAITED = 60.0  # s for another program that reads or writes
SLOW = 0.1  # s between records from which each of them survives a power loss too


class Record(NamedTuple):
    """Points, and what was found there.

    Attributes:
        kind: What was evaluated; of a step it is "rows".
        theta: The points ``(n, d)``.
        values: What was found, ``(n, columns)``.
        counts: Solves so far, evaluations, and failures by cause; of a step those of
            its ensemble alone.
    """

    kind: Kind
    theta: Floats
    values: Floats
    counts: Sequence[int]


class Store:
    """The file of a run: records, and named entries that JSON can hold.

    Args:
        path: Its name; it is made if it is not there.
        read_only: Whether it is only looked at.

    Raises:
        ValueError: If it is another file, damaged, or of another version.
    """

    def __init__(self, path: str, read_only: bool = False) -> None:
        self.path = os.path.abspath(path)  # a solver may change the directory
        self._file: sqlite3.Connection | None = None
        self._time, self._closed = 0.0, False
        if read_only and not os.path.exists(self.path):
            raise ValueError(
                f"there is no file {self.path}; give the name that run had as backend"
            )
        try:
            with self._reading() if read_only else self._writing("the file") as file:
                names = file.execute("SELECT name FROM sqlite_master").fetchall()
                version = file.execute("PRAGMA user_version").fetchone()[0]
                for statement in () if names or read_only else TABLES:
                    file.execute(statement)
            if (names or read_only) and (("record",) not in names or version != FORMAT):
                raise ValueError(
                    f"backend: {self.path} is not the file of a run, or another "
                    "version of emcee_femu wrote it; give a new file name"
                )
        except (ValueError, OSError):
            self.close()
            raise

    def close(self) -> None:
        """Close the file, which can still be read: it is opened again for that."""
        self._closed = True
        if self._file is not None:
            with suppress(sqlite3.Error):  # else the journal stays beside the file
                self._file.execute("PRAGMA journal_mode = DELETE")
            self._file.close()
            self._file = None

    def __getitem__(self, name: str) -> Any:
        """Return the entry of that name, None if there is none."""
        query = "SELECT * FROM entry WHERE name = ?"
        for content in self._rows(query, name):
            return json.loads(content[1])
        return None

    def __setitem__(self, name: str, value: object) -> None:
        """Store an entry."""
        with self._writing(f"the {name}") as file:
            _insert(file, ENTRY, name, json.dumps(value))

    def lengths(self) -> dict[int, int]:
        """Return how many records each stream has."""
        streams, lengths = np.unique(self._records()[:, 0], return_counts=True)
        return dict(zip(streams.tolist(), lengths.tolist(), strict=True))

    def _records(self) -> NDArray[np.int_]:
        """Return stream, number and points of each record, in their order."""
        query = "SELECT stream, number, points FROM record ORDER BY stream, number"
        with self._reading() as file:
            rows = file.execute(query).fetchall()
            if None in itertools.chain.from_iterable(rows):
                raise sqlite3.DatabaseError("a number is missing")
        return np.array(rows, dtype=int).reshape(-1, 3)

    def sample_records(self, size: int) -> Iterator[tuple[Floats, Floats]]:
        """Yield stored points with their values, spread evenly over all of them."""
        records = self._records()
        ends, total = records[:, 2].cumsum(), int(records[:, 2].sum())
        for place in np.linspace(0, total - 1, min(size, total)).astype(int):
            at = int(np.searchsorted(ends, place, "right"))
            stream, number, _ = records[at].tolist()
            (record,) = self.read(stream, range(number, number + 1))
            yield record.theta[place - ends[at]], record.values[place - ends[at]]

    def append(
        self, stream: int, number: int, record: Record, position: object = None
    ) -> None:
        """Store a record and the new state of its ensemble, both or neither."""
        content = np.hstack([record.theta, record.values]).astype("<f8").tobytes()
        lead = stream, number, record.kind, *record.theta.shape
        counts = json.dumps(list(record.counts))
        what = f"step {number} of ensemble {stream}" if stream else f"batch {number}"
        with self._writing(what) as file:
            _insert(file, RECORD, *lead, counts, content)
            if position is not None:
                _insert(file, ENTRY, f"position {stream}", json.dumps(position))

    def read(self, stream: int, numbers: range) -> Iterator[Record]:
        """Yield some records of a stream."""
        query = (
            "SELECT * FROM record WHERE stream = ? AND number >= ? AND number < ? "
            "AND (number - ?) % ? = 0 ORDER BY number"
        )
        ends = numbers.start, numbers.stop, numbers.start, numbers.step
        for _, _, kind, n, ndim, counts, content in self._rows(query, stream, *ends):
            table = np.frombuffer(content, "<f8").reshape(n, -1).copy()
            yield Record(kind, table[:, :ndim], table[:, ndim:], json.loads(counts))

    def spent(self) -> list[int]:
        """Return the counts of all streams together, at their last records."""
        last = [
            next(self.read(stream, range(length - 1, length)))
            for stream, length in self.lengths().items()
        ]
        total: list[int] = np.sum([record.counts for record in last], axis=0).tolist()
        return total

    def verify(self) -> None:
        """Read the whole file, and refuse it if a single bit has changed."""
        with self._reading() as file:
            (report,) = file.execute("PRAGMA quick_check").fetchone()
            if report != "ok":
                raise sqlite3.DatabaseError(report)
        for table in ("entry", "record"):
            for _ in self._rows(f"SELECT * FROM {table}"):
                pass

    def _rows(self, query: str, *values: object) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a query after comparing their checksums."""
        with self._reading() as file:
            for *row, checksum in file.execute(query, values):
                if checksum != _checksum(row):
                    raise sqlite3.DatabaseError(
                        f"{row[:2]} does not match its checksum"
                    )
                yield tuple(row)

    def _connect(self, mode: str) -> sqlite3.Connection:
        uri = Path(self.path).as_uri() + f"?mode={mode}"
        # Transactions are begun by _writing, on whatever thread.
        return sqlite3.connect(
            uri,
            uri=True,
            timeout=WAITED,
            isolation_level=None,
            check_same_thread=False,
        )

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        """Yield the open file, or open it for this once."""
        with self._translating(""):
            if self._file is not None:
                yield self._file
                return
            # "rw", by which SQLite takes back what a kill left half written.
            with closing(self._connect("rw")) as file:
                yield file

    @contextmanager
    def _writing(self, what: str) -> Iterator[sqlite3.Connection]:
        """Yield the file in a transaction: all is written, or nothing."""
        now = time.monotonic()
        slow, self._time = now - self._time > SLOW, now
        with self._translating(what):
            if self._file is None:
                self._file = self._connect("rwc")
                self._file.execute("PRAGMA journal_mode = TRUNCATE")
            file = self._file
            file.execute(f"PRAGMA synchronous = {'NORMAL' if slow else 'OFF'}")
            file.execute("BEGIN IMMEDIATE")
            try:
                yield file
                file.execute("COMMIT")
            finally:
                if file.in_transaction:
                    file.execute("ROLLBACK")
                if self._closed:  # a step after the run: nobody would close it again
                    self.close()

    @contextmanager
    def _translating(self, written: str) -> Iterator[None]:
        """Add to SQLite's error the file's name and what was not written."""
        try:
            yield
        except sqlite3.IntegrityError as error:
            raise ValueError(
                f"backend: {written} is in {self.path} already: another run writes to "
                "it; stop one of the two and continue with resume=True"
            ) from error
        except sqlite3.Error as error:
            if written and isinstance(error, sqlite3.OperationalError):
                full = error.sqlite_errorcode == sqlite3.SQLITE_FULL
                raise OSError(
                    errno.ENOSPC if full else errno.EIO,
                    f"{error}; {written} was not stored, all before it are: free disk "
                    "space, or wait until nobody locks the file, and resume=True",
                    self.path,
                ) from error
            raise ValueError(
                f"backend: {self.path} could not be read ({error}): it is damaged, or "
                "not the file of a run. It was left as it is: restore it from a copy, "
                "or give another file name"
            ) from error


def _insert(file: sqlite3.Connection, statement: str, *values: object) -> None:
    file.execute(statement, (*values, _checksum(values)))


def _checksum(values: Sequence[object]) -> int:
    parts = [v if isinstance(v, bytes) else f"{v}|".encode() for v in values]
    return zlib.crc32(b"".join(parts))


class StoredChain(emcee.backends.Backend):
    """One ensemble of a run in its file, as emcee's samplers ask for a backend.

    Args:
        store: The file.
        ensemble: Its number, from 0.
        start: Where it starts, of a new run.
        evaluation: What evaluates it, whose counts are stored with every step.
        moves: Its own, to which what they remember is given back; none to read.

    Attributes:
        remembered: What they remembered at the last stored step.
    """

    def __init__(
        self,
        store: Store,
        ensemble: int,
        start: emcee.State | None = None,
        evaluation: Evaluation | None = None,
        moves: Weighted = (),
    ) -> None:
        super().__init__(np.float64)
        self._moves = moves
        self._store, self._stream, self._evaluation = store, ensemble + 1, evaluation
        self.initialized = True
        if start is not None:
            self.iteration, self.accepted = -1, np.zeros(len(start.coords))
            self.save_step(start, np.zeros(len(start.coords), dtype=bool))
        self.iteration = store.lengths()[self._stream] - 1
        position = store[f"position {self._stream}"]
        self.accepted = np.array(position["accepted"])
        self.remembered = position["moves"]
        if moves:
            restore(moves, self.remembered)
        key, *rest = position["random"]
        self.random_state = ("MT19937", np.array(key, dtype=np.uint32), *rest)
        (last,) = store.read(self._stream, range(self.iteration, self.iteration + 1))
        self.last, (self.nwalkers, self.ndim) = last, last.theta.shape

    def has_blobs(self) -> bool:
        """Return whether the walkers have blobs, as they do."""
        return True

    def get_last_sample(self) -> emcee.State:
        """Return the last stored state; the start if there is no step."""
        theta, rows = self.last.theta.copy(), self.last.values.copy()
        return emcee.State(theta, *split_rows(rows), self.random_state)

    def get_value(
        self, name: str, flat: bool = False, thin: int = 1, discard: int = 0
    ) -> Floats:
        """Return the stored steps of ``chain``, ``log_prob`` or ``blobs``."""
        numbers = range(discard + thin, self.iteration + 1, thin)
        if not numbers:
            raise AttributeError(f"{self._store.path}: no step of this ensemble left")
        part = 0 if name == "log_prob" else slice(1, None)
        steps = [
            record.theta if name == "chain" else record.values[:, part]
            for record in self._store.read(self._stream, numbers)
        ]
        return np.asarray(np.concatenate(steps) if flat else np.stack(steps))

    def reset(self, nwalkers: int, ndim: int) -> None:
        """Refuse to clear the chain: a file is for one run."""
        path = self._store.path
        raise ValueError(f"backend: steps in {path} are never cleared; take a new name")

    def grow(self, ngrow: int, blobs: object) -> None:
        """Do nothing: the file grows by itself."""

    def save_step(self, state: emcee.State, accepted: NDArray[np.bool_]) -> None:
        """Append a step completely or not at all."""
        total = self.accepted + accepted
        rows = np.column_stack([state.log_prob, state.blobs])
        counts = self._evaluation.counts if self._evaluation else self.last.counts
        last = Record("rows", state.coords.copy(), rows, counts)
        _, key, *rest = state.random_state
        position = {"accepted": total.tolist(), "random": [key.tolist(), *rest]}
        position["moves"] = remembered = remember(self._moves)
        self._store.append(self._stream, self.iteration + 1, last, position)
        self.last, self.random_state = last, state.random_state
        self.remembered = remembered
        self.iteration, self.accepted = self.iteration + 1, total
