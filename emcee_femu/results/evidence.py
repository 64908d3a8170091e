"""The evidence of a model class, from what its posterior's samplers stored."""

import json
from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from ..contracts import Floats
from ..search.importance import bridge
from ..search.record import Annealed, Chains, about_box
from ..table import Parts, Report
from ..verdict.diagnosis import NOT_CONVERGED, measure
from ..verdict.statistics import tau_by_ensemble
from ..verdict.verdict import judge_chains
from .arviz_objects import judgement_of
from .chains import read_chains

TAU_WINDOW = 5  # tau up to which emcee sums covariances
EVIDENCE_TAU = 20  # least length in tau at which tau and its error can be believed
ENOUGH_OVERLAP = 0.1
SCATTER_LEVEL = 0.01  # chance that right ensembles scatter more than is allowed


@dataclass(frozen=True, eq=False, repr=False)
class Evidence(Report):
    """The result of :func:`.log_evidence`; ``print`` it.

    Attributes:
        log_evidence: Natural logarithm of the evidence.
        log_evidence_error: Its standard error; infinite if there are problems.
        method: How it was computed, in words.
        problems: Why no standard error can be given; usually empty.
        overlaps: Overlap of the distributions at neighbouring betas, 1 if they are
            equal, ``(n_betas - 1,)``; empty for other methods.
        failed_solves: Number of solves that were rejected because they failed.
        log_box: Natural logarithm of the volume of the box between whose bounds a
            bare log-likelihood was sampled (:meth:`LogPosterior.from_function`); NaN
            for other priors.
    """

    log_evidence: float
    log_evidence_error: float
    method: str
    problems: tuple[str, ...] = ()
    overlaps: Floats = field(default_factory=lambda: np.empty(0))
    failed_solves: int = 0
    log_box: float = np.nan

    def _parts(self) -> Parts:
        error = f"+- {self.log_evidence_error:.4f}"
        if not np.isfinite(self.log_evidence_error):
            error = "(no standard error can be given)"
        yield f"log evidence (natural) {self.log_evidence:.4f} {error}, {self.method}"
        for problem in self.problems:
            yield f"{problem[:1].upper()}{problem[1:]}."
        yield from about_box(self.log_box)
        if self.failed_solves:
            meaning = (
                "it is for the solvable part of the prior; for the whole prior add "
                "ln(share of its draws that can be solved)"
                if len(self.overlaps)
                else "the part of the prior that cannot be solved counts as impossible"
            )
            yield f"{self.failed_solves} solves failed: {meaning}."


