"""Whether independent ensembles scatter as much as their own errors claim."""

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ..interfaces import Floats

FEWEST_ENSEMBLES = 3  # of which the scatter is known
LEVEL = 1e-4  # of a false alarm, over all parameters
TAU_KNOWN_TO = 1.5  # ratio by which a variance claimed from tau may be too small


def autocorrelation_time(chain: Floats) -> Floats:
    """Return emcee's tau of ``chain (steps, walkers, d)``, ``(d,)``, however short."""
    # tol=0 because diagnose reports steps / tau itself.
    tau: Floats = emcee.autocorr.integrated_time(chain, tol=0)
    return tau


def tau_by_ensemble(values: Floats, moved: NDArray[np.bool_]) -> Floats:
    """Return tau by ensemble, ``(ensembles, d)``, of those walkers that moved."""
    taus = np.full((values.shape[1], values.shape[3]), np.nan)
    for ensemble in np.flatnonzero(moved.any(axis=1)):
        taus[ensemble] = autocorrelation_time(values[:, ensemble, moved[ensemble]])
    return taus


def excess_scatter(values: Floats, tau: Floats) -> Floats:
    r"""Return by how much ensemble means scatter more than they may, ``(d,)``.

    .. math:: \chi^2 = \sum_e \frac{(\bar x_e - \bar x)^2}{v_e},
        \qquad v_e = \frac{s^2 \tau_e}{\mathrm{steps} \cdot \mathrm{walkers}}

    over its quantile for ``ensembles - 1`` degrees of freedom: above 1 the errors that
    tau claims are too small, or an ensemble is somewhere else.

    Args:
        values: Draws, or functions of them, ``(steps, ensembles, walkers, d)``.
        tau: Their autocorrelation times in steps, ``(ensembles, d)``; an ensemble
            whose values never change, NaN, gets the longest of the others.

    Returns:
        The ratios; NaN for fewer than three ensembles, which do not tell.
    """
    steps, n_ensembles, n_walkers, d = values.shape
    if n_ensembles < FEWEST_ENSEMBLES:
        return np.full(d, np.nan)
    tau = np.where(np.isfinite(tau), tau, np.fmax.reduce(tau))  # NaN if all are
    variance = values.var(axis=(0, 1, 2)) * tau / (steps * n_walkers)
    means = values.mean(axis=(0, 2))
    with np.errstate(divide="ignore", invalid="ignore"):  # of what never changes
        centre = (means / variance).sum(axis=0) / (1 / variance).sum(axis=0)
        found = ((means - centre) ** 2 / variance).sum(axis=0)
    most = stats.chi2.isf(LEVEL / d, n_ensembles - 1)
    ratio: Floats = found / (TAU_KNOWN_TO * most)
    return ratio
