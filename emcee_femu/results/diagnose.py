"""Judge a run: autocorrelation time, ESS, R-hat, acceptance, and three statements."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from ..contracts import Floats
from ..sampling.record import Chains
from ..table import Parts, Report, Table
from .arviz_objects import effective_sizes, mean_sizes, rhat
from .chains import check_length, excess_scatter, read_chains, tau_by_ensemble
from .fit import judge_fit
from .modes import ModeWeights, weigh_modes
from .verdict import CONVERGED, NO_CHAINS, Statement, judge_chains, judge_search
from .verdict import judge_without_chains as judge_others

UNKNOWN = Statement("not judged", "not judged", "not judged.")
TAILS = (0.05, 0.95)


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Report):
    """What :func:`.diagnose` found; ``print`` it for a table and three statements.

    Attributes:
        names: Parameter names, ``d`` of them.
        steps: Stored steps per ensemble, after burn-in.
        tau: Integrated autocorrelation time in stored steps, ``(ensembles, d)``; NaN
            where no walker moved.
        steps_per_tau: ``steps / tau`` of the worst ensemble, ``(d,)``; from 50 on, tau
            and ESS can be believed.
        ess_bulk: Effective sample size for the centre, all ensembles, ``(d,)``.
        ess_tail: Effective sample size for the 5 % and 95 % quantiles, ``(d,)``.
        acceptance: Fraction of accepted proposals, ``(ensembles, walkers)``; NaN where
            it is not known.
        stuck: ``(ensemble, walker)`` of each walker with a parameter that never
            changed.
        rhat_within: R-hat over the walkers of one ensemble, the worst, ``(d,)``: a
            mixing indicator, not convergence, since walkers depend on one another;
            NaN for a single walker.
        rhat_between: R-hat with each independent ensemble as one chain, ``(d,)``: the
            test for a missed mode; NaN for a single ensemble.
        sd_error: Relative standard error of the standard deviation, by the ESS of
            squared deviations, ``(d,)``.
        scatter: By how much the ensembles' means and variances scatter more than tau
            allows (above 1), the worse of both, ``(d,)``; NaN for less than three.
        failures: Number of rejected solves by cause (``run(on_failure="reject")``).
        modes: Separated modes of the posterior and the frozen proposal, if "auto"
            ran; printed where there are several.
        chains: Whether they converged: "converged", "well mixed" (of one ensemble, or
            from given starts) or "not converged", and how many steps it takes; "none"
            of a population or of weighted draws, whose numbers are NaN.
        search: "searched" or "not searched", what was there, and how small a mode may
            be missing.
        fit: Whether what was measured lies inside the posterior predictive: "fits",
            "doubtful" (it does, but parameters are far from their prior, or the model
            or the prior was warned of), "at a bound", "does not fit" or "not checked".
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
    modes: ModeWeights | None = None
    chains: Statement = UNKNOWN
    search: Statement = UNKNOWN
    fit: Statement = UNKNOWN

    @property
    def converged(self) -> bool:
        """Whether several ensembles of independent starts agree, each well mixed."""
        return self.chains.status == CONVERGED

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
        return between.join(f"{k}: {getattr(s, attribute)}" for k, s in three.items())

    @property
    def table(self) -> Table:
        """One row per parameter; tau is that of the worst ensemble."""
        n_ensembles, n_walkers = self.acceptance.shape
        return Table.from_columns(
            f"Diagnosis: {n_ensembles} x {n_walkers} walkers, {self.steps} steps",
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

    def _parts(self) -> Parts:
        if self.chains.status != NO_CHAINS:
            yield self.table
        if self.modes is not None and len(self.modes.importance) > 1:
            yield self.modes.table
        if np.isfinite(self.acceptance).all():
            yield (
                f"Acceptance {self.acceptance.mean():.2f} (walkers "
                f"{self.acceptance.min():.2f} to {self.acceptance.max():.2f}), "
                f"{len(self.stuck)} stuck walkers."
            )
        if self.failures:
            yield f"Failed solves, counted as zero probability: {dict(self.failures)}."
        yield self.verdict


def diagnose(source: object, discard: int = 0) -> Diagnosis:
    """Say whether chains converged, what a search found, and whether the model fits.

    Three statements, each with its own status: converged chains may have missed a mode,
    and may be those of a model that fits nothing.

    tau is emcee's, for each ensemble by itself. R-hat is rank-normalised and split.
    One ensemble cannot show that it missed a mode: run several from
    over-dispersed starts. For tempered runs only the cold walkers are judged, and tau
    and ESS are those of the mean over these walkers: an exchange hands a state to
    another walker, so that a walker forgets sooner than its ensemble. Populations and
    the weighted draws of a certificate are no chains, which the first statement says,
    and by what they are judged instead.

    Args:
        source: What :func:`run` returned, EnsembleSamplers of one target, or the name
            of a run's file; what :func:`anneal` or :func:`certify` returned; or an
            ArviZ object of them, with steps counted after its own ``discard`` and
            ``thin``.
        discard: Stored steps to drop as burn-in.

    Returns:
        Numbers and three statements; ``print`` it.

    Raises:
        TypeError: If source is something else, or discard not a whole number.
        ValueError: If fewer than 8 steps are left.

    Source: Goodman and Weare (2010), doi:10.2140/camcos.2010.5.65 (tau); Vehtari et
    al. (2021), doi:10.1214/20-BA1221 (R-hat, ESS).

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 50, ensembles=1, seed=1)
        >>> diagnosis = ef.diagnose(run)
        >>> diagnosis.chains.status, diagnosis.search.status, diagnosis.fit.status
        ('not converged', 'not searched', 'fits')
    """
    source = getattr(source, "idata", source)  # of a certificate
    chains = read_chains(source, discard=discard)
    if chains.kind == "chain":
        diagnosis = measure(chains)
        about = judge_chains(diagnosis, chains.starts_given, discard)
        search = judge_search(diagnosis.modes)
    else:
        about, search = judge_others(source, chains)
        nan: Any = np.full((1, len(chains.names)), np.nan)
        # From tau to scatter, in the order of the attributes.
        numbers = nan, *3 * [nan[0]], nan[:, :1], (), *4 * [nan[0]]
        measured = chains.names, len(chains.draws), *numbers, chains.failures
        diagnosis = Diagnosis(*measured)
    fit = judge_fit(source, chains, discard)
    return replace(diagnosis, chains=about, search=search, fit=fit)


def measure(chains: Chains) -> Diagnosis:
    """Return the numbers of chains, not judged."""
    draws = chains.draws
    steps, n_ensembles, n_walkers, ndim = draws.shape
    check_length(draws)
    moved = (draws != draws[0]).any(axis=0).all(axis=2)  # (ensembles, walkers)
    by_ensemble = draws.transpose(1, 2, 0, 3)  # (ensembles, walkers, steps, d)
    squares = (draws - draws.mean(axis=(0, 1, 2))) ** 2
    scatter = within = between = np.full(ndim, np.nan)
    if len(chains.betas) > 1:
        tau = tau_by_ensemble(
            draws.mean(axis=2, keepdims=True), moved.any(axis=1, keepdims=True)
        )
        bulk, tail = _sizes_by_means(draws)
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
    with np.errstate(divide="ignore", invalid="ignore"):
        steps_per_tau = steps / tau.max(axis=0)
        of_variance = np.sqrt(squares.var(axis=(0, 1, 2)) / of_squares)
        sd_error = 0.5 * of_variance / squares.mean(axis=(0, 1, 2))
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
        modes=weigh_modes(chains),
        failures=chains.failures,
    )


