"""The evidence of a model class, from what its posterior's samplers stored."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..interfaces import Floats
from ..moves import IndependenceMove
from ..table import Parts, Report
from .chains import list_runs, stack_chains
from .evidence_bridge import bridge_evidence
from .evidence_ladder import check_betas, tempered_evidence
from .stored_runs import read_runs


@dataclass(frozen=True, eq=False)
class Evidence(Report):
    """What :func:`.log_evidence` found; ``print`` it.

    Attributes:
        log_evidence: Natural logarithm of the evidence.
        log_evidence_error: Its standard error; infinite where none can be claimed.
        method: Where it comes from, in words.
        problems: Why no standard error can be claimed; usually none.
        overlaps: Of neighbouring betas, 1 where their laws are the same,
            ``(n_betas - 1,)``; empty for other methods.
        better_betas: The powers to temper by next time, at equal distances by this
            run's log-likelihoods; empty for other methods.
        failed_solves: Number of solves that were rejected because they failed.
    """

    log_evidence: float
    log_evidence_error: float
    method: str
    problems: tuple[str, ...] = ()
    overlaps: Floats = field(default_factory=lambda: np.empty(0))
    better_betas: Floats = field(default_factory=lambda: np.empty(0))
    failed_solves: int = 0

    def _parts(self) -> Parts:
        error = (
            f"+- {self.log_evidence_error:.4f}"
            if np.isfinite(self.log_evidence_error)
            else "(no standard error can be claimed)"
        )
        lines = [
            f"log evidence (natural) {self.log_evidence:.4f} {error}, {self.method}",
            *(f"{problem[:1].upper()}{problem[1:]}." for problem in self.problems),
        ]
        if self.failed_solves:
            meaning = (
                "it holds for the prior where it can be solved; for all of it add "
                "ln(share of its draws that can)"
                if len(self.overlaps)
                else "the part of the prior that cannot be solved counts as impossible"
            )
            lines.append(f"{self.failed_solves} solves failed: {meaning}.")
        return lines


def log_evidence(samplers: Any, discard: int = 0) -> Evidence:
    r"""Estimate the log evidence of a model class by bridge sampling.

    .. math:: \ln Z = \sum_t \ln \frac{Z_t}{Z_{t+1}}, \qquad
        \frac{Z_t}{Z_{t+1}} = \frac{\langle f_t h_t \rangle_{t+1}}
        {\langle f_{t+1} h_t \rangle_t}, \qquad
        h_t = \frac{1}{f_t + (Z_t / Z_{t+1}) f_{t+1}}

    with :math:`f_t = p(\theta) L(\theta)^{\beta_t}`: between neighbouring betas of a
    tempered run, down to the prior. For samplers of "auto" one bridge is enough, from
    the proposal that was fitted and frozen, whose normalisation is known. The
    likelihood is normalised (the constant of :class:`FrequencyTerm` is included), so
    that differences between two model classes' results for the same data are log Bayes
    factors: see :func:`compare_models`.

    Where a term returns -inf, or ``on_failure="reject"`` took a failed solve for
    impossible, no walker goes at any beta: the evidence of a tempered run is that of
    the prior normalised over the rest. For the prior as given, multiply it by the prior
    probability of the rest. That of "auto" is for the prior as given.

    The standard errors come from one series per ensemble: the estimate, to first order,
    is a mean over generations of a sum over all walkers and betas, so that its
    autocorrelation time includes what exchanges carry between them. With several
    ensembles their spread is taken where chance does not explain that it is larger: it
    sees a mode that one missed.
    None is claimed where neighbouring betas hardly overlap (less than 0.1: temper by
    ``better_betas``), or where the series is shorter than 20 of its autocorrelation
    times, as it also is where it still drifts.

    Args:
        samplers: What :func:`run` returned for a ``TemperedMove`` with betas to 0 or
            for "auto", one of them, or their files as opened again; also what
            ``anneal`` returns, whose own estimate is handed on, and for "auto" the
            ArviZ object of the run, perhaps from a netCDF file.
        discard: Stored steps to drop as burn-in.

    Returns:
        The estimate, its standard error and what speaks against it; ``print`` it.

    Raises:
        TypeError: If discard is not a whole number.
        ValueError: If a sampler is neither tempered nor of "auto", or an ArviZ object
            not of "auto" (it has no hot walkers), betas differ or do
            not end at 0, fewer than 8 steps are left, or the log-likelihoods are not
            finite or constant.

    Source: Meng and Wong (1996), Statistica Sinica 6, 831-860; Bennett (1976),
    doi:10.1016/0021-9991(76)90078-4; Fruehwirth-Schnatter (2004),
    doi:10.1111/j.1368-423X.2004.00125.x (errors).

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
        >>> term = ef.FrequencyTerm([3.0], relative_sd=0.1)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> move = ef.TemperedMove(ef.DEMCMove(), betas=[1.0, 0.3, 0.0])
        >>> posterior = ef.LogPosterior(model, term, prior)
        >>> samplers = ef.run(posterior, move, nsteps=300, seed=1)
        >>> round(ef.log_evidence(samplers, discard=50).log_evidence, 1)
        -0.2
    """
    if hasattr(samplers, "log_evidence_error"):
        return Evidence(
            float(samplers.log_evidence),
            float(samplers.log_evidence_error),
            method="as it was given",
            problems=tuple(getattr(samplers, "problems", ())),
        )
    stored = hasattr(samplers, "children") or hasattr(samplers, "groups")
    runs = read_runs(samplers) if stored else list_runs(samplers)
    # The ensembles of one run share a log of failures.
    logs = {id(log): log for run in runs if (log := getattr(run, "failures", None))}
    failed = sum(log.causes.total() for log in logs.values())
    log_prob = _finite_log_prob(runs, discard)
    record = _record(runs[0])
    if record is not None:
        move = IndependenceMove(*record["proposal"])
        chain = stack_chains(runs, "chain", discard)
        log_q = move.log_density(chain.reshape(-1, chain.shape[3]))
        weights = [-np.inf if w is None else w for w in record["log_weights"]]
        value, error, problems = bridge_evidence(
            log_prob - log_q.reshape(log_prob.shape), np.array(weights)
        )
        found: dict[str, Any] = {"method": "by a bridge from the frozen proposal"}
    else:
        betas = check_betas(runs)
        log_prior = stack_chains(runs, "blobs", discard, hot=True)[..., 0]
        shape = (*log_prob.shape[:2], len(betas), -1)
        log_likelihood = (log_prob - log_prior).reshape(shape)
        value, error, problems, found = tempered_evidence(log_likelihood, betas)
        found["method"] = f"by bridges between {len(betas)} betas"
    if problems:
        error = np.inf
    return Evidence(value, error, problems=problems, failed_solves=failed, **found)


def _record(run: Any) -> dict[str, Any] | None:
    """Return what "auto" recorded of its proposal, None if it did not run."""
    manifest = getattr(getattr(run, "backend", run), "manifest", {})  # of a run's file
    stored = manifest.get("recipe", {}).get("record")
    record: dict[str, Any] | None
    record = getattr(getattr(run, "recipe", None), "record", stored)
    return record


def _finite_log_prob(runs: Sequence[Any], discard: int) -> Floats:
    """Return the log-posteriors ``(steps, ensembles, walkers)`` of all walkers."""
    log_prob = stack_chains(list(runs), "log_prob", discard, hot=True)
    if len(log_prob) < 8:
        raise ValueError(
            f"discard: expected at least 8 steps to judge, left {len(log_prob)}"
        )
    if not np.isfinite(log_prob).all():
        step, ensemble, walker = map(int, np.argwhere(~np.isfinite(log_prob))[0])
        raise ValueError(
            f"samplers: the log-posterior of walker {walker} of ensemble {ensemble} is "
            f"{log_prob[step, ensemble, walker]} at step {step} after discard; start "
            "where it is finite, or discard more"
        )
    return log_prob
