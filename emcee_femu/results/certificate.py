"""What full solves say of an emulated posterior, as a table and sentences."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..interfaces import Floats
from ..sampling.importance import GOOD_K
from ..table import Parts, Report, Table

EQUAL = 0.9  # efficiency above which weights are so equal that their tail is no matter
FEWEST = 25  # draws
FEWEST_EFFECTIVE = 50  # what they are worth, to know a standard deviation to 10 %
CLOSE = 0.1  # of a standard deviation, in means and standard deviations
CERTIFIED, CORRECTED, REFUSED = "certified", "corrected", "refused"


@dataclass(frozen=True, eq=False)
class Certificate(Report):
    """What :func:`.certify` found; ``print`` it for a table and the verdict.

    Attributes:
        names: Parameter names, ``d`` of them.
        short: "certified", "corrected" or "refused".
        verdict: The verdict in one sentence, with what to do.
        solves: Full solves spent, all of them.
        failed_solves: Of these, how many failed and were taken for impossible.
        efficiency: Effective share of the weights (Kish): 1 where all are equal.
        effective: Independent draws of the posterior that the weighted ones are worth.
        pareto_k: Of the weights; infinite where there are fewer than 25.
        curvature_k: The Pareto k that the curvature of the logarithms of all weights
            implies, which few weights tell better.
        largest: The largest weight, over the mean weight.
        mean: Of the true posterior, ``(d,)``.
        mean_error: Standard errors of the means, ``(d,)``.
        sd: Standard deviations of the true posterior, ``(d,)``.
        sd_error: Their standard errors, ``(d,)``.
        emulated_mean: Of the emulated posterior's whole chain, ``(d,)``.
        emulated_sd: The same for standard deviations, ``(d,)``.
        theta: The draws that were solved in full, ``(n, d)``.
        weights: Their weights, of mean one, ``(n,)``.
        log_posterior: The true log-posterior there, ``(n,)``.
        findings: Plain sentences.
        idata: The ArviZ object to go on with. If corrected, its draws are those that
            were solved in full, with their weights in ``sample_stats``, and tables and
            figures show the weighted draws; else it is a copy of what was given. Either
            way it has a group ``certificate``, and tables and figures say so.
    """

    names: tuple[str, ...]
    short: str
    verdict: str
    solves: int
    failed_solves: int
    efficiency: float
    effective: float
    pareto_k: float
    curvature_k: float
    largest: float
    mean: Floats
    mean_error: Floats
    sd: Floats
    sd_error: Floats
    emulated_mean: Floats
    emulated_sd: Floats
    theta: Floats = field(repr=False)
    weights: Floats = field(repr=False)
    log_posterior: Floats = field(repr=False)
    findings: tuple[str, ...] = ()
    idata: Any = field(default=None, repr=False)

    @property
    def table(self) -> Table:
        """Emulated and true moments, errors and differences, one row per parameter."""
        shift = (self.mean - self.emulated_mean) / self.sd
        return Table.from_columns(
            f"Certificate by {self.solves} full solves",
            [
                ("parameter", "", list(self.names)),
                ("emulated mean", ".5g", self.emulated_mean),
                ("mean", ".5g", self.mean),
                ("+-", ".2g", self.mean_error),
                ("shift/sd", "+.3f", shift),
                ("emulated sd", ".4g", self.emulated_sd),
                ("sd", ".4g", self.sd),
                ("+- ", ".2g", self.sd_error),
                ("sd off by %", "+.1f", 100 * (self.emulated_sd / self.sd - 1)),
            ],
        )

    def _parts(self) -> Parts:
        return self.table, self.verdict, *self.findings


def judge(
    found: Certificate, bounds: list[str], missed: list[str]
) -> tuple[str, str, list[str]]:
    """Return the verdict in one word and in one sentence, and what else is wrong.

    Args:
        found: All that is known but the verdict.
        bounds: What is wrong with the emulated posterior's bounds or chain.
        missed: What a search found that the draws lack.
    """
    n = len(found.weights)
    facts = (
        f"{n} draws, efficiency {found.efficiency:.2f}, Pareto k {found.pareto_k:.2f} "
        f"({found.curvature_k:.2f} by the curvature of the weights), "
        f"largest weight {found.largest:.2g} times the mean"
    )
    faults = [*bounds, *_weak_weights(found), *missed]
    if faults:
        more = [f"Also: {fault}." for fault in faults[1:]]
        return REFUSED, f"Refused: {faults[0]} ({facts}).", more
    shift = np.abs(found.mean - found.emulated_mean) / found.sd
    off = np.abs(found.emulated_sd / found.sd - 1)
    differences = (
        f"means differ by up to {shift.max():.3f} standard deviations, standard "
        f"deviations by up to {100 * off.max():.1f} %"
    )
    if found.efficiency >= EQUAL and max(shift.max(), off.max()) <= CLOSE:
        verdict = (
            "Certified: as far as full solves at its draws can tell, the emulated "
            f"posterior is the true one; {differences} ({facts})."
        )
        return CERTIFIED, verdict, []
    verdict = (
        f"Corrected: {differences}, which the weights repair; use the idata, mean and "
        f"sd of the certificate, or emulate with more solves ({facts})."
    )
    return CORRECTED, verdict, []


def _weak_weights(found: Certificate) -> list[str]:
    """Return why the weights cannot be trusted, the plainest first."""
    n = len(found.weights)
    k = max(found.pareto_k, found.curvature_k)
    better = "emulate with more solves, or sample with a DelayedAcceptanceMove"
    if n < FEWEST or not np.isfinite(found.effective):
        return [
            f"too few solves, {FEWEST} draws are the least that tell anything; certify "
            "with more"
        ]
    if not found.largest < np.inf:
        return [f"the true posterior is zero at all draws; {better}"]
    heavy = found.efficiency < EQUAL
    if heavy and k > GOOD_K:
        return [
            "the weights have so heavy a tail that no mean over them can be believed; "
            f"{better}"
        ]
    needed = FEWEST_EFFECTIVE if heavy else FEWEST
    if found.effective < needed:
        more = found.solves * needed / max(found.effective, 1.0)
        return [
            f"too few solves: the weighted draws are worth {found.effective:.0f} "
            f"independent ones, and {needed} are needed; {better}, or certify with "
            f"{_round_up(more)} solves"
        ]
    if heavy and k > 1 - 1 / np.log10(n):
        return [
            "too few solves for so heavy a tail of the weights; certify with "
            f"{_round_up(found.solves / n * 10 ** (1 / (1 - k)))} solves, or emulate "
            "with more"
        ]
    return []


def _round_up(solves: float) -> int:
    """Return a number of two digits."""
    size = 10 ** max(0, int(np.log10(solves)) - 1)
    return int(-(-solves // size) * size)
