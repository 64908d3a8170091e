"""The evidence of a model class, from walkers tempered between prior and posterior."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np

from ..interfaces import Floats
from ..moves.acceptance import subtract_log_prior
from ..moves.tempering import find_ladder
from .chains import list_runs, stack_chains
from .diagnostics import autocorrelation_time


@dataclass(frozen=True, eq=False)
class Evidence:
    """What :func:`log_evidence` found; ``print`` it.

    Attributes:
        stepping_stones: Natural logarithm of the evidence, by stepping stones.
        stepping_stones_error: Its Monte Carlo standard error.
        thermodynamic: The same logarithm, by thermodynamic integration.
        thermodynamic_error: Its Monte Carlo standard error; what the trapezoids between
            few betas miss comes on top.
        betas: Powers of the likelihood, from 1 to 0, ``(n_betas,)``.
        mean_log_likelihood: Mean log-likelihood at each of them, ``(n_betas,)``.
        failed_solves: Number of solves that were rejected because they failed.
    """

    stepping_stones: float
    stepping_stones_error: float
    thermodynamic: float
    thermodynamic_error: float
    betas: Floats
    mean_log_likelihood: Floats
    failed_solves: int = 0

    def __str__(self) -> str:
        """Return both estimates, and a warning where they disagree."""
        lines = [
            f"log evidence (natural), {len(self.betas)} betas",
            f"stepping stones            {self.stepping_stones:.4f} "
            f"+- {self.stepping_stones_error:.4f}",
            f"thermodynamic integration  {self.thermodynamic:.4f} "
            f"+- {self.thermodynamic_error:.4f}",
        ]
        error = np.hypot(self.stepping_stones_error, self.thermodynamic_error)
        if abs(self.stepping_stones - self.thermodynamic) > 3 * error:
            lines.append("The two disagree: use more betas near 0, or run longer.")
        if self.failed_solves:
            lines.append(
                f"{self.failed_solves} solves failed: it holds for the prior where it "
                "can be solved; for all of it add ln(share of its draws that can)."
            )
        return "\n".join(lines)


def log_evidence(
    samplers: emcee.EnsembleSampler | Sequence[emcee.EnsembleSampler],
    discard: int = 0,
) -> Evidence:
    r"""Estimate the log evidence of a model class from tempered samplers, in two ways.

    .. math:: \ln Z &= \sum_t \ln \left\langle L^{\beta_t - \beta_{t+1}}
        \right\rangle_{t+1} \\
        \ln Z &= \int_0^1 \langle \ln L \rangle_\beta d\beta \approx \sum_t
        \tfrac{h_t}{2} (E_t + E_{t+1}) - \tfrac{h_t^2}{12} (V_t - V_{t+1})

    with :math:`h_t = \beta_t - \beta_{t+1}`, and E and V the mean and variance of ln L
    at a beta. The likelihood is normalised (the constant of
    :class:`FrequencyTerm` is included), so that differences between two model classes'
    results for the same data are log Bayes factors.

    Where a term returns -inf, or ``on_failure="reject"`` took a failed solve for
    impossible, no walker goes at any beta: the evidence is that of the prior normalised
    over the rest. For the prior as given, multiply it by the prior probability of the
    rest.

    The standard errors come from one series per ensemble: each estimate, to first
    order, is a mean over generations of a sum over all walkers and betas, so that its
    autocorrelation time includes what exchanges carry between them. With several
    ensembles their spread is taken where it is larger: it sees a mode that one missed.

    Args:
        samplers: What :func:`run` returned for a ``TemperedMove`` with betas to 0.
        discard: Stored steps to drop as burn-in.

    Raises:
        TypeError: If discard is not a whole number.
        ValueError: If a sampler is not tempered, betas differ or do not end at 0, fewer
            than 8 steps are left, or the log-likelihoods are not finite or constant.

    Source: Xie et al. (2011), doi:10.1093/sysbio/syq085 (stepping stones); Friel, Hurn
    and Wyse (2014), doi:10.1007/s11222-013-9397-1 (integration).
    """
    runs = list_runs(samplers)
    betas = _shared_betas(runs)
    log_likelihood = _stack_log_likelihoods(runs, len(betas), discard)
    gaps = betas[:-1] - betas[1:]

    powers = gaps[:, None] * log_likelihood[:, :, 1:]
    largest = powers.max(axis=(0, 1, 3))
    ratios = np.exp(powers - largest[:, None]).mean(axis=3)  # (steps, ensembles, gaps)
    means = ratios.mean(axis=(0, 1))

    average = log_likelihood.mean(axis=(0, 1, 3))
    squares = ((log_likelihood - average[:, None]) ** 2).mean(axis=3)
    trapezoids = _trapezoids(log_likelihood.mean(axis=3), squares, gaps)
    # The ensembles of one run share a log of failures.
    logs = {id(log): log for run in runs if (log := getattr(run, "failures", None))}
    return Evidence(
        stepping_stones=float((largest + np.log(means)).sum()),
        stepping_stones_error=_standard_error((ratios / means).sum(axis=2)),
        thermodynamic=float(trapezoids.mean()),
        thermodynamic_error=_standard_error(trapezoids),
        betas=betas,
        mean_log_likelihood=average,
        failed_solves=sum(log.causes.total() for log in logs.values()),
    )


def _stack_log_likelihoods(runs: list[Any], n_betas: int, discard: int) -> Floats:
    """Return them as ``(steps, ensembles, n_betas, block)``."""
    log_prob = stack_chains(runs, "log_prob", discard, hot=True)
    blobs = stack_chains(runs, "blobs", discard, hot=True)
    steps, ensembles, nwalkers = log_prob.shape
    if steps < 8:
        raise ValueError(f"discard: expected at least 8 steps to judge, left {steps}")
    if not np.isfinite(log_prob).all():
        step, ensemble, walker = map(int, np.argwhere(~np.isfinite(log_prob))[0])
        raise ValueError(
            f"samplers: the log-posterior of walker {walker} of ensemble {ensemble} is "
            f"{log_prob[step, ensemble, walker]} at step {step} after discard; start "
            "where it is finite, or discard more"
        )
    shape = (steps, ensembles, n_betas, nwalkers // n_betas)
    return subtract_log_prior(log_prob, blobs[..., 0]).reshape(shape)


def _shared_betas(runs: list[Any]) -> Floats:
    """Return the betas that all runs share, refusing those that do not end at 0."""
    found = [find_ladder(getattr(run, "_moves", ())) for run in runs]
    betas: list[Floats] = [move.betas for move in found if move is not None]
    if len(betas) < len(runs):
        raise ValueError(
            "samplers: expected samplers of a TemperedMove, got one that is not "
            "tempered, or a backend, which does not know its moves"
        )
    if not all(np.array_equal(own, betas[0]) for own in betas):
        got = [own.tolist() for own in betas]
        raise ValueError(f"samplers: expected the same betas in all, got {got}")
    if betas[0][-1] != 0:
        raise ValueError(
            "samplers: expected betas that end at 0, the prior, from which the "
            f"evidence starts, got {betas[0].tolist()}"
        )
    return betas[0].copy()


def _trapezoids(mean: Floats, variance: Floats, gaps: Floats) -> Floats:
    """Return the corrected trapezoid rule over the last axis, the betas."""
    areas = 0.5 * gaps * (mean[..., :-1] + mean[..., 1:])
    correction = gaps**2 / 12 * (variance[..., :-1] - variance[..., 1:])
    total: Floats = (areas - correction).sum(axis=-1)
    return total


def _standard_error(series: Floats) -> float:
    """Return the standard error of the mean of ``series (steps, ensembles)``."""
    steps, ensembles = series.shape
    variances = series.var(axis=0)
    if not (variances > 0).all():
        raise ValueError(
            "samplers: the log-likelihoods of an ensemble never changed; see diagnose"
        )
    tau = [autocorrelation_time(one[:, None, None])[0] for one in series.T]
    within = np.sqrt((variances * np.maximum(tau, 1)).sum() / steps) / ensembles
    if ensembles == 1:
        return float(within)
    between = series.mean(axis=0).std(ddof=1) / np.sqrt(ensembles)
    return float(max(within, between))
