"""What evaluates a posterior: serially or on a pool, with failures counted."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Self

import emcee
import numpy as np

from ..interfaces import Backend, Floats, Linearization
from ..posterior.failures import FailureLog
from ..posterior.linearize import unstack
from ..posterior.log_posterior import LogPosterior
from ..posterior.numerical import difference
from ..posterior.rejecting import count_failures, guard
from .arguments import Moves, Settings


class Call(emcee.ensemble._FunctionWrapper):
    """emcee's call of a function, but for the page that it prints of an error."""

    def __call__(self, theta: Floats) -> Any:
        """Return what the function does."""
        return self.f(theta)


@dataclass(eq=False)
class Evaluation:
    """What evaluates a posterior, and what counts its solves and failures.

    Attributes:
        posterior: The posterior.
        failures: The log, None if failures are raised.
        function: What emcee calls.
        pool: Where emcee calls it, or None.
        bare: The same pool, which counts nothing.
        settings: The settings of :func:`run`, where this is for one.
        solves: Model solves of :meth:`rows` and :meth:`linearize` so far.
    """

    posterior: LogPosterior
    failures: FailureLog | None
    function: Any
    pool: Any
    bare: Any
    settings: Any = None
    solves: int = field(default=0, init=False)

    @classmethod
    def of(
        cls, posterior: LogPosterior, pool: Any, on_failure: Any, max_failures: Any
    ) -> Self:
        """Return the evaluation of a posterior on a pool of ``open_pool``, or None.

        Raises:
            ValueError: If on_failure is neither "raise" nor "reject", or max_failures
                is not a fraction.
        """
        return cls(posterior, *guard(posterior, pool, on_failure, max_failures), pool)

    @classmethod
    def begin(cls, settings: Settings, pool: Any) -> Self:
        """Return the evaluation for a run on a pool, or None."""
        kind, most = settings.on_failure, settings.max_failures
        return replace(cls.of(settings.posterior, pool, kind, most), settings=settings)

    def uncounted(self) -> Self:
        """Return the same with a log of its own that never stops."""
        kind = "raise" if self.failures is None else "reject"
        other = self.of(self.posterior, self.bare, kind, 1.0)
        # Forked workers know the function itself.
        return other if self.pool is None else replace(other, function=self.function)

    def sampler(
        self, moves: Moves | None = None, backend: Backend | None = None
    ) -> emcee.EnsembleSampler:
        """Return a sampler of the posterior."""
        sampler = emcee.EnsembleSampler(
            self.settings.nwalkers,
            self.posterior.ndim,
            self.function,
            moves=moves,
            backend=backend,
            pool=self.pool,
            vectorize=self.settings.vectorize,
        )
        sampler.log_prob_fn = Call(self.function, None, None)
        return sampler

    def rows(self, theta: Floats) -> Floats:
        """Return the rows of the posterior at ``theta (n, d)``."""
        self._count(theta)
        return self._map(self.function, theta)

    def each(self, theta: Floats) -> Iterator[tuple[int, Floats]]:
        """Yield number and row of each point of ``theta (n, d)`` as it is solved."""
        if self.pool is None:
            for number in range(len(theta)):
                yield number, self.rows(theta[number : number + 1])[0]
            return
        for number, result in self.bare.each(self.function, theta):
            self._count(theta[number : number + 1])
            if self.failures is not None:
                result = count_failures([result], self.failures, self.posterior)[0]
            yield number, result

    def linearize(self, theta: Floats) -> Linearization:
        """Return what :meth:`LogPosterior.linearize` does, evaluated in the same way.

        Where a solve failed the row is -inf and the gradient NaN. Finite differences
        are one-sided here, d + 1 solves a point, good to about 1 %: enough to search
        by. All points go to the pool at once; one that failed beside a point leaves
        the point its row, and NaN for the gradient. Where failures are rejected, but
        a ``jacobian`` fails, there are differences, too.
        """
        if not self.posterior.differentiable:
            stacked = self._differences(theta)
        elif self.failures is None:
            self._count(theta)
            stacked = self._map(self.function.stack_linearization, theta)
        else:
            stacked = self._linearize_or_difference(theta, self.failures)
        return unstack(self.posterior, stacked)

    def _linearize_or_difference(self, theta: Floats, log: FailureLog) -> Floats:
        """Return rows, gradients and information.

        What fails is solved again without derivatives: a solve that fails is rejected
        and counted, a jacobian that fails is done without.
        """
        self._count(theta)
        alone = self.uncounted()
        stacked = alone._map(alone.function.stack_linearization, theta)
        failed = np.zeros(len(theta), dtype=bool)
        if alone.failures and alone.failures.causes.total():
            failed = self.posterior.support(theta)[1] & (stacked[:, 0] == -np.inf)
        log.count(len(theta) - int(failed.sum()), [])
        if not failed.any():
            return stacked
        rows, d = self.rows(theta[failed]), theta.shape[1]
        found = np.full((len(theta), rows.shape[1] + d + d * d), np.nan)
        found[:, : stacked.shape[1]] = stacked  # which has rows alone if all failed
        found[failed, : rows.shape[1]] = rows
        failed[failed] = rows[:, 0] > -np.inf
        if failed.any():
            found[failed] = self._differences(theta[failed])
        return found

    def _differences(self, theta: Floats) -> Floats:
        return difference(self.posterior, theta, self._deviations, True, True)

    def _deviations(self, theta: Floats) -> Floats:
        self._count(theta)
        return self._map(self.function.stack_deviations, theta)

    def _count(self, theta: Floats) -> None:
        """Count what is solved: all inside the prior's support."""
        self.solves += int(np.count_nonzero(self.posterior.support(theta)[1]))

    def _map(self, function: Any, theta: Floats) -> Floats:
        if self.pool is None:
            rows: Floats = function(theta)
            return rows
        return np.array(list(self.pool.map(function, theta)))
