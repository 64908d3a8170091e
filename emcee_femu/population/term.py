"""The tests as the data of a population."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..interfaces import Floats, Parameters, Variable


@dataclass(frozen=True)
class PopulationTerm:
    """The sum of what the tests say; the tests are its data, one by one."""

    tests: Sequence[str]
    name: str = "tests"

    @property
    def reads(self) -> dict[str, Variable]:
        """The log-likelihood of each test."""
        return {"log_marginal": Variable({"test": tuple(self.tests)})}

    def __call__(self, parameters: Parameters, response: Any) -> Floats:
        """Return the log-likelihood ``(n,)``."""
        total: Floats = response["log_marginal"].sum(axis=1)
        return total

    def pointwise(self, parameters: Parameters, stored: Any) -> dict[str, Floats]:
        """Return the log-likelihood of each test, so that one may be left out."""
        return {"log_marginal": stored["log_marginal"]}
