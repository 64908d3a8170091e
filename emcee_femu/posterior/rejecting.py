"""A posterior that turns failed solves into rejections, and what counts them."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Floats
from .failures import Failure, FailureLog, describe_failure
from .linearize import split
from .log_posterior import LogPosterior


class GuardedPosterior:
    """Return a :class:`Failure` in place of a row whose solve failed.

    The error of a batch does not say which of its rows is to blame: they are then
    evaluated one by one, which gives the others the same bits. A model that solves one
    set at a time (``one_by_one``) is asked so from the start.

    Args:
        posterior: What is evaluated, here or on a worker.
    """

    takes_batches = True

    def __init__(self, posterior: LogPosterior) -> None:
        self.posterior = posterior
        self.names = posterior.names

    def __call__(self, theta: Floats) -> Any:
        """Return a row or a failure, or a sequence of them for ``(n, d)``."""
        return self._guard(self.posterior, theta)

    def stack_gradient(self, theta: Floats) -> Any:
        """Return the same with gradients (:meth:`LogPosterior.stack_gradient`).

        If a finite difference fails, so does the point.
        """
        return self._guard(self.posterior.stack_gradient, theta)

    def stack_linearization(self, theta: Floats) -> Any:
        """Return the same with gradients and information."""
        return self._guard(self.posterior.stack_linearization, theta)

    def stack_deviations(self, theta: Floats) -> Any:
        """Return the same with the terms' deviations."""
        return self._guard(self.posterior.stack_deviations, theta)

    def _guard(self, function: Any, theta: Floats) -> Any:
        if np.ndim(theta) == 1:
            return self._evaluate(function, theta)
        if not self.posterior.one_by_one:
            try:
                return function(theta)
            except Exception:  # of any kind: it is the user's model that raised
                pass  # found below
        return [self._evaluate(function, point) for point in theta]

    def _evaluate(self, function: Any, point: Floats) -> Any:
        try:
            return function(point)
        except Exception as error:
            values = np.asarray(point, dtype=float).tolist()
            return describe_failure(error, dict(zip(self.names, values, strict=True)))


class CountedPosterior:
    """A guarded posterior in this process: failures are counted, their rows -inf.

    Args:
        posterior: What is evaluated.
        log: What counts.
    """

    takes_batches = True

    def __init__(self, posterior: LogPosterior, log: FailureLog) -> None:
        self.posterior = posterior
        self._guarded = GuardedPosterior(posterior)
        self._log = log
        self.posterior = posterior
        self.names = posterior.names

    def __call__(self, theta: Floats) -> Floats:
        """Return the row or the rows of ``theta``."""
        return self._count(self._guarded, theta)

    def gradient(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return rows and gradients, which are NaN where a solve failed."""
        return split(self.posterior, self.stack_gradient(theta))

    def stack_gradient(self, theta: Floats) -> Floats:
        """Return rows with gradients behind them."""
        return self._count(self._guarded.stack_gradient, theta)

    def stack_linearization(self, theta: Floats) -> Floats:
        """Return rows with gradients and information behind them."""
        return self._count(self._guarded.stack_linearization, theta)

    def stack_deviations(self, theta: Floats) -> Floats:
        """Return rows with the terms' deviations behind them."""
        return self._count(self._guarded.stack_deviations, theta)

    def _count(self, function: Any, theta: Floats) -> Floats:
        single = np.ndim(theta) == 1
        results = function(np.asarray(theta)[None] if single else theta)
        rows = count_failures(results, self._log, self.posterior)
        return rows[0] if single else rows


class CountingPool:
    """A pool that counts the failures which its workers return.

    Args:
        pool: Anything with a ``map``.
        posterior: The posterior behind the guard.
        log: What counts.
    """

    def __init__(self, pool: Any, posterior: LogPosterior, log: FailureLog) -> None:
        self._pool, self._posterior, self._log = pool, posterior, log

    def map(self, function: Any, points: Iterable[Any]) -> Floats:
        """Return the rows of all points."""
        results = list(self._pool.map(function, points))
        return count_failures(results, self._log, self._posterior)


def count_failures(results: Any, log: FailureLog, posterior: LogPosterior) -> Floats:
    """Count the failures among rows, and return rows for all."""
    if isinstance(results, np.ndarray):
        log.count(len(results), [])
        return results
    failures = [result for result in results if isinstance(result, Failure)]
    log.count(len(results), failures)
    rejected = posterior.rejected()
    # What a row has behind its columns is not known of a failure.
    lengths = [len(row) for row in results if not isinstance(row, Failure)]
    length = max(lengths, default=0)
    behind = np.full(max(0, length - len(rejected)), np.nan)
    rejected = np.concatenate([rejected, behind])
    rows = [rejected if isinstance(row, Failure) else row for row in results]
    return np.array(rows)


def guard(
    posterior: LogPosterior, pool: Any, on_failure: Any, max_failures: Any
) -> tuple[FailureLog | None, Any, Any]:
    """Return what counts failures, what is evaluated, and the pool.

    Raises:
        ValueError: If on_failure is neither "raise" nor "reject", or max_failures is
            not a fraction.
    """
    if not isinstance(on_failure, str) or on_failure not in ("raise", "reject"):
        raise ValueError(
            f"on_failure: expected 'raise' or 'reject', got {on_failure!r}"
        )
    fraction = checks.real_number("max_failures", max_failures, 0.0)
    if fraction > 1:
        raise ValueError(f"max_failures: expected at most 1, got {fraction:g}")
    if on_failure == "raise":
        return None, posterior, pool
    log = FailureLog(fraction)
    if pool is None:
        return log, CountedPosterior(posterior, log), None
    return log, GuardedPosterior(posterior), CountingPool(pool, posterior, log)
