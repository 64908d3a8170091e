"""Stored chains as arrays: which walkers and which steps."""

import json
from collections.abc import Sequence
from typing import Any

import emcee
import numpy as np

from .. import checks
from ..interfaces import Floats
from ..moves.tempering import find_ladder
from ..sampling.annealing import Annealed


def list_runs(
    samplers: emcee.EnsembleSampler | Sequence[emcee.EnsembleSampler],
) -> list[Any]:
    """Return one or several samplers (or backends) as a list."""
    runs = list(samplers) if isinstance(samplers, Sequence) else [samplers]
    if not runs:
        raise ValueError("samplers: expected at least one, got none")
    for run in runs:
        if isinstance(run, Annealed):
            raise TypeError(
                "samplers: expected EnsembleSamplers, got a population of anneal, "
                "which is no chain; print it for its evidence and effective sizes, or "
                "give it to to_inference_data for tables and figures"
            )
        if not hasattr(run, "get_chain"):
            got = type(run).__name__
            raise TypeError(f"samplers: expected EnsembleSamplers, got {got}")
        if not run.iteration:
            raise ValueError("samplers: one has no stored steps; run it first")
    return runs


def cold(run: Any) -> slice:
    """Return the walkers that sample the posterior: all but those of hot blocks.

    Raises:
        ValueError: If the run's moves do not share their temperatures.
    """
    rungs = _count_rungs(run)
    return slice(0, run.nwalkers // rungs) if rungs > 1 else slice(None)


def _count_rungs(run: Any) -> int:
    """Return the number of temperatures, by the moves or by the run's own file."""
    tempered = find_ladder(getattr(run, "_moves", ()))
    own: Any = getattr(run, "backend", run) if tempered is None else tempered
    return len(getattr(own, "betas", (1.0,)))


def describe_runs(runs: list[Any]) -> dict[str, Any]:
    """Return what runs know of themselves, as attributes that netCDF can hold.

    The acceptance is that of every walker that samples the posterior, ensemble after
    ensemble; failed solves are in one log of all ensembles, where run made it.
    """
    fractions = []
    for run in runs:
        backend = getattr(run, "backend", run)
        fractions += (backend.accepted / backend.iteration)[cold(run)].tolist()
    return {
        "acceptance": json.dumps(fractions),
        "tempered": int(_count_rungs(runs[0]) > 1),
        "population": int(getattr(runs[0], "population", False)),
        "starts_given": int(any(getattr(run, "starts_given", False) for run in runs)),
        "failures": json.dumps(
            dict(getattr(getattr(runs[0], "failures", None), "causes", {}))
        ),
    }


def stack_chains(
    runs: list[Any],
    what: str,
    discard: int = 0,
    thin: int = 1,
    hot: bool = False,
) -> Floats:
    """Return chain, log_prob or blobs, ``(draws, ensembles, walkers, ...)``.

    Ensembles must have the same number of walkers and steps. For tempered ones only
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
