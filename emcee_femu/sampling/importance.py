"""What importance weights say of the proposal that they correct."""

import importlib
import warnings

import numpy as np

from ..interfaces import Floats

GOOD_K = 0.7  # below it the error of an importance estimate can be believed
FAIR_SHARE = 0.5  # effective share above which a heavy tail of weights matters little


def pareto_k(log_weights: Floats) -> float:
    """Return the shape k of the generalised Pareto law of the largest weights.

    Weights with k above .7 have so heavy a tail that means over them, and chains of
    independence proposals, may miss what the proposal does not cover.

    Args:
        log_weights: ln(p / q) at draws of q, ``(n,)``; -inf where p is zero.

    Returns:
        k; infinite if too few weights are above zero.

    Source: Vehtari, Simpson, Gelman, Yao and Gabry (2024), "Pareto smoothed importance
    sampling", JMLR 25(72).

    Example:
        >>> rng = np.random.default_rng(1)
        >>> pareto_k(-0.1 * rng.normal(size=2_000) ** 2) < GOOD_K
        True
    """
    # Weights of zero are no part of the tail; ArviZ would make NaN of -inf.
    finite = log_weights[np.isfinite(log_weights)]
    if len(finite) < 25:
        return np.inf
    floor = finite.min() - 1.0
    filled = np.where(np.isfinite(log_weights), log_weights, floor)
    largest = np.sort(filled)[-round(min(len(filled) / 5, 3 * len(filled) ** 0.5)) :]
    if np.ptp(largest) < 1e-9:  # equal: no tail, to which no law can be fitted
        return -np.inf
    with warnings.catch_warnings():  # ArviZ 0.23 announces version 1, and warns of k
        warnings.simplefilter("ignore")
        try:
            stats = importlib.import_module("arviz_stats.base").array_stats
        except ImportError:
            import arviz

            k = arviz.psislw(filled)[1]
        else:
            k = stats.psislw(-filled)[1]  # since version 1 it takes log-likelihoods
    return float(k)


def kish_share(log_weights: Floats) -> float:
    """Return the effective share of draws, (sum w)^2 / (n sum w^2).

    Source: Kish (1965), Survey Sampling.
    """
    top = log_weights.max(initial=-np.inf)
    if not np.isfinite(top):
        return 0.0
    weights = np.exp(log_weights - top)
    return float(weights.sum() ** 2 / (len(weights) * (weights**2).sum()))
