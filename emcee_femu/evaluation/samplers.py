"""emcee's samplers: all that is known here of their insides is known in this file."""

from collections.abc import Callable, Sequence
from inspect import signature
from typing import Any

import emcee
import numpy as np
from emcee.ensemble import _FunctionWrapper

from ..interfaces import Evaluator, Floats, Move

LONGEST_REPR = 200  # characters of a move that are printed


class Sampler(emcee.EnsembleSampler):
    """An emcee sampler whose walkers are evaluated in one call.

    ``log_prob_fn.f`` is the evaluator, as it is the function of any emcee sampler.
    """

    def __init__(
        self,
        nwalkers: int,
        evaluator: Evaluator,
        moves: list[tuple[Move, float]] | None = None,
        backend: emcee.backends.Backend | None = None,
    ) -> None:
        ndim = evaluator.posterior.ndim
        super().__init__(
            nwalkers, ndim, evaluator.rows, moves=moves, backend=backend, vectorize=True
        )
        self.log_prob_fn.f = evaluator
        self.evaluator = evaluator

    def compute_log_prob(self, coords: Floats) -> tuple[Floats, Floats]:
        """Return log-posteriors ``(n,)`` and blobs of ``coords (n, d)``.

        emcee's own loops over walkers, and prints a page before an error.
        """
        if not np.isfinite(coords).all():
            raise ValueError("coords: a move proposed a number that is not finite")
        rows = self.evaluator.rows(coords)
        return rows[:, 0].copy(), rows[:, 1:]

    def advance(self, state: emcee.State, steps: int, thin_by: int, bar: Any) -> None:
        """Go on from a state by some stored steps; a bar is told of each."""
        # Prior draws are linearly independent with probability one, and a single
        # Metropolis walker, which emcee refuses, is a valid chain.
        options = dict(thin_by=thin_by, skip_initial_state_check=True)
        for last in self.sample(state, iterations=steps, **options):
            self._previous_state = last
            bar.update(1)


def unwrap(function: Any) -> Callable[[Any], Any]:
    """Return what emcee wraps, anew for every sampler, if it wraps nothing else."""
    bare = isinstance(function, _FunctionWrapper)
    if bare and not (function.args or function.kwargs):
        return function.f  # type: ignore[no-any-return]
    return function  # type: ignore[no-any-return]


def moves_of(sampler: object) -> list[tuple[Move, float]]:
    """Return the weighted moves of a sampler; none of a backend, which has none."""
    moves = getattr(sampler, "_moves", ())
    return list(zip(moves, getattr(sampler, "_weights", ()), strict=True))


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
    kept = [f"{n}={getattr(value, n)!r}" for n in sorted(names) if hasattr(value, n)]
    return f"{type(value).__name__}({', '.join(kept)})"
