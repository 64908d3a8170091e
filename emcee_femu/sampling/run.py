"""Run emcee on a posterior: starts, seeds, independent ensembles, backends."""

from collections.abc import Sequence
from os import PathLike
from typing import Any

import emcee
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Backend
from ..moves import DEMCMove
from ..posterior.log_posterior import LogPosterior
from .arguments import (
    Moves,
    Settings,
    check_backends,
    check_moves,
    check_progress,
    check_starts,
    check_walkers,
)
from .auto import find_recipe, plan
from .evaluation import Evaluation
from .journal import Journal
from .pools.own_processes import open_pool
from .resume import begin_in_file, start_given


def run(
    posterior: LogPosterior,
    moves: Moves | str | None = None,
    nwalkers: int | None = None,
    nsteps: int = 5_000,
    *,
    ensembles: int = 1,
    seed: int,
    workers: int | None = None,
    pool: Any = None,
    vectorize: bool | None = None,
    backend: str | PathLike[str] | Backend | Sequence[Backend] | None = None,
    thin_by: int = 1,
    progress: bool | str = False,
    initial: ArrayLike | None = None,
    resume: bool = False,
    on_failure: str = "raise",
    max_failures: float = 0.1,
    probe_tolerance: float = 1e-6,
) -> list[emcee.EnsembleSampler]:
    """Sample the posterior with emcee; the same seed gives the same chain, to the bit.

    Args:
        posterior: What to sample.
        moves: An emcee move, or a list of ``(move, weight)``; None for
            ``DEMCMove()``; "auto" to search for the modes, with a fifth as many
            evaluations as the chain takes but at least 1,000, refine an
            :class:`IndependenceMove` by importance weights, with 1,500 to some 10,000
            evaluations more, and sample with it and DE-MC, or with a
            :class:`HamiltonianMove` where that pays. The stored chain starts after
            that; ``str(sampler.recipe)`` says what was done, and
            ``sampler.recipe.record`` what was found.
        nwalkers: Walkers per ensemble; None for 4 per parameter, at least 16, and as
            many for each temperature of a :class:`TemperedMove`.
        nsteps: Stored steps; ``nsteps * thin_by`` generations are run.
        ensembles: Independent ensembles, each with its own start and random stream.
            Four from over-dispersed starts are what R-hat needs to see a missed mode.
        seed: A whole number.
        workers: Number of processes to start for the evaluations, and to end with the
            run; None for none. They pay from about a millisecond per solve on, with one
            thread each for linear algebra (``OMP_NUM_THREADS=1``, set before Python
            starts). No more than ``nwalkers / 2`` are of use to most moves.
            On Linux they are forked, which works from scripts without a guard and from
            notebooks. ``multiprocessing.set_start_method("spawn")`` is for solvers that
            do not survive a fork (some with threads or a GPU). A script then needs
            ``if __name__ == "__main__":``, and a model that is defined in a notebook
            needs cloudpickle, of the extra ``notebooks``. So it is on macOS and
            Windows, and on Linux with Python 3.14, whose default is forkserver, if the
            script made processes of its own before without setting "fork".
        pool: Where to evaluate instead, one walker per task: whatever
            :class:`EvaluationPool` takes, such as a ``ProcessPoolExecutor`` or a dask
            ``Client``; or an EvaluationPool of your own.
        vectorize: Whether to evaluate all moving walkers in one call. None for yes
            without workers and pool, no with them.
        backend: None to keep the chain in memory, the name of a file, such as
            "run.chain" (see :class:`.RunFile`), or one emcee backend per ensemble.
        thin_by: Store every ``thin_by``-th generation.
        progress: Whether to show a progress bar per ensemble (needs tqdm);
            "notebook" for the bar of notebooks (needs ipywidgets too).
        initial: Starting positions ``(nwalkers, ndim)``, or ``(ensembles, nwalkers,
            ndim)``; None for draws from the prior. "auto" takes them for points of its
            search, and starts from draws of its proposal.
        resume: Whether to go on with the file ``backend``, if there is one, until every
            ensemble has ``nsteps`` steps; the chain is that of a run that was never
            stopped, to the bit. What else was asked for must be as it was: the file
            knows data, prior, moves and settings; and its last generation is evaluated
            again, ``nwalkers`` solves per ensemble, which tells a changed model. Where
            there is no file a new run begins, so a script may always say
            ``resume=True``. The search of "auto" goes on too.
        on_failure: What an exception, a time-out, NaN or a wrong number of modes of a
            solve does: "raise" to stop with the parameters by name, "reject" to take
            the posterior for zero there, count the cause and log it (logger
            "emcee_femu"); ``sampler.failures`` and ``diagnose`` report them, and
            starts from the prior that cannot be solved are drawn again. A stored run
            may go on with the other of the two.
        max_failures: Fraction of the evaluations, of at least 100, above which
            "reject" stops the run: a posterior with such holes is another one.
        probe_tolerance: Relative difference above which a stored value that is
            evaluated again counts as another.

    Returns:
        One ``emcee.EnsembleSampler`` per ensemble, after the run. With it go
        ``seed``, ``recipe``, ``burn_in_evaluations`` (what was evaluated before the
        stored chain), ``failures`` and ``starts_given`` (whether by ``initial``).

    Raises:
        TypeError: If a count is not a whole number, or posterior is not a
            LogPosterior, or cannot be pickled for the processes of a pool.
        ValueError: If the moves do not fit the ensemble, an initial point is out of
            bounds or has no finite log-posterior, a backend already holds steps, a
            file is not that of the same run, or two of workers, pool and vectorize are
            asked for. All are raised before sampling.
        ImportError: If progress is "notebook" and ipywidgets is not installed.
        RuntimeError: If there are fewer walkers than twice the parameters and the move
            is without ``live_dangerously=True``; too many solves failed, or a worker
            died. An exception during sampling has the samplers so far, as its attribute
            ``samplers``.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> samplers = ef.run(posterior, nwalkers=20, nsteps=100, ensembles=2, seed=1)
        >>> [sampler.get_chain().shape for sampler in samplers]
        [(100, 20, 5), (100, 20, 5)]
    """
    if not isinstance(posterior, LogPosterior):
        raise TypeError(
            f"posterior: expected a LogPosterior, got {type(posterior).__name__}; for "
            "a bare log-probability function use emcee.EnsembleSampler"
        )
    if isinstance(moves, str) and moves != "auto":
        raise ValueError(f"moves: expected emcee moves or 'auto', got {moves!r}")
    given = DEMCMove() if moves is None or isinstance(moves, str) else moves
    check_moves("moves", given)
    nwalkers = check_walkers(nwalkers, given, posterior)
    ensembles = checks.whole_number("ensembles", ensembles, 1)
    serial = workers is None and pool is None
    vectorize = checks.flag("vectorize", serial if vectorize is None else vectorize)
    if vectorize and not serial:
        raise ValueError("vectorize: emcee ignores workers and pool then; omit them")
    resume = checks.flag("resume", resume)
    backends, path = check_backends(backend, ensembles, resume)
    settings = Settings(
        posterior=posterior,
        moves=None if isinstance(moves, str) else given,
        nwalkers=nwalkers,
        nsteps=checks.whole_number("nsteps", nsteps, 1),
        ensembles=ensembles,
        seed=checks.whole_number("seed", seed),
        vectorize=vectorize,
        backends=backends,
        path=path,
        thin_by=checks.whole_number("thin_by", thin_by, 1),
        progress=check_progress(progress),
        initial=check_starts(initial, posterior, ensembles, nwalkers),
        resume=resume,
        on_failure=on_failure,
        max_failures=max_failures,
        probe_tolerance=checks.real_number("probe_tolerance", probe_tolerance, 0),
    )
    with open_pool(pool, workers, posterior.one_by_one) as evaluators:
        samplers, states = begin(Evaluation.begin(settings, evaluators))
        try:
            for number, state in enumerate(states, 1):
                advance(settings, samplers[number - 1], state, number)
        except BaseException as error:  # also of the keyboard: nothing is lost
            error.samplers = samplers  # type: ignore[attr-defined]
            raise
    return samplers


