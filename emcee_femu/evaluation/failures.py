"""Solves that fail: why, where, and how many."""

import subprocess
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..contracts import SolveError

FEWEST_COUNTED = 100  # evaluations before a fraction of failures is judged
CAUSES = ("not finite", "wrong shape", "time-out", "exception")
KEPT_FAILURES = 1_000  # failures whose parameters are kept


class Failure(NamedTuple):
    """One failed solve.

    Attributes:
        cause: One of ``CAUSES``.
        message: What the model or the checks said.
        parameters: Where, by name.
    """

    cause: str
    message: str
    parameters: Mapping[str, float]


def describe_failure(error: Exception, parameters: Mapping[str, float]) -> Failure:
    """Return the text by which an error is recorded."""
    is_late = isinstance(error, TimeoutError | subprocess.TimeoutExpired)
    cause = "time-out" if is_late else "exception"
    if isinstance(error, SolveError):
        cause = error.cause
    return Failure(cause, f"{type(error).__name__}: {error}", parameters)


class FailureLog:
    """Count failures by cause, keep them with their parameters, stop when too many.

    Args:
        max_failures: Fraction of the evaluations, of at least 100.

    Attributes:
        evaluations: Points evaluated so far, those that failed among them.
        causes: Number of failures by cause.
        kept: The first 1,000 failures.
    """

    def __init__(self, max_failures: float) -> None:
        self.max_failures, self.evaluations = max_failures, 0
        self.causes: Counter[str] = Counter()
        self.kept: list[Failure] = []

    def count(self, evaluations: int, failures: Sequence[Failure]) -> None:
        """Count a batch.

        Raises:
            RuntimeError: If too many failed.
        """
        self.evaluations += evaluations
        self.causes.update(failed.cause for failed in failures)
        self.kept += failures[: max(0, KEPT_FAILURES - len(self.kept))]
        self.check(FEWEST_COUNTED)

    def check(self, fewest: int) -> None:
        """Stop if too many of at least ``fewest`` evaluations failed.

        Raises:
            RuntimeError: If so.
        """
        total = self.causes.total()
        if self.evaluations < fewest or total <= self.max_failures * self.evaluations:
            return
        example = ""
        if self.kept:  # those before a resume were logged, and are not kept
            last = self.kept[-1]
            example = f"; for instance {last.message} at {dict(last.parameters)}"
        raise RuntimeError(
            f"on_failure: {total} of {self.evaluations} solves failed "
            f"({dict(self.causes)}), more than max_failures = {self.max_failures:g}"
            f"{example}. Fix the model, narrow the prior to where it can be solved, "
            "or raise max_failures where failures are random"
        )

    def __repr__(self) -> str:
        """Return how many solves failed, why, and one of them."""
        text = f"{self.causes.total():,} of {self.evaluations:,} evaluations failed"
        if self.causes:
            text += (
                f" ({', '.join(f'{n} {cause}' for cause, n in self.causes.items())})"
            )
        if self.kept:
            text += f"; the first: {self.kept[0].message} at {self.kept[0].parameters}"
        return text

    @property
    def counts(self) -> list[int]:
        """Evaluations, then failures in the order of ``CAUSES``."""
        return [self.evaluations, *(self.causes[cause] for cause in CAUSES)]

    def restore(self, counts: Sequence[int]) -> None:
        """Go on from the counts of an earlier run."""
        self.evaluations = int(counts[0])
        pairs = zip(CAUSES, counts[1:], strict=True)
        self.causes = Counter({cause: int(n) for cause, n in pairs if n})
