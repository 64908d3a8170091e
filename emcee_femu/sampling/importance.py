"""What importance weights say of the proposal that they correct."""

import importlib
import warnings

import numpy as np

from ..interfaces import Floats

GOOD_K = 0.7  # below it the error of an importance estimate can be believed
FEWEST_WEIGHTS = 25  # from which k can be said
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

    Examples:
        >>> rng = np.random.default_rng(1)
        >>> pareto_k(-0.1 * rng.normal(size=2_000) ** 2) < GOOD_K
        True
    """
    return smooth_tail(log_weights)[1]


def smooth_tail(log_weights: Floats) -> tuple[Floats, float]:
    """Return log-weights whose largest are smoothed by a Pareto law, and its shape k.

    The largest weights are replaced by the expected order statistics of the law that
    fits them, which lowers the variance of means over them at a small bias.

    Args:
        log_weights: ln(p / q) at draws of q, ``(n,)``; -inf where p is zero.

    Returns:
        Smoothed log-weights up to a constant, and k; the weights as they are, and an
        infinite k, if fewer than 25 are above zero.
    """
    # Weights of zero are no part of the tail; ArviZ would make NaN of -inf.
    above_zero = np.isfinite(log_weights)
    finite = log_weights[above_zero]
    if len(finite) < FEWEST_WEIGHTS:
        return log_weights, np.inf
    floor = finite.min() - 1.0
    filled = np.where(above_zero, log_weights, floor)
    largest = np.sort(filled)[-round(min(len(filled) / 5, 3 * len(filled) ** 0.5)) :]
    if np.ptp(largest) < 1e-9:  # equal: no tail, to which no law can be fitted
        return log_weights, -np.inf
    with warnings.catch_warnings():  # ArviZ 0.23 announces version 1, and warns of k
        warnings.simplefilter("ignore")
        try:
            stats = importlib.import_module("arviz_stats.base").array_stats
        except ImportError:
            import arviz

            smoothed, k = arviz.psislw(filled)
        else:
            # Since version 1 it takes log-likelihoods.
            smoothed, k = stats.psislw(-filled)[:2]
    return np.where(above_zero, smoothed, -np.inf), float(k)


def kish_share(log_weights: Floats) -> float:
    """Return the effective share of draws, (sum w)^2 / (n sum w^2).

    Source: Kish (1965), Survey Sampling.
    """
    top = log_weights.max(initial=-np.inf)
    if not np.isfinite(top):
        return 0.0
    weights = np.exp(log_weights - top)
    return float(weights.sum() ** 2 / (len(weights) * (weights**2).sum()))
