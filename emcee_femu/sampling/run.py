"""Run emcee on a posterior: starts, seeds, independent ensembles, files."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike

import emcee
from emcee.backends import Backend
from numpy.typing import ArrayLike
from scipy.constants import hour, minute

from .. import checks
from ..contracts import Floats, Move
from ..evaluation.ensemble import Sampler
from ..evaluation.evaluator import Bar, Evaluation
from ..evaluation.memory import Weighted, copy_moves, foreign_moves
from ..evaluation.progress import check_progress, complete, progress_bar
from ..evaluation.resume import StoredEvaluation, logger, open_evaluator
from ..evaluation.starts import check_first_solve, draw_starts, time_batch
from ..evaluation.store import Store, StoredChain
from ..models.function import DensityModel
from ..moves.proposing import find_stock_fault, ladder_of
from ..posterior.log_posterior import LogPosterior
from ..search.auto import budget_of, search_and_start
from ..search.record import STOPPED_BY_STEPS, SearchRecord
from ..search.settings import SETTINGS
from .advance import sample_steps, sample_until
from .arguments import Moves, check_backends, check_starts, check_walkers, weigh_moves
from .record import Run

# If `solves` is small, the search is sized for a chain of a third of them, and may take
# half of them.
SIZED_BY = 3
# Seconds above which the length of a run is announced.
LONG_RUN = 600.0
# If a solve takes fewer seconds than this, a batch is solved to time it better.
BRIEF = 3.0
# The same where points are solved one by one, of which a batch is one.
BRIEF_ALONE = 0.1


def run(
    posterior: LogPosterior,
    moves: Moves | str = "auto",
    nwalkers: int | None = None,
    steps: int | None = None,
    *,
    ess: float = 1_000,
    solves: int = 200_000,
    ensembles: int = 4,
    seed: int,
    workers: int | None = None,
    pool: object = None,
    backend: str | PathLike[str] | Backend | Sequence[Backend] | None = None,
    thin_by: int = 1,
    progress: bool | str | None = None,
    starts: ArrayLike | None = None,
    resume: bool = False,
    on_failure: str = "raise",
    max_failures: float = 0.2,
    probe_tolerance: float = 1e-6,
) -> Run:
    """Sample a posterior with emcee, from the search for its maxima to the verdict.

    ``run(posterior, seed=1)`` is enough for most problems: it searches for the
    maxima of the posterior, fits a proposal to them, samples, and stops when
    :func:`diagnose` calls the chains converged. Use it if a solve takes less than
    about a second. For slower models use :func:`run_emulated`.

    By other moves than "auto" the walkers start from the prior. The run then finds its
    burn-in, ``run.burn_in``, which the verdict, tables and figures leave out.

    The result is the same to the bit for the same seed, with or without
    ``workers``, and if the run was stopped and resumed. Cost: some 5,000 to 25,000
    solves, at most ``solves`` (a last step of moves that take several solves may
    exceed it). With ``steps``, the chain takes ``ensembles * nwalkers * steps *
    thin_by`` solves, and the search of "auto" at most twice as many or 30,000. A
    warning announces runs of more than ten minutes.

    Args:
        posterior: The :class:`LogPosterior` to sample.
        moves: "auto" for the search and the proposal fitted by it (the page "What
            auto does" explains them); an emcee move, such as ``DEMCMove()``, which
            is the paper's; or a list of ``(move, weight)``. Each ensemble has its
            own copy.
        nwalkers: Walkers per ensemble. Default: 2 per parameter and at least 8 if
            the run ends by its verdict; 4 per parameter and at least 16 if
            ``steps`` is given. A :class:`~.moves.TemperedMove` has so many at each
            temperature.
        steps: Number of stored steps. None to stop as soon as the chains have
            converged, every parameter has ``ess`` effective samples and standard
            deviations are known to 5 %, or to 10 % by other moves than "auto".
        ess: Effective sample size (bulk and tail) at which a run without ``steps``
            stops.
        solves: Maximum number of solves, search included, if ``steps`` is None.
        ensembles: Number of independent ensembles, each with its own starts and
            random stream. Four are what R-hat needs to show that one of them missed
            a maximum.
        seed: A whole number.
        workers: Number of worker processes for the solves; None for none. They save
            time if a solve takes more than a millisecond. Most moves can use up to
            ``ensembles * nwalkers / 2``. Set ``OMP_NUM_THREADS=1``; on macOS and
            Windows, use ``if __name__ == "__main__":``.
        pool: Where to solve instead: a ``concurrent.futures`` executor, a dask
            ``Client``, or whatever else :class:`EvaluationPool` takes.
        backend: File in which every step is stored, such as "run.chain"; None to
            keep the chain in memory. :func:`diagnose` and :func:`to_inference_data`
            read the file by its name, even while the run is going on. Or one emcee
            backend per ensemble.
        thin_by: Store only every ``thin_by``-th step.
        progress: Whether to show a progress bar (in notebooks with ipywidgets), or
            a line at every tenth elsewhere. None: on terminals and in notebooks.
            "notebook": the notebook's bar.
        starts: Starting positions ``(ensembles, nwalkers, ndim)``, or ``(nwalkers,
            ndim)`` for one ensemble. Default: draws from the prior. "auto" searches
            from them, and starts the chain from draws of its proposal.
        resume: Whether to continue from the file ``backend``; without a file, a new
            run begins. Posterior, moves, walkers, ensembles, seed and starts must be
            unchanged: 16 stored points are solved again to detect a changed model.
        on_failure: "raise" to stop at the first solve that fails (an exception, a
            time-out, NaN or a wrong number of modes); "reject" to treat the
            posterior as zero there. Failures are counted by cause in
            ``run.failures``.
        max_failures: Fraction of failed solves above which "reject" stops.
        probe_tolerance: Relative difference between a stored and a repeated solve
            above which the model is considered changed.

    Returns:
        The run: a sequence of emcee samplers, one per ensemble, for all tables,
        figures and :func:`report`. ``run.search`` is what "auto" found, and
        ``run.stopped`` why the run ended.

    Raises:
        TypeError: If posterior is not a LogPosterior or cannot be sent to the
            workers, a count is not a whole number, or a move cannot be copied.
        ValueError: If the moves do not fit the ensemble, a start is out of bounds
            or has no finite log-posterior, the file is that of another run, a
            backend already holds steps, or a move remembers more than its
            ``state()``.
        ImportError: If progress is "notebook" and ipywidgets is not installed.
        RuntimeError: If there are fewer walkers than twice the parameters, too many
            solves failed, or a worker died. After an error during sampling, its
            attribute ``run`` has the samples so far.
        UserWarning: If the predictions at the prior mean are off by more than a
            factor of 3 (units?), the frequencies are in another order than the
            measured ones, the prior looks wrong, or the model ignores its
            parameters. Or if a move is one of emcee's that samples wrongly.

    Source: D. Foreman-Mackey et al. (2013), emcee, doi:10.1086/670067; Sherri,
    Boulkaibet, Marwala and Friswell, whose DE-MC algorithm is :class:`DEMCMove`.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=2, seed=1)
        >>> [sampler.get_chain().shape for sampler in run]
        [(100, 20, 5), (100, 20, 5)]
    """
    # 1. Check what is asked, before any solve.
    checks.instance("posterior", posterior, LogPosterior)
    weighted = None if moves == "auto" else _copy_given(moves)
    nwalkers = check_walkers(nwalkers, weighted, posterior, few=steps is None)
    ensembles = checks.whole_number("ensembles", ensembles, 1)
    steps = None if steps is None else checks.whole_number("steps", steps, 1)
    ess = checks.real_number("ess", ess, 0.0)
    solves = checks.whole_number(
        "solves",
        solves,
        SETTINGS.sized_for if weighted is None and steps is None else 1,
    )
    seed = checks.whole_number("seed", seed)
    thin_by = checks.whole_number("thin_by", thin_by, 1)
    progress = check_progress(progress)
    points = check_starts(starts, posterior, ensembles, nwalkers)
    in_file = resume or isinstance(backend, str | PathLike)
    backends = check_backends(None if in_file else backend, ensembles)
    shape, each = (nwalkers, ensembles, seed), thin_by * nwalkers * ensembles
    asked = _identify(weighted, points, shape, thin_by)
    how = workers, pool, on_failure, max_failures, backend if in_file else None
    # 2. Open workers and file, and solve once.
    with open_evaluator(posterior, asked, *how, resume, probe_tolerance) as evaluator:
        store = evaluator.store if isinstance(evaluator, StoredEvaluation) else None
        seconds, doubts = check_first_solve(evaluator)
        search: SearchRecord | None = None
        sizes = _size_search(steps, solves, each)
        if store is None or not store.lengths().get(1):
            # A search takes as much again. Without steps=, twice the chain for which a
            # search is sized is assumed, with any moves.
            _warn_if_long(
                evaluator,
                seconds,
                shape,
                sizes[0] * (2 if weighted is None else 1)
                if steps
                else 2 * SETTINGS.sized_for,
            )
        # 3. Search, or draw the starts.
        if weighted is None:
            search, states = _search(evaluator, store, shape, *sizes, points, progress)
            weighted = search.moves(posterior.prior)
        else:
            states = draw_starts(evaluator, *shape, points)
        # 4. Make a sampler of each ensemble, or open what the file has of it.
        own = [copy_moves(weighted) for _ in backends]
        samplers, states = _make_samplers(
            evaluator, own, states, backends, steps, search
        )
        record = Run(
            tuple(samplers),
            posterior,
            seed,
            own[0],
            search,
            nwalkers * ensembles if search is None else search.solves,
            evaluator.failures,
            # "auto" only searches from given starts, it does not begin there.
            points is not None and search is None,
            doubts,
        )
        # 5. Sample. (emcee's own backends may be parts of one file.)
        together = ensembles > 1 and (backend is None or in_file)
        together &= evaluator.pool is not None and evaluator.pool.takes_turns
        walk = partial(
            sample_steps, samplers, thin_by, _find_doubted(store, weighted), together
        )
        stopped = _sample(record, states, steps, (ess, solves, each), progress, walk)
        if store is not None:
            store["stopped"] = stopped
            # The burn-in is stored with its number of steps, since a run may go on.
            store["burn-in"] = [[samplers[0].iteration, record.burn_in]]
    return replace(record, stopped=stopped)


def _copy_given(moves: object) -> list[tuple[Move, float]]:
    """Return copies of moves with their weights, and warn of those that are wrong."""
    weighted = copy_moves(weigh_moves(moves))
    for move, _ in weighted:
        if fault := find_stock_fault(move):
            warnings.warn(f"moves: {fault}", UserWarning, stacklevel=3)
    return weighted


def _sample(
    record: Run,
    states: Sequence[emcee.State],
    steps: int | None,
    until: tuple[float, int, int],
    progress: bool | str,
    walk: Callable[[Sequence[emcee.State], int, Bar], None],
) -> str:
    """Sample so many steps, or until the verdict is good; return why it ended.

    An error has the run so far as its attribute.

    Args:
        record: The run.
        states: The state from which each ensemble goes on.
        steps: Stored steps in the end; None to end by the verdict.
        until: Effective samples, solves, and evaluations of a step for the verdict.
        progress: How it is shown.
        walk: The function that advances the samplers.
    """
    try:
        if steps is None:
            return sample_until(record, states, *until, progress, walk)
        walk(states, steps, progress_bar(progress, steps * len(record), "sampling"))
    except BaseException as error:  # an interrupt too: nothing is lost
        error.run = record  # type: ignore[attr-defined]
        raise
    return STOPPED_BY_STEPS


def _find_doubted(store: Store | None, weighted: Weighted) -> Weighted | None:
    """Return the moves whose memory has to be checked; None if there is no need."""
    return weighted if store is not None and any(foreign_moves(weighted)) else None


def _identify(
    weighted: Weighted | None,
    points: Floats | None,
    shape: tuple[int, int, int],
    thin_by: int,
) -> dict[str, object]:
    """Return the arguments by which a file is known to belong to the same run."""
    listed = [(f"{weight:g} x", move) for move, weight in weighted or ()]
    betas = ladder_of([move for _, move in listed])
    nwalkers, ensembles, seed = shape
    return {
        "moves": listed or "auto",
        "betas": betas if len(betas) > 1 else None,
        "nwalkers": nwalkers,
        "ensembles": ensembles,
        "thin_by": thin_by,
        "seed": seed,
        "starts": points,
    }


def _size_search(steps: int | None, solves: int, each: int) -> tuple[int, int]:
    """Return the evaluations of the chain that size the search, and its budget."""
    if steps is None:
        evaluations = min(SETTINGS.sized_for, solves // SIZED_BY)
        return evaluations, min(budget_of(evaluations), solves // 2)
    return steps * each, budget_of(steps * each)


def _make_samplers(
    evaluator: Evaluation,
    own: Sequence[Weighted],
    states: list[emcee.State],
    backends: Sequence[Backend | StoredChain | None],
    steps: int | None,
    search: SearchRecord | None,
) -> tuple[list[Sampler], list[emcee.State]]:
    """Return the sampler of each ensemble, and the state from which it goes on.

    Args:
        evaluator: Evaluates the posterior, and has the file if there is one.
        own: The moves of each ensemble.
        states: The start of each, if a file does not hold it.
        backends: The backend of each, if there is no file.
        steps: Stored steps in the end, None if not known.
        search: The record of "auto", which a file keeps after the starts.
    """
    parts = [evaluator.part() for _ in own]
    if isinstance(evaluator, StoredEvaluation):
        store = evaluator.store
        chains = _open_chains(store, evaluator, parts, own, states, steps)
        if search is not None:  # after the starts, since it promises these
            store["search"] = search.to_json()
        states, backends = [one.get_last_sample() for one in chains], chains
    evaluator.solves += search.followed_in if search is not None else 0
    nwalkers = len(states[0].coords)
    samplers = [
        Sampler(nwalkers, part, [*mine], chain)
        for part, mine, chain in zip(parts, own, backends, strict=True)
    ]
    return samplers, states


def _warn_if_long(
    evaluator: Evaluation,
    seconds: float,
    shape: tuple[int, int, int],
    evaluations: int,
) -> None:
    """Warn before the search of a long run, and say how to make it shorter."""
    # A first call may be far slower than later ones: a worker, for example, has to
    # import the model first.
    posterior, half = evaluator.posterior, max(shape[0] // 2, 1)
    brief = BRIEF
    if evaluator.pool is not None:
        half *= shape[1]  # the ensembles take turns on it
    elif posterior.one_by_one:
        half, brief = 1, BRIEF_ALONE
    if LONG_RUN / evaluations < seconds < brief:
        seconds = time_batch(evaluator, half)
    total = seconds * evaluations
    if not total > LONG_RUN:  # NaN too, if it is unknown
        return
    long = (
        f"{total / hour:.1f} hours" if total > hour else f"{total / minute:.0f} minutes"
    )
    remedies = "workers= shares those of a run among processes; solves= sets a limit"
    if not any(isinstance(e.model, DensityModel) for e in posterior.experiments):
        remedies = (
            "run_emulated(posterior, seed=1) needs some hundred solves in all; "
            f"reduce_model makes large matrices small; {remedies}"
        )
    warnings.warn(
        f"posterior: a solve takes {seconds:.2g} s, and a run some {evaluations:,}: "
        f"{long}. {remedies}",
        stacklevel=3,
    )


def _search(
    evaluator: Evaluation,
    store: Store | None,
    shape: tuple[int, int, int],
    evaluations: int,
    most: int,
    points: Floats | None,
    progress: bool | str,
) -> tuple[SearchRecord, list[emcee.State]]:
    """Return the record of "auto" and its starts; no starts if a file has the record.

    Args:
        evaluator: Evaluates the posterior.
        store: The file, if there is one.
        shape: Walkers, ensembles and the seed.
        evaluations: Evaluations of the chains, by which the search is sized.
        most: Solves that the search may take.
        points: Starts that the user gave, ``(ensembles, nwalkers, d)``.
        progress: How it is shown.
    """
    posterior, ensembles = evaluator.posterior, shape[1]
    if store is not None:  # steps may have grown since the search began
        evaluations = store["evaluations"] or evaluations
        most = store["search budget"] or most
        store["evaluations"], store["search budget"] = evaluations, most
        if (stored := store["search"]) is not None:
            return SearchRecord.from_json(stored), []
    logger.info(f"search, about {most:,} solves at most")
    places = points if points is None else [*points]
    if places is None and posterior.draws is not None:
        places = [posterior.draws[i::ensembles] for i in range(ensembles)]
    with progress_bar(progress, most, "search") as evaluator.bar:
        found = search_and_start(evaluator, *shape, evaluations, most, places)
        complete(evaluator.bar)
    evaluator.bar = Evaluation.bar
    return found


def _open_chains(
    store: Store,
    solver: Evaluation,
    parts: Sequence[Evaluation],
    own: Sequence[Weighted],
    states: Sequence[emcee.State],
    steps: int | None,
) -> list[StoredChain]:
    """Return the chains of a file; those that it does not hold get their starts."""
    lengths, chains = store.lengths(), []
    for ensemble, (part, moves) in enumerate(zip(parts, own, strict=True)):
        start = None if ensemble + 1 in lengths else states[ensemble]
        chains.append(StoredChain(store, ensemble, start, part, moves))
        part.restore(chains[-1].last.counts)
    longest = max(chain.iteration for chain in chains)
    if steps is not None and longest > steps:
        raise ValueError(
            f"steps: expected at least the {longest} steps that {store.path} holds "
            f"already, got {steps}"
        )
    # Evaluations of a step that was not stored are repeated, so they do not count.
    solver.restore(store.spent())
    return chains
