"""emcee's samplers: all that is known here of their insides is known in this file.

And what moves remember. Of each ensemble they have their own memory, kept in the file
of a run. A run that is resumed knows the walkers, the random stream, and what the moves
say that they remember. With a file, each step is therefore made again from what that
holds.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from copy import deepcopy
from importlib import import_module
from importlib.util import find_spec
from inspect import signature
from threading import Lock, RLock
from typing import Any, TypeAlias

import emcee
import numpy as np
from emcee.pbar import get_progress_bar

from .. import checks
from ..contracts import Floats, Move
from ..posterior.log_posterior import LOG_POSTERIOR
from .evaluator import Bar, Evaluation
from .pools import EvaluationPool, Function

LONGEST_REPR = 200  # characters of a move that are printed
PACKAGE = __name__.partition(".")[0]

Weighted: TypeAlias = Sequence[tuple[Move, float]]
Found: TypeAlias = tuple[Floats, Floats]  # points (n, d), and their rows


def start_state(
    theta: Floats, rows: Floats, seed: np.random.SeedSequence
) -> emcee.State:
    """Return emcee's state of evaluated walkers, with a random stream of that seed."""
    random = np.random.RandomState(np.random.MT19937(seed)).get_state()
    log_p, blobs = rows[:, LOG_POSTERIOR], np.delete(rows, LOG_POSTERIOR, axis=1)
    return emcee.State(theta, log_p, blobs, random)


class Sampler(emcee.EnsembleSampler):
    """An emcee sampler whose walkers are evaluated in one call.

    ``log_prob_fn.f`` is the evaluator, as it is the function of any emcee sampler.
    """

    def __init__(
        self,
        nwalkers: int,
        evaluator: Evaluation,
        moves: list[tuple[Move, float]] | None = None,
        backend: emcee.backends.Backend | None = None,
    ) -> None:
        ndim = evaluator.posterior.ndim
        super().__init__(
            nwalkers, ndim, evaluator.rows, moves=moves, backend=backend, vectorize=True
        )
        self.log_prob_fn.f = evaluator
        self.evaluator = evaluator
        self._found: list[Found] | None = None

    def compute_log_prob(self, coords: Floats) -> tuple[Floats, Floats]:
        """Return log-posteriors ``(n,)`` and blobs of ``coords (n, d)``.

        emcee's own loops over walkers, and prints a page before an error.
        """
        if not np.isfinite(coords).all():
            raise ValueError("coords: a move proposed a number that is not finite")
        rows = self.evaluator.rows(coords)
        if self._found is not None:
            self._found.append((coords.copy(), rows))
        return rows[:, 0].copy(), rows[:, 1:]

    def advance(
        self,
        state: emcee.State,
        steps: int,
        thin_by: int,
        bar: Bar,
        fresh: Weighted | None = None,
    ) -> None:
        """Go on by some stored steps.

        Args:
            state: Where the walkers are.
            steps: How many.
            thin_by: Generations of each.
            bar: What shows them.
            fresh: The moves as they were at first, with which each step is made again
                from what a file holds; None where there is none, or no need.

        Raises:
            ValueError: If that gives another step.
        """
        # Prior draws are linearly independent with probability one, and a single
        # Metropolis walker, which emcee refuses, is a valid chain.
        options = dict(thin_by=thin_by, skip_initial_state_check=True)
        if fresh is not None:
            self._found = []
            before = self.backend.get_last_sample(), self.backend.remembered
        for last in self.sample(state, iterations=steps, **options):
            self._previous_state = last
            bar.update(1)
            if fresh is not None:
                self._make_again(fresh, *before, last, options)
                self._found = []
                before = self.backend.get_last_sample(), self.backend.remembered
        self._found = None

    def _make_again(
        self,
        fresh: Weighted,
        before: emcee.State,
        remembered: str,
        last: emcee.State,
        options: dict[str, int],
    ) -> None:
        """Refuse moves whose last step cannot be repeated from the stored state."""
        replay, moves = Replay(self.evaluator, self._found or []), copy_moves(fresh)
        restore(moves, remembered)
        again = Sampler(self.nwalkers, replay, moves)
        (state,) = again.sample(before, iterations=1, store=False, **options)
        streams = zip(state.random_state[1:], last.random_state[1:], strict=True)
        pairs = (state.coords, last.coords), *streams
        same = all(np.array_equal(one, other) for one, other in pairs)
        same &= remember(moves) == self.backend.remembered
        if replay.strayed or replay.left or not same:
            raise ValueError(
                f"moves: {name_moves(foreign_moves(fresh))} made step "
                f"{self.iteration} from memory that the file does not hold, so "
                "resume=True would give another chain; give the move state() and "
                "restore(state), see emcee_femu.contracts, or sample without a file"
            )


