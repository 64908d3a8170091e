"""The ratio of two evidences, from draws of both laws."""

import numpy as np
from scipy.special import expit

from ..interfaces import Floats


def bridge(low: Floats, high: Floats) -> tuple[float, Floats, Floats]:
    r"""Return the log ratio of normalising constants of two powers, by both.

    .. math:: \sum_{low} \frac{1}{1 + e^{r - l_i}} = \sum_{high}
        \frac{1}{1 + e^{l_i - r}}

    l is what the log density gains from the lower to the higher power. Draws of the
    higher one know regions of which the lower one has few; weights of the lower draws
    alone would miss them.

    Args:
        low: l at draws of the lower power, ``(n,)``.
        high: l at as many draws of the higher one.

    Returns:
        r, and by how much each draw of the two raised it, to first order: their sums
        over independent groups of draws are independent, and sum up to zero.

    Source: Bennett (1976), doi:10.1016/0021-9991(76)90078-4; Meng and Wong (1996).
    """
    both = np.concatenate([low, high])
    lowest, highest = both.min(), both.max()
    for _ in range(100):  # the left side falls with r, the right side rises
        ratio = 0.5 * (lowest + highest)
        if expit(low - ratio).sum() > expit(ratio - high).sum():
            lowest = ratio
        else:
            highest = ratio
    up, down = expit(low - ratio), expit(ratio - high)
    slope = (up * (1 - up)).sum() + (down * (1 - down)).sum()
    return float(ratio), (up - up.mean()) / slope, (down.mean() - down) / slope
