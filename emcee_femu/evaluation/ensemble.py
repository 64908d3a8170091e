"""emcee's samplers: all that is known here of their insides is known in this file."""

from collections.abc import Sequence
from inspect import signature

import emcee
import numpy as np

from ..contracts import Floats, Move, split_rows
from .evaluator import Bar, Evaluation
from .memory import (
    Found,
    Replay,
    Weighted,
    copy_moves,
    foreign_moves,
    name_moves,
    remember,
    restore,
)

LONGEST_REPR = 200  # characters of a move that are printed


def start_state(
    theta: Floats, rows: Floats, seed: np.random.SeedSequence
) -> emcee.State:
    """Return emcee's state of evaluated walkers, with a random stream of that seed."""
    random = np.random.RandomState(np.random.MT19937(seed)).get_state()
    return emcee.State(theta, *split_rows(rows.copy()), random)


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
        log_prob, blobs = split_rows(rows)
        return log_prob.copy(), blobs

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
