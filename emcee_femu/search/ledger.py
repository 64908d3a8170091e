"""The ledger of a search: what each stage may spend, and what each has spent."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Literal, TypeAlias

from ..evaluation.evaluator import Evaluation

BEFORE = "first solve"  # the entry for solves before the search
# The stages that have a reserve of solves.
Kept: TypeAlias = Literal["adapt", "judge", "bend", "tune"]


class Ledger:
    """Grant the solves of a search to its stages, and write down who spent them.

    Args:
        evaluator: Whose solves are counted.
        total: Solves that the search may take.
        kept: The reserve of each stage: solves that no other stage may spend.

    Attributes:
        spent: Solves by stage, in the order in which the stages began.
    """

    def __init__(
        self, evaluator: Evaluation, total: int, kept: Mapping[Kept, int]
    ) -> None:
        self.total, self.kept = total, kept
        self.spent: dict[str, int] = {BEFORE: 0}
        self._evaluator, self._payer, self._settled = evaluator, BEFORE, 0
        self._settle()

    @property
    def solves(self) -> int:
        """Solves so far, those before the search included."""
        return self._evaluator.solves

    def end(self, *stages: Kept) -> int:
        """Return at how many solves others must end, to leave these their reserves.

        Without arguments, the reserves of all stages are left untouched.
        """
        return self.total - sum(self.kept[stage] for stage in stages or self.kept)

    @contextmanager
    def charge(self, stage: str) -> Iterator[None]:
        """Charge what is solved inside to a stage, and to no stage around it."""
        self._settle()
        around, self._payer = self._payer, stage
        try:
            yield
        finally:
            self._settle()
            self._payer = around

    def _settle(self) -> None:
        """Write down what was spent since the last entry."""
        new = self.solves - self._settled
        self.spent[self._payer] = self.spent.get(self._payer, 0) + new
        self._settled = self.solves
