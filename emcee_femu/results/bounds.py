"""Whether a posterior presses against the bounds of its prior."""

import numpy as np
from numpy.typing import NDArray

from ..contracts import Floats

PARTS = 10  # parts of equally many samples; the width of a part gives its density
# Density at a bound relative to the highest: 1 for a half-normal, 0.7 for a Gaussian
# cut at one sd from its mean, 0.3 at two sds. From 1,000 samples it is known to 10 %.
AT_THE_HIGHEST = 0.75
PREFERRED = 2.0  # times the prior's density there, so that it is due to the data


def find_density(
    bounds: Floats, before: Floats, draws: Floats, weights: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the densities at the bounds, and whether draws are pressed against them.

    The densities are relative to the highest one. Both results are ``(d, 2)``. Parts of
    equal mass are narrowest where the density is highest.

    Args:
        bounds: Bounds of the prior, ``(d, 2)``.
        before: Draws of the prior.
        draws: Draws of the posterior, ``(n, d)``.
        weights: Weights of these.
    """
    positive = bounds[:, 0] >= 0
    shares = np.linspace(0, 1, PARTS + 1)[1:]
    with np.errstate(divide="ignore", invalid="ignore"):  # for zeros and infinities
        ends, before, draws = (
            np.where(positive, np.log(x), x) for x in (bounds.T, before, draws)
        )
        ends[~positive & (bounds.T == 0)] = np.inf  # nature sets a bound of zero
        away = np.abs(draws - ends[:, None])  # (2, n, d)
        edges = np.quantile(away, shares, 1, weights=weights, method="inverted_cdf")
        widths = np.diff(edges, axis=0, prepend=0.0)
        at_bound = np.nan_to_num(widths.min(axis=0) / widths[0])
        near = np.abs(before - ends[:, None]) <= edges[:1].swapaxes(0, 1)
        flat = edges[0] / np.ptp(ends, axis=0)  # where the prior is not known
        prior = np.where(np.isnan(before).any(axis=0), flat, near.mean(axis=1))
    pressed = (at_bound >= AT_THE_HIGHEST) & (PREFERRED * prior <= shares[0])
    return at_bound.T, pressed.T
