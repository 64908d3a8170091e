"""The result of full solves at draws of an emulated posterior: numbers and verdict."""

import json
from dataclasses import asdict, dataclass, replace

import numpy as np

from ...contracts import Floats, Reported
from ...posterior.log_posterior import LogPosterior
from ...results.arviz_objects import (
    JUDGED_IN,
    NOTE,
    InferenceData,
    groups,
    unit_of,
    wrap,
)
from ...results.evidence import Evidence
from ...results.groups import convert, pick_some
from ...results.to_arviz import judge_samples, store_fit
from ...search.importance import GOOD_K
from ...search.record import Chains
from ...table import Parts, Report, Table, number_columns
from ...verdict.diagnosis import Statement

# Efficiency above which weights are so equal that their tail is no matter.
EQUAL_WEIGHTS = 0.9
FEWEST_CERTIFIED = 25  # draws
FEWEST_EFFECTIVE = 50  # effective draws, which determine an sd to 10 %
CLOSE_MOMENTS = 0.1  # of a standard deviation, in means and standard deviations
SURE = 2.0  # standard errors that chance may well make in few draws
MISSED_SHARE = 0.01  # share of the posterior that may be missing
FOUND = 0.25  # share of a maximum's weight below which the draws miss it
CERTIFIED, CORRECTED, REFUSED = "certified", "corrected", "refused"
GROUP = "certificate"  # of the ArviZ object


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Report):
    """The result of :func:`.certify`; ``print`` it for a table and the verdict.

    Attributes:
        names: Parameter names, ``d`` of them.
        solves: Total number of full solves.
        failed_solves: Number of solves that failed.
        efficiency: Effective share of the weights (Kish): 1 if all are equal. Draws
            that failed by chance do not count.
        effective: Number of independent draws that the weighted draws are worth.
        settled: Whether the emulator ended within its tolerance; None where that is
            not known, or the approximate posterior is not of :func:`emulate`.
        log_ratio: Natural logarithm of the ratio of the true evidence to the emulated
            one: of the mean weight before it was made one.
        pareto_k: Pareto k of the weights; infinite for fewer than 25 of them.
        largest: The largest weight, divided by the mean weight.
        mean: Means of the true posterior, ``(d,)``.
        mean_error: Standard errors of the means, ``(d,)``.
        sd: Standard deviations of the true posterior, ``(d,)``.
        sd_error: Their standard errors, ``(d,)``.
        off_error: Standard errors of the difference between sd and emulated_sd,
            ``(d,)``. They are smaller because both come from the same chain.
        emulated_mean: Means of the emulated posterior's whole chain, ``(d,)``.
        emulated_sd: Standard deviations of this chain, ``(d,)``.
        theta: The draws that were solved in full, ``(n, d)``.
        weights: Their weights, with mean one, ``(n,)``.
        log_posterior: The true log-posterior there, ``(n,)``.
        search: Whether climbs looked elsewhere, how many there were, and how many ended
            at a maximum.
        refitted: Whether the emulator has learned from the solved draws too. If so,
            mean, sd and idata are those of a chain of the later emulated posterior.
        faults: Faults of the bounds or the chain of the emulated posterior.
        missed: Regions found by the search that the draws do not contain.
        notes: Further remarks.
        emulated_evidence: The log evidence of the emulated posterior, if "auto" sampled
            it.
        emulated: The emulator that :func:`.run_emulated` made.
        posterior: The true posterior.
        idata: The ArviZ object for further work. If the verdict is *corrected*, it
            holds the draws that were solved in full, with their weights in
            ``sample_stats``, and tables and figures show the weighted draws. Otherwise
            it is a copy of the given object. It has a group ``certificate``, and
            tables and figures show the verdict.
    """

    names: tuple[str, ...]
    solves: int
    failed_solves: int
    efficiency: float
    effective: float
    settled: bool | None
    log_ratio: float
    pareto_k: float
    largest: float
    mean: Floats
    mean_error: Floats
    sd: Floats
    sd_error: Floats
    off_error: Floats
    emulated_mean: Floats
    emulated_sd: Floats
    theta: Floats
    weights: Floats
    log_posterior: Floats
    search: Statement
    refitted: bool = False
    faults: tuple[str, ...] = ()
    missed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    emulated_evidence: Evidence | None = None
    emulated: Report | None = None
    posterior: LogPosterior | None = None
    idata: InferenceData | None = None

    def reported(self) -> Reported:
        """Return the contents of a report: the samples of the certificate."""
        return Reported("certificate", self.idata)

    @property
    def short(self) -> str:
        """The verdict in one word, "certified", "corrected" or "refused"."""
        if self._reasons:
            return REFUSED
        shift, off, error = self._differences
        close = max(shift, off + self._sure * error) <= CLOSE_MOMENTS
        return CERTIFIED if self.efficiency >= EQUAL_WEIGHTS and close else CORRECTED

    @property
    def verdict(self) -> str:
        """The verdict in one sentence, with the next step."""
        equal = self.efficiency >= EQUAL_WEIGHTS  # whose tail is no matter
        facts = (
            f"{len(self.weights)} draws, efficiency {self.efficiency:.2f}, "
            f"{'' if equal else f'Pareto k {self.pareto_k:.2f}, '}"
            f"largest weight {self.largest:.2g} times the mean"
        )
        if reasons := self._reasons:
            return f"Refused: {reasons[0]} ({facts})."
        since = "since the emulator learned from them too, " if self.refitted else ""
        if self.short == CERTIFIED:
            return (
                "Certified: as far as full solves at its draws can tell, the emulated "
                f"posterior is the true one; {since}{self.differences} ({facts})."
            )
        cure = f"{'certify' if equal else 'emulate'} with more solves"
        by = "what it learned corrects" if self.refitted else "the weights correct"
        return (
            f"Corrected: {since}{self.differences}, which {by}; use the idata, "
            f"mean and sd of the certificate, or {cure} ({facts})."
        )

    @property
    def differences(self) -> str:
        """How far means and standard deviations are from the emulated ones."""
        shift, off, error = self._differences
        return (
            f"means differ by up to {shift:.3f} standard deviations, standard "
            f"deviations by up to {100 * off:.1f} % (+- {100 * error:.1f} %)"
        )

    @property
    def findings(self) -> tuple[str, ...]:
        """Further faults and remarks in plain sentences."""
        also = (f"Also: {reason}." for reason in self._reasons[1:])
        return (*also, *self.notes, self.search.sentence)

    @property
    def evidence(self) -> Evidence | None:
        """The log evidence of the true posterior; None if "auto" did not sample."""
        if (emulated := self.emulated_evidence) is None:
            return None
        solved = np.mean(self.weights > 0)  # what failed is zero in the evidence
        of_weights = np.sqrt((1 - self.efficiency * solved) / self.effective)
        problems, error = emulated.problems, emulated.log_evidence_error
        if self.short == REFUSED:
            problems, error = (*problems, "the emulated posterior is refused"), np.inf
        return replace(
            emulated,
            log_evidence=emulated.log_evidence + self.log_ratio,
            log_evidence_error=float(np.hypot(error, of_weights)),
            method=f"{emulated.method}, corrected by {len(self.weights)} full solves",
            problems=problems,
            failed_solves=self.failed_solves,
        )

    @property
    def _sure(self) -> float:
        """Errors added to a difference: none of draws that have been judged before."""
        return 0.0 if self.refitted else SURE

    @property
    def _differences(self) -> tuple[float, float, float]:
        """The largest of the means, in sds, and of sds, relative, with its error."""
        shift = np.abs(self.mean - self.emulated_mean) / self.sd
        off, error = np.abs(self.emulated_sd / self.sd - 1), self.off_error / self.sd
        worst = int(np.argmax(off + self._sure * error))
        return float(shift.max()), float(off[worst]), float(error[worst])

    @property
    def _reasons(self) -> list[str]:
        """Why the emulated posterior is refused, the most obvious reason first."""
        reasons = (*self.faults, self._find_weakness(), *self.missed)
        return [*filter(None, reasons)]

    def _find_weakness(self) -> str:
        """Return the most obvious reason not to trust the weights; empty if none."""
        n, heavy = len(self.weights), self.efficiency < EQUAL_WEIGHTS
        better = "emulate with more solves, or sample with a DelayedAcceptanceMove"
        if not self.largest < np.inf:
            return f"the true posterior is zero at all draws; {better}"
        known = heavy and n >= FEWEST_CERTIFIED  # of fewer weights no tail is known
        if known and self.pareto_k > min(GOOD_K, 1 - 1 / np.log10(n)):
            return (
                f"the weights have such a heavy tail that no mean over {n} of them "
                f"can be trusted; {better}"
            )
        needed = FEWEST_EFFECTIVE if heavy else FEWEST_CERTIFIED
        if self.effective < needed:
            more = self.solves * needed / max(self.effective, 1.0)
            return (
                f"too few solves: the weighted draws are worth {self.effective:.0f} "
                f"independent ones, and {needed} are needed; {better}, or certify with "
                f"{-(-more // 10) * 10:.0f} solves"
            )
        if self.settled is False:
            return (
                "the solves of emulate were spent before its errors were within the "
                "tolerance, so its posterior may lack a part that none of its draws "
                "shows; emulate with more solves"
            )
        return ""

    @property
    def table(self) -> Table:
        """Emulated and true moments, errors and differences, one row per parameter."""
        shift = (self.mean - self.emulated_mean) / self.sd
        error, sd_error = self.mean_error, self.sd_error
        unit, numbers = number_columns(
            [unit_of(self.idata, name) for name in self.names],
            [
                ("emulated mean", self.emulated_mean, error),
                ("mean", self.mean, error),
                ("+-", error, error),
                ("emulated sd", self.emulated_sd, sd_error),
                ("sd", self.sd, sd_error),
                ("+- ", sd_error, sd_error),
            ],
        )
        return Table.from_columns(
            f"Certificate by {self.solves} full solves",
            [
                ("parameter", "", list(self.names)),
                *unit,
                *numbers[:3],
                ("shift/sd", "+.3f", shift),
                *numbers[3:],
                ("sd off by %", "+.1f", 100 * (self.emulated_sd / self.sd - 1)),
            ],
        )

    def _parts(self) -> Parts:
        return self.table, self.verdict, *self.findings

    def sealed(
        self,
        posterior: LogPosterior,
        rows: Floats,
        log_emulated: Floats,
        again: int = 0,
        extra: int = 0,
    ) -> "Certificate":
        """Return the certificate with the ArviZ object for further work.

        Until then its ``idata`` is that of the emulated posterior.

        Args:
            posterior: The true posterior.
            rows: Rows of the true posterior at the solved draws, ``(n, columns)``.
            log_emulated: The emulated log-posterior there, ``(n,)``.
            again: How many of these draws may be solved again to judge the fit.
            extra: Solves that this takes.
        """
        import xarray

        text, sealed = f"{self.short} by {self.solves} full solves", groups(self.idata)
        if weighted := self.short == CORRECTED and not self.refitted:
            text = f"corrected by the weights of {len(self.weights)} full solves"
            possible = self.weights > 0
            solved = rows[possible, None, None]
            attributes = sealed["posterior"].attrs
            chains = Chains(
                posterior.names,
                self.theta[possible, None, None],
                solved[..., 0],
                np.full((1, 1), np.nan),
                solved[..., 1:],
                posterior=posterior,
                kind="weighted",
                seed="unknown (solved at chosen draws)",
                origin="draws of an emulated posterior, solved in full and weighted",
                solves=self.solves + extra,
                doubts=json.loads(attributes.get("doubts", "[]")),
            )
            judged = judge_samples(chains, self.weights[possible], again)
            sealed = groups(store_fit(convert(chains), judged))
            weight = ("chain", "draw"), self.weights[possible][None]
            sealed["sample_stats"] = sealed["sample_stats"].assign(weight=weight)
            if "new_measurement" in sealed:
                sealed["posterior_predictive"] = pick_some(
                    sealed["new_measurement"], self.weights[possible]
                )
        noted = {NOTE: text, JUDGED_IN: GROUP}
        sealed["posterior"] = sealed["posterior"].assign_attrs(noted)
        told = {
            "verdict": self.verdict,
            "refused": int(self.short == REFUSED),  # netCDF has no truth values
            "findings": json.dumps(self.findings),
            "search": json.dumps(asdict(self.search)),
        }
        if (found := self.evidence) is not None:
            held = found.log_evidence, found.log_evidence_error, found.method
            rest = found.problems, found.failed_solves, found.log_box
            told["evidence"] = json.dumps([*held, *rest])
        sealed[GROUP] = xarray.Dataset(
            {
                "theta": (("solve", "parameter"), self.theta),
                "weight": ("solve", self.weights),
                "lp": ("solve", self.log_posterior),
                "lp_emulated": ("solve", log_emulated),
            },
            {"parameter": list(self.names)},
            told,
        )
        spent = self.solves + extra * weighted
        return replace(self, idata=wrap(sealed), solves=spent)
