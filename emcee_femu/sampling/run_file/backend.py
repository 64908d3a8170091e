"""A backend of emcee in an HDF5 file that a kill at any moment leaves usable."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from typing import Any, BinaryIO, Literal, Self

import emcee
import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...interfaces import Floats
from . import creation, storage
from .storage import Layout


class RunFile(emcee.backends.HDFBackend):
    """One ensemble of a run in an HDF5 file, which a kill at any moment leaves usable.

    A run that was killed and resumed ends bit-identical to one that was not. emcee's
    own ``HDFBackend(path, name="ensemble_0")`` reads the file, also while it is
    written, but cannot append to it. Room for all steps is made when the file is
    created; it fills as the run goes. Writing a step takes a fraction of a
    millisecond and no lock, so that others may read meanwhile.

    Make a file by :meth:`create`, go on with :meth:`resume`; the bare class reads one.

    Args:
        filename: The file.
        name: The ensemble's group in it.

    Raises:
        ImportError: If h5py is not installed.
    """

    def __init__(self, filename: str | PathLike[str], name: str = "ensemble_0") -> None:
        """See the class."""
        storage.hdf5()
        super().__init__(os.fspath(filename), name=name, dtype=np.float64)
        self._layout: Layout | None = None
        self.log: Any = None  # whose counts are stored with every step
        self._expected: int | None = None  # steps in the file as far as we know

    @classmethod
    def create(
        cls,
        filename: str | PathLike[str],
        nwalkers: int,
        ndim: int,
        nsteps: int,
        *,
        blobs: int = 0,
        ensembles: int = 1,
        fingerprint: Mapping[str, str],
    ) -> list[Self]:
        """Make a file with room for all ensembles, in one step: all of it or nothing.

        Its size is ``8 * nwalkers * (ndim + 1 + blobs) * nsteps * ensembles`` bytes
        and some kB.

        Args:
            filename: The file, which must not exist.
            nwalkers: Walkers an ensemble.
            ndim: Parameters.
            nsteps: Stored steps.
            blobs: Blobs a walker.
            ensembles: Groups ``ensemble_0``, ``ensemble_1``, ... in the file.
            fingerprint: What is sampled and how, see
                :func:`emcee_femu.sampling.fingerprint.fingerprint`.

        Returns:
            One backend an ensemble.

        Raises:
            ImportError: If h5py is not installed.
            ValueError: If the file exists, its directory does not, a count is below 1,
                or the disk has too little room.
        """
        path = os.fspath(filename)
        counts = {"nwalkers": nwalkers, "ndim": ndim, "nsteps": nsteps}
        for argument, value in {**counts, "ensembles": ensembles}.items():
            checks.whole_number(argument, value, 1)
        checks.whole_number("blobs", blobs)
        creation.create(
            path,
            Layout(nwalkers, ndim, nsteps, blobs),
            ensembles,
            json.dumps(dict(fingerprint)),
        )
        return cls.resume(path, ensembles)

    @classmethod
    def resume(cls, filename: str | PathLike[str], ensembles: int = 1) -> list[Self]:
        """Open a file to go on with it, after a kill too; nothing is lost but a step.

        Args:
            filename: A file that :meth:`create` made.
            ensembles: How many ensembles it must hold.

        Returns:
            One backend an ensemble.

        Raises:
            ImportError: If h5py is not installed.
            ValueError: If the file is not there, truncated, damaged, not made by
                :meth:`create`, or holds another number of ensembles. It is left as
                it is.
        """
        ensembles = checks.whole_number("ensembles", ensembles, 1)
        path = os.fspath(filename)
        with storage.opened(path) as h5:
            held = len(h5)
        if held != ensembles:
            raise ValueError(
                f"backend: {path} holds {held} ensembles, but ensembles={ensembles} "
                f"was asked for; resume with ensembles={held}"
            )
        backends = [cls(path, f"ensemble_{k}") for k in range(ensembles)]
        records = [backend._checked() for backend in backends]  # before any is changed
        for backend, record in zip(backends, records, strict=True):
            backend._expected = int(record["iteration"])
            with backend._file("r+b") as (file, layout):
                storage.publish(file, layout, record)
        return backends

    def _checked(self) -> Any:
        """Return the last commit record of a file that may be written to."""
        storage.check_places(self.filename, self.name)
        with self._file("rb") as (file, layout):
            record = storage.latest(self.filename, file, layout)
            storage.check_last_rows(self.filename, file, layout, record)
        return record

    @contextmanager
    def _file(self, mode: Literal["rb", "r+b"]) -> Iterator[tuple[BinaryIO, Layout]]:
        """Open the file and say where what is; it may have been replaced meanwhile."""
        with open(self.filename, mode, buffering=0) as file:
            found = storage.identity(os.fstat(file.fileno()))
            if self._layout is None or self._layout.identity != found:
                self._layout = storage.read_layout(self.filename, self.name)
            yield file, self._layout

    def _latest(self) -> Any:
        with self._file("rb") as (file, layout):
            return storage.latest(self.filename, file, layout)

    @property
    def fingerprint(self) -> dict[str, str]:
        """What is sampled and how, as it was given when the file was created."""
        with storage.opened(self.filename) as h5:
            stored: dict[str, str] = json.loads(h5.attrs["fingerprint"])
        return stored

    @property
    def capacity(self) -> int:
        """Number of steps for which the file has room."""
        with self._file("rb") as (_, layout):
            return layout.nsteps

    @property
    def shape(self) -> tuple[int, int]:
        """Walkers and parameters."""
        with self._file("rb") as (_, layout):
            return layout.nwalkers, layout.ndim

    def has_blobs(self) -> bool:
        """Return whether the walkers have blobs."""
        with self._file("rb") as (_, layout):
            return layout.blobs > 0

    @property
    def iteration(self) -> int:
        """Number of stored steps."""
        return int(self._latest()["iteration"])

    @property
    def accepted(self) -> Floats:
        """Accepted proposals, ``(nwalkers,)``."""
        counts: Floats = self._latest()["accepted"].copy()
        return counts

    @property
    def counts(self) -> list[int]:
        """Evaluations and failures by cause, of all ensembles up to the last step."""
        counts: list[int] = self._latest()["counts"].tolist()
        return counts

    @property
    def random_state(self) -> tuple[Any, ...] | None:
        """The state of NumPy's ``RandomState`` after the last step, None before one."""
        last = self._latest()
        if not last["iteration"]:
            return None
        key, *rest = (last[f"random_state_{i}"] for i in range(1, 5))
        return "MT19937", key.copy(), *(value.item() for value in rest)

    def get_value(
        self, name: str, flat: bool = False, thin: int = 1, discard: int = 0
    ) -> Floats | None:
        """Return the stored steps of ``chain``, ``log_prob`` or ``blobs``.

        Past HDF5, which may show this process what it read before the last steps.
        """
        iteration = self.iteration
        if not iteration:
            super().get_value(name)  # raises emcee's own error
        if name == "blobs" and not self.has_blobs():
            return None
        with self._file("rb") as (file, layout):
            inner = {"chain": (layout.ndim,), "blobs": layout.blob_shape}.get(name, ())
            shape = (iteration, layout.nwalkers, *inner)
            stored = np.memmap(file, "<f8", "r", layout.places[name], shape)
            steps: Floats = np.array(stored[discard + thin - 1 :: thin], np.float64)
        return steps.reshape(-1, *inner) if flat else steps

    def reset(self, nwalkers: int, ndim: int) -> None:
        """Refuse to clear the chain: a file is for one run.

        Raises:
            ValueError: Always, with the remedy.
        """
        if os.path.lexists(self.filename):
            storage.read_layout(self.filename, self.name)  # says what is wrong
            raise ValueError(
                f"backend: the steps in {self.filename} are never cleared; give a new "
                "file name"
            )
        raise ValueError(
            f"backend: there is no {self.filename}; make it by RunFile.create"
        )

    def grow(self, ngrow: int, blobs: Any) -> None:
        """Make room for ``ngrow`` more steps, by a larger copy where there is none.

        Raises:
            ValueError: If the blobs are not those of the file, or the disk is full.
        """
        self._check_blobs(blobs)
        steps = int(self._checked()["iteration"])
        if self._expected is None:
            self._expected = steps
        if steps + ngrow > self.capacity:
            creation.extend(self.filename, steps + ngrow)

    def save_step(self, state: emcee.State, accepted: NDArray[np.bool_]) -> None:
        """Add a step; it exists once its commit record is written.

        Raises:
            TypeError: If the walkers are not in double precision, which the file is.
            ValueError: If shapes do not fit, there is no room, or another process
                writes to the file.
        """
        self._check(state, accepted)
        if state.coords.dtype != np.float64:
            raise TypeError(
                f"initial_state: expected float64 coordinates, got {state.coords.dtype}"
                "; a resumed run would differ"
            )
        with self._file("r+b") as (file, layout):
            last = storage.latest(self.filename, file, layout)
            step = int(last["iteration"])
            if self._expected not in (None, step):
                raise ValueError(
                    f"backend: {self.filename} holds {step} steps of {self.name}, but "
                    f"this run knows of {self._expected}: another run writes to it; "
                    "stop one of the two and resume"
                )
            if step >= layout.nsteps:
                raise ValueError(f"backend: {self.filename} is full; call grow first")
            self._expected = None  # unknown, should it be interrupted here
            record = storage.write_rows(file, layout, last, state)
            record["accepted"] += accepted
            if self.log is not None:
                record["counts"] = self.log.counts
            for i, value in enumerate(state.random_state[1:], 1):
                record[f"random_state_{i}"] = value
            storage.commit(file, layout, record)
            storage.publish(file, layout, record)
        self._expected = step + 1

    def _check_blobs(self, blobs: Any) -> None:
        with self._file("rb") as (_, layout):
            expected = (layout.nwalkers, *layout.blob_shape) if layout.blobs else None
        got = None if blobs is None else np.shape(blobs)
        if got != expected or (blobs is not None and blobs.dtype != np.float64):
            room = f"float64 blobs of shape {expected}" if expected else "no blobs"
            kind = "none" if blobs is None else f"{blobs.dtype} ones of shape {got}"
            raise ValueError(
                f"blobs: {self.filename} has room for {room}, got {kind}; give a new "
                "file name"
            )
