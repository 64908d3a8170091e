"""Starting positions inside the prior's bounds."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from .. import checks
from ..interfaces import Floats, Prior
from .priors import inside, summarize_prior


def draw_start(
    prior: Prior, nwalkers: int, seed: Any, around: ArrayLike | None
) -> Floats:
    """Draw starting positions; see :meth:`LogPosterior.start`."""
    nwalkers = checks.whole_number("nwalkers", nwalkers, 1)
    try:
        rng = np.random.default_rng(seed)
    except (TypeError, ValueError) as error:
        raise type(error)(
            f"seed: expected what numpy.random.default_rng takes, got {seed!r} "
            f"({error})"
        ) from None
    if around is None:
        return prior.sample(rng, nwalkers)
    centre = checks.real_array("around", around, 1)
    check_inside(prior, "around", centre[None])
    spread = 0.1 * summarize_prior(prior)[1]
    low, high = (prior.bounds.T - centre) / spread
    shape = (nwalkers, len(centre))
    standard = stats.truncnorm.rvs(low, high, size=shape, random_state=rng)
    result: Floats = np.clip(  # rounding alone can pass a bound, by an ulp
        centre + spread * standard, *prior.bounds.T
    )
    return result


def check_inside(prior: Prior, argument: str, theta: Floats) -> None:
    """Raise ValueError, by name, if a row of ``theta (n, d)`` is out of bounds."""
    if theta.ndim != 2 or theta.shape[1] != len(prior.names):
        raise ValueError(
            f"{argument}: expected one number for each of {prior.names}, "
            f"got shape {theta.shape}"
        )
    bounds = prior.bounds
    if inside(theta, bounds).all():
        return
    within = (theta >= bounds[:, 0]) & (theta <= bounds[:, 1])
    row, column = np.argwhere(~within)[0]
    low, high = bounds[column]
    raise ValueError(
        f"{argument}: {prior.names[column]} = {theta[row, column]:g} of point "
        f"{row} is outside its bounds ({low:g}, {high:g})"
    )
