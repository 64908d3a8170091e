"""What is left to be judged: chains wherever they are, populations and searches."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from ..contracts import Floats, Move, Prior
from ..moves.delayed_acceptance import DelayedAcceptanceMove
from ..moves.demc import DEMCMove
from ..moves.hamiltonian import HamiltonianMove
from ..moves.independence import IndependenceMove
from ..moves.mixture import Mixture
from ..posterior.log_posterior import LOG_POSTERIOR, LogPosterior
from ..table import Column, Parts, Report, Table, number_columns
from .proposal import Labels, assign
from .response_surface import ResponseSurface

# Fields of a record in files of version 0.5, which had other names.
RENAMED = {"mode_of": "maximum_of"}
# Share of the DE-MC steps with gamma = 1, which jump between maxima.
JUMPS = 0.1
# Share of Hamiltonian moves where gradients do better, or of proposals that polynomials
# screen. These are wrong in places, which a walker leaves by the other moves. (H
# structure, beta 500, 200 steps, 5 seeds: it waits at most 77 steps instead of 139.)
BEST_SHARE = 0.8
STOPPED_BY_VERDICT, STOPPED_BY_SOLVES, STOPPED_BY_STEPS = "converged", "solves", "steps"
# The same in words.
ENDED = {
    STOPPED_BY_VERDICT: "it had converged",
    STOPPED_BY_SOLVES: "its solves were spent; with more of them (solves=), a run in a "
    "file goes on by resume=True",
}


@dataclass(frozen=True, eq=False)
class Chains:
    """Chains of one posterior, and what is known of how they came about.

    Attributes:
        names: Parameter names.
        draws: ``(steps, ensembles, walkers, d)``; of a tempered run its cold walkers.
        log_prob: Log-posteriors ``(steps, ensembles, walkers)``.
        acceptance: Acceptance of each walker, ``(ensembles, walkers)``; NaN if unknown.
        blobs: The rest of the rows, ``(steps, ensembles, walkers, columns - 1)``; None
            if there is none, or if it was not asked for.
        posterior: The sampled posterior, None if unknown.
        search: The record of "auto", None if it did not run.
        betas: Powers of the likelihood of the blocks of walkers; one if untempered.
        kind: "chain", "population" (annealed), or "weighted" (draws with weights).
        moves: The moves in words.
        seed: The seed in words.
        origin: How the chain began, in words.
        failures: Failed solves by cause.
        solves: Model solves spent; 0 if unknown.
        starts_given: Whether the walkers started where a user said.
        doubts: Warnings before the run, about the model or the prior.
        stopped: Why the run ended, as in :class:`Run`.
        discard: Stored steps that were left out before these, as burn-in.
        initial: The row at the prior mean, if a file has it; None if unknown.
        plain: Whether they are of emcee alone, without anything that :func:`run` takes.
        log_box: ln of the volume of the box that is the prior of a bare log-likelihood;
            NaN for any other prior.
    """

    names: tuple[str, ...]
    draws: Floats
    log_prob: Floats
    acceptance: Floats
    blobs: Floats | None = None
    posterior: LogPosterior | None = None
    search: SearchRecord | None = None
    betas: Floats = field(default_factory=lambda: np.ones(1))
    kind: str = "chain"
    moves: str = "unknown (read from a backend)"
    seed: str = "unknown (not started by run)"
    origin: str = ""
    failures: Mapping[str, int] = field(default_factory=dict)
    solves: int = 0
    starts_given: bool = False
    doubts: Sequence[str] = ()
    stopped: str = ""
    discard: int = 0
    initial: Floats | None = None
    plain: bool = False
    log_box: float = np.nan


@dataclass(frozen=True, eq=False, repr=False)
class Annealed(Report):
    """A population of the posterior and its history; ``print`` it.

    Attributes:
        names: Parameter names.
        theta: The members, ``(size, d)``, with equal weights.
        rows: Their rows as a LogPosterior returns them, ``(size, columns)``.
        powers: Powers of the likelihood from 0 to 1, ``(stages + 1,)``.
        acceptance: Share of accepted proposals at each power, ``(stages,)``.
        sweeps: Number of times all members were moved, ``(stages,)``.
        log_evidence: Natural logarithm of the evidence.
        log_evidence_error: Its Monte Carlo standard error; infinite where none can be
            claimed.
        effective_size: Number of independent draws that would estimate the mean equally
            well, ``(d,)``.
        solves: Model solves spent.
        failed_solves: How many of these failed, and were given a likelihood of zero.
        problems: Why no standard error can be claimed; usually none.
        units: Units of the parameters that have one, by name.
        doubts: Warnings that were given before.
        log_box: ln of the volume of the box that is the prior of a bare log-likelihood;
            NaN for any other prior.
        posterior: The annealed posterior.
    """

    names: tuple[str, ...]
    theta: Floats
    rows: Floats
    powers: Floats
    acceptance: Floats
    sweeps: NDArray[np.intp]
    log_evidence: float
    log_evidence_error: float
    effective_size: Floats
    solves: int
    failed_solves: int = 0
    problems: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    doubts: Sequence[str] = ()
    log_box: float = np.nan
    posterior: LogPosterior | None = None

    def as_chains(self) -> Chains:
        """Return the members as one walker, in the order of their lineages."""
        return Chains(
            self.names,
            self.theta[:, None, None],
            self.rows[:, None, None, LOG_POSTERIOR],
            self.acceptance[-1:, None],
            np.delete(self.rows, LOG_POSTERIOR, axis=1)[:, None, None],
            self.posterior,
            kind="population",
            moves="annealed",
            seed="unknown (annealed)",
            origin=(
                f"annealed through {len(self.sweeps)} powers of the likelihood, "
                f"{self.solves} solves"
            ),
            solves=self.solves,
            doubts=self.doubts,
        )

    @property
    def table(self) -> Table:
        """Mean, standard deviation and effective size, one row per parameter."""
        sd = self.theta.std(axis=0, ddof=1)
        unit, numbers = number_columns(
            (self.units.get(name, "") for name in self.names),
            [("mean", self.theta.mean(axis=0), sd), ("sd", sd, sd)],
        )
        columns: list[Column] = [
            ("parameter", "", list(self.names)),
            *unit,
            *numbers,
            ("effective size", ".0f", self.effective_size),
        ]
        return Table.from_columns(f"Population of {len(self.theta)}", columns)

    def _parts(self) -> Parts:
        error = f"+- {self.log_evidence_error:.3f}"
        if self.problems:
            error = "(no standard error can be given)"
        yield self.table
        yield f"log evidence (natural) {self.log_evidence:.3f} {error}"
        yield from (f"{text[:1].upper()}{text[1:]}." for text in self.problems)
        yield from about_box(self.log_box)
        yield (
            f"{len(self.sweeps)} powers of the likelihood, {self.solves} solves, "
            f"{100 * self.acceptance.min():.0f} to {100 * self.acceptance.max():.0f} % "
            "of the proposals accepted"
        )
        if self.failed_solves:
            yield (
                f"{self.failed_solves} solves failed: the evidence counts the "
                "likelihood there as zero"
            )


def about_box(log_box: float) -> Iterator[str]:
    """Say which prior the evidence of a bare log-probability has, if it is a box."""
    if np.isfinite(log_box):
        yield (
            "The prior is uniform in the box. If your function already includes its "
            f"prior, add {log_box:.4f}, ln of the volume of the box."
        )


@dataclass(frozen=True, eq=False, repr=False)
class SearchRecord(Report):
    """The result of the search of "auto"; ``print`` it.

    A maximum here is a separate part of the posterior: one component of the proposal,
    or several that overlap.

    Attributes:
        mixture: The frozen proposal; its defensive component covers the others.
        maximum_of: The maximum of each component, -1 for the defensive one.
        weights: Each maximum's share of the posterior by importance sampling; NaN if
            unknown.
        errors: Standard errors of the weights.
        found_by: Climbs of each ensemble that ended at each, ``(ensembles, g)``.
        starts: Share of each ensemble's walkers that start there, ``(ensembles, g)``.
        pareto_k: Pareto k of the proposal's importance weights.
        efficiency: Effective share of these weights.
        log_weights: ln(p / q) of some draws of the proposal; -inf where p is zero.
        points: How many points were searched.
        climbs: How many climbs there were.
        annealed: Whether an annealed population was used for the starts.
        solves: Evaluations in all.
        share: The share of independence proposals among the moves.
        trajectories: Arguments of a Hamiltonian move, where that pays; else None.
        screened: Independence proposals for each solve, by a response surface.
        surface: Arguments of that surface, where there is one and it is kept.
        from_prior: How many climbs began at draws of the prior, whatever their height.
        followed: By experiment, the number that each mode of the structure at the prior
            mean has at the maxima, ``(g, p)``; 0 where it lost its shape.
        kurtosis: Kurtosis of each parameter by weighted draws, ``(d,)``; 0 if unknown.
        spent: Solves by stage of the search, those before it first; empty if unknown.
        kinds: What each component is for: "core", "tail", "carrier" or "defensive";
            empty if unknown.
    """

    mixture: Mixture
    maximum_of: Labels
    weights: Floats
    errors: Floats
    found_by: NDArray[np.intp]
    starts: Floats
    pareto_k: float
    efficiency: float
    log_weights: Floats
    points: int
    climbs: int
    annealed: bool
    solves: int
    share: float
    trajectories: Mapping[str, Any] | None = None
    screened: int = 1
    surface: Mapping[str, Any] | None = None
    from_prior: int = 0
    followed: Mapping[str, Any] = field(default_factory=dict)
    kurtosis: Floats | float = 0.0
    spent: Mapping[str, int] = field(default_factory=dict)
    kinds: Sequence[str] | NDArray[np.str_] = ()

    @property
    def table(self) -> Table:
        """Solves by stage of the search."""
        stages = [(name, count) for name, count in self.spent.items() if count]
        names, counts = zip(*stages, strict=True) if stages else ((), ())
        columns: list[Column] = [
            ("stage", "", [name.replace("_", " ") for name in names]),
            ("solves", ",d", counts),
            ("share %", ".0f", [100 * count / self.solves for count in counts]),
        ]
        return Table.from_columns("Solves of the search", columns)

    @property
    def followed_in(self) -> int:
        """Solves spent on following modes, which no evaluator counted."""
        return len(self.followed) * (len(self.weights) + 2)

    @property
    def proposal(self) -> IndependenceMove:
        """The frozen proposal as a move."""
        mixture = self.mixture
        return IndependenceMove(
            mixture.weights, mixture.means, mixture.matrices, mixture.df, mixture.logs
        )

    def moves(self, prior: Prior | None) -> list[tuple[Move, float]]:
        """Return independence proposals and local moves.

        Args:
            prior: The prior of the posterior; None if nothing will be evaluated.
        """
        share = self.share
        moves: list[tuple[Move, float]] = []
        if self.surface is not None:
            surface = ResponseSurface(prior, **self.surface)
            screen = DelayedAcceptanceMove(self.proposal, surface, self.screened)
            moves.append((screen, share))
        elif share:
            moves.append((self.proposal, share))
        if self.trajectories is not None:
            moves.append((HamiltonianMove(**self.trajectories), BEST_SHARE))
            share += BEST_SHARE
        return [*moves, (DEMCMove(mode_jump=JUMPS), 1.0 - share)]

    @property
    def sentence(self) -> str:
        """The search in words."""
        count = len(self.weights)
        parts = [f"{100 * s:.0f} % {type(m).__name__}" for m, s in self.moves(None)]
        return (
            f"a search by {self.points:,} points and {self.climbs:,} climb"
            f"{'' if self.climbs == 1 else 's'} found "
            f"{'one maximum' if count == 1 else f'{count} separated maxima'}; "
            f"{'an annealed population, ' if self.annealed else ''}"
            f"{len(self.mixture.weights)} Student-t components refined by importance "
            f"weights, {100 * self.efficiency:.0f} % efficient (Pareto k "
            f"{self.pareto_k:.2f}); {self.solves:,} evaluations in all; then "
            f"{', '.join(parts)}"
        )

    def _parts(self) -> Parts:
        yield self.sentence
        if len(self.kinds):
            counts = Counter(map(str, self.kinds))
            listed = ", ".join(f"{count} {kind}" for kind, count in counts.items())
            yield f"Components: {listed}."
        if self.spent:
            yield self.table

    def label(self, theta: Floats) -> Labels:
        """Return the maximum of each point ``(n,)``."""
        return assign(theta, self.mixture, self.maximum_of)

    def to_json(self) -> dict[str, Any]:
        """Return the record as JSON types."""
        fields = asdict(self)
        fields["mixture"] = [*fields["mixture"].values()]
        return dict(json.loads(json.dumps(fields, default=np.ndarray.tolist)))

    @classmethod
    def from_json(cls, record: dict[str, Any]) -> Self:
        """Return the record that :meth:`to_json` wrote."""
        *lists, df, logs = [*record["mixture"], None][:5]  # in files of 0.5 no logs
        logs = None if logs is None else np.array(logs, dtype=bool)
        weights, means, matrices = map(np.array, lists)
        mixture = Mixture(weights, means, matrices, df, logs)
        fields = {RENAMED.get(name, name): value for name, value in record.items()}
        return cls(**_as_arrays(fields | {"mixture": mixture}))


def _as_arrays(value: Any) -> Any:
    """Return a value with arrays for lists, in mappings too."""
    if type(value) is dict:
        return {key: _as_arrays(part) for key, part in value.items()}
    return np.array(value) if type(value) is list else value


def weigh(labels: Labels, log_weights: Floats, count: int) -> tuple[Floats, Floats]:
    """Return the weight of each maximum by importance sampling, and standard errors."""
    if not np.isfinite(log_weights).any():
        return np.full(count, np.nan), np.full(count, np.nan)
    weights = softmax(log_weights)
    inside = labels[:, None] == np.arange(count)
    shares = weights @ inside
    return shares, np.sqrt(weights**2 @ (inside - shares) ** 2)