def _as_chains(values: Floats) -> Floats:
    """Return values with every walker as a chain, ``(chains, steps, d)``."""
    return values.transpose(1, 2, 0, 3).reshape(-1, len(values), values.shape[3])


def _sizes_by_means(draws: Floats) -> tuple[Floats, Floats]:
    """Return bulk and tail ESS by how much the means over the walkers scatter."""
    scores = stats.rankdata(draws.reshape(-1, draws.shape[-1]), axis=0)
    scores = stats.norm.ppf((scores - 0.375) / (len(scores) + 0.25))
    # Ranks make little of the gap between modes, over which the draws mix slowest.
    bulk = [size_by_means(values) for values in (draws, scores.reshape(draws.shape))]
    ends = np.quantile(draws, TAILS, axis=(0, 1, 2))
    tails = [size_by_means(1.0 * (draws <= end)) for end in ends]
    return np.min(bulk, axis=0), np.min(tails, axis=0)


def size_by_means(values: Floats) -> Floats:
    """Return the ESS of the mean of ``values (steps, ensembles, walkers, d)``.

    By the means over walkers that exchange places: var / var(mean).
    """
    series = values.mean(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = values.var(axis=(0, 1, 2)) / series.var(axis=(0, 1))
    return np.asarray(gain * mean_sizes(series.swapaxes(0, 1)))
