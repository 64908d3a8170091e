"""A diagnosis: the numbers of chains, and the three statements made of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..contracts import Floats
from ..likelihoods.residuals import FitRecord
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

CONVERGED, MIXED, NOT_CONVERGED = "converged", "well mixed", "not converged"
NO_CHAINS = "none"  # for a population, or weighted draws
REFUSED = "refused"  # an emulated posterior that full solves contradict
SEARCHED, NOT_SEARCHED = "searched", "not searched"


@dataclass(frozen=True)
class Statement:
    """One of the three statements of a diagnosis.

    Attributes:
        status: A word or two that never vary, such as "converged".
        short: The status in a few words, with its reason.
        sentence: The same at length, and what to do.
        reasons: All that speaks against the chains, in a word or two each.
    """

    status: str
    short: str
    sentence: str
    reasons: tuple[str, ...] = ()


class Cures(NamedTuple):
    """Remedies for chains, in terms of the function that made them."""

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
    "run {:,} steps in all",
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
        drift: How many of the first ``steps`` still drift; the other numbers include
            them. 0 if no drift is seen, all steps if the later ones drift as well.
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
            run; "refused" of an emulated posterior that its certificate refuses. For a
            population or weighted draws it is "none", and the numbers above are NaN.
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
        """The statements in one line."""
        return ". ".join(f"{k}: {s.short}" for k, s in self._statements.items()) + "."

    @property
    def verdict(self) -> str:
        """The statements, one below the other."""
        return "\n".join(f"{k}: {s.sentence}" for k, s in self._statements.items())

    @property
    def _statements(self) -> Mapping[str, Statement]:
        three = {"Chains": self.chains, "Search": self.search, "Fit": self.fit}
        if taken := sorted(three.keys() & self.further):
            raise ValueError(f"FURTHER: these titles are taken: {taken}; choose others")
        return three | dict(self.further)

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
    """Return the numbers of chains, without a judgement.

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
        if np.shape(seen) == kurtosis.shape:  # for a tail that chains may have missed
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
