"""A backend of emcee in a file that a kill at any moment leaves usable."""

import os
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Self

import emcee
import numpy as np
from numpy.typing import NDArray

from ...interfaces import Floats
from .log import COUNTS, RANDOM, Log, check_new, create


class RunFile(emcee.backends.Backend):
    """One ensemble of a run in a file, which a kill at any moment leaves usable.

    A run that was killed and resumed ends bit-identical to one that was not. The bare
    class reads what is stored of one ensemble, also while a run goes on; only the steps
    that are asked for are read. ``emcee.EnsembleSampler(..., backend=RunFile(path))``
    is a sampler of it.

    Args:
        path: The file.
        ensemble: Number of the ensemble, from 0.

    Raises:
        ValueError: If it is not a file of a run, is damaged (by the number of the
            record, with what can be kept), or has no such ensemble.

    Examples:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> import emcee_femu as ef
        >>> from emcee_femu.sampling.run_file import RunFile
        >>> posterior = ef.paper.mass_spring().posterior
        >>> with TemporaryDirectory() as folder:
        ...     path = Path(folder, "run.chain")
        ...     samplers = ef.run(posterior, nsteps=20, seed=1, backend=path)
        ...     RunFile(path).get_chain(discard=10).shape
        (10, 20, 5)
    """

    def __init__(self, path: str | PathLike[str] | Log, ensemble: int = 0) -> None:
        super().__init__(np.float64)
        self._log = log = path if isinstance(path, Log) else Log(os.fspath(path))
        if ensemble not in range(log.header["streams"]):
            raise ValueError(
                f"ensemble: {log.path} holds {log.header['streams']}, numbered from 0, "
                f"got {ensemble!r}"
            )
        self._stream = ensemble
        self.nwalkers, self.ndim = log.header["nwalkers"], log.header["ndim"]
        self.failures: Any = None  # whose counts are stored with every step
        self.initialized = True

    @classmethod
    def open(cls, path: str | PathLike[str]) -> list[Self]:
        """Return a backend per ensemble, to read them or to go on.

        Args:
            path: The file.

        Returns:
            One of each ensemble.

        Raises:
            ValueError: If it is not a file of a run, or is damaged.

        Examples:
            >>> from pathlib import Path
            >>> from tempfile import TemporaryDirectory
            >>> import emcee_femu as ef
            >>> from emcee_femu.sampling.run_file import RunFile
            >>> posterior = ef.paper.mass_spring().posterior
            >>> with TemporaryDirectory() as folder:
            ...     path = Path(folder, "run.chain")
            ...     _ = ef.run(posterior, nsteps=20, ensembles=2, seed=1, backend=path)
            ...     [ensemble.iteration for ensemble in RunFile.open(path)]
            [20, 20]
        """
        log = Log(os.fspath(path))
        return [cls(log, stream) for stream in range(log.header["streams"])]

    @classmethod
    def create(
        cls,
        path: str | PathLike[str],
        starts: Sequence[emcee.State],
        manifest: Mapping[str, Any],
        counts: Sequence[int] = (0,) * COUNTS,
        stages: int = 1,
    ) -> list[Self]:
        """Make a file, whole or not at all, and return one backend per ensemble.

        Args:
            path: The file, which must not exist.
            starts: Where each ensemble begins: evaluated, with its random state.
            manifest: What is sampled and how, for JSON.
            counts: Evaluations so far, and failures by cause.
            stages: Chains per ensemble; those of later stages have no start.

        Raises:
            ValueError: If the file exists, or its directory does not or takes no files.
            OSError: If it cannot be written.
        """
        nwalkers, ndim = starts[0].coords.shape
        header = {
            "nwalkers": nwalkers,
            "ndim": ndim,
            "blobs": 0 if starts[0].blobs is None else starts[0].blobs.shape[1],
            "starts": len(starts),
            "streams": stages * len(starts),
            "manifest": dict(manifest),
        }
        create(os.path.abspath(path), header, starts, counts)
        return cls.open(path)

    @property
    def manifest(self) -> dict[str, Any]:
        """What is sampled and how, as it was when the file was made."""
        return dict(self._log.header["manifest"])

    @property
    def betas(self) -> Sequence[float]:
        """Powers of the likelihood, one per block of walkers; (1,) if untempered."""
        betas: Sequence[float] = self._log.header["manifest"].get("betas", (1.0,))
        return betas

    @property
    def counts(self) -> list[int]:
        """Evaluations and failures by cause, of all ensembles up to the last step."""
        return self._log.counts

    @property
    def iteration(self) -> int:
        """Number of stored steps."""
        return self._log.steps(self._stream)

    @property
    def accepted(self) -> Floats:
        """Accepted proposals, ``(nwalkers,)``."""
        if not self.iteration:
            return np.zeros(self.nwalkers)
        counts: Floats = self._log.last(self._stream)["accepted"].copy()
        return counts

    @property
    def random_state(self) -> tuple[Any, ...] | None:
        """The state of NumPy's ``RandomState`` after the last step, None before one."""
        return self.get_last_sample().random_state if self.iteration else None

    def has_blobs(self) -> bool:
        """Return whether the walkers have blobs."""
        return bool(self._log.header["blobs"])

    def get_last_sample(self) -> emcee.State:
        """Return the last stored state, that of the start before there is a step."""
        last = self._log.last(self._stream)
        key, *rest = (last[name] for name in RANDOM)
        return emcee.State(
            last["chain"].copy(),
            last["log_prob"].copy(),
            last["blobs"].copy() if self.has_blobs() else None,
            ("MT19937", key.copy(), *(value.item() for value in rest)),
        )

    def get_value(
        self, name: str, flat: bool = False, thin: int = 1, discard: int = 0
    ) -> Floats | None:
        """Return the stored steps of ``chain``, ``log_prob`` or ``blobs``."""
        if not self.iteration:
            raise AttributeError(f"{self._log.path}: no step of this ensemble is there")
        if name == "blobs" and not self.has_blobs():
            return None
        part = slice(discard + thin - 1, None, thin)
        found: Floats = self._log.read(self._stream, name, part)
        return found.reshape(-1, *found.shape[2:]) if flat else found

    def reset(self, nwalkers: int, ndim: int) -> None:
        """Refuse to clear the chain: a file is for one run."""
        raise ValueError(
            f"backend: the steps in {self._log.path} are never cleared; give a new "
            "file name"
        )

    def grow(self, ngrow: int, blobs: Any) -> None:
        """Refuse blobs that have no place in the records; the file grows by itself."""
        expected = (self.nwalkers, self._log.header["blobs"])
        if np.shape(blobs) != (expected if self.has_blobs() else ()):
            raise ValueError(
                f"blobs: {self._log.path} stores numbers of shape {expected}, got "
                f"{np.shape(blobs)}; give a new file name"
            )

    def save_step(self, state: emcee.State, accepted: NDArray[np.bool_]) -> None:
        """Append a step: all of it, or nothing.

        Raises:
            ValueError: If shapes do not fit, or another run writes to the file.
            OSError: If it cannot be written, as on a full disk; nothing is lost.
        """
        self._check(state, accepted)
        counts = self._log.counts if self.failures is None else self.failures.counts
        self._log.append(self._stream, state, self.accepted + accepted, counts)

    def to_hdf(self, path: str | PathLike[str]) -> None:
        """Write all ensembles for emcee's HDFBackend, in groups ``ensemble_0`` ...

        Raises:
            ImportError: If h5py is not installed.
            ValueError: If the file exists, or its directory does not or takes no files.
        """
        try:
            import h5py
        except ImportError as error:
            raise ImportError(
                'h5py is needed to write HDF5; pip install "emcee_femu[hdf]"'
            ) from error
        check_new(os.fspath(path))
        with h5py.File(path, "w") as h5:
            for number, own in enumerate(self.open(self._log.path)):
                own._write_hdf(h5.create_group(f"ensemble_{number}"))

    def _write_hdf(self, group: Any) -> None:
        steps = self.iteration
        attributes = {"version": emcee.__version__, "iteration": steps}
        attributes |= {"nwalkers": self.nwalkers, "ndim": self.ndim}
        attributes |= {"has_blobs": self.has_blobs()}
        for i, value in enumerate(self.random_state or ()):
            attributes[f"random_state_{i}"] = value
        group.attrs.update(attributes)
        group["accepted"] = self.accepted
        for name in ("chain", "log_prob", "blobs")[: 2 + self.has_blobs()]:
            shape = self._log.read(self._stream, name, slice(0)).shape[1:]
            stored = group.create_dataset(name, (steps, *shape), np.float64)
            for at in range(0, steps, 1_000):  # never all of it in memory
                part = slice(at, at + 1_000)
                stored[part] = self._log.read(self._stream, name, part)
