"""What evaluates a posterior: failures, pools, and the file of a run."""

from collections.abc import Iterator
from typing import Protocol

from ..contracts import Floats, Linearization
from ..posterior.log_posterior import Kind, LogPosterior


class Evaluator(Protocol):
    """What evaluates a posterior, and counts what that costs.

    One solves (``Evaluation``), one stores what was solved or reads it from a
    file (``StoredEvaluation``).
    """

    @property
    def posterior(self) -> LogPosterior:
        """What is evaluated."""

    @property
    def solves(self) -> int:
        """The solves spent so far, which are all points inside the prior's support."""

    @property
    def failed(self) -> int:
        """How many of them failed."""

    def rows(self, theta: Floats) -> Floats:
        """Return the rows of the posterior at ``theta (n, d)``."""

    def stack(self, theta: Floats, kind: Kind) -> Floats:
        """Return "rows", "deviations" and more of ``theta (n, d)`` side by side."""

    def gradient(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return rows and gradients of ``theta (n, d)``."""

    def linearize(self, theta: Floats) -> Linearization:
        """Return rows, gradients and information of ``theta (n, d)``."""

    def each(self, theta: Floats) -> Iterator[tuple[int, Floats]]:
        """Yield number and row of each point of ``theta (n, d)`` as it is solved."""
