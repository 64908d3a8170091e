"""The first state of every ensemble: starts, random streams, burn-in."""

from dataclasses import dataclass, replace
from typing import Any, Self

import emcee
import numpy as np

from ..interfaces import Backend, Floats
from ..posterior.failures import FailureLog
from ..posterior.rejecting import guard
from .arguments import Moves, Settings

MOST_DRAWS = 20  # of a starting point


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What evaluates the posterior of a run, and what counts its failures.

    Attributes:
        settings: What was asked for.
        failures: The log, None if failures stop the run.
        function: What emcee calls.
        pool: Where emcee calls it, or None.
        bare: The same pool, which counts nothing.
    """

    settings: Settings
    failures: FailureLog | None
    function: Any
    pool: Any
    bare: Any

    @classmethod
    def begin(cls, settings: Settings, pool: Any) -> Self:
        """Return the evaluation of the posterior on a pool, or None."""
        kind, most = settings.on_failure, settings.max_failures
        return cls(settings, *guard(settings.posterior, pool, kind, most), pool)

    def uncounted(self) -> Self:
        """Return the same with a log of its own that never stops."""
        other = self.begin(replace(self.settings, max_failures=1.0), self.bare)
        # Forked workers know the function itself.
        return other if self.pool is None else replace(other, function=self.function)

    def sampler(
        self, moves: Moves | None = None, backend: Backend | None = None
    ) -> emcee.EnsembleSampler:
        """Return a sampler of the posterior."""
        return emcee.EnsembleSampler(
            self.settings.nwalkers,
            self.settings.posterior.ndim,
            self.function,
            moves=moves,
            backend=backend,
            pool=self.pool,
            vectorize=self.settings.vectorize,
        )


def draw_starts(evaluation: Evaluation) -> list[emcee.State]:
    """Return the evaluated start of each ensemble, with its own random stream.

    If failed solves are rejected, draws from the prior where the posterior is zero are
    drawn again.
    """
    settings = evaluation.settings
    posterior, sampler = settings.posterior, evaluation.sampler()
    states = []
    streams = np.random.SeedSequence(settings.seed).spawn(settings.ensembles)
    for ensemble, stream in enumerate(streams):
        if settings.initial is None:
            start = posterior.start(settings.nwalkers, stream.spawn(1)[0])
        else:
            start = settings.initial[ensemble].copy()
        log_prob, blobs = sampler.compute_log_prob(start)
        redraw = evaluation.failures is not None and settings.initial is None
        for _ in range(MOST_DRAWS if redraw else 0):
            again = np.flatnonzero(~np.isfinite(log_prob))
            if not len(again):
                break
            start[again] = posterior.start(len(again), stream.spawn(1)[0])
            log_prob[again], blobs[again] = sampler.compute_log_prob(start[again])
        _check_finite(log_prob, start, posterior.names)
        random = np.random.RandomState(np.random.MT19937(stream))
        states.append(emcee.State(start, log_prob, blobs, random.get_state()))
    return states


def _check_finite(log_prob: Floats, start: Floats, names: tuple[str, ...]) -> None:
    if not np.isfinite(log_prob).all():
        walker = int(np.argmin(np.isfinite(log_prob)))
        values = dict(zip(names, start[walker].tolist(), strict=True))
        raise ValueError(
            f"initial: the log-posterior of walker {walker} is {log_prob[walker]} at "
            f"{values}; every walker must start where it is finite (for a solve that "
            "failed, on_failure='raise' tells why)"
        )
