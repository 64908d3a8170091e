"""Whether a file belongs to what is asked for: by its header, and by solving again."""

import hashlib
import json
import logging
import os
import platform
import warnings
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np

from .. import checks
from ..contracts import Floats
from ..posterior.log_posterior import Kind, LogPosterior
from ..posterior.priors import list_laws
from .ensemble import describe_object
from .evaluator import Evaluation, Solver
from .failures import FailureLog
from .pools import open_pool
from .store import Record, Store

logger = logging.getLogger("emcee_femu")

PACKAGES = ("emcee_femu", "emcee", "numpy", "scipy")
SHOWN_NUMBERS = 64  # numbers of an array; of a larger one the digest is kept
PROBED = 16  # stored points solved again, at most
# Of the largest value of a variable, to which the tolerance is relative.
LEAST_DIFFERENCE = 1e-3
MOST_LOST = 256  # points of a batch that a kill may lose
LOG_BOX = "logarithm of the volume of the box"


def describe(posterior: LogPosterior, asked: Mapping[str, object]) -> dict[str, Any]:
    """Describe a posterior and the settings of its sampler for JSON.

    Functions are not compared: the probe detects a changed model, prior or term.
    """
    prior, kind = posterior.prior, type(posterior.prior).__name__
    entries: dict[str, object] = {
        "parameters": posterior.names,
        "prior": list_laws(prior) or kind,
        "terms": posterior.term_names,
        "stored": {name: v.shape for name, v in posterior.variables.items()},
    }
    if np.isfinite(posterior.log_box):  # the box is the prior of a bare function
        entries[LOG_BOX] = posterior.log_box
    for name, bounds in zip(posterior.names, prior.bounds, strict=True):
        entries[f"bounds of {name}"] = bounds
    for name, term in zip(posterior.term_names, posterior.terms, strict=True):
        for variable, values in term.observed.items():
            entries[f"{variable} measured ({name})"] = np.asarray(values)
    entries["version of python"] = platform.python_version()
    entries |= {f"version of {name}": installed_version(name) for name in PACKAGES}
    entries |= asked
    described: dict[str, Any] = json.loads(json.dumps(entries, default=_readable))
    return described


@cache
def installed_version(package: str) -> str:
    """Return the version of a package, for which its folder is searched once."""
    return version(package)


def _readable(value: object) -> object:
    """Return numbers as a list, or a digest if they are many; objects in words."""
    if isinstance(value, np.ndarray | np.generic):
        if value.size <= SHOWN_NUMBERS and value.dtype.kind in "biuf":
            return value.tolist()
        digest = hashlib.sha256(value.tobytes()).hexdigest()[:16]
        return f"{value.shape} numbers with the digest {digest}"
    return describe_object(value)


def check_path(backend: object, resume: bool) -> str | None:
    """Return the path of a file, or None; refuse one that cannot be created.

    Raises:
        TypeError: If resume is asked for without a file.
        ValueError: If there is a file and resume is not asked for, or no directory.
    """
    if backend is None and resume:
        raise TypeError("resume: expected backend, the name of a file to continue")
    if backend is None:
        return None
    path = os.path.abspath(checks.file_name("backend", backend))
    if not os.path.basename(str(backend)) or os.path.isdir(path):
        raise ValueError(f"backend: expected the name of a file, got {backend!r}")
    if os.path.lexists(path) and not resume:
        raise ValueError(
            f"backend: {path} exists; continue it with resume=True, or take a new name"
        )
    if not os.access(os.path.dirname(path), os.W_OK | os.X_OK):
        raise ValueError(
            f"backend: the directory of {path} does not exist or is not writable; "
            "create it, or give another path"
        )
    return path


@contextmanager
def open_evaluator(
    posterior: LogPosterior,
    asked: Mapping[str, object],
    workers: int | None,
    pool: object,
    on_failure: str,
    max_failures: float,
    backend: object = None,
    resume: bool = False,
    probe_tolerance: float = 1e-6,
) -> Iterator[Evaluation]:
    """Yield an evaluator, which uses a file for its results if one is given.

    Args:
        posterior: What is evaluated.
        asked: What else the file must have been made for.
        workers: And the rest: as in :func:`.run`.
        pool: Likewise.
        on_failure: Likewise.
        max_failures: Likewise.
        backend: Likewise, the name of a file.
        resume: Likewise.
        probe_tolerance: Likewise.
    """
    path = check_path(backend, checks.flag("resume", resume))
    tolerance = checks.real_number("probe_tolerance", probe_tolerance, 0)
    reject = checks.one_of("on_failure", on_failure, ("raise", "reject")) == "reject"
    log = FailureLog(checks.real_number("max_failures", max_failures, 0.0, 1.0))
    solver = Solver(posterior, reject)
    with open_pool(pool, workers, solver) as opened:
        evaluation = Evaluation(solver, opened, log if solver.reject else None)
        if path is None:
            yield evaluation
            return
        manifest = describe(posterior, asked)
        with closing(Store(path)) as store:
            if (stored := store["manifest"]) is None:
                store["manifest"] = manifest
            else:
                store.verify()
                compare(path, stored, manifest)
                probe(evaluation, store, tolerance)
            try:
                yield StoredEvaluation(evaluation, store)
            except KeyboardInterrupt as error:
                stopped = KeyboardInterrupt(
                    f"stopped; all that was solved and sampled so far is in {path}. "
                    "The same call with resume=True goes on from there"
                )
                vars(stopped).update(vars(error))  # the run so far
                raise stopped from None  # where it was stopped says nothing