def copy_moves(weighted: Weighted) -> list[tuple[Move, float]]:
    """Copy moves for one ensemble, so that ensembles share no memory.

    Raises:
        TypeError: If one cannot be copied.
    """
    try:
        return deepcopy([*weighted])
    except TypeError as error:
        raise TypeError(
            "moves: every ensemble has moves of its own, but "
            f"{name_moves(move for move, _ in weighted)} cannot be copied ({error}); "
            "a move that holds such an object needs __deepcopy__(memo)"
        ) from error


def foreign_moves(weighted: Weighted) -> Iterator[Move]:
    """Yield the moves, and those inside of others, that are not of this package.

    The package's own keep counts and caches, which change no proposal.
    """
    for outer, _ in weighted:
        move: Move | None = outer
        while move is not None:
            if type(move).__module__.partition(".")[0] != PACKAGE:
                yield move
            move = getattr(move, "inner", None)


def remember(weighted: Weighted) -> str:
    """Return the state of moves as JSON.

    Raises:
        TypeError: If JSON cannot hold it.
    """
    moves = _moves_with_state(weighted)
    try:
        return json.dumps([move.state() for move in moves])
    except TypeError as error:
        raise TypeError(
            f"moves: expected state() of {name_moves(moves)} to return what JSON can "
            f"hold, such as array.tolist() ({error})"
        ) from error


def restore(weighted: Weighted, remembered: str) -> None:
    """Let moves remember what :func:`remember` returned."""
    states = json.loads(remembered)
    for move, state in zip(_moves_with_state(weighted), states, strict=True):
        move.restore(state)


def _moves_with_state(weighted: Weighted) -> list[Any]:
    return [move for move in foreign_moves(weighted) if hasattr(move, "state")]


def name_moves(moves: Iterator[object] | Sequence[object]) -> str:
    """Return the classes of moves in words."""
    return ", ".join(dict.fromkeys(type(move).__name__ for move in moves))


class Replay(Evaluation):
    """An evaluation that gives again what was found, and refuses all else.

    Args:
        evaluation: What found it. Gradients are evaluated anew, and not counted there.
        found: Points ``(n, d)`` and their rows, in the order of the calls.

    Attributes:
        left: What was not asked for again.
        strayed: Whether something else was asked for.
    """

    def __init__(self, evaluation: Evaluation, found: list[Found]) -> None:
        part = evaluation.part()
        super().__init__(part.solver, part.pool, part.failures)
        self.left, self.strayed = found, False

    def rows(self, theta: Floats) -> Floats:
        """Return the stored rows of these points, or rows of zero density."""
        if self.left and np.array_equal(self.left[0][0], theta):
            return self.left.pop(0)[1]
        self.strayed = True
        return np.tile(self.posterior.rejected(), (len(theta), 1))


def moves_of(sampler: emcee.EnsembleSampler) -> list[tuple[Move, float]]:
    """Return the weighted moves of a sampler."""
    return list(zip(sampler._moves, sampler._weights, strict=True))


def describe_moves(weighted: Sequence[tuple[object, float]]) -> str:
    """Return moves with their weights in words."""
    words = []
    for move, weight in weighted:
        text = describe_object(move)
        if len(text) > LONGEST_REPR:  # of a fitted mixture, all its numbers
            text = f"{type(move).__name__}(...)"
        words.append(f"{weight:g} x {text}")
    return "; ".join(words)


