"""What "auto" found: the moves, where the ensembles start, and the record of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np

from ..interfaces import Move
from ..moves import DEMCMove, HamiltonianMove, IndependenceMove
from ..table import Parts, Report
from .arguments import Moves
from .groups import label, separate, weigh
from .search import Search
from .trial import Trial

JUMPS = 0.1  # of the DE-MC steps have gamma = 1
KEPT = 2_000  # importance weights in the record
MOST_K = 10.0  # weights of k above 1 have no mean
# Share of independence proposals by their expected acceptance.
SHARES = ((0.2, 0.9), (0.05, 0.6), (0.0, 0.2))
HAMILTONIAN, BESIDE = 0.8, 0.1  # shares where gradients do better, and of independence


@dataclass(frozen=True, eq=False)
class Recipe(Report):
    """How a chain begins.

    Attributes:
        moves: The moves for sampling.
        states: Where the ensembles are, with their random streams.
        evaluations: Log-posterior evaluations spent per ensemble.
        sentence: What was done, in words; empty if the moves were given.
        record: What was found, None if the moves were given: the frozen "proposal"
            (weights, means, scale matrices and degrees of freedom of a Student-t
            mixture), the separated group of each of its components ("group_of", -1
            for the wide one that belongs to none), each group's "weights" in the
            posterior by importance sampling and their "errors", how many climbs of
            each ensemble ended in it ("found_by") and the share of its walkers that
            "start" there, the "pareto_k", the "efficiency" (effective share) and
            some "log_weights" ln(p / q) of draws of the proposal (None where p is
            zero), the points and climbs that "searched", the "share" of independence
            proposals, and the arguments of a "hamiltonian" move where that pays.
    """

    moves: Moves
    states: list[emcee.State]
    evaluations: int
    sentence: str = ""
    record: Mapping[str, Any] | None = None

    def _parts(self) -> Parts:
        return (self.sentence or f"The moves were given: {self.moves!r}",)


def make_moves(record: Mapping[str, Any]) -> list[tuple[Move, float]]:
    """Return independence proposals, and local moves."""
    share = record["share"]
    moves: list[tuple[Move, float]] = []
    if share:
        moves.append((IndependenceMove(*record["proposal"]), share))
    if "hamiltonian" in record:
        moves.append((HamiltonianMove(*record["hamiltonian"]), HAMILTONIAN))
        share += HAMILTONIAN
    return [*moves, (DEMCMove(mode_jump=JUMPS), 1.0 - share)]


def describe(search: Search, trial: Trial) -> dict[str, Any]:
    """Return the record of a proposal; where the walkers start is added later."""
    law = trial.law
    group_of = separate(law)
    count = int(group_of.max()) + 1
    labels = label(trial.theta, law, group_of)
    weights, errors = weigh(labels, trial.log_weights, count)
    found = np.zeros((len(search.streams), count), dtype=int)
    tops = np.array([maximum.theta for maximum in search.maxima])
    for group, by in zip(label(tops, law, group_of), search.found_by, strict=True):
        found[:, group] += by
    kept = trial.log_weights[:: -(-len(trial.log_weights) // KEPT)]
    acceptance = trial.acceptance
    return {
        "proposal": [*(part.tolist() for part in law[:3]), law.df],
        "group_of": group_of.tolist(),
        "weights": weights,
        "errors": errors,
        "found_by": found.tolist(),
        "pareto_k": float(np.clip(trial.k, -MOST_K, MOST_K)),  # JSON has no inf
        "efficiency": trial.share,
        "log_weights": [w if np.isfinite(w) else None for w in kept.tolist()],
        "searched": [sum(len(points) for points, _ in search.own), search.climbs],
        "share": next(share for least, share in SHARES if acceptance >= least),
    }


def write_sentence(record: Mapping[str, Any], annealed: bool, solves: int) -> str:
    """Return what was done in words."""
    points, climbs = record["searched"]
    components, groups = len(record["proposal"][0]), len(record["weights"])
    shares = {type(move).__name__: share for move, share in make_moves(record)}
    steps = ", ".join(f"{100 * share:.0f} % {name}" for name, share in shares.items())
    found = "one group" if groups == 1 else f"{groups} separated groups"
    population = "an annealed population, " if annealed else ""
    return (
        f"a search by {points} points and {climbs} climbs found {found}; {population}"
        f"{components} Student-t components refined by importance weights, "
        f"{100 * record['efficiency']:.0f} % efficient (Pareto k "
        f"{record['pareto_k']:.2f}); {solves} evaluations in all; then {steps}"
    )
