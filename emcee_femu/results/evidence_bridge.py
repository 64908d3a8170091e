"""The evidence from a chain and a normalised law, and the error of a series."""

import numpy as np
from scipy import stats

from ..interfaces import Floats
from ..sampling.bridging import bridge
from .diagnostics import autocorrelation_time

ENOUGH_TAU = 20  # of a series, below which neither tau nor its error can be believed
ENOUGH_OVERLAP = 0.1
LEVEL = 0.01  # of ensembles that scatter more than their series allow


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

    With several ensembles their spread is taken where it is larger than chance makes
    it: it sees a mode that one missed. The larger of the two, without a test, is 1.2
    times too large with two ensembles.

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
        most = stats.chi2.isf(LEVEL, ensembles - 1) / (ensembles - 1)
        if between**2 > most * error**2:
            error = between
    per_tau = steps / tau.mean()  # a drift makes it small, too
    if per_tau >= ENOUGH_TAU:
        return float(error), ()
    return float(error), (
        f"the chain is only {per_tau:.0f} autocorrelation times of the evidence long "
        f"({ENOUGH_TAU} are needed)",
    )