def compare(
    path: str, stored: Mapping[str, object], manifest: Mapping[str, object]
) -> None:
    """Refuse a file whose manifest is another; warn of other versions of libraries.

    Raises:
        ValueError: If anything but a version differs.
    """
    changed = {
        name: f"{name}: was {stored.get(name, 'absent')}, "
        f"is {manifest.get(name, 'absent')}"
        for name in {**stored, **manifest}
        if stored.get(name) != manifest.get(name)
    }
    versions = [changed.pop(name) for name in [*changed] if "version of" in name]
    if changed:
        raise ValueError(
            f"resume: {path} holds a different run:\n  "
            + "\n  ".join(changed.values())
            + "\nUse the original settings, or give another file name"
        )
    if versions:
        warnings.warn(
            f"resume: {'; '.join(versions)}. The run continues, but its chain is that "
            "of an uninterrupted run only if these versions give the same numbers",
            stacklevel=5,
        )


def probe(evaluation: Evaluation, store: Store, tolerance: float) -> None:
    """Refuse to continue if stored points, solved again, give other values.

    Raises:
        ValueError: If so, or if the solver scatters by itself.
    """
    posterior, points = evaluation.posterior, [*store.sample_records(PROBED)]
    if not points:
        return
    logger.info("resume: %d points of %s are solved again", len(points), store.path)
    theta = np.array([point for point, _ in points])
    was = np.array([row[: posterior.row_size] for _, row in points])
    now = evaluation.again(theta)
    if difference := _first_difference(was, now, theta, posterior, tolerance):
        again = evaluation.again(theta)
        scatter = _first_difference(now, again, theta, posterior, tolerance)
        if scatter:
            raise ValueError(
                f"resume: the solver is not deterministic: {scatter}. Fix its seeds, "
                "starts and threads, or set probe_tolerance to its scatter"
            )
        raise ValueError(
            f"resume: {store.path} holds a run of another posterior: {difference}, by "
            f"more than probe_tolerance={tolerance:g}. Restore model, files and "
            "versions, or give another file name"
        )


def _first_difference(
    was: Floats, now: Floats, theta: Floats, posterior: LogPosterior, tolerance: float
) -> str:
    """Return the first difference in words, with the parameters by name, or nothing.

    A single term or variable says more than the sum, which comes first in a row.
    """
    sizes, floor = np.abs(np.where(np.isfinite(was), was, 0.0)), np.zeros(was.shape[1])
    for part in posterior.columns.values():
        floor[part] = LEAST_DIFFERENCE * sizes[:, part].max(initial=0.0)
    same = np.isclose(now, was, tolerance, tolerance * floor, equal_nan=True)
    if same.all():
        return ""
    point = int(np.argmin(same.all(axis=1)))
    columns = np.flatnonzero(~same[point])
    solved = now[point, 0] > -np.inf and len(columns) > 1
    column = int(columns[1] if solved and columns[0] == 0 else columns[0])
    values = dict(zip(posterior.names, theta[point].tolist(), strict=True))
    label, old, new = posterior.labels[column], was[point, column], now[point, column]
    return f"{label} was {old:.12g} and is {new:.12g} at {values}"


class StoredEvaluation(Evaluation):
    """An evaluation that stores each batch, or finds it in the file.

    A search is replayed from the file: it asks for the same batches in the same order,
    until the file ends.
    """

    def __init__(self, evaluation: Evaluation, store: Store) -> None:
        super().__init__(evaluation.solver, evaluation.pool, evaluation.failures)
        self.store, self._number, self._end = store, 0, store.lengths().get(0, 0)

    def rows(self, theta: Floats) -> Floats:
        """Return the rows of the posterior at ``theta (n, d)``, part by part."""
        starts = range(0, max(len(theta), 1), MOST_LOST)
        parts = [self.stack(theta[i : i + MOST_LOST], "rows") for i in starts]
        return np.concatenate(parts)

    def each(self, theta: Floats) -> Iterator[tuple[int, Floats]]:
        """Yield number and row of each point, in the order in which they came."""
        waiting = list(range(len(theta)))
        while waiting and (record := self._next()) is not None:
            same = [i for i in waiting if np.array_equal(theta[i], record.theta[0])]
            self._go_on(record, record.kind == "rows" and bool(same))
            waiting.remove(same[0])
            yield same[0], record.values[0]
        for number, row in super().each(theta[waiting]):
            place = waiting[number]
            self._append("rows", theta[place : place + 1], row[None])
            yield place, row

    def stack(self, theta: Floats, kind: Kind) -> Floats:
        """Return the requested quantities at ``theta (n, d)`` in one array."""
        record = self._next()
        if record is None:
            values = self.solve(theta, kind)
            self._append(kind, theta, values)
            return values
        same = record.kind == kind and np.array_equal(record.theta, theta)
        self._go_on(record, same)
        return record.values

    def _next(self) -> Record | None:
        """Return the next record of the file, None at its end."""
        if self._number >= self._end:
            return None
        return next(self.store.read(0, range(self._number, self._number + 1)))

    def _go_on(self, record: Record, same: bool) -> None:
        """Count the solves of a record and move on; refuse one of another search."""
        if not same:
            raise ValueError(
                "resume: the search differs from the one recorded in "
                f"{self.store.path}, although the posterior is the same: results "
                "depend on the machine and on library versions. Continue where the "
                "run began, or give another file name"
            )
        self._number += 1
        self.restore(record.counts)

    def _append(self, kind: Kind, theta: Floats, values: Floats) -> None:
        record = Record(kind, theta, values, self.counts)
        self.store.append(0, self._number, record)
        self._number = self._end = self._number + 1
