"""Separated groups of a posterior in its chain, held to what importance sampling says.

What "auto" froze is an importance sampler too: its own draws weigh the groups without
any chain, and its density at the chain's draws says, without a solve, how long a walker
waits for the next proposal that is accepted.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..interfaces import Floats
from ..moves.mixture_em import Mixture, log_density
from ..sampling.groups import label
from ..sampling.importance import pareto_k
from ..table import Parts, Report, Table
from . import arviz_objects
from .agreement import excess_scatter, tau_by_ensemble
from .chains import list_runs, stack_chains

MOST_DRAWS = 20_000  # whose Pareto k is found
CHUNK = 20_000


@dataclass(frozen=True, eq=False)
class Groups(Report):
    """Separated groups of the posterior in the chain of ``run(..., "auto")``.

    Attributes:
        weights: Share of each group in each ensemble, ``(ensembles, g)``.
        errors: Standard error of the weights of all ensembles together, ``(g,)``.
        scatter: By how much the weights scatter over the ensembles beyond what tau
            allows (above 1), ``(g,)``; NaN for less than three ensembles.
        importance: Weights by importance sampling, ``(g,)``; NaN where not known.
        importance_errors: Their standard errors, ``(g,)``.
        acceptance: Expected acceptance of frozen proposals from there, ``(g,)``; NaN
            where the chain has no draw.
        slowest: The least acceptance from a draw of the chain: how long the worst
            walker waits.
        found: Whether a search ended or a walker started there, ``(g,)``.
        pareto_k: Of the importance weights of the proposal, at its refinement.
        chain_k: The same by the draws of the chain.
        efficiency: Effective share of its draws.
        share: Share of the steps that propose from it.
        searched: Points of the search for modes.
    """

    weights: Floats
    errors: Floats
    scatter: Floats
    importance: Floats
    importance_errors: Floats
    acceptance: Floats
    slowest: float
    found: NDArray[np.bool_]
    pareto_k: float
    chain_k: float
    efficiency: float
    share: float
    searched: int = 0

    def _parts(self) -> Parts:
        return (self.table,)

    @property
    def table(self) -> Table:
        """One row per group."""
        n_ensembles, n_groups = self.weights.shape
        by_ensemble = [
            (f"ensemble {e}", ".3f", row) for e, row in enumerate(self.weights, 1)
        ]
        return Table.from_columns(
            f"Weights of {n_groups} separated groups",
            [
                ("group", "", list(range(1, n_groups + 1))),
                *by_ensemble,
                ("+-", ".3f", self.errors),
                ("importance", ".3f", self.importance),
                ("+- ", ".3f", self.importance_errors),
                ("acceptance", ".2f", self.acceptance),
            ],
        )


def weigh_groups(samplers: Any, discard: int, draws: Floats) -> Groups | None:
    """Return the groups in ``draws (steps, ensembles, walkers, d)``.

    Returns:
        None where no record of "auto" goes with the samplers or the ArviZ object, or
        only some parameters were kept.
    """
    record = find_record(samplers)
    if record is None or draws.shape[-1] != np.shape(record["proposal"][1])[1]:
        return None
    weights, means, matrices, df = record["proposal"]
    law = Mixture(np.array(weights), np.array(means), np.array(matrices), df)
    group_of, n_groups = np.array(record["group_of"]), len(record["weights"])
    flat = draws.reshape(-1, draws.shape[-1])
    pieces = np.array_split(flat, -(-len(flat) // CHUNK))
    log_weights = _log_prob(samplers, discard).reshape(-1)
    log_weights = log_weights - np.concatenate([log_density(x, law) for x in pieces])
    own = np.concatenate([label(x, law, group_of) for x in pieces])
    labels = own.reshape(draws.shape[:3])
    indicators = 1.0 * (labels[..., None] == np.arange(n_groups))
    accepted = expected_acceptance(log_weights)
    acceptance = [
        accepted[own == g].mean() if (own == g).any() else np.nan
        for g in range(n_groups)
    ]
    # Draws of p, not of q, have the tail index k / (1 - k).
    some = np.linspace(0, len(flat) - 1, min(len(flat), MOST_DRAWS)).astype(int)
    k = pareto_k(log_weights[some])
    sizes = arviz_objects.mean_sizes(
        indicators.transpose(1, 2, 0, 3).reshape(-1, len(draws), n_groups)
    )
    by_ensemble = indicators.mean(axis=(0, 2))
    total = by_ensemble.mean(axis=0)
    sizes = np.where(np.isfinite(sizes), sizes, labels.size)
    # Of a group without draws, or with nothing else, as if there were one other draw.
    variance = np.maximum(total * (1 - total), 1 / sizes)
    return Groups(
        weights=by_ensemble,
        errors=np.sqrt(variance / sizes) * (n_groups > 1),
        scatter=_scatter(indicators),
        importance=_floats(record["weights"]),
        importance_errors=_floats(record["errors"]),
        acceptance=np.array(acceptance),
        slowest=float(accepted.min()),
        found=np.add(
            np.sum(record["found_by"], axis=0), np.sum(record["start"], axis=0)
        )
        > 0,
        pareto_k=float(record["pareto_k"]),
        chain_k=k / (1 + k) if 0 < k < np.inf else min(k, 1.0),
        efficiency=float(record.get("efficiency", np.nan)),
        share=float(record.get("share", 1.0)),
        searched=int(np.ravel(record.get("searched", 0))[0]),
    )


def _scatter(indicators: Floats) -> Floats:
    """Return the excess scatter of each group's weight ``(g,)``."""
    moved = (indicators != indicators[0]).any(axis=0)  # (ensembles, walkers, g)
    tau = [
        tau_by_ensemble(indicators[..., [g]], moved[..., g])
        for g in range(indicators.shape[-1])
    ]
    return excess_scatter(indicators, np.hstack(tau))


def find_record(samplers: Any) -> Mapping[str, Any] | None:
    """Return what "auto" found, of samplers or of an ArviZ object."""
    if hasattr(samplers, "posterior"):
        posterior = arviz_objects.dataset(samplers, "posterior")
        text = str(posterior.attrs.get("recipe", ""))
        return json.loads(text) if text.startswith("{") else None
    recipe = getattr(list_runs(samplers)[0], "recipe", None)
    found: Mapping[str, Any] | None = getattr(recipe, "record", None)
    return found


def _log_prob(samplers: Any, discard: int) -> Floats:
    """Return the log-posteriors ``(steps, ensembles, walkers)`` of the draws."""
    if not hasattr(samplers, "posterior"):
        return stack_chains(list_runs(samplers), "log_prob", discard)
    lp = arviz_objects.dataset(samplers, "sample_stats")["lp"]
    values: Floats = lp.transpose("draw", "chain").values
    return values[checks.whole_number("discard", discard) :]


def _floats(values: Any) -> Floats:
    return np.array([np.nan if v is None else v for v in values], dtype=float)


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
    n = len(inverse)
    below = np.cumsum(increasing)
    result = np.empty(n)
    result[order] = (below + increasing * np.arange(n - 1, -1, -1)) / below[-1]
    return result
