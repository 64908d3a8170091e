"""The numbers of a verdict: R-hat, ESS, tau, scatter, waits.

They lie below :func:`.run`, which may ask them. The only module that imports ArviZ,
which takes seconds: it is imported where it is used.
"""

import warnings
from typing import Any

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ..contracts import Floats

FEWEST_STEPS = 8  # that can be judged
FEWEST_ENSEMBLES = 3  # of which the scatter is known
FALSE_ALARM = 1e-4  # its probability, over all parameters
TAU_KNOWN_TO = 1.5  # ratio by which a variance claimed from tau may be too small
TAILS = (0.05, 0.95)


def load_arviz() -> Any:
    """Import ArviZ; version 0.23 announces version 1, which is not the user's task."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "[\\s\\S]*ArviZ", FutureWarning)
        import arviz

    return arviz


def spread_out(n: int, most: int) -> NDArray[np.intp]:
    """Return which of n draws to take where ``most`` will do, evenly spread."""
    return np.linspace(0, n - 1, min(n, most)).astype(np.intp)


def rhat(chains: Floats) -> Floats:
    """Return the rank-normalised split R-hat of ``chains (m, n, d)``, ``(d,)``."""
    return _by_parameter(load_arviz().rhat, chains)


def effective_sizes(chains: Floats) -> tuple[Floats, Floats]:
    """Return bulk and tail (5 %, 95 %) ESS of ``chains (m, n, d)``, each ``(d,)``."""
    ess = load_arviz().ess
    bulk = _by_parameter(ess, chains, method="bulk")
    # The quantiles are named because their default differs between ArviZ 0.x and 1.x.
    tail = _by_parameter(ess, chains, method="tail", prob=(0.05, 0.95))
    return bulk, tail


def mean_sizes(chains: Floats) -> Floats:
    """Return the ESS of the mean of ``chains (m, n, d)``, ``(d,)``."""
    return _by_parameter(load_arviz().ess, chains, method="mean")


def _by_parameter(statistic: Any, chains: Floats, **options: Any) -> Floats:
    import xarray

    sample_dims = ["chain", "draw"]
    data = xarray.Dataset({"p": ((*sample_dims, "parameter"), chains)})
    data.attrs["sample_dims"] = sample_dims
    # Walkers that never move make ArviZ divide by zero; diagnose names them.
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(statistic(data, **options)["p"])


def check_length(values: Floats) -> None:
    """Refuse values ``(steps, ...)`` of too few steps to judge."""
    if len(values) < FEWEST_STEPS:
        raise ValueError(
            f"discard: expected at least {FEWEST_STEPS} steps to judge, left "
            f"{len(values)}"
        )


def autocorrelation_time(chain: Floats) -> Floats:
    """Return emcee's tau of ``chain (steps, walkers, d)``, ``(d,)``, however short."""
    # tol=0 because diagnose reports steps / tau itself.
    return np.asarray(emcee.autocorr.integrated_time(chain, tol=0))


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
        squares = ((means - centre) ** 2 / variance).sum(axis=0)
    most = stats.chi2.isf(FALSE_ALARM / d, n_ensembles - 1)
    return np.asarray(squares / (TAU_KNOWN_TO * most))


def sizes_by_means(draws: Floats) -> tuple[Floats, Floats]:
    """Return bulk and tail ESS by how much the means over the walkers scatter."""
    scores = stats.rankdata(draws.reshape(-1, draws.shape[-1]), axis=0)
    scores = stats.norm.ppf((scores - 0.375) / (len(scores) + 0.25))
    # Ranks make little of the gap between modes, over which the draws mix slowest.
    bulk = [size_by_means(values) for values in (draws, scores.reshape(draws.shape))]
    ends = np.quantile(draws, TAILS, axis=(0, 1, 2))
    tails = [size_by_means(1.0 * (draws <= end)) for end in ends]
    return np.min(bulk, axis=0), np.min(tails, axis=0)


def size_by_means(values: Floats) -> Floats:
    """Return the ESS of the mean of ``values (steps, ensembles, walkers, d)``.

    By the means over walkers that exchange places: var / var(mean).
    """
    series = values.mean(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = values.var(axis=(0, 1, 2)) / series.var(axis=(0, 1))
    return np.asarray(gain * mean_sizes(series.swapaxes(0, 1)))


def expected_acceptance(log_weights: Floats) -> Floats:
    r"""Return the acceptance of a proposal of q from each draw of p, ``(n,)``.

    .. math:: a(x) = E_q \min\{1, w(y) / w(x)\}
        = \frac{E_p \min\{1 / w(y), 1 / w(x)\}}{E_p\, 1 / w(y)}

    Args:
        log_weights: ln w = ln(p / q) at draws of p, ``(n,)``.
    """
    inverse = np.exp(log_weights.min() - log_weights)
    order = np.argsort(inverse)
    increasing = inverse[order]
    below, above = np.cumsum(increasing), np.arange(len(inverse))[::-1]
    result = np.empty(len(inverse))
    result[order] = (below + increasing * above) / below[-1]
    return result
