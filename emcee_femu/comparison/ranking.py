"""Rank the moves of a comparison: what each achieved, and who won, in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Floats
from ..results.arviz_objects import samples
from ..results.diagnostics import CONVERGED, Diagnosis
from ..table import Table

MOST_NAMES = 4  # in a sentence
LEAD = 2.0  # combined standard errors by which a winner must be ahead


def known_moments(
    reference: Mapping[str, tuple[float, float]] | None, names: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Return the reference, checked, by parameter name; empty if there is none."""
    known = checks.by_name("reference", {} if reference is None else reference, names)
    for name, pair in known.items():
        moments = checks.real_array(f"reference[{name!r}]", pair, 1)
        if moments.shape != (2,) or not moments[1] > 0:
            raise ValueError(
                f"reference[{name!r}]: expected a pair (mean, sd) with sd above zero, "
                f"got {pair!r}"
            )
    return known


@dataclass(frozen=True, eq=False)
class Entry:
    """What one move achieved; evaluations are those of the log-posterior.

    Attributes:
        label: The move's name.
        diagnosis: The judgement of all its ensembles.
        ess: Bulk ESS of the worst parameter in each ensemble, ``(ensembles,)``.
        kept, chain, before: Evaluations of the kept steps, of the stored ones, and of
            what was before them.
        solves, cpu: FE solves and CPU seconds, in total.
        recipe: What was done before the stored steps, in words.
        idata: ArviZ object of the kept steps.
    """

    label: str
    diagnosis: Diagnosis
    ess: Floats
    kept: int
    chain: int
    before: int
    solves: int
    cpu: float
    recipe: str
    idata: Any

    @property
    def ess_per_1000(self) -> Floats:
        """ESS per 1000 evaluations of each ensemble, ``(ensembles,)``."""
        return 1000 * len(self.ess) * self.ess / self.kept

    @property
    def efficiency(self) -> float:
        """ESS of all ensembles per 1000 evaluations of the kept steps."""
        return float(1000 * self.diagnosis.ess_bulk.min() / self.kept)

    @property
    def error(self) -> float:
        """Standard error of the efficiency, from the spread of the ensembles."""
        return float(self.ess_per_1000.std(ddof=1) / np.sqrt(len(self.ess)))

    @property
    def end_to_end(self) -> float:
        """ESS per 1000 evaluations, with all that was dropped or went before."""
        return self.efficiency * self.kept / (self.chain + self.before)

    @property
    def per_cpu_second(self) -> float:
        """ESS per CPU second of the kept steps, at an even pace."""
        share = self.kept / (self.chain + self.before)
        return float(self.diagnosis.ess_bulk.min() / (share * self.cpu))

    def __str__(self) -> str:
        """Return label, efficiency and its standard error."""
        return f"{self.label} {self.efficiency:.3g} +- {self.error:.2g}"


def table(
    title: str,
    entries: Sequence[Entry],
    known: Mapping[str, tuple[float, float]],
) -> Table:
    """Tabulate the moves, one row each, with numbers of the worst parameter.

    FE solves are those of the whole run; "before chain" are evaluations for the starts
    and the search of "auto"; ESS per 1000 counts evaluations of the kept steps, +- is
    its standard error over the ensembles; "end to end" counts all evaluations. Errors
    are the largest against a reference, in its standard deviations.
    """
    found = [entry.diagnosis for entry in entries]
    columns: list[tuple[str, str, Any]] = [
        ("move", "", [e.label for e in entries]),
        ("FE solves", "d", [e.solves for e in entries]),
        ("before chain", "d", [e.before for e in entries]),
        ("acceptance", ".2f", [float(d.acceptance.mean()) for d in found]),
        ("tau", ".0f", [float(d.tau.max()) for d in found]),
        ("steps/tau", ".0f", [float(d.steps_per_tau.min()) for d in found]),
        ("ESS bulk", ".0f", [float(d.ess_bulk.min()) for d in found]),
        ("ESS tail", ".0f", [float(d.ess_tail.min()) for d in found]),
        ("ESS per 1000", ".3g", [e.efficiency for e in entries]),
        ("+-", ".2g", [e.error for e in entries]),
        ("ESS per CPU s", ".5g", [e.per_cpu_second for e in entries]),
        ("R-hat ensembles", ".3f", [float(d.rhat_between.max()) for d in found]),
    ]
    if known:
        off = [_errors(entry.idata, known) for entry in entries]
        columns.append(("mean error/sd", ".3f", [mean for mean, _ in off]))
        columns.append(("sd error %", ".1f", [sd for _, sd in off]))
    columns += [
        ("end to end", ".3g", [e.end_to_end for e in entries]),
        ("verdict", "", [d.short for d in found]),
    ]
    return Table.from_columns(title, columns)


def _errors(
    idata: Any, known: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    """Return the largest error of a mean in sds, and of an sd in percent."""
    chains = samples(idata, list(known))[1]
    draws = chains.reshape(-1, len(known))
    mean, sd = np.array(list(known.values())).T
    off_sd = 100 * np.abs(draws.std(axis=0, ddof=1) / sd - 1)
    return float(np.abs((draws.mean(axis=0) - mean) / sd).max()), float(off_sd.max())


def conclusion(entries: Sequence[Entry]) -> tuple[str | None, str]:
    """Return the label of the winner, or None, and the outcome, one sentence per line.

    The winner has converged, and leads every other converged move by more than two
    combined standard errors.
    """
    ranked = sorted(entries, key=lambda entry: -entry.efficiency)
    able = [entry for entry in ranked if entry.diagnosis.short == CONVERGED]
    winner, lines = None, []
    if not able:
        lines.append("No winner: no move has converged; run longer.")
    else:
        best, *others = able
        lead = {e: best.efficiency - e.efficiency for e in others}
        close = [e for e in others if lead[e] <= LEAD * np.hypot(best.error, e.error)]
        if close:
            names = [str(entry) for entry in (best, *close)]
            if len(names) > MOST_NAMES:
                names[MOST_NAMES - 1 :] = [f"{len(names) - MOST_NAMES + 1} more"]
            lines.append(
                f"No winner: {', '.join(names[:-1])} and {names[-1]} are within the "
                "spread of the ensembles (ESS per 1000 evaluations)."
            )
        else:
            winner = best.label
            rest = f"the next is {others[0]}" if others else "no other has converged"
            lines.append(f"Winner: {best} ESS per 1000 evaluations; {rest}.")
        first = max(able, key=lambda entry: entry.end_to_end)
        if first is not best:
            lines.append(
                f"End to end, with burn-in counted, {first.label} is ahead: "
                f"{first.end_to_end:.3g} against {best.end_to_end:.3g} of {best.label}."
            )
    unfit = [f"{e.label} ({e.diagnosis.short})" for e in ranked if e not in able]
    if unfit and able:
        lines.append(f"Not converged, so out of the contest: {', '.join(unfit)}.")
    lines += [
        f"{entry.label}: {entry.recipe}; {entry.before} evaluations in all before "
        "its chains."
        for entry in entries
        if entry.recipe
    ]
    return winner, "\n".join(lines)
