"""Importance weights: what they say of a proposal, resampling, bridge sampling."""

import importlib
import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import expit, softmax

from ..contracts import Floats

# Pareto k up to which the error of an importance estimate can be believed.
GOOD_K = 0.7
# Effective share from which a heavy tail of weights matters little.
FAIR_SHARE = 0.5
# Fewest weights for which k is estimated.
FEWEST_WEIGHTS = 25
# Relative range of the largest weights, below which they are equal and have no tail:
# half of the digits of a number, since log-densities in the thousands lose others.
EQUAL = np.sqrt(np.finfo(float).eps)
# Two log evidences that differ by more are not those of the same parts.
EVIDENCE_APART = 1.0


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
        infinite k, if fewer than 25 are above zero or no law can be fitted.
    """
    # Weights of zero are no part of the tail; ArviZ would make NaN of -inf.
    above_zero = np.isfinite(log_weights)
    finite = log_weights[above_zero]
    if len(finite) < FEWEST_WEIGHTS:
        return log_weights, np.inf
    floor = finite.min() - 1.0
    filled = np.where(above_zero, log_weights, floor)
    largest = np.sort(filled)[-round(min(len(filled) / 5, 3 * len(filled) ** 0.5)) :]
    if np.ptp(largest) < EQUAL:  # equal: no tail, to which no law can be fitted
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
    if np.isnan(k):  # one weight is nearly all: some versions of ArviZ find no law
        return log_weights, np.inf
    return np.where(above_zero, smoothed, -np.inf), float(k)


def kish_share(log_weights: Floats, log_shares: Floats | float = 0.0) -> float:
    """Return the effective share of draws, (sum s w)^2 / (sum s sum s w^2).

    Args:
        log_weights: Logarithms of the weights w, ``(n,)``.
        log_shares: Logarithms of the shares s of the draws, ``(n,)`` or one for all.

    Source: Kish (1965), Survey Sampling.
    """
    top = log_weights.max(initial=-np.inf)
    if not np.isfinite(top):
        return 0.0
    weights = np.exp(log_weights - top)
    shares = np.exp(log_shares + np.zeros_like(weights))
    squares = shares.sum() * (shares * weights**2).sum()
    share = (shares * weights).sum() ** 2 / squares
    return min(float(share), 1.0)  # which rounding may exceed


def are_reliable(k: float, share: float) -> bool:
    """Return whether means over importance weights can be believed.

    The weights may have a heavy tail, as long as they are nearly equal otherwise.

    Args:
        k: Their Pareto k.
        share: Their effective share.
    """
    return not (k > GOOD_K and share < FAIR_SHARE)


def independence_acceptance(log_weights: Floats, at_c: Floats) -> Floats:
    r"""Return the acceptance of independent draws of c from each of some points.

    .. math:: a(x) = E_{y \sim c} \min\{1, w(y) / w(x)\}, \qquad w = p / c

    Args:
        log_weights: ln w at the points, up to a constant, ``(n,)``.
        at_c: The weight of each point among draws of c; they sum to one.

    Returns:
        a, ``(n,)``; 0 where w is not finite, as at a point where c is zero.
    """
    finite = np.flatnonzero(np.isfinite(log_weights))
    order = finite[np.argsort(log_weights[finite])]
    log_w, c = log_weights[order], at_c[order]
    with np.errstate(divide="ignore"):  # for points that are no draws of c
        less = np.logaddexp.accumulate(np.log(c) + log_w)
    result = np.zeros(len(log_weights))
    result[order] = np.exp(less - log_w) + np.append(c[:0:-1].cumsum()[::-1], 0.0)
    return result


def find_acceptance(log_p: Floats, log_c: Floats, log_q: Floats) -> float:
    """Return the acceptance of independent draws of c, in equilibrium with p.

    Args:
        log_p: ln p, unnormalised, at draws of q, ``(n,)``; -inf where p is zero.
        log_c: ln c at the same draws.
        log_q: ln q at the same draws.
    """
    if not np.isfinite(log_p + log_c).any():
        return 0.0
    at_p, at_c = (softmax(x - log_q) for x in (log_p, log_c))
    with np.errstate(invalid="ignore"):  # at draws where p and c are zero
        return float(at_p @ independence_acceptance(log_p - log_c, at_c))


def resample(weights: Floats, size: int, offset: float | Floats) -> NDArray[np.intp]:
    """Return members as often as their weights say, rounded up or down.

    Member i comes size w_i / sum(w) times, rounded up or down to a whole number.

    Args:
        weights: ``(n,)``, not below zero.
        size: How many members to return.
        offset: A uniform number in [0, 1) (systematic), or ``size`` of them
            (stratified).

    Source: Douc and Cappe (2005), doi:10.1109/ISPA.2005.195385.
    """
    edges = np.cumsum(weights)
    places = (np.arange(size) + offset) / size * edges[-1]
    members: NDArray[np.intp] = np.searchsorted(edges, places, side="right")
    return np.minimum(members, len(weights) - 1)


class Bridge(NamedTuple):
    """The result of a bridge.

    Attributes:
        log_ratio: ln of the ratio of the normalising constants of f and g.
        from_f: First-order error that each draw of f adds to log_ratio; their mean is
            zero.
        from_g: The same of the draws of g.
        overlap: The overlap of f and g: 1 if they are the same law, 0 if no draw of one
            has a chance under the other.
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
    # The derivative of the equation with respect to log_ratio: since f (1 - p) s equals
    # g p (1 - s), the mean of p (1 - p) is the mean of p over g.
    slope = (1 - share) * p_g.mean()
    unit = slope if slope > 0 else np.inf  # without overlap no error is known
    return Bridge(
        log_ratio=log_ratio,
        from_f=share * (p_f - p_f.mean()) / unit,
        from_g=(1 - share) * (p_g - p_g.mean()) / unit,
        overlap=float(slope / (share * (1 - share))),
    )
