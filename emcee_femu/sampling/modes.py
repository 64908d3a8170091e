"""Separate modes in a chain, compared with importance sampling.

A chain of independence proposals waits for a long time where the proposal is too small.
The importance weights reveal this, at fresh draws of the proposal and at the chain's.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..contracts import Floats
from ..table import Parts, Report, Table
from .importance import pareto_k
from .judge import expected_acceptance, mean_sizes, spread_out
from .record import Chains

MOST_WEIGHED = 20_000  # whose Pareto k is found
CHUNK = 20_000
MOST_BY_OTHERS = 0.5  # share of independence proposals; of fewer, others end waits


@dataclass(frozen=True, eq=False, repr=False)
class ModeWeights(Report):
    """Separate modes of the posterior in the chain of ``run(..., "auto")``.

    Attributes:
        weights: Share of each mode in each ensemble, ``(ensembles, g)``.
        errors: Standard errors of the weights of all ensembles together, ``(g,)``.
        importance: Weights by importance sampling, ``(g,)``; NaN if unknown.
        importance_errors: Their standard errors, ``(g,)``.
        acceptance: Expected acceptance of frozen proposals from each mode, ``(g,)``;
            NaN if the chain has no draw there.
        mean_error: Standard error of each mean, in standard deviations, from the time
            that walkers wait for an accepted proposal at each place, ``(d,)``; NaN if
            most of their steps are of other moves.
        sd_error: Relative standard error of each standard deviation, likewise.
        reached: Whether a search ended or a walker started there, ``(g,)``.
        pareto_k: Pareto k of the proposal's importance weights, at its refinement.
        chain_k: The same, from the draws of the chain.
        efficiency: Effective share of the proposal's draws.
        share: Share of the steps that use the proposal.
        searched: Number of points in the search for modes.
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
    def table(self) -> Table:
        """One row per mode."""
        n_modes = len(self.importance)
        ensembles = enumerate(self.weights, 1)
        return Table.from_columns(
            f"Weights of {n_modes} separated modes",
            [
                ("mode", "", range(1, n_modes + 1)),
                *((f"ensemble {e}", ".3f", row) for e, row in ensembles),
                ("+-", ".3f", self.errors),
                ("importance", ".3f", self.importance),
                ("+- ", ".3f", self.importance_errors),
                ("acceptance", ".2f", self.acceptance),
            ],
        )


def weigh_modes(chains: Chains) -> ModeWeights | None:
    """Return the modes in chains of "auto"; None for other chains."""
    search, draws = chains.search, chains.draws
    if search is None or draws.shape[-1] != search.mixture.means.shape[1]:
        return None
    n_modes = len(search.weights)
    flat = draws.reshape(-1, draws.shape[-1])
    pieces = np.array_split(flat, -(-len(flat) // CHUNK))
    log_q = np.concatenate([search.mixture.log_density(x) for x in pieces])
    log_weights = chains.log_prob.reshape(-1) - log_q
    owner = np.concatenate([search.label(x) for x in pieces])
    labels = owner.reshape(draws.shape[:3])
    indicators = 1.0 * (labels[..., None] == np.arange(n_modes))
    accepted = expected_acceptance(log_weights)
    counts = np.bincount(owner, minlength=n_modes)
    with np.errstate(invalid="ignore"):  # of modes without a draw
        acceptance = np.bincount(owner, accepted, n_modes) / counts
    # Draws of p, not of q, have the tail index k / (1 - k).
    k = pareto_k(log_weights[spread_out(len(flat), MOST_WEIGHED)])
    share = search.share * search.screened
    mean_error, sd_error = _errors(flat, accepted, share)
    as_chains = indicators.transpose(1, 2, 0, 3).reshape(-1, len(draws), n_modes)
    sizes = mean_sizes(as_chains)
    by_ensemble = indicators.mean(axis=(0, 2))
    total = by_ensemble.mean(axis=0)
    sizes = np.where(np.isfinite(sizes), sizes, labels.size)
    # Of a mode without draws, or with nothing else, as if there were one other draw.
    variance = np.maximum(total * (1 - total), 1 / sizes)
    return ModeWeights(
        weights=by_ensemble,
        errors=np.sqrt(variance / sizes) * (n_modes > 1),
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
    r"""Return the errors that waits make of means and standard deviations, ``(d,)``.

    .. math:: \epsilon^2 = \frac{1}{n} E_p\left[ h^2 \left( \frac{2}{s a} - 1
        \right) \right], \qquad h = \max(1, |z|), \quad \frac{z^2 - 1}{2}

    That is how long walkers stay that leave a place with probability s a, by accepted
    independence proposals, a share s of their steps; where these are the lesser part,
    nothing is known. h is at least one because a part near the mean has a weight too.
    """
    if share <= MOST_BY_OTHERS:
        unknown = np.full(flat.shape[1], np.nan)
        return unknown, unknown
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = (flat - flat.mean(axis=0)) ** 2 / flat.var(axis=0)
        longer = np.maximum(2 / (share * accepted) - 1, 1.0) / len(flat) ** 2
        means = np.sqrt(longer @ np.fmax(squares, 1.0))
        return means, np.sqrt(longer @ (squares - 1) ** 2) / 2
