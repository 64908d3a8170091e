"""Run emcee on a posterior: starts, seeds, independent ensembles, backends."""

from collections.abc import Sequence
from functools import partial
from os import PathLike
from typing import Any

import emcee
import numpy as np
from numpy.typing import ArrayLike

from . import checks
from .auto import burn_in_and_fit
from .moves import DEMCMove
from .moves.tempering import ladder
from .posterior import LogPosterior


def run(
    posterior: LogPosterior,
    moves: Any = None,
    nwalkers: int | None = None,
    nsteps: int = 5_000,
    *,
    ensembles: int = 1,
    seed: int,
    pool: Any = None,
    vectorize: bool | None = None,
    backend: Any = None,
    thin_by: int = 1,
    progress: bool | str = False,
    initial: ArrayLike | None = None,
) -> list[emcee.EnsembleSampler]:
    """Sample the posterior with emcee; the same seed gives the same chain, to the bit.

    Args:
        posterior: What to sample.
        moves: An emcee move, or a list of ``(move, weight)``; None for
            ``DEMCMove()``; "auto" to burn in with DE-MC until that is long enough,
            fit an :class:`IndependenceMove` to it and sample with both (the stored
            chain starts after the burn-in; ``sampler.recipe`` says what was done).
        nwalkers: Walkers an ensemble; None for 4 a parameter, at least 16.
        nsteps: Stored steps; ``nsteps * thin_by`` generations are run.
        ensembles: Independent ensembles, each with its own start and random stream.
            Four from over-dispersed starts are what R-hat needs to see a missed mode.
        seed: A whole number.
        pool: Anything with a ``map``, such as ``multiprocessing.Pool``; evaluations
            then run there, one walker at a time.
        vectorize: Whether to evaluate all moving walkers in one call. None for yes
            without a pool, no with one.
        backend: None to keep the chain in memory, the name of an HDF5 file (each
            ensemble in a group of its own), or one emcee backend an ensemble.
        thin_by: Store every ``thin_by``-th generation.
        progress: Whether to show a progress bar an ensemble (needs tqdm).
        initial: Starting positions ``(nwalkers, ndim)``, or ``(ensembles, nwalkers,
            ndim)``; None for draws from the prior.

    Returns:
        One ``emcee.EnsembleSampler`` an ensemble, after the run. With it go
        ``seed``, ``recipe`` and ``burn_in_evaluations``, what was evaluated before the
        stored chain.

    Raises:
        TypeError: If a count is not a whole number, or posterior is no LogPosterior.
        ValueError: If the moves do not fit the ensemble, an initial point is out of
            bounds or has no finite log-posterior, a backend already holds steps, or
            pool and vectorize are both asked for. All are raised before sampling.
    """
    if not isinstance(posterior, LogPosterior):
        raise TypeError(
            f"posterior: expected a LogPosterior, got {type(posterior).__name__}; for "
            "a bare log-probability function use emcee.EnsembleSampler"
        )
    ndim = posterior.ndim
    ensembles = checks.whole_number("ensembles", ensembles, 1)
    nsteps = checks.whole_number("nsteps", nsteps, 1)
    thin_by = checks.whole_number("thin_by", thin_by, 1)
    seed = checks.whole_number("seed", seed)
    if nwalkers is None:
        nwalkers = max(16, 4 * ndim)
    nwalkers = checks.whole_number("nwalkers", nwalkers, 1)
    automatic = isinstance(moves, str)
    if automatic and moves != "auto":
        raise ValueError(f"moves: expected emcee moves or 'auto', got {moves!r}")
    if moves is None or automatic:
        moves = DEMCMove()
    ladder(_listed(moves))  # refuses temperatures that differ
    for move in _listed(moves):
        if hasattr(move, "check"):
            move.check(nwalkers, ndim)
    if vectorize is None:
        vectorize = pool is None
    if vectorize and pool is not None:
        raise ValueError("vectorize: emcee ignores the pool then; give one of the two")

    streams = np.random.SeedSequence(seed).spawn(ensembles)
    starts = _starts(posterior, nwalkers, streams, initial)
    backends = _backends(backend, ensembles)
    build = partial(
        emcee.EnsembleSampler, nwalkers, ndim, posterior, pool=pool, vectorize=vectorize
    )
    states = [
        _first_state(build(), start, stream)
        for start, stream in zip(starts, streams, strict=True)
    ]
    evaluations, recipe = nwalkers, ""
    if automatic:
        moves, states, evaluations, recipe = burn_in_and_fit(build, states, progress)
    samplers = [build(moves=moves, backend=own) for own in backends]
    for sampler in samplers:  # kept for to_inference_data and compare_moves
        sampler.seed = seed
        sampler.recipe = recipe
        sampler.burn_in_evaluations = evaluations
    for number, (sampler, state) in enumerate(zip(samplers, states, strict=True), 1):
        sampler.run_mcmc(
            state,
            nsteps,
            thin_by=thin_by,
            progress=progress,
            progress_kwargs={"desc": f"ensemble {number}/{ensembles}"},
            # Prior draws are linearly independent with probability one, and a single
            # Metropolis walker, which emcee's check refuses, is a legitimate chain.
            skip_initial_state_check=True,
        )
    return samplers


def _listed(moves: Any) -> list[Any]:
    """Return the moves of what emcee accepts: a move, a list, or weighted pairs."""
    if not isinstance(moves, Sequence):
        return [moves]
    return [item[0] if isinstance(item, Sequence) else item for item in moves]


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


def _backends(backend: Any, ensembles: int) -> list[Any]:
    if backend is None:
        return [None] * ensembles
    if isinstance(backend, str | PathLike):
        backends = [
            emcee.backends.HDFBackend(str(backend), name=f"ensemble_{k}")
            for k in range(ensembles)
        ]
    else:
        backends = list(backend) if isinstance(backend, Sequence) else [backend]
    if len(backends) != ensembles:
        raise ValueError(
            f"backend: expected one for each of {ensembles} ensembles, "
            f"got {len(backends)}"
        )
    for own in backends:
        if own.initialized and own.iteration:
            raise ValueError(
                f"backend: {own!r} already holds {own.iteration} steps of another "
                "run; give a new file name, or call its reset()"
            )
    return backends


def _first_state(
    sampler: emcee.EnsembleSampler, start: Any, stream: np.random.SeedSequence
) -> emcee.State:
    """Return the evaluated start, with the ensemble's own random stream."""
    log_prob, blobs = sampler.compute_log_prob(start)
    if not np.isfinite(log_prob).all():
        walker = int(np.argmin(np.isfinite(log_prob)))
        raise ValueError(
            f"initial: the log-posterior of walker {walker} is {log_prob[walker]} at "
            f"{start[walker].tolist()}; every walker must start where it is finite"
        )
    random = np.random.RandomState(np.random.MT19937(stream))
    return emcee.State(start, log_prob, blobs, random.get_state())