def log_evidence(source: object, discard: int | None = None) -> Evidence:
    r"""Estimate the log evidence of a model class by bridge sampling.

    .. math:: \ln Z = \sum_t \ln \frac{Z_t}{Z_{t+1}}, \qquad
        \frac{Z_t}{Z_{t+1}} = \frac{\langle f_t h_t \rangle_{t+1}}
        {\langle f_{t+1} h_t \rangle_t}, \qquad
        h_t = \frac{1}{f_t + (Z_t / Z_{t+1}) f_{t+1}}

    where :math:`f_t = p(\theta) L(\theta)^{\beta_t}`, between neighbouring betas of a
    tempered run, down to the prior. For a run of "auto" one bridge is enough, from the
    fitted proposal, whose normalisation is known. Use the result to compare model
    classes for the same data with :func:`compare_models`: likelihoods are normalised
    (with the constant of :class:`FrequencyTerm`), so differences are log Bayes factors.
    It takes no solves.

    If a term returns -inf, or ``on_failure="reject"`` gave failed solves zero
    likelihood, no walker can go there at any temperature. The evidence of a tempered
    run is then that of the prior normalised over the remaining region; multiply it by
    the prior probability of this region to obtain the evidence for the full prior.
    "auto" gives the latter directly.

    If a bare log-probability already includes its prior and was given with bounds only
    (:meth:`LogPosterior.from_function`), the evidence is that of the uniform prior in
    the box; ``print`` says what to add.

    The standard errors come from one series per ensemble: the estimate, to first order,
    is a mean over generations of a sum over all walkers and betas, so that its
    autocorrelation time includes what exchanges carry between them. With several
    ensembles their spread is taken where chance does not explain that it is larger: it
    sees a maximum that one missed.
    None is claimed where neighbouring betas hardly overlap (less than 0.1), where the
    series is shorter than 20 of its autocorrelation times, as it also is where it still
    drifts, or where :func:`diagnose` calls the chains not converged.

    Args:
        source: The result of :func:`run` with a ``TemperedMove`` whose betas end at 0,
            or with "auto"; one of its samplers; the name of its file; or the ArviZ
            object of an "auto" run, even from a netCDF file. For the result of
            :func:`anneal`, its own estimate is returned; for that of :func:`certify`
            the evidence of the true posterior, if "auto" sampled the emulated one.
        discard: Number of stored steps to drop as burn-in. None for those of the run.

    Returns:
        The estimate, its standard error and any problems; ``print`` it.

    Raises:
        TypeError: If discard is not a whole number.
        ValueError: If the run is neither tempered nor of "auto", an ArviZ object is not
            of "auto" (it has no hot walkers), betas differ or do not end at 0, fewer
            than 8 steps are left, or the log-likelihoods are not finite or constant.

    Source: Meng and Wong (1996), Statistica Sinica 6, 831-860; Bennett (1976),
    doi:10.1016/0021-9991(76)90078-4; Fruehwirth-Schnatter (2004),
    doi:10.1111/j.1368-423X.2004.00125.x (errors).

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
        >>> term = ef.FrequencyTerm([3.0], relative_sd=0.1)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> move = ef.moves.TemperedMove(ef.DEMCMove(), betas=[1.0, 0.3, 0.0])
        >>> posterior = ef.LogPosterior(model, term, prior)
        >>> run = ef.run(posterior, move, steps=300, seed=1, ensembles=1)
        >>> round(ef.log_evidence(run, discard=50).log_evidence, 1)
        -0.2
    """
    if isinstance(source, Evidence):
        return source
    if isinstance(source, Annealed):
        error, problems = source.log_evidence_error, source.problems
        found = source.log_evidence, error, "as it was given", problems, np.empty(0)
        return Evidence(*found, source.failed_solves, source.log_box)
    if (stored := judgement_of(source).get("evidence")) is not None:
        value, error, method, problems, failed, log_box = json.loads(stored)
        told = {"failed_solves": failed, "log_box": log_box}
        return Evidence(value, error, method, tuple(problems), **told)
    chains = read_chains(source, discard=discard, blobs=True, hot=True)
    if chains.kind != "chain" or (chains.search is None and len(chains.betas) < 2):
        raise ValueError(
            "source: expected a run of 'auto' or of a TemperedMove, or what anneal "
            f"returned, got a {chains.kind} of {chains.moves}"
        )
    log_prob = chains.log_prob
    if not np.isfinite(log_prob).all():
        raise ValueError(
            "source: a log-posterior is not finite; start elsewhere, or discard more"
        )
    cold = read_chains(source, discard=discard)
    about = judge_chains(measure(cold), cold.starts_given)
    failed = sum(chains.failures.values())
    overlaps, method = np.empty(0), "by a bridge from the frozen proposal"
    if chains.search is not None:
        flat = chains.draws.reshape(-1, chains.draws.shape[-1])
        log_q = chains.search.mixture.log_density(flat).reshape(log_prob.shape)
        value, error, problems = _bridge(log_prob - log_q, chains.search.log_weights)
    else:
        value, error, problems, overlaps = _climb_ladder(chains)
        method = f"by bridges between {len(chains.betas)} betas"
    if about.status == NOT_CONVERGED:
        problems = (*problems, f"the chains are {about.sentence.rstrip('.')}")
    error = np.inf if problems else error
    return Evidence(value, error, method, problems, overlaps, failed, chains.log_box)


