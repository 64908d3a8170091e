"""Bridge sampling: the ratio of two normalising constants, from draws of both laws."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit

from ..interfaces import Floats


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
