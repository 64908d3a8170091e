"""Run emcee on a posterior: starts, seeds, independent ensembles, backends."""

from functools import partial
from os import PathLike
from typing import Any

import emcee
from numpy.typing import ArrayLike

from .. import checks
from ..moves import DEMCMove
from ..moves.stock_faults import refuse_sequential
from ..moves.tempering import ladder
from ..posterior.log_posterior import LogPosterior
from ..posterior.rejecting import guard
from .arguments import (
    backend_list,
    check_moves,
    check_picklable,
    check_progress,
    listed,
)
from .fingerprint import fingerprint
from .pools.evaluation_pool import safe_pool, usable
from .resume import StoredRun, place
from .starts import begin_run


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
    resume: bool = False,
    on_failure: str = "raise",
    max_failures: float = 0.1,
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
        pool: Where to evaluate, one walker a task: whatever :class:`EvaluationPool`
            takes, such as ``multiprocessing.Pool``, which is wrapped in it; or an
            EvaluationPool of your own, say for vectorised calls on the workers.
        vectorize: Whether to evaluate all moving walkers in one call. None for yes
            without a pool, no with one.
        backend: None to keep the chain in memory, the name of an HDF5 file (needs
            h5py; each ensemble in a group of its own, see :class:`RunFile`),
            or one emcee backend an ensemble.
        thin_by: Store every ``thin_by``-th generation.
        progress: Whether to show a progress bar an ensemble (needs tqdm).
        initial: Starting positions ``(nwalkers, ndim)``, or ``(ensembles, nwalkers,
            ndim)``; None for draws from the prior.
        resume: Whether to go on with the file ``backend``, if there is one, until every
            ensemble has ``nsteps`` steps; the chain is that of a run that was never
            stopped, to the bit. Whatever else was asked for must be as it was: the file
            knows posterior, data, moves, settings and versions. A new run is started
            where there is no file, so a script may always say ``resume=True``. The
            burn-in of "auto" goes on too, from files beside it that are then removed.
        on_failure: What an exception, a time-out, NaN or a wrong number of modes of a
            solve does: "raise" to stop with the parameters by name, "reject" to take
            the posterior for zero there, count the cause and log it (logger
            "emcee_femu"); ``sampler.failures`` and ``diagnose`` report them, and
            starts from the prior that cannot be solved are drawn again. A stored run
            may go on with the other of the two.
        max_failures: Fraction of the evaluations, of at least 100, above which
            "reject" stops the run: a posterior with such holes is another one.

    Returns:
        One ``emcee.EnsembleSampler`` an ensemble, after the run. With it go
        ``seed``, ``recipe`` and ``burn_in_evaluations``, what was evaluated before the
        stored chain.

    Raises:
        TypeError: If a count is not a whole number, posterior is no LogPosterior, or it
            cannot be pickled for the processes of a pool.
        ValueError: If the moves do not fit the ensemble, an initial point is out of
            bounds or has no finite log-posterior, a backend already holds steps, a
            file is not that of the same run, or pool and vectorize are both asked for.
            All are raised before sampling.
        RuntimeError: If too many solves failed. An exception during sampling has the
            samplers so far, as its attribute ``samplers``.
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
    check_moves("moves", moves)
    ladder(listed(moves))  # refuses temperatures that differ
    for move in listed(moves):
        refuse_sequential("moves", move)
        if hasattr(move, "check"):
            move.check(nwalkers, ndim)
    if vectorize is None:
        vectorize = pool is None
    vectorize = checks.flag("vectorize", vectorize)
    resume = checks.flag("resume", resume)
    check_progress(progress)
    if vectorize and pool is not None:
        raise ValueError("vectorize: emcee ignores the pool then; give one of the two")
    if pool is not None and (isinstance(pool, type) or not usable(pool)):
        raise TypeError(f"pool: expected something with a map, got {pool!r}")

    log, evaluated, workers = guard(
        posterior, safe_pool(pool), on_failure, max_failures
    )
    check_picklable(pool, evaluated)
    build = partial(
        emcee.EnsembleSampler,
        nwalkers,
        ndim,
        evaluated,
        pool=workers,
        vectorize=vectorize,
    )
    first = partial(
        begin_run,
        posterior,
        moves,
        automatic,
        build,
        seed,
        initial,
        ensembles,
        progress,
        redraw=log is not None,  # a failed solve is one reason among others
    )
    if isinstance(backend, str | PathLike):
        checks.file_name("backend", backend)
        describe = partial(
            fingerprint,
            posterior,
            "auto" if automatic else moves,
            nwalkers=nwalkers,
            ensembles=ensembles,
            seed=seed,
            thin_by=thin_by,
            initial=initial,
        )
        # The place is checked before a burn-in, not after.
        stored = StoredRun(place(backend), ensembles, describe(), describe, log)
        if not resume:
            stored.check_new()
        backends, begin = stored.begin(moves, automatic, nsteps, first)
    elif resume:
        raise TypeError(
            f"resume: expected backend to be the name of a file, got {backend!r}"
        )
    else:
        backends = backend_list(backend, ensembles)
        begin = first(backends=lambda *_: [None] * ensembles)
    left = [nsteps - (own.iteration if resume else 0) for own in backends]
    if min(left) < 0:
        raise ValueError(
            f"nsteps: expected at least the {nsteps - min(left)} steps that {backend} "
            f"holds already, got {nsteps}"
        )
    samplers = [build(moves=begin.moves, backend=own) for own in backends]
    for sampler in samplers:  # kept for to_inference_data and compare_moves
        sampler.seed = seed
        sampler.recipe = begin.sentence
        sampler.burn_in_evaluations = begin.evaluations
        sampler.failures = log
    for number, sampler in enumerate(samplers, 1):
        if not left[number - 1]:
            continue
        try:
            sampler.run_mcmc(
                begin.states[number - 1],
                left[number - 1],
                thin_by=thin_by,
                progress=progress,
                progress_kwargs={"desc": f"ensemble {number}/{ensembles}"},
                # Prior draws are linearly independent with probability one, and a
                # single Metropolis walker, which emcee refuses, is a legitimate chain.
                skip_initial_state_check=True,
            )
        except BaseException as error:  # also of the keyboard: nothing is lost
            error.samplers = samplers  # type: ignore[attr-defined]
            raise
    return samplers
