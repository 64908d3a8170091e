"""Bridge sampling: the ratio of two normalising constants, from draws of both laws."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit

from ..interfaces import Floats
from .diagnostics import autocorrelation_time

ENOUGH_TAU = 20  # of a series, below which neither tau nor its error can be believed
ENOUGH_OVERLAP = 0.1
HALVES_APART = 4.0  # standard errors of their difference


class Bridge(NamedTuple):
    """What one bridge found.

    Attributes:
        log_ratio: ln of the ratio of the normalising constants of f and g.
        from_f: First-order error of log_ratio that each draw of f adds, so that the
            mean of all is zero.
        from_g: The same of the draws of g.
        overlap: Of f and g, 1 where they are the same law, 0 where no draw of one has
            a chance under the other.
    """

    log_ratio: float
    from_f: Floats
    from_g: Floats
    overlap: float


def bridge(at_f: Floats, at_g: Floats, share: float = 0.5) -> Bridge:
    r"""Return the ratio of the normalising constants of f and g.

    .. math:: (1 - s) \langle p \rangle_g = s \langle 1 - p \rangle_f, \qquad
        p = \frac{s f}{s f + (1 - s) r g}, \qquad r = Z_f / Z_g

    Args:
        at_f: ln(f / g) of the unnormalised densities at draws of f, any shape.
        at_g: The same at draws of g; -inf where f is zero.
        share: s, the share of f in the effective number of draws.

    Source: Meng and Wong (1996), Statistica Sinica 6, 831-860; between two powers of
    one likelihood it is the acceptance ratio of Bennett (1976),
    doi:10.1016/0021-9991(76)90078-4.
    """
    odds = np.log(share / (1 - share))
    inside = at_g > -np.inf
    if not inside.any():
        return Bridge(np.nan, np.zeros_like(at_f), np.zeros_like(at_g), 0.0)

    def unbalance(log_ratio: float) -> float:
        p_g, p_f = (expit(x - log_ratio + odds) for x in (at_g, at_f))
        return float((1 - share) * p_g.mean() - share * (1 - p_f).mean())

    low = min(at_f.min(), at_g[inside].min()) + np.log(inside.mean()) - 1.0
    high = max(at_f.max(), at_g.max()) + 1.0
    log_ratio = brentq(unbalance, low, high, xtol=1e-9 * max(1.0, high - low))
    p_g, p_f = (expit(x - log_ratio + odds) for x in (at_g, at_f))
    # Each side of the equation, and its derivative by log_ratio: as f (1 - p) s is
    # g p (1 - s), the mean of p (1 - p) is that of p over g.
    slope = (1 - share) * p_g.mean()
    if not slope > 0:
        return Bridge(log_ratio, np.zeros_like(at_f), np.zeros_like(at_g), 0.0)
    return Bridge(
        log_ratio=log_ratio,
        from_f=share * (p_f - p_f.mean()) / slope,
        from_g=(1 - share) * (p_g - p_g.mean()) / slope,
        overlap=float(slope / (share * (1 - share))),
    )


def bridge_evidence(
    at_posterior: Floats, at_proposal: Floats
) -> tuple[float, float, tuple[str, ...]]:
    """Return the log evidence from chains and independent draws of a normalised law q.

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
        found = bridge(at_posterior, at_proposal, share)
        series = found.from_f.mean(axis=2)
        chain_error, problems = standard_error(series)
        scatter = found.from_f.var()
        size = max(scatter / chain_error**2, 1.0) if chain_error > 0 else 1.0
        share = size / (size + n)
    error = np.hypot(chain_error, found.from_g.std() / np.sqrt(n))
    if found.overlap < ENOUGH_OVERLAP:
        problems = (
            *problems,
            f"the proposal and the chain hardly overlap ({found.overlap:.3f} of 1)",
        )
    return found.log_ratio, float(error), problems


def standard_error(series: Floats) -> tuple[float, tuple[str, ...]]:
    """Return the standard error of the mean of ``series (steps, ensembles)``.

    With several ensembles their spread is taken where it is larger: it sees a mode
    that one missed.

    Returns:
        The error, and what forbids to believe it.
    """
    steps, ensembles = series.shape
    variances = series.var(axis=0)
    tau = np.ones(ensembles)
    for i in np.flatnonzero(variances > 0):
        tau[i] = max(autocorrelation_time(series[:, i, None, None])[0], 1.0)
    error = np.sqrt((variances * tau).sum() / steps) / ensembles
    if ensembles > 1:
        between = series.mean(axis=0).std(ddof=1) / np.sqrt(ensembles)
        error = max(error, between)
    problems = []
    if steps < ENOUGH_TAU * tau.mean():
        problems.append(
            f"the chain is only {steps / tau.mean():.0f} autocorrelation times of the "
            f"evidence long ({ENOUGH_TAU} are needed)"
        )
    early, late = (half.mean() for half in np.array_split(series, 2))
    if abs(early - late) > HALVES_APART * 2 * error:
        problems.append("its two halves disagree: discard more")
    return float(error), tuple(problems)
