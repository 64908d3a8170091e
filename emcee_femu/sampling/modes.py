"""Separated modes in a chain, held to what importance sampling says of them.

A chain of independence proposals waits long where the proposal is too thin: the
importance weights tell, at fresh draws of the proposal and at the chain's own.
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
RARE = 0.001  # share of a chain at places where a wait matters little


@dataclass(frozen=True, eq=False, repr=False)
class ModeWeights(Report):
    """Separated modes of the posterior in the chain of ``run(..., "auto")``.

    Attributes:
        weights: Share of each mode in each ensemble, ``(ensembles, g)``.
        errors: Standard error of the weights of all ensembles together, ``(g,)``.
        importance: Weights by importance sampling, ``(g,)``; NaN where not known.
        importance_errors: Their standard errors, ``(g,)``.
        acceptance: Expected acceptance of frozen proposals from there, ``(g,)``; NaN
            where the chain has no draw.
        slowest: Acceptance from the worst thousandth of the chain's draws, at most: how
            long walkers wait. A walker that came upon a place which the search missed
            stays there, and makes up more than that.
        reached: Whether a search ended or a walker started there, ``(g,)``.
        pareto_k: Of the importance weights of the proposal, at its refinement.
        chain_k: The same by the draws of the chain.
        efficiency: Effective share of its draws.
        share: Share of the steps that propose from it.
        searched: Points of the search for modes.
        climbs: How many climbs there were, and how many of them from the prior.
    """

    weights: Floats
    errors: Floats
    importance: Floats
    importance_errors: Floats
    acceptance: Floats
    slowest: float
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
    """Return the modes in chains of "auto", None if they are of something else."""
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
        slowest=float(np.quantile(accepted, RARE)),
        reached=search.found_by.sum(axis=0) + search.starts.sum(axis=0) > 0,
        pareto_k=search.pareto_k,
        chain_k=k / (1 + k) if 0 < k < np.inf else min(k, 1.0),
        efficiency=search.efficiency,
        share=search.share * search.screened,
        searched=search.points,
        climbs=(search.climbs, search.from_prior),
    )
