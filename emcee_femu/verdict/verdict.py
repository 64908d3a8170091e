"""The verdict on chains: their numbers, and what speaks against them.

Below :func:`.run`, which may end by it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from ..contracts import Floats
from ..likelihoods.residuals import FitRecord
from ..search.importance import GOOD_K, are_reliable
from ..search.record import ENDED, Chains
from ..table import Column, Parts, Report, Table
from .burn_in import FEWEST_STEPS
from .statistics import (
    MaximaWeights,
    effective_sizes,
    excess_scatter,
    find_drift,
    mean_sizes,
    rhat,
    size_by_means,
    sizes_by_means,
    tau_by_ensemble,
    weigh_maxima,
)

# Steps per autocorrelation time below which tau itself is unreliable. (emcee centres
# each walker on its own mean, so an estimate is .7 of tau on average. The largest of
# four ensembles of ten walkers is .84 of it, and .96 where there are five parameters.
# At 50 tau, which emcee asks of a chain, .83, .96 and 1.1. ESS does not depend on it.)
STEPS_PER_TAU = 25
GOOD_RHAT = 1.01  # Vehtari et al. (2021), doi:10.1214/20-BA1221
# R-hat over walkers is about sqrt(1 + 2 tau / steps), 1.02 at 50 tau, and the worst of
# four ensembles and five parameters 1.03. More means walkers that stay apart, which tau
# cannot see. In shorter chains more is let pass, as that grows: 1.1 at 25 tau, where
# the worst is 1.06, in one of twenty runs above 1.08.
WALKERS_APART, TAU_OF_APART = 1.05, 50
SD_KNOWN_TO = 0.1  # relative standard error of a standard deviation
ERRORS_APART = 4.0  # between two estimates of a weight
SMALL_WEIGHT = 0.005  # a weight, or a difference of two, that does not matter
ENOUGH_VISITS = 20  # accepted frozen proposals of a walker while it stays at a maximum
MEAN_KNOWN_TO = 0.05  # sds, with the waits of walkers at places of poor acceptance
WEIGHT_KNOWN_TO = MEAN_KNOWN_TO / ERRORS_APART  # standard error of a weight
STUCK_BY_CHANCE = 0.05  # walkers that may not have moved yet in a short chain
CONVERGED, MIXED, NOT_CONVERGED = "converged", "well mixed", "not converged"
NO_CHAINS = "none"  # of a population, or of weighted draws
TOO_SHORT = "too short"
BEGINS_ELSEWHERE = "the chain begins elsewhere"
SEARCHED, NOT_SEARCHED = "searched", "not searched"
LENGTH_MARGIN = 1.25  # since tau and errors are estimates themselves
MUCH = 4.0  # times longer, where no number says how much
MUCH_TOO_SHORT = 1_000.0  # times longer: of more it is only said that it is more
MOST_LONGER = 10.0  # times longer, above which it is not length that lacks
# In a few words, in a sentence, and how many times longer a chain would mend it; 0
# where none would, and the sentence says what does.
Complaint: TypeAlias = tuple[str, str, float]


@dataclass(frozen=True)
class Statement:
    """One of the three statements of a diagnosis.

    Attributes:
        status: A word or two that never vary, such as "converged".
        short: The status in a few words, with its reason.
        sentence: The same at length, and what to do.
        reasons: All that speaks against chains, in a word or two each.
    """

    status: str
    short: str
    sentence: str
    reasons: tuple[str, ...] = ()


class Cures(NamedTuple):
    """What mends chains, in the words of what made them."""

    steps: str
    ensembles: str
    search: str
    stuck: str


OF_RUN = Cures(
    "run steps={:,}",
    "run ensembles=4",
    'run(posterior, "auto")',
    "look at starts and at failed solves",
)
OF_EMCEE = Cures(
    "run {:,} steps",
    "diagnose four samplers, each from starts of its own",
    "run(LogPosterior.from_function(...), seed=1)",
    "look at their starts",
)
NOT_JUDGED = Statement("not judged", "not judged", "not judged.")


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Report):
    """The result of :func:`.diagnose`; ``print`` it for a table and three statements.

    Attributes:
        names: Parameter names, ``d`` of them.
        steps: Stored steps per ensemble, after burn-in.
        discard: Stored steps that were left out before these, as burn-in.
        drift: How many of ``steps`` are a way in from elsewhere, which the other
            numbers then include; 0 if none are seen, and all of them if what follows
            drifts as well.
        tau: Integrated autocorrelation time in stored steps, ``(ensembles, d)``; NaN
            if no walker moved.
        steps_per_tau: ``steps / tau`` of the worst ensemble, ``(d,)``. Below 25 a chain
            is too short.
        ess_bulk: Effective sample size for the centre, from all ensembles, ``(d,)``.
        ess_tail: Effective sample size for the 5 % and 95 % quantiles, ``(d,)``.
        acceptance: Fraction of accepted proposals, ``(ensembles, walkers)``; NaN if
            unknown.
        stuck: ``(ensemble, walker)`` of each walker with a parameter that never
            changed.
        rhat_within: R-hat over the walkers of one ensemble, for the worst ensemble,
            ``(d,)``. It measures mixing, not convergence, because walkers depend on one
            another; NaN for a single walker.
        rhat_between: R-hat with each independent ensemble as one chain, ``(d,)``. It
            reveals maxima that some ensembles missed; NaN for a single ensemble.
        sd_error: Relative standard error of the standard deviation, from the ESS of
            the squared deviations and their kurtosis, by the chain or by the search of
            "auto", or from the waits of walkers where its proposal lacks mass,
            whichever is largest, ``(d,)``.
        scatter: Scatter of the ensembles' means and variances, whichever is worse,
            relative to the limit that tau allows, ``(d,)``. Values above 1 are too
            large; NaN for fewer than three ensembles.
        failures: Number of rejected solves by cause (``run(on_failure="reject")``).
        maxima: The maxima of the posterior and the quality of the frozen proposal, if
            "auto" ran; printed if there are several.
        chains: Whether the chains converged: "converged", "well mixed" (a single
            ensemble, or given starts) or "not converged", with the number of steps to
            run. For a population or weighted draws it is "none", and the numbers above
            are NaN.
        search: "searched" or "not searched"; the maxima found, and how small a maximum
            may have been missed.
        fit: Whether the measurements lie inside the posterior predictive: "fits",
            "doubtful" (they do, but parameters are far from their prior, modes of the
            structure have changed places, or there were warnings about the model or
            the prior), "at a bound", "does not fit" or "not checked".
        data: What the statement on the fit is made from: one record for each term,
            mode, sensor, channel and so on; printed by ``data_table``.
        further: Statements that a maintainer added, by their title.
        plain: Whether the samplers are emcee's own, without a LogPosterior.
        stopped: Why the run ended: "converged", "solves" or "steps"; empty if unknown.
    """

    names: tuple[str, ...]
    steps: int
    tau: Floats
    steps_per_tau: Floats
    ess_bulk: Floats
    ess_tail: Floats
    acceptance: Floats
    stuck: tuple[tuple[int, int], ...]
    rhat_within: Floats
    rhat_between: Floats
    sd_error: Floats
    scatter: Floats
    failures: Mapping[str, int]
    maxima: MaximaWeights | None = None
    chains: Statement = NOT_JUDGED
    search: Statement = NOT_JUDGED
    fit: Statement = NOT_JUDGED
    data: tuple[FitRecord, ...] = ()
    further: Mapping[str, Statement] = field(default_factory=dict)
    plain: bool = False
    stopped: str = ""
    discard: int = 0
    drift: int = 0

    @property
    def converged(self) -> bool:
        """Whether several ensembles of independent starts agree, each well mixed."""
        return self.chains.status == CONVERGED

    @property
    def cures(self) -> Cures:
        """What the user of these chains can do."""
        return OF_EMCEE if self.plain else OF_RUN

    @property
    def short(self) -> str:
        """The three statements in one line."""
        return self._join("short", ". ") + "."

    @property
    def verdict(self) -> str:
        """The three statements, one below the other."""
        return self._join("sentence", "\n")

    def _join(self, attribute: str, between: str) -> str:
        three = {"Chains": self.chains, "Search": self.search, "Fit": self.fit}
        every = three | dict(self.further)
        return between.join(f"{k}: {getattr(s, attribute)}" for k, s in every.items())

    @property
    def table(self) -> Table:
        """One row per parameter; tau is that of the worst ensemble."""
        n_ensembles, n_walkers = self.acceptance.shape
        return Table.from_columns(
            f"Diagnosis: {n_ensembles} x {n_walkers} walkers, {self.steps} steps"
            + f" after a burn-in of {self.discard}" * (self.discard > 0),
            [
                ("parameter", "", list(self.names)),
                ("tau", ".1f", self.tau.max(axis=0)),
                ("steps/tau", ".0f", self.steps_per_tau),
                ("ESS bulk", ".0f", self.ess_bulk),
                ("ESS tail", ".0f", self.ess_tail),
                ("R-hat walkers", ".3f", self.rhat_within),
                ("R-hat ensembles", ".3f", self.rhat_between),
            ],
        )

    @property
    def data_table(self) -> Table:
        """chi^2 of each term and of its groups, and the range of a right model."""
        names = [".".join(filter(None, (r.experiment, r.term))) for r in self.data]
        judged = [f"{r.kind} {r.label}".rstrip() for r in self.data]
        columns: list[Column] = [
            ("term", "", names),
            ("data", "", judged),
            ("says", "", [r.status for r in self.data]),
        ]
        for title, spec, name in (
            ("chi^2", ".3g", "chi2"),
            ("mean", ".3g", "size"),
            ("2.5 %", ".3g", "low"),
            ("97.5 %", ".3g", "high"),
            ("p", ".2g", "p"),
            ("MAC", ".3f", "mac"),
        ):
            columns.append((title, spec, [vars(r)[name] for r in self.data]))
        return Table.from_columns("What the samples say of the data", columns)

    def _parts(self) -> Parts:
        if self.chains.status != NO_CHAINS:
            yield self.table
        if self.maxima is not None and len(self.maxima.importance) > 1:
            yield self.maxima.table
        if np.isfinite(self.acceptance).all():
            yield (
                f"Acceptance {self.acceptance.mean():.2f} (walkers "
                f"{self.acceptance.min():.2f} to {self.acceptance.max():.2f}), "
                f"{len(self.stuck)} stuck walkers."
            )
        if ended := ENDED.get(self.stopped):
            yield f"The run ended when {ended}."
        if self.failures:
            yield f"Failed solves, counted as zero probability: {dict(self.failures)}."
        yield self.verdict


def measure(chains: Chains) -> Diagnosis:
    """Return the numbers of chains, not judged.

    Raises:
        ValueError: If there are too few steps.
    """
    draws = chains.draws
    steps, n_ensembles, n_walkers, ndim = draws.shape
    if steps < FEWEST_STEPS:
        raise ValueError(
            f"discard: expected at least {FEWEST_STEPS} steps to judge, left {steps}"
        )
    moved = (draws != draws[0]).any(axis=0).all(axis=2)  # (ensembles, walkers)
    by_ensemble = draws.transpose(1, 2, 0, 3)  # (ensembles, walkers, steps, d)
    squares = (draws - draws.mean(axis=(0, 1, 2))) ** 2
    scatter = within = between = np.full(ndim, np.nan)
    if len(chains.betas) > 1:
        tau = tau_by_ensemble(
            draws.mean(axis=2, keepdims=True), moved.any(axis=1, keepdims=True)
        )
        bulk, tail = sizes_by_means(draws)
        of_squares = size_by_means(squares)
    else:
        tau = tau_by_ensemble(draws, moved)
        bulk, tail = effective_sizes(_as_chains(draws))
        of_squares = mean_sizes(_as_chains(squares))
        of_variances = excess_scatter(squares, tau_by_ensemble(squares, moved))
        scatter = np.fmax(excess_scatter(draws, tau), of_variances)
    if n_walkers > 1:
        within = np.max([rhat(walkers) for walkers in by_ensemble], axis=0)
    if n_ensembles > 1:
        between = rhat(by_ensemble.reshape(n_ensembles, -1, ndim))
    maxima = weigh_maxima(chains)
    with np.errstate(divide="ignore", invalid="ignore"):
        steps_per_tau = steps / tau.max(axis=0)
        kurtosis = 1 + squares.var(axis=(0, 1, 2)) / squares.mean(axis=(0, 1, 2)) ** 2
        seen = 0.0 if chains.search is None else chains.search.kurtosis
        if np.shape(seen) == kurtosis.shape:  # of a tail that chains may have missed
            kurtosis = np.fmax(kurtosis, seen)
        sd_error = 0.5 * np.sqrt((kurtosis - 1) / of_squares)
        if maxima is not None:
            sd_error = np.fmax(sd_error, maxima.sd_error)
    return Diagnosis(
        names=chains.names,
        steps=steps,
        tau=tau,
        steps_per_tau=steps_per_tau,
        ess_bulk=bulk,
        ess_tail=tail,
        acceptance=chains.acceptance,
        stuck=tuple((int(e), int(w)) for e, w in np.argwhere(~moved)),
        rhat_within=within,
        rhat_between=between,
        sd_error=sd_error,
        scatter=scatter,
        maxima=maxima,
        failures=chains.failures,
        plain=chains.plain,
        stopped=chains.stopped,
        discard=chains.discard,
        drift=find_drift(draws),
    )


def _as_chains(values: Floats) -> Floats:
    """Return values with every walker as a chain, ``(chains, steps, d)``."""
    return values.transpose(1, 2, 0, 3).reshape(-1, len(values), values.shape[3])


def judge_chains(diagnosis: Diagnosis, starts_given: bool) -> Statement:
    """Say whether the chains converged; if not, what speaks first and what mends it."""
    if complaints := list(_complaints(diagnosis)):
        short, sentence, longer = complaints[0]
        if longer:
            longer = min(max(factor for *_, factor in complaints), MUCH_TOO_SHORT)
            steps = diagnosis.discard + LENGTH_MARGIN * longer * diagnosis.steps
            unit = 10 ** max(int(np.log10(steps)) - 1, 0)  # two digits, and zeros
            needed = unit * int(np.ceil(steps / unit))
            sentence += f"; {diagnosis.cures.steps.format(needed)}"
            sentence += " at least" if longer == MUCH_TOO_SHORT else ""
        sentence = f"{NOT_CONVERGED}, {short}: {sentence}."
        reasons = tuple(reason for reason, *_ in complaints)
        return Statement(NOT_CONVERGED, short, sentence, reasons)
    count, status, short = len(diagnosis.tau), CONVERGED, CONVERGED
    most = diagnosis.rhat_between.max()
    words = f"{status}: {count} ensembles agree (R-hat at most {most:.3f})"
    if starts_given or count == 1:
        status, short = MIXED, "starts given" if count > 1 else "one ensemble"
        cure = "leave starts out" if count > 1 else diagnosis.cures.ensembles
        words = f"{status}, but other maxima would not be seen ({short}): {cure}"
    sentence = (
        f"{words}; {diagnosis.steps_per_tau.min():.0f} autocorrelation times, ESS at "
        f"least {diagnosis.ess_bulk.min():,.0f}."
    )
    return Statement(status, short, sentence)


def _complaints(diagnosis: Diagnosis) -> Iterator[Complaint]:
    """Yield what speaks against the chains, the plainest first."""
    names, stuck, maxima = diagnosis.names, diagnosis.stuck, diagnosis.maxima
    places = f"(ensemble, walker): {list(stuck[:5])}"
    sentence = f"they never moved, {places}; {diagnosis.cures.stuck}"
    complaint = f"{len(stuck)} walkers stuck", sentence, 0.0
    moving = diagnosis.acceptance[diagnosis.acceptance > 0]
    # So many of the others would be still there by chance after as many steps.
    by_chance = ((1 - moving) ** diagnosis.steps).sum()
    if stuck and by_chance < STUCK_BY_CHANCE:
        yield complaint
    if drift := diagnosis.drift:
        over = drift < diagnosis.steps
        sentence = (
            f"its first {drift} steps differ from those after; "
            f"discard={diagnosis.discard + drift}"
            if over
            else "its second half still drifts"
        )
        yield BEGINS_ELSEWHERE, sentence, 0.0 if over else MUCH
    within, between = diagnosis.rhat_within, diagnosis.rhat_between
    fewer = np.fmax(1.0, TAU_OF_APART / diagnosis.steps_per_tau)
    apart = np.sqrt(1 + (WALKERS_APART**2 - 1) * fewer)
    # Values, their best, their limit, and by which power of them a chain is too short.
    for values, best, limit, power, short, what in (
        (diagnosis.steps_per_tau, 0, STEPS_PER_TAU, -1, TOO_SHORT, "steps/tau"),
        (within, 1, apart, 1, "walkers stay apart", "R-hat over walkers"),
        (diagnosis.sd_error, 0, SD_KNOWN_TO, 2, "sd unknown", "relative error of sd"),
        (between, 1, GOOD_RHAT, 1, "ensembles disagree", "R-hat over ensembles"),
        (diagnosis.scatter, 0, 1, 1, "ensembles disagree", "chi-square by its limit"),
    ):
        excess = ((values - best) / (limit - best)) ** power
        worst = int(np.argmax(excess))
        longer = float(excess[worst])
        if longer > 1:  # never for NaN
            limit = np.broadcast_to(limit, values.shape)[worst]
            bound = f"at {'least' if power < 0 else 'most'} {limit:.4g}"
            sentence = f"{what} of {names[worst]} is {values[worst]:.4g} ({bound})"
            if best and longer > MOST_LONGER:
                cure = "take a TemperedMove" if maxima else diagnosis.cures.search
                sentence, longer = f"{sentence}, as between maxima; {cure}", 0.0
            yield short, sentence, longer
    if stuck and by_chance >= STUCK_BY_CHANCE:
        yield complaint
    if maxima is not None:
        yield from _weights(maxima, diagnosis.acceptance.shape[1])
        yield from _proposal(maxima, diagnosis.steps)


def _weights(maxima: MaximaWeights, walkers: int) -> Iterator[Complaint]:
    """Yield maxima that are lost, or whose weight is wrong or not known."""
    chain, exact, error = maxima.weights.mean(axis=0), maxima.importance, maxima.errors
    best, apart = np.fmin(error, maxima.importance_errors), np.abs(chain - exact)
    both = np.hypot(error, maxima.importance_errors)
    differ = apart > np.maximum(SMALL_WEIGHT, ERRORS_APART * both)  # never for NaN
    for i, lost in enumerate((chain == 0) & maxima.reached & ~(exact < SMALL_WEIGHT)):
        stated = f"{exact[i]:.3f} (+- {maxima.importance_errors[i]:.3f})"
        sentence = (
            f"maximum {i + 1}, where a search ended or a walker started, holds "
            f"{chain[i]:.3f} (+- {error[i]:.3f}) of the chain, by importance sampling "
            f"{'what is not known' if np.isnan(exact[i]) else stated}"
        )
        if lost:
            yield "a maximum is lost", f"{sentence}; run nwalkers={2 * walkers}", 0.0
        elif differ[i] or best[i] > WEIGHT_KNOWN_TO:
            longer = max(MUCH * differ[i], (best[i] / WEIGHT_KNOWN_TO) ** 2)
            yield f"weights {'disagree' if differ[i] else 'unknown'}", sentence, longer


def _proposal(maxima: MaximaWeights, steps: int) -> Iterator[Complaint]:
    """Yield what is wrong with the frozen proposal, if steps are made with it."""
    several, made = len(maxima.importance) > 1, maxima.share * steps
    k = float(np.fmax(maxima.pareto_k, maxima.chain_k))
    # Weights of maxima are compared with those of the search, unless k is large.
    if several and not are_reliable(k, maxima.efficiency):
        yield "proposal too narrow", f"Pareto k is {k:.2f} (at most {GOOD_K})", MUCH
    left = float(np.nanmin(maxima.acceptance)) * made
    if several and made and left < ENOUGH_VISITS:
        sentence = (
            f"in {steps} steps a walker leaves the worst maximum {left:.1f} times (at "
            f"least {ENOUGH_VISITS})"
        )
        longer = min(ENOUGH_VISITS / left, MOST_LONGER) if left else MOST_LONGER
        yield "proposal too narrow", sentence, longer
    error = float(maxima.mean_error.max())
    if error > MEAN_KNOWN_TO:  # never for NaN
        sentence = (
            f"waits of walkers make the error of a mean {error:.3f} sd (at most "
            f"{MEAN_KNOWN_TO})"
        )
        yield "proposal too narrow", sentence, (error / MEAN_KNOWN_TO) ** 2
