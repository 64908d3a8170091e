"""The tasks of one ``map``, whoever does them."""

from typing import Any, Protocol

from .worker import Outcome


class Tasks(Protocol):
    """The tasks of one ``map``."""

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        """Hand out ``evaluate(digest, points, payload)``."""

    def wait(self) -> tuple[int, Outcome]:
        """Wait for a task that is done, and return its number and its outcome."""

    def abandon(self) -> None:
        """Drop what is still waiting."""


def worker_lost(owner: str) -> RuntimeError:
    """Return the error that says so, and what to do."""
    return RuntimeError(
        f"pool: a worker of {owner} died (out of memory, killed, or a crash in the "
        "solver's own code); what was sampled so far is kept in the backend: start the "
        "workers anew and resume"
    )
