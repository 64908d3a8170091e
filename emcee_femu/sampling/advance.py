"""Advance the ensembles of a run: by so many steps, or until the verdict is good."""

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from threading import Lock
from typing import Any

import emcee
import numpy as np

from ..evaluation.ensemble import Sampler
from ..evaluation.evaluator import Bar, Evaluation
from ..evaluation.memory import Weighted
from ..evaluation.pools import EvaluationPool, Function
from ..evaluation.progress import caption, complete, progress_bar
from ..moves.proposing import ladder_of
from ..search.record import STOPPED_BY_SOLVES, STOPPED_BY_VERDICT
from ..search.settings import SETTINGS
from ..verdict.burn_in import FEWEST_STEPS
from ..verdict.diagnosis import NOT_CONVERGED, measure
from ..verdict.verdict import judge_chains
from .record import Run, burn_in_of, read_backends

# Steps after which the verdict is first asked if steps= is not given: a little more
# than the 25 autocorrelation times that it takes, at a tau of one step.
FIRST_LOOK = 30
# Ratio of the steps at a look to those at the look before: with it there are few looks,
# and few steps too many.
LOOK_FURTHER = 1.15


def sample_until(
    record: Run,
    states: Sequence[emcee.State],
    ess: float,
    solves: int,
    per_step: int,
    progress: bool | str,
    walk: Callable[[Sequence[emcee.State], int, Bar], None],
) -> str:
    """Advance all ensembles until the verdict is good, or solves are spent.

    The verdict is asked at fixed numbers of steps, so that a resumed run ends at the
    same step.

    Args:
        record: The run.
        states: The state from which each ensemble goes on.
        ess: Effective samples that a run needs to end.
        solves: Most solves that may be spent.
        per_step: Evaluations that a stored step of all ensembles takes.
        progress: How it is shown.
        walk: :func:`sample_steps` of these samplers.

    Returns:
        Why it ended.
    """
    samplers = record.samplers
    bar = progress_bar(progress, solves, "sampling")
    with bar:
        for sampler in samplers:
            sampler.evaluator.bar = bar
        bar.update(record.solves)
        while True:
            lengths = [sampler.iteration for sampler in samplers]
            done, even = max(lengths), min(lengths) == max(lengths)
            look = next_look(done)
            left = solves - record.solves
            if even:
                if done == look:
                    converged, text = _ask(record, ess)
                    caption(bar, text)
                    if converged:
                        complete(bar)
                        return STOPPED_BY_VERDICT
                    look = next_look(done + 1)
                # Some moves take several solves for a proposal, and only steps already
                # made tell how many. So the first steps are few, and then at most half
                # of the steps for which solves are left are made at a time.
                spent = record.solves - record.evaluations if done else 0
                room = left // max(per_step, -(-spent // max(done, 1)))
                look = min(look, done + room - room // 2, 2 * done + FEWEST_STEPS)
                if look <= done:
                    return STOPPED_BY_SOLVES
            walk(states, look, Evaluation.bar)  # a bar that shows nothing
            states = [sampler.get_last_sample() for sampler in samplers]


def _ask(record: Run, ess: float) -> tuple[bool, str]:
    """Return whether chains converged and are long enough, and that in words."""
    betas = ladder_of([move for move, _ in record.moves])
    backends = [sampler.backend for sampler in record]
    burn_in = 0 if record.search else burn_in_of(backends, betas)
    if min(sampler.iteration for sampler in record) - burn_in < FEWEST_STEPS:
        return False, "sampling"
    chains = replace(
        read_backends(backends, betas, discard=burn_in),
        names=record.posterior.names,
        search=record.search,
    )
    diagnosis = measure(chains)
    chain = judge_chains(diagnosis, record.starts_given)
    least = np.nan_to_num([diagnosis.ess_bulk, diagnosis.ess_tail]).min()
    known = chain.status != NOT_CONVERGED and least >= ess
    if record.search:
        known &= not (diagnosis.sd_error > SETTINGS.sd_at_end).any()
    if known:
        return True, f"converged, ESS {least:,.0f}"
    return False, f"sampling, ESS {least:,.0f} of {ess:,.0f}"


def next_look(steps: int) -> int:
    """Return the first number of steps, from these on, at which the verdict is asked.

    Examples:
        >>> [next_look(steps) for steps in (0, 31, 36)]
        [30, 35, 41]
    """
    look = FIRST_LOOK
    while look < steps:
        look = math.ceil(LOOK_FURTHER * look)
    return look


def sample_steps(
    samplers: Sequence[Sampler],
    thin_by: int,
    fresh: Weighted | None,
    together: bool,
    states: Sequence[emcee.State],
    steps: int,
    bar: Bar,
) -> None:
    """Advance all ensembles to ``steps``, one after another or in turns on a pool.

    Args:
        samplers: One of each ensemble.
        thin_by: Steps for each that is stored.
        fresh: Moves as they were given, by which what a move remembers is checked.
        together: Whether the ensembles take turns.
        states: Where each goes on from.
        steps: Stored steps of each in the end.
        bar: The progress bar, which counts steps.
    """
    left = [steps - sampler.iteration for sampler in samplers]
    bar.update(steps * len(samplers) - sum(left))

    def advance(number: int) -> None:
        samplers[number].advance(states[number], left[number], thin_by, bar, fresh)

    with bar:
        if together:
            take_turns([sampler.evaluator for sampler in samplers], advance)
        else:
            for number in range(len(samplers)):
                advance(number)


class Turn(EvaluationPool):
    """A pool that gives the turn to other ensembles while it works.

    Args:
        pool: The pool.
    """

    def __init__(self, pool: EvaluationPool) -> None:
        self.pool, self.lock, self.ended = pool, Lock(), False

    def map(self, function: Function, iterable: Iterable[object]) -> list[Any]:
        """Return the results of the pool."""
        self.lock.release()
        try:
            return self.pool.map(function, iterable)
        finally:
            self.lock.acquire()
            self.check()

    def check(self) -> None:
        """End a thread if another one has failed."""
        if self.ended:
            raise RuntimeError("another ensemble failed, or the run was interrupted")


def take_turns(
    evaluations: Sequence[Evaluation], advance: Callable[[int], None]
) -> None:
    """Advance all ensembles in threads, so that they share the pool.

    Args:
        evaluations: The evaluator of each ensemble; all use one pool.
        advance: Runs one ensemble, of that number, to its end.

    Raises:
        BaseException: The error of the first ensemble that failed.
    """
    pool, ensembles = evaluations[0].pool, range(len(evaluations))
    assert pool is not None
    turn = Turn(pool)
    for evaluation in evaluations:
        evaluation.pool = turn

    def work(number: int) -> None:
        with turn.lock:
            turn.check()
            advance(number)

    threads = ThreadPoolExecutor(len(ensembles))
    try:
        for future in as_completed([threads.submit(work, i) for i in ensembles]):
            future.result()
    except BaseException:  # an interrupt too: the others stop where they wait
        with turn.lock:
            turn.ended = True
        raise
    finally:
        threads.shutdown(wait=False)
        for evaluation in evaluations:
            evaluation.pool = pool
