"""Evaluate a posterior, here or on workers: solves are counted, failures rejected."""

import logging
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from emcee.pbar import get_progress_bar

from ..contracts import Floats, Linearization, RepeatedModes
from ..posterior.derivatives import difference, unstack
from ..posterior.log_posterior import LOG_POSTERIOR, Kind, LogPosterior
from .failures import Failure, FailureLog, describe_failure
from .pools import EvaluationPool

logger = logging.getLogger("emcee_femu")

Request: TypeAlias = tuple[Kind, Floats]  # what is asked for, and a point (d,)
Result: TypeAlias = Floats | Failure
Failures: TypeAlias = dict[int, Failure]  # by the number of the point
Bar: TypeAlias = Any  # tqdm's, or one with update(count)
LOGGED = 5  # rejected solves, after which a warning of each says nothing new
DERIVED = "gradient", "linearization"  # what asks a model for derivatives
# Log-posterior below which a point is impossible: no data are 1e10 standard deviations
# off, and numbers like -1e300 are meant so.
IMPOSSIBLE = -1e20


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
            if not self.returns(error, kind):
                raise
            values = zip(self.posterior.names, theta.tolist(), strict=True)
            return describe_failure(error, dict(values))

    def returns(self, error: Exception, kind: Kind) -> bool:
        """Return whether an error is no end: where modes coincide, rows still exist."""
        return self.reject or (kind in DERIVED and isinstance(error, RepeatedModes))


@dataclass(eq=False)
class Evaluation:
    """The evaluator that solves: in this process in batches, or on a pool.

    Attributes:
        solver: What evaluates a point.
        pool: Where, None for this process.
        failures: The failed solves; None where a failure is an error.
        whole: The evaluation of which this is a part, None of the whole.
        solves: Points inside the prior's support so far.
        rejected: Solves that failed here so far.
        bar: What shows how many more there are; at first nothing.
        warned: Whether it was said that points are taken for impossible.
    """

    solver: Solver
    pool: EvaluationPool | None = None
    failures: FailureLog | None = None
    whole: "Evaluation | None" = None
    solves: int = field(default=0, init=False)
    rejected: int = field(default=0, init=False)
    bar: Bar = field(default=get_progress_bar(False, None), init=False)
    warned: bool = field(default=False, init=False)

    def part(self) -> "Evaluation":
        """Return an evaluation with its own counts; all is counted here too."""
        log = None if self.failures is None else FailureLog(1.0)
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
        return self._count(*self._results(theta, kind))

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
        requests: list[Request] = [("rows", point) for point in theta]
        results: Iterable[tuple[int, Result]] = enumerate(map(self.solver, requests))
        if self.pool is not None:
            results = self.pool.each(self.solver, requests)
        for number, result in results:
            yield number, self._count(*self._side_by_side([result]))[0]

    def again(self, theta: Floats) -> Floats:
        """Return rows for a comparison: neither solves nor failures are counted."""
        return self._results(theta, "rows")[0]

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

    def _results(self, theta: Floats, kind: Kind) -> tuple[Floats, Failures]:
        """Return what is asked for at each point, and why solves failed."""
        apart = self.solver.reject and self.posterior.one_by_one
        if self.pool is None and not apart:
            try:
                return self.posterior.stack(theta, kind), {}
            except Exception as error:
                if not self.solver.returns(error, kind):
                    error.add_note(
                        'on_failure="reject" rejects such points and goes on'
                    )
                    raise
        requests: list[Request] = [(kind, point) for point in theta]
        each = map if self.pool is None else self.pool.map
        return self._side_by_side([*each(self.solver, requests)])

    def _side_by_side(self, results: Sequence[Result]) -> tuple[Floats, Failures]:
        """Return results as an array, -inf and NaN where a solve failed, and why."""
        rejected, failures = self.posterior.rejected(), Failures()
        width = max(map(len, [rejected, *results]))  # a failure is never the longest
        stacked = np.full((len(results), width), np.nan)
        for number, result in enumerate(results):
            if isinstance(result, Failure):
                failures[number] = result
                result = rejected
            stacked[number, : len(result)] = result
        return stacked, failures

    def _count(self, stacked: Floats, failures: Failures) -> Floats:
        """Count solves and failures, and return the results."""
        stacked = self._reject_impossible(stacked)
        # Outside the prior's support nothing is solved, and the log-prior is -inf.
        solves = len(failures) + int(np.count_nonzero(stacked[:, 1] > -np.inf))
        self.bar.update(solves)
        for each in failures.values():
            run = self.whole or self
            run.rejected += 1
            level = logging.WARNING if run.rejected <= LOGGED else logging.DEBUG
            logger.log(level, "rejected: %s at %s", each.message, dict(each.parameters))
            if run.rejected == LOGGED:
                logger.warning("further rejected solves are logged at level DEBUG")
        for evaluation in filter(None, (self, self.whole)):
            evaluation.solves += solves
            if evaluation.failures is not None:
                evaluation.failures.count(len(stacked), [*failures.values()])
        return stacked

    def _reject_impossible(self, stacked: Floats) -> Floats:
        """Return results with a log-posterior of -inf where it is too low to be meant.

        That is said once, unless all terms are Gaussian: their likelihood is as low as
        this where it is zero, such as beside no noise at all. A function may mean more.
        """
        heights = stacked[:, LOG_POSTERIOR]
        low = (heights < IMPOSSIBLE) & np.isfinite(heights)
        if not low.any():
            return stacked
        whole = self.whole or self
        if not (whole.warned or self.solver.posterior.normal):
            whole.warned = True
            warnings.warn(
                f"posterior: a log-posterior below {IMPOSSIBLE:g}, such as "
                f"{heights[low].min():.3g}, is taken for impossible; return -inf there",
                stacklevel=4,
            )
        stacked = stacked.copy()
        stacked[low, LOG_POSTERIOR] = -np.inf
        return stacked

    def _linearize(self, theta: Floats, kind: Kind) -> Floats:
        """Return rows, gradients and perhaps information, side by side."""
        information, d = kind == "linearization", self.posterior.ndim
        width = self.posterior.row_size
        stacked = np.full((len(theta), width + d + information * d * d), np.nan)
        stacked[:, :width] = self.posterior.rejected()
        failed = self.posterior.support(theta)[1]
        if self.posterior.differentiable:
            results, failures = self._results(theta, kind)
            failed = np.isin(np.arange(len(theta)), [*failures])
            solved = self._count(results[~failed], {})
            stacked[~failed, : solved.shape[1]] = solved
            # Derivatives may fail where the model itself does not.
            if failed.any():
                stacked[failed, :width] = self.solve(theta[failed], "rows")
                failed &= stacked[:, 0] > -np.inf
        if failed.any():
            around = partial(self.solve, kind="deviations")
            stacked[failed] = difference(
                self.posterior, theta[failed], around, information, searching=True
            )
        return stacked
