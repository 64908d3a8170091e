"""Stored chains as arrays: which walkers and steps, and whether memory holds them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import emcee
import numpy as np

from .. import checks
from ..interfaces import Floats
from ..moves.tempering import ladder

MEMINFO = Path("/proc/meminfo")  # Linux alone says what can be had without swapping


def as_list(
    samplers: emcee.EnsembleSampler | Sequence[emcee.EnsembleSampler],
) -> list[Any]:
    """Return one or several samplers (or backends) as a list."""
    runs = list(samplers) if isinstance(samplers, Sequence) else [samplers]
    if not runs:
        raise ValueError("samplers: expected at least one, got none")
    for run in runs:
        if not hasattr(run, "get_chain"):
            raise TypeError(f"samplers: expected EnsembleSamplers, got {run!r}")
        if not run.iteration:
            raise ValueError("samplers: one has no stored steps; run it first")
    return runs


def cold(run: Any) -> slice:
    """Return the walkers that sample the posterior: all but those of hot blocks.

    Raises:
        ValueError: If the run's moves do not share their temperatures.
    """
    tempered = ladder(getattr(run, "_moves", ()))
    return slice(None) if tempered is None else tempered.cold(run.nwalkers)


def stacked(
    runs: list[Any],
    what: str,
    discard: int = 0,
    thin: int = 1,
    hot: bool = False,
) -> Floats:
    """Return chain, log_prob or blobs, ``(draws, ensembles, walkers, ...)``.

    Ensembles must have the same number of walkers and steps. Of tempered ones only
    the cold walkers are returned unless ``hot``. Besides the result, memory holds one
    ensemble's part of it, read from its file.
    """
    discard = checks.whole_number("discard", discard)
    thin = checks.whole_number("thin", thin, 1)
    result: Floats = np.empty(0)
    for ensemble, run in enumerate(runs):
        part = getattr(run, f"get_{what}")(discard=discard, thin=thin)
        if part is None:
            raise ValueError(
                f"samplers: no {what} stored; was it a LogPosterior that ran?"
            )
        if not hot:
            part = part[:, cold(run)]
        if not len(part):
            raise ValueError(
                f"discard: no steps are left after {discard} (thin={thin})"
            )
        if ensemble == 0:
            result = np.empty((len(part), len(runs), *part.shape[1:]), part.dtype)
        shape = (len(result), *result.shape[2:])
        if part.shape != shape:
            raise ValueError(
                "samplers: expected chains of one shape, got "
                f"{sorted({shape, part.shape})}"
            )
        result[:, ensemble] = part
        del part  # before the next one is read
    return result


def check_memory(
    runs: list[Any], numbers: int, discard: int, thin: int | None = None
) -> None:
    """Refuse to read more than fits, before it is read; only Linux tells what does.

    Args:
        runs: Samplers or backends.
        numbers: How many a walker and step are to be read, of 8 bytes. Twice as much
            must be available: files are read part by part, and who uses the result
            copies of it.
        discard: Stored steps to drop.
        thin: Keep every ``thin``-th stored step; None for all, without a choice.

    Raises:
        MemoryError: If too little is available; it says how much is needed, and which
            thin or discard fits.
    """
    discard = checks.whole_number("discard", discard)
    every = 1 if thin is None else checks.whole_number("thin", thin, 1)
    needed = step = steps = 0
    for run in runs:
        # Whole numbers of Python, which do not overflow; those of HDF5 files do.
        steps, walkers = int(run.iteration), int(getattr(run, "backend", run).shape[0])
        size = 2 * 8 * walkers * numbers
        needed += size * len(range(discard + every - 1, steps, every))
        step += size
    available = available_memory()
    if available is None or needed <= available:
        return
    if thin is None:
        remedy = f"use discard={steps - available // step} or more"
    else:
        unthinned = step * (steps - discard)
        remedy = f"use thin={-(-unthinned // max(available, 1))} or more, or a larger "
        remedy += "discard"
    raise MemoryError(
        f"samplers: to read them takes {needed / 1e9:.3g} GB of memory, but "
        f"{available / 1e9:.3g} GB are available; {remedy}"
    )


def available_memory() -> int | None:
    """Return the bytes that can be had without swapping, None where no one tells."""
    if not MEMINFO.exists():
        return None
    for line in MEMINFO.read_text(encoding="ascii").splitlines():
        if line.startswith("MemAvailable:"):
            return 1024 * int(line.split()[1])
    return None
