"""Evaluate a posterior, here or on workers: solves are counted, failures rejected."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from emcee.pbar import get_progress_bar

from .. import checks
from ..contracts import Floats, Linearization, RepeatedModes
from ..posterior.derivatives import difference, unstack
from ..posterior.log_posterior import Kind, LogPosterior
from .failures import Failure, FailureLog, describe_failure
from .pools import EvaluationPool, open_pool

Request: TypeAlias = tuple[Kind, Floats]  # what is asked for, and a point (d,)
Result: TypeAlias = Floats | Failure
DERIVED = "gradient", "linearization"  # kinds that need derivatives


def _lacks_derivatives(error: Exception, kind: Kind) -> bool:
    """Return whether modes coincide, so that the model itself can still be solved."""
    return kind in DERIVED and isinstance(error, RepeatedModes)


@dataclass(frozen=True, eq=False)
class Solver:
    """What a worker holds: a posterior, and whether a failed solve is returned."""

    posterior: LogPosterior
    reject: bool

    def __call__(self, request: Request) -> Result:
        """Return the requested quantities as columns (:meth:`LogPosterior.stack`)."""
        kind, theta = request
        try:
            return self.posterior.stack(theta, kind)
        except Exception as error:  # of any kind: it is the user's model that raised
            if not (self.reject or _lacks_derivatives(error, kind)):
                raise
            values = zip(self.posterior.names, theta.tolist(), strict=True)
            return describe_failure(error, dict(values))


@dataclass(eq=False)
class Evaluation:
    """The evaluator that solves: in this process in batches, or on a pool.

    Attributes:
        solver: What evaluates a point.
        pool: Where, None for this process.
        failures: The failed solves; None where a failure is an error.
        whole: The evaluation of which this is a part, None of the whole.
        solves: Points inside the prior's support so far.
        bar: What shows how many more there are; at first nothing.
    """

    solver: Solver
    pool: EvaluationPool | None = None
    failures: FailureLog | None = None
    whole: "Evaluation | None" = None
    solves: int = field(default=0, init=False)
    bar: Any = field(default=get_progress_bar(False, None), init=False)

    @classmethod
    @contextmanager
    def open(
        cls,
        posterior: LogPosterior,
        workers: int | None = None,
        pool: object = None,
        on_failure: str = "raise",
        max_failures: float = 0.2,
    ) -> "Iterator[Evaluation]":
        """Yield the evaluation for the arguments of :func:`.run`.

        Raises:
            ValueError: If one of them makes no sense.
        """
        if on_failure not in ("raise", "reject"):
            raise ValueError(f"on_failure: raise or reject, not {on_failure!r}")
        fraction = checks.real_number("max_failures", max_failures, 0.0, 1.0)
        reject = on_failure == "reject"
        solver = Solver(posterior, reject)
        with open_pool(pool, workers, solver) as opened:
            yield cls(solver, opened, FailureLog(fraction) if reject else None)

    def part(self) -> "Evaluation":
        """Return an evaluation with its own counts; all is counted here too."""
        log = None if self.failures is None else FailureLog(1.0, self.failures)
        return Evaluation(self.solver, self.pool, log, self)

    @property
    def posterior(self) -> LogPosterior:
        """What is evaluated."""
        return self.solver.posterior

    def stack(self, theta: Floats, kind: Kind) -> Floats:
        """Return the requested quantities at ``theta (n, d)`` in one array."""
        return self.solve(theta, kind)

    def solve(self, theta: Floats, kind: Kind) -> Floats:
        """Return the same from new solves, never from a file."""
        if kind in DERIVED:
            return self._linearize(theta, kind)
        return self._count(self._results(theta, kind))

    def rows(self, theta: Floats) -> Floats:
        """Return the rows of the posterior at ``theta (n, d)``."""
        return self.stack(theta, "rows")

    def gradient(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return rows and gradients of ``theta (n, d)``."""
        rows, gradient, _ = unstack(self.posterior, self.stack(theta, "gradient"))
        return rows, gradient

    def linearize(self, theta: Floats) -> Linearization:
        """Return rows, gradients and information at ``theta (n, d)``.

        By the models' derivatives, and by differences where there are none or they
        fail.
        """
        return unstack(self.posterior, self.stack(theta, "linearization"))

    def each(self, theta: Floats) -> Iterator[tuple[int, Floats]]:
        """Yield number and row of each point of ``theta (n, d)`` as it is solved."""
        if self.pool is None:
            for number in range(len(theta)):
                yield number, self.solve(theta[number : number + 1], "rows")[0]
            return
        requests: list[Request] = [("rows", point) for point in theta]
        for number, result in self.pool.each(self.solver, requests):
            yield number, self._count([result])[0]

    def again(self, theta: Floats) -> Floats:
        """Return rows for a comparison: neither solves nor failures are counted."""
        return self._fill(self._results(theta, "rows"))[0]

    @property
    def differentiable(self) -> bool:
        """Whether gradients take one solve."""
        return self.posterior.differentiable

    @property
    def scale(self) -> Floats:
        """The scale of each parameter under the prior ``(d,)``."""
        return self.posterior.scale

    @property
    def failed(self) -> int:
        """Number of solves that failed so far."""
        return 0 if self.failures is None else self.failures.causes.total()

    @property
    def counts(self) -> list[int]:
        """Solves so far, evaluations, and failures by cause."""
        log = FailureLog(1.0) if self.failures is None else self.failures
        return [self.solves, *log.counts]

    def restore(self, counts: Sequence[int]) -> None:
        """Go on with solves and failures from the counts of an earlier run."""
        self.bar.update(counts[0] - self.solves)
        self.solves = counts[0]
        if self.failures is not None:
            self.failures.restore(counts[1:])

    def _results(self, theta: Floats, kind: Kind) -> Sequence[Result]:
        """Return the requested quantities at each point, or why its solve failed."""
        if self.pool is not None:
            requests: list[Request] = [(kind, point) for point in theta]
            return self.pool.map(self.solver, requests)
        rejecting = self.failures is not None
        if not (rejecting and self.posterior.one_by_one):
            try:
                return self.posterior.stack(theta, kind)  # type: ignore[return-value]
            except Exception as error:
                if not (rejecting or _lacks_derivatives(error, kind)):
                    raise
        return [self.solver((kind, point)) for point in theta]

    def _count(self, results: Sequence[Result]) -> Floats:
        """Count solves and failures, and return rows for all."""
        stacked, failed = self._fill(results)
        # Outside the prior's support nothing is solved, and the log-prior is -inf.
        solves = len(failed) + int(np.count_nonzero(stacked[:, 1] > -np.inf))
        for evaluation in filter(None, (self, self.whole)):
            evaluation.solves += solves
        self.bar.update(solves)
        if self.failures is not None:
            self.failures.count(len(results), failed)
        return stacked

    def _fill(self, results: Sequence[Result]) -> tuple[Floats, list[Failure]]:
        """Return the results as an array, a failure as -inf and NaN, and failures."""
        if isinstance(results, np.ndarray):
            return results, []
        failed = [result for result in results if isinstance(result, Failure)]
        rejected = self.posterior.rejected()
        rows = [rejected if isinstance(r, Failure) else r for r in results]
        width = max(map(len, rows), default=len(rejected))
        stacked = np.full((len(rows), width), np.nan)
        for place, row in zip(stacked, rows, strict=True):
            place[: len(row)] = row
        return stacked, failed

    def _linearize(self, theta: Floats, kind: Kind) -> Floats:
        """Return rows, gradients and perhaps information, side by side."""
        information, d = kind == "linearization", self.posterior.ndim
        width = self.posterior.row_size
        stacked = np.full((len(theta), width + d + information * d * d), np.nan)
        stacked[:, :width] = self.posterior.rejected()
        failed = self.posterior.support(theta)[1]
        if self.posterior.differentiable:
            results = self._results(theta, kind)
            failed = np.array([isinstance(result, Failure) for result in results])
            solved = self._count([r for r in results if not isinstance(r, Failure)])
            stacked[~failed, : solved.shape[1]] = solved
            # Derivatives may fail where the model itself does not.
            if failed.any():
                stacked[failed, :width] = self.solve(theta[failed], "rows")
                failed &= stacked[:, 0] > -np.inf
        if failed.any():
            stacked[failed] = difference(
                self.posterior,
                theta[failed],
                lambda points: self.solve(points, "deviations"),
                information,
                searching=True,
            )
        return stacked