def begin(
    evaluation: Evaluation,
) -> tuple[list[emcee.EnsembleSampler], list[emcee.State]]:
    """Return the samplers, which may hold steps already, and where they go on from."""
    settings = evaluation.settings
    backends: Sequence[Backend | None] = settings.backends
    if settings.path is not None:
        backends, recipe = begin_in_file(evaluation)
    elif settings.moves is None:
        journal = Journal(evaluation, None, {})
        recipe = find_recipe(journal, settings, plan(settings))
    else:
        recipe = start_given(evaluation)
    samplers = [evaluation.sampler(recipe.moves, own) for own in backends]
    for sampler in samplers:  # kept for to_inference_data, diagnose and compare_moves
        sampler.seed = settings.seed
        sampler.recipe = recipe
        sampler.burn_in_evaluations = recipe.evaluations
        sampler.failures = evaluation.failures
        # "auto" only searches from them too.
        own = settings.initial is not None and settings.moves is not None
        sampler.starts_given = own
    return samplers, recipe.states


def advance(
    settings: Settings, sampler: emcee.EnsembleSampler, state: emcee.State, number: int
) -> None:
    """Run an ensemble up to ``nsteps`` stored steps."""
    left = settings.nsteps - sampler.iteration
    if left:
        sampler.run_mcmc(
            state,
            left,
            thin_by=settings.thin_by,
            progress=settings.progress,
            progress_kwargs={"desc": f"ensemble {number}/{settings.ensembles}"},
            # Prior draws are linearly independent with probability one, and a
            # single Metropolis walker, which emcee refuses, is a legitimate chain.
            skip_initial_state_check=True,
        )
