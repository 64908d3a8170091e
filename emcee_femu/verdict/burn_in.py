"""Burn-in: how many steps a chain takes to forget where it began.

Two series are used for each parameter and ensemble: the means over walkers of z and of
z^2. A chain that begins elsewhere differs in the first by its place, and in the second
by its width.
"""

import numpy as np

from ..contracts import Floats

FEWEST_STEPS = 8  # fewest that can be judged
# z^2 is cut here, five standard deviations: a single walker far outside then says as
# little as one that has nearly arrived.
MOST_SQUARED = 25.0


def find_burn_in(draws: Floats, rungs: int = 1) -> int:
    r"""Return the number of steps that are left out of a chain as burn-in.

    .. math:: b = \arg\min_{b \le n / 2} \sum_j
        \frac{\operatorname{var}(y_{j, b + 1}, \ldots, y_{j, n})}{s_j^2 (n - b)}

    This is the marginal standard error rule, with one b for all series y: it minimises
    the sum of the squared standard errors of their means, each relative to the variance
    s^2 of the second half. Steps are dropped only while that lowers the standard error.
    For tempered walkers it is the largest b of all temperatures.

    Args:
        draws: ``(steps, ensembles, walkers, d)``.
        rungs: Number of temperatures, whose walkers stand one after another.

    Source: K. P. White (1997), doi:10.1177/003754979706900601.

    Examples:
        >>> rng = np.random.default_rng(1)
        >>> draws = rng.standard_normal((400, 4, 8, 3))
        >>> draws[:50] += 9.0
        >>> find_burn_in(draws)
        50
    """
    steps, ensembles, walkers, d = draws.shape
    blocks = draws.reshape(steps, ensembles, rungs, walkers // rungs, d)
    return max(_fewest(means_over_walkers(blocks[:, :, rung])) for rung in range(rungs))


def _fewest(series: Floats) -> int:
    """Return the b of :func:`find_burn_in` for ``series (steps, ensembles, m)``."""
    steps = len(series)
    late = series[steps // 2 :]
    backwards = (series - late.mean(axis=0))[::-1]
    counts = np.arange(1, steps + 1)[:, None, None]
    means = np.cumsum(backwards, axis=0) / counts
    variances = np.cumsum(backwards**2, axis=0) / counts - means**2
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.nan_to_num(variances / counts / late.var(axis=0), posinf=0.0)
    errors = relative.sum(axis=(1, 2))[::-1]
    most = max(min(steps // 2, steps - FEWEST_STEPS), 0)
    return int(np.argmin(errors[: most + 1]))


def means_over_walkers(draws: Floats) -> Floats:
    """Return the means over walkers of z and z^2, ``(steps, ensembles, 2 d)``."""
    late = draws[len(draws) // 2 :]
    with np.errstate(divide="ignore", invalid="ignore"):  # for what never moves
        z = draws - np.median(late, axis=(0, 1, 2))
        z = z / late.std(axis=(0, 1, 2))
    both = np.concatenate([z, np.minimum(z**2, MOST_SQUARED)], axis=-1)
    return np.asarray(both.mean(axis=2))
