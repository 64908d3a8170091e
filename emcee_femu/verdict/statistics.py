"""The numbers of a verdict: R-hat, ESS, tau, scatter, waits, weights of maxima.

They lie below :func:`.run`, which ends by them. ArviZ takes seconds to import;
:func:`load_arviz` imports it when it is first needed.
"""

import warnings
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import softmax

from ..contracts import Floats
from ..search.importance import independence_acceptance, pareto_k
from ..search.record import Chains
from ..table import Parts, Report, Table
from .burn_in import FEWEST_STEPS, find_burn_in, means_over_walkers

FEWEST_ENSEMBLES = 3  # fewest whose scatter can be judged
FALSE_ALARM = 1e-4  # probability of a false alarm, over all parameters
TAU_KNOWN_TO = 1.5  # ratio by which a variance claimed from tau may be too small
TAILS = (0.05, 0.95)  # quantiles
MOST_WEIGHED = 20_000  # draws in a batch, and most draws for Pareto k
# Share of independence proposals among the steps. Below this share, other moves end
# most waits, and waits say nothing.
LEAST_INDEPENDENT = 0.5


def load_arviz() -> ModuleType:
    """Import ArviZ; version 0.23 announces version 1, which is not the user's task."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "[\\s\\S]*ArviZ", FutureWarning)
        return import_module("arviz")


def spread_out(n: int, most: int) -> NDArray[np.intp]:
    """Return the places of at most ``most`` of n draws, evenly spread."""
    return np.linspace(0, n - 1, min(n, most)).astype(np.intp)


def rhat(chains: Floats) -> Floats:
    """Return the rank-normalised split R-hat of ``chains (m, n, d)``, ``(d,)``."""
    return _by_parameter(load_arviz().rhat, chains)


def effective_sizes(chains: Floats) -> tuple[Floats, Floats]:
    """Return bulk and tail (5 %, 95 %) ESS of ``chains (m, n, d)``, each ``(d,)``."""
    ess = load_arviz().ess
    bulk = _by_parameter(ess, chains, method="bulk")
    # The quantiles are named because their default differs between ArviZ 0.x and 1.x.
    tail = _by_parameter(ess, chains, method="tail", prob=TAILS)
    return bulk, tail


def mean_sizes(chains: Floats) -> Floats:
    """Return the ESS of the mean of ``chains (m, n, d)``, ``(d,)``."""
    return _by_parameter(load_arviz().ess, chains, method="mean")


def _by_parameter(statistic: Any, chains: Floats, **options: object) -> Floats:
    import xarray

    sample_dims = ["chain", "draw"]
    data = xarray.Dataset({"p": ((*sample_dims, "parameter"), chains)})
    data.attrs["sample_dims"] = sample_dims
    # Walkers that never move make ArviZ divide by zero; diagnose names them.
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(statistic(data, **options)["p"])


def tau_by_ensemble(values: Floats, moved: NDArray[np.bool_]) -> Floats:
    """Return emcee's tau of each ensemble's walkers that moved, ``(ensembles, d)``.

    Short chains are accepted, since diagnose reports steps / tau itself.
    """
    taus = np.full((values.shape[1], values.shape[3]), np.nan)
    for ensemble in np.flatnonzero(moved.any(axis=1)):
        walkers = values[:, ensemble, moved[ensemble]]
        taus[ensemble] = emcee.autocorr.integrated_time(walkers, tol=0)
    return taus


def excess_scatter(values: Floats, tau: Floats) -> Floats:
    r"""Return by how much ensemble means scatter more than they may, ``(d,)``.

    .. math:: \chi^2 = \sum_e \frac{(\bar x_e - \bar x)^2}{v_e},
        \qquad v_e = \frac{s^2 \tau_e}{\mathrm{steps} \cdot \mathrm{walkers}}

    relative to its quantile for ``ensembles - 1`` degrees of freedom. Above 1, the
    errors that follow from tau are too small, or an ensemble is somewhere else.

    Args:
        values: Draws, or functions of them, ``(steps, ensembles, walkers, d)``.
        tau: Their autocorrelation times in steps, ``(ensembles, d)``; an ensemble
            whose values never change, NaN, gets the longest of the others.

    Returns:
        The ratios; NaN for fewer than three ensembles, which cannot be judged.
    """
    steps, n_ensembles, n_walkers, d = values.shape
    if n_ensembles < FEWEST_ENSEMBLES:
        return np.full(d, np.nan)
    tau = np.where(np.isfinite(tau), tau, np.fmax.reduce(tau))  # NaN if all are
    variance = values.var(axis=(0, 1, 2)) * tau / (steps * n_walkers)
    means = values.mean(axis=(0, 2))
    with np.errstate(divide="ignore", invalid="ignore"):  # for what never changes
        centre = (means / variance).sum(axis=0) / (1 / variance).sum(axis=0)
        squares = ((means - centre) ** 2 / variance).sum(axis=0)
    most = stats.chi2.isf(FALSE_ALARM / d, n_ensembles - 1)
    return np.asarray(squares / (TAU_KNOWN_TO * most))


def sizes_by_means(draws: Floats) -> tuple[Floats, Floats]:
    """Return bulk and tail ESS from the scatter of the means over walkers."""
    scores = stats.rankdata(draws.reshape(-1, draws.shape[-1]), axis=0)
    scores = stats.norm.ppf((scores - 0.375) / (len(scores) + 0.25))
    # Ranks shrink the gap between maxima, across which the draws mix slowest.
    bulk = [size_by_means(values) for values in (draws, scores.reshape(draws.shape))]
    ends = np.quantile(draws, TAILS, axis=(0, 1, 2))
    tails = [size_by_means(1.0 * (draws <= end)) for end in ends]
    return np.min(bulk, axis=0), np.min(tails, axis=0)


def size_by_means(values: Floats) -> Floats:
    """Return the ESS of the mean of ``values (steps, ensembles, walkers, d)``.

    It is var / var(mean), with the mean over walkers, which may exchange places.
    """
    series = values.mean(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = values.var(axis=(0, 1, 2)) / series.var(axis=(0, 1))
    return np.asarray(gain * mean_sizes(series.swapaxes(0, 1)))


def find_drift(draws: Floats) -> int:
    """Return how many first steps of a chain drift, 0 if no drift is seen.

    All of its steps drift if those after :func:`.find_burn_in` do so as well.
    The means of all series over the first half, quarter, eighth ... of the steps are
    compared with those over the second half, by the standard error that the second half
    claims for as many steps (the test of Geweke, 1992, for several lengths).

    Args:
        draws: ``(steps, ensembles, walkers, d)``.
    """
    series = means_over_walkers(draws)
    steps, ensembles, m = series.shape
    half, shortest = steps // 2, FEWEST_STEPS // 2
    if half < shortest:
        return 0
    late = series[half:]
    sizes = mean_sizes(late.swapaxes(0, 1)) / len(late)  # per step of all ensembles
    lengths = []
    while half >= shortest:
        lengths.append(half)
        half //= 2
    # The F law is used, since so few independent values tell the variance.
    known = np.fmax(sizes * len(late) - 1, 1.0)
    least = stats.f.isf(FALSE_ALARM / (m * len(lengths)), 1, known)
    for length in lengths:
        apart = series[:length].mean(axis=(0, 1)) - late.mean(axis=(0, 1))
        share = 1 / length + 1 / len(late)
        with np.errstate(divide="ignore", invalid="ignore"):
            squares = apart**2 / (late.var(axis=(0, 1)) * share / sizes)
        if (squares > TAU_KNOWN_TO * least).any():  # never for NaN
            burn_in = max(find_burn_in(draws), shortest)
            return steps if find_drift(draws[burn_in:]) else burn_in
    return 0


LEAST_SHOWN = 0.0005  # the least weight that three decimals show


@dataclass(frozen=True, eq=False, repr=False)
class MaximaWeights(Report):
    """Separate maxima of the posterior in the chain of ``run(..., "auto")``.

    Attributes:
        weights: Share of each maximum in each ensemble, ``(ensembles, g)``.
        errors: Standard errors of the weights of all ensembles together, ``(g,)``.
        importance: Weights by importance sampling, ``(g,)``; NaN if unknown.
        importance_errors: Their standard errors, ``(g,)``.
        acceptance: Expected acceptance of frozen proposals from each maximum, ``(g,)``;
            NaN if the chain has no draw there.
        mean_error: Standard error of each mean, in standard deviations, from the time
            that walkers wait for an accepted proposal at each place, ``(d,)``; NaN if
            most of their steps are of other moves.
        sd_error: Relative standard error of each standard deviation, likewise.
        reached: Whether a climb ended or a walker started there, ``(g,)``.
        pareto_k: Pareto k of the proposal's importance weights, at its refinement.
        chain_k: The same, from the draws of the chain.
        efficiency: Effective share of the proposal's draws.
        share: Share of the steps that use the proposal.
        searched: Number of points in the search for maxima.
        climbs: Number of climbs, and how many of them started from the prior.
    """

    weights: Floats
    errors: Floats
    importance: Floats
    importance_errors: Floats
    acceptance: Floats
    mean_error: Floats
    sd_error: Floats
    reached: NDArray[np.bool_]
    pareto_k: float
    chain_k: float
    efficiency: float
    share: float
    searched: int = 0
    climbs: tuple[int, int] = (0, 0)

    def _parts(self) -> Parts:
        return (self.table,)

    @property
    def held(self) -> int:
        """How many maxima have a weight that is printed as more than zero."""
        return int(
            (~(np.fmax(self.importance, self.weights.mean(axis=0)) < LEAST_SHOWN)).sum()
        )

    @property
    def table(self) -> Table:
        """One row per maximum."""
        count = len(self.importance)
        ensembles = enumerate(self.weights, 1)
        return Table.from_columns(
            f"Weights of {count} separated maxima",
            [
                ("maximum", "", range(1, count + 1)),
                *((f"ensemble {e}", ".3f", row) for e, row in ensembles),
                ("+-", ".3f", self.errors),
                ("importance", ".3f", self.importance),
                ("+- ", ".3f", self.importance_errors),
                ("acceptance", ".2f", self.acceptance),
            ],
        )


def weigh_maxima(chains: Chains) -> MaximaWeights | None:
    """Return the maxima in chains of "auto"; None for other chains."""
    search, draws = chains.search, chains.draws
    if search is None or draws.shape[-1] != search.mixture.means.shape[1]:
        return None
    count = len(search.weights)
    flat = draws.reshape(-1, draws.shape[-1])
    pieces = np.array_split(flat, -(-len(flat) // MOST_WEIGHED))
    log_q = np.concatenate([search.mixture.log_density(x) for x in pieces])
    log_weights = chains.log_prob.reshape(-1) - log_q
    owner = np.concatenate([search.label(x) for x in pieces])
    labels = owner.reshape(draws.shape[:3])
    indicators = 1.0 * (labels[..., None] == np.arange(count))
    accepted = independence_acceptance(log_weights, softmax(-log_weights))
    counts = np.bincount(owner, minlength=count)
    with np.errstate(invalid="ignore"):  # for maxima without a draw
        acceptance = np.bincount(owner, accepted, count) / counts
    # Draws of p, not of q, have the tail index k / (1 - k).
    k = pareto_k(log_weights[spread_out(len(flat), MOST_WEIGHED)])
    share = search.share * search.screened
    mean_error, sd_error = _errors(flat, accepted, share)
    as_chains = indicators.transpose(1, 2, 0, 3).reshape(-1, len(draws), count)
    sizes = mean_sizes(as_chains)
    by_ensemble = indicators.mean(axis=(0, 2))
    total = by_ensemble.mean(axis=0)
    sizes = np.where(np.isfinite(sizes), sizes, labels.size)
    # If a maximum has no draws, or all of them, assume one draw to the contrary.
    variance = np.maximum(total * (1 - total), 1 / sizes)
    return MaximaWeights(
        weights=by_ensemble,
        errors=np.sqrt(variance / sizes) * (count > 1),
        importance=search.weights,
        importance_errors=search.errors,
        acceptance=acceptance,
        mean_error=mean_error,
        sd_error=sd_error,
        reached=search.found_by.sum(axis=0) + search.starts.sum(axis=0) > 0,
        pareto_k=search.pareto_k,
        chain_k=k / (1 + k) if 0 < k < np.inf else min(k, 1.0),
        efficiency=search.efficiency,
        share=share,
        searched=search.points,
        climbs=(search.climbs, search.from_prior),
    )


def _errors(flat: Floats, accepted: Floats, share: float) -> tuple[Floats, Floats]:
    r"""Return the errors of means and standard deviations from waits, ``(d,)`` each.

    .. math:: \epsilon^2 = \frac{1}{n} E_p\left[ h^2 \left( \frac{2}{s a} - 1
        \right) \right], \qquad h = \max(1, |z|), \quad \frac{z^2 - 1}{2}

    Walkers leave a place with probability s a, where s is the share of independence
    proposals among their steps and a the acceptance of these. If s is at most a half,
    the errors are NaN. h is at least 1 because a part near the mean has a weight too.
    """
    if share <= LEAST_INDEPENDENT:
        unknown = np.full(flat.shape[1], np.nan)
        return unknown, unknown
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = (flat - flat.mean(axis=0)) ** 2 / flat.var(axis=0)
        longer = np.maximum(2 / (share * accepted) - 1, 1.0) / len(flat) ** 2
        means = np.sqrt(longer @ np.fmax(squares, 1.0))
        return means, np.sqrt(longer @ (squares - 1) ** 2) / 2