def _bridge(
    at_posterior: Floats, at_proposal: Floats
) -> tuple[float, float, tuple[str, ...]]:
    """Return the log evidence from chains and independent draws of a proposal q.

    Args:
        at_posterior: ln of the unnormalised posterior over q, at the chains'
            draws, ``(steps, ensembles, walkers)``.
        at_proposal: The same at independent draws of q, ``(n,)``; -inf where the
            posterior is zero.

    Returns:
        The log evidence, its standard error, and what forbids to claim one.

    Source: Meng and Wong (1996) for the bridge; Fruehwirth-Schnatter (2004),
    doi:10.1111/j.1368-423X.2004.00125.x, for the error from a correlated chain.
    """
    n = at_proposal.size
    share = at_posterior.size / (at_posterior.size + n)
    for _ in range(3):  # with shares by the effective size of the chain
        ratio = bridge(at_posterior, at_proposal, share)
        chain_error, problems = standard_error(ratio.from_f.mean(axis=2))
        scatter = ratio.from_f.var()
        size = max(scatter / chain_error**2, 1.0) if chain_error > 0 else 1.0
        share = size / (size + n)
    error = np.hypot(chain_error, ratio.from_g.std() / np.sqrt(n))
    if ratio.overlap < ENOUGH_OVERLAP:
        thin = f"the proposal and the chain hardly overlap ({ratio.overlap:.3f} of 1)"
        problems = (*problems, thin)
    return ratio.log_ratio, float(error), problems


def _climb_ladder(chains: Chains) -> tuple[float, float, tuple[str, ...], Floats]:
    """Return the log evidence along betas, its error, its problems, and overlaps."""
    betas, blobs = chains.betas, chains.blobs
    if betas[-1] != 0 or blobs is None:
        raise ValueError(
            "source: expected betas that end at 0, the prior, from which the "
            f"evidence starts, got {betas.tolist()}"
        )
    log_likelihood = chains.log_prob - blobs[..., 0]
    steps, ensembles, _ = log_likelihood.shape
    by_beta = log_likelihood.reshape(steps, ensembles, len(betas), -1)
    by_rung = np.moveaxis(by_beta, 2, 0)
    if not (by_rung.var(axis=(1, 3)) > 0).all():
        raise ValueError(
            "source: the log-likelihoods of an ensemble never changed; see diagnose"
        )
    total, series, overlaps = 0.0, np.zeros((steps, ensembles)), []
    for rung, gap in enumerate(betas[:-1] - betas[1:]):
        ratio = bridge(gap * by_rung[rung], gap * by_rung[rung + 1])
        total += ratio.log_ratio
        # One series, for exchanges carry errors from rung to rung.
        series += (ratio.from_f + ratio.from_g).mean(axis=2)
        overlaps.append(ratio.overlap)
    error, problems = standard_error(series)
    worst = int(np.argmin(overlaps))
    if overlaps[worst] < ENOUGH_OVERLAP:
        gap = (
            f"betas {betas[worst]:.3g} and {betas[worst + 1]:.3g} hardly overlap "
            f"({overlaps[worst]:.3f} of 1): run again with one between them"
        )
        problems = (*problems, gap)
    return total, error, problems, np.array(overlaps)


def standard_error(series: Floats) -> tuple[float, tuple[str, ...]]:
    """Return the standard error of the mean of ``series (steps, ensembles)``.

    If there are several ensembles, their spread is used if it is significantly larger:
    it reveals a maximum that one missed. Without the test, the larger of the two
    errors would be 1.2 times too large for two ensembles.

    Returns:
        The error, and the reasons not to trust it.
    """
    steps, ensembles = series.shape
    variances = series.var(axis=0)
    moved = (variances > 0)[:, None]
    tau = np.fmax(tau_by_ensemble(series[..., None, None], moved)[:, 0], 1.0)
    # Each covariance that tau sums lacks the scatter of the mean itself: Wolff (2004),
    # doi:10.1016/S0010-4655(03)00467-3, equation 49, with the window of emcee's tau.
    unseen = 1 + (2 * TAU_WINDOW * tau + 1) / steps
    error = np.sqrt((variances * tau * unseen).sum() / steps) / ensembles
    if ensembles > 1:
        between = series.mean(axis=0).std(ddof=1) / np.sqrt(ensembles)
        most = stats.chi2.isf(SCATTER_LEVEL, ensembles - 1) / (ensembles - 1)
        if between**2 > most * error**2:
            error = between
    per_tau = steps / tau.mean()  # a drift makes it small, too
    if per_tau >= EVIDENCE_TAU:
        return float(error), ()
    return float(error), (
        f"the chain is only {per_tau:.0f} autocorrelation times of the evidence long "
        f"({EVIDENCE_TAU} are needed)",
    )
