"""The first state of every ensemble: starts, random streams, burn-in."""

from collections.abc import Callable, Sequence
from typing import Any

import emcee
import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..posterior.log_posterior import LogPosterior
from .auto import Backends, Recipe, burn_in_and_fit

MOST_DRAWS = 20  # of a starting point


def begin_run(
    posterior: LogPosterior,
    moves: Any,
    automatic: bool,
    build: Callable[..., emcee.EnsembleSampler],
    seed: int,
    initial: Any,
    ensembles: int,
    progress: bool | str,
    redraw: bool,
    backends: Backends,
) -> Recipe:
    """Return evaluated starts and the moves, after the burn-in of "auto".

    Args:
        posterior: What is sampled.
        moves: The moves that were asked for.
        automatic: Whether they shall be found by a burn-in.
        build: ``build(moves=...)`` makes an emcee sampler of the posterior.
        seed: Of all random streams.
        initial: Starting positions, or None for draws from the prior.
        ensembles: Number of ensembles.
        progress: Whether to show the progress of the burn-in.
        redraw: Whether draws from the prior where the posterior is zero are redrawn.
        backends: Of the burn-in, see :func:`sampling.auto.burn_in_and_fit`.

    Raises:
        ValueError: If initial has the wrong shape or is out of bounds, or a walker
            starts where the posterior is zero.
    """
    streams = np.random.SeedSequence(seed).spawn(ensembles)
    nwalkers = build().nwalkers
    starts = _starts(posterior, nwalkers, streams, initial)
    drawn = posterior if redraw and initial is None else None
    states = [
        _first_state(build(), start, stream, drawn, posterior.names)
        for start, stream in zip(starts, streams, strict=True)
    ]
    if automatic:
        return burn_in_and_fit(build, states, progress, backends)
    return Recipe(moves, states, nwalkers, "")


def _starts(
    posterior: LogPosterior,
    nwalkers: int,
    streams: list[np.random.SeedSequence],
    initial: ArrayLike | None,
) -> list[Any]:
    if initial is None:
        return [posterior.start(nwalkers, stream.spawn(1)[0]) for stream in streams]
    # A copy in double precision: emcee would truncate steps from integer starts.
    starts = checks.real_array("initial", initial)
    if starts.ndim == 2 and len(streams) == 1:
        starts = starts[None]
    if starts.shape != (len(streams), nwalkers, posterior.ndim):
        raise ValueError(
            f"initial: expected shape {(len(streams), nwalkers, posterior.ndim)} "
            f"(ensembles, nwalkers, ndim), got {starts.shape}"
        )
    for start in starts:
        posterior.check_inside("initial", start)
    return list(starts)


def _first_state(
    sampler: emcee.EnsembleSampler,
    start: Any,
    stream: np.random.SeedSequence,
    drawn: LogPosterior | None,
    names: Sequence[str],
) -> emcee.State:
    """Return the evaluated start, with the ensemble's own random stream.

    Draws from the prior, ``drawn``, at which the posterior is zero, as where a solve
    failed and was rejected, are drawn again.
    """
    log_prob, blobs = sampler.compute_log_prob(start)
    for _ in range(MOST_DRAWS):
        again = np.flatnonzero(~np.isfinite(log_prob))
        if drawn is None or not len(again):
            break
        start[again] = drawn.start(len(again), stream.spawn(1)[0])
        log_prob[again], blobs[again] = sampler.compute_log_prob(start[again])
    if not np.isfinite(log_prob).all():
        walker = int(np.argmin(np.isfinite(log_prob)))
        values = dict(zip(names, start[walker].tolist(), strict=True))
        raise ValueError(
            f"initial: the log-posterior of walker {walker} is {log_prob[walker]} at "
            f"{values}; every walker must start where it is finite (of a solve that "
            "failed, on_failure='raise' tells why)"
        )
    random = np.random.RandomState(np.random.MT19937(stream))
    return emcee.State(start, log_prob, blobs, random.get_state())