def describe_object(value: object) -> str:
    """Return the repr of an object, or its class with the arguments that it keeps.

    emcee's moves keep their arguments but do not show them.
    """
    if type(value).__repr__ is not object.__repr__:
        return repr(value).partition(" at 0x")[0]
    kinds = [kind for kind in type(value).__mro__ if "__init__" in vars(kind)]
    names = {name for kind in kinds[:-1] for name in signature(kind).parameters}
    there = getattr(value, "__dict__", {})
    kept = [f"{n}={v!r}" for n, v in sorted(there.items()) if n in names]
    return f"{type(value).__name__}({', '.join(kept)})"


def check_progress(progress: bool | str | None) -> bool | str:
    """Return True, False, or "notebook" if ipywidgets can show that bar.

    None: whether there is a terminal or a notebook, unless tqdm's own variable
    TQDM_DISABLE is set.
    """
    if progress is None:
        disabled = os.environ.get("TQDM_DISABLE", "").lower() not in ("", "0", "false")
        return not disabled and (
            _in_notebook() or (_on_terminal() and find_spec("tqdm") is not None)
        )
    if progress != "notebook":
        return checks.flag("progress", progress)
    if find_spec("ipywidgets") is None:
        raise ImportError(
            "progress: 'notebook' needs ipywidgets: pip install ipywidgets tqdm; or "
            "take progress=True, which does not"
        )
    return progress


def progress_bar(progress: bool | str, total: int, text: str) -> Bar:
    """Return a progress bar with emcee's interface, as requested."""
    if progress is True and not _on_terminal():
        if not _in_notebook() or find_spec("ipywidgets") is None:
            return _Lines(total, text)
        progress = "notebook"
    if progress and find_spec("tqdm") is not None:
        # tqdm's own lock, of processes, would settle how processes are started.
        bars = import_module("tqdm").tqdm
        if not hasattr(bars, "_lock"):
            bars.set_lock(RLock())
    return get_progress_bar(progress, total, desc=text)


def caption(bar: Bar, text: str) -> None:
    """Write the state of a run beside its bar; emcee's empty bar cannot show it."""
    if show := getattr(bar, "set_description", None):
        show(text)


def complete(bar: Bar) -> None:
    """End a bar that is not full at its present value."""
    if total := getattr(bar, "n", None):  # of tqdm
        bar.total = total
        bar.refresh()


def _on_terminal() -> bool:
    return sys.stderr is not None and sys.stderr.isatty()


def _in_notebook() -> bool:
    return type(sys.stderr).__module__.startswith("ipykernel")


class _Lines:
    """A line at each tenth of the total, for a file, a pipe or a log."""

    def __init__(self, total: int, text: str) -> None:
        self.total, self.text, self.count = max(total, 1), text, 0
        self.started = time.perf_counter()

    def __enter__(self) -> "_Lines":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def update(self, count: int) -> None:
        """Count, and print a line at each tenth."""
        tenth = 10 * self.count // self.total
        self.count += count
        if 10 * self.count // self.total > tenth:
            done = f"{100 * self.count // self.total}% {self.count}/{self.total}"
            seconds = time.perf_counter() - self.started
            print(f"{self.text}: {done}, {seconds:.0f} s", file=sys.stderr)

    def set_description(self, text: str) -> None:
        """Print how far a run is."""
        seconds = time.perf_counter() - self.started
        print(f"{text}: {self.count:,} solves, {seconds:.0f} s", file=sys.stderr)


class Turn(EvaluationPool):
    """A pool, during whose work others have their turn.

    Args:
        pool: The pool.
    """

    def __init__(self, pool: EvaluationPool) -> None:
        self.pool, self.lock, self.ended = pool, Lock(), False

    def map(self, function: Function, iterable: Iterable[object]) -> list[Any]:
        """Return what the pool does."""
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
        evaluations: What evaluates each of them, on one pool.
        advance: Runs one ensemble, of that number, to its end.

    Raises:
        BaseException: What the first that failed raised.
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
    except BaseException:  # also of the keyboard: the others stop where they wait
        with turn.lock:
            turn.ended = True
        raise
    finally:
        threads.shutdown(wait=False)
        for evaluation in evaluations:
            evaluation.pool = pool
