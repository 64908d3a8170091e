"""What sampling leaves: runs, chains wherever they are, populations and searches."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Self, TypeAlias, overload

import emcee
import numpy as np
from emcee.backends import Backend
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import softmax

from ..contracts import Floats, Move, Prior
from ..evaluation.failures import FailureLog
from ..evaluation.samplers import describe_moves
from ..moves.delayed_acceptance import DelayedAcceptanceMove
from ..moves.demc import DEMCMove
from ..moves.hamiltonian import HamiltonianMove
from ..moves.independence import IndependenceMove
from ..moves.mixture import Mixture
from ..moves.proposing import ladder_of
from ..posterior.log_posterior import LogPosterior
from ..table import Column, Parts, Report, Table, unit_column
from .burn_in import find_burn_in
from .proposals import COVERS
from .response_surface import ResponseSurface

MODES_APART = 10.0  # squared distance of the centres, by the sum of the matrices
NO_MODE = -1  # the mode of components that cover the others and belong to none
JUMPS = 0.1  # of the DE-MC steps have gamma = 1
HAMILTONIAN = 0.8  # of the moves where gradients do better
STOPPED_BY_VERDICT, STOPPED_BY_SOLVES, STOPPED_BY_STEPS = "converged", "solves", "steps"
# The same in words.
ENDED = {
    STOPPED_BY_VERDICT: "it had converged",
    STOPPED_BY_SOLVES: "its solves were spent; resume=True with more goes on",
}
Labels: TypeAlias = NDArray[np.intp]


@dataclass(frozen=True, eq=False, repr=False)
class Run(Report, Sequence[emcee.EnsembleSampler]):
    """A run: emcee's samplers, one per ensemble, and how they were sampled.

    Attributes:
        samplers: One per ensemble; indexing and iterating the run returns them.
        posterior: The sampled posterior.
        seed: The seed of the run.
        moves: The moves of the first ensemble, with weights; each ensemble has its own
            copies.
        search: The result of the search of "auto"; None if the moves were given.
        evaluations: Number of log-posterior evaluations before the stored chains, in
            the search or for the starts.
        failures: The failed solves; None if a failure is an error.
        starts_given: Whether the walkers started from ``starts``.
        doubts: What was warned of before the search or the starts.
        stopped: Why it ended: "converged", "solves" or "steps"; empty while it goes on.
    """

    samplers: tuple[emcee.EnsembleSampler, ...]
    posterior: LogPosterior
    seed: int
    moves: list[tuple[Move, float]]
    search: SearchRecord | None
    evaluations: int
    failures: FailureLog | None
    starts_given: bool
    doubts: Sequence[str] = ()
    stopped: str = ""

    @property
    def solves(self) -> int:
        """Solves of all ensembles, including those before the stored chains."""
        return int(self.samplers[0].evaluator.whole.solves)

    @cached_property
    def burn_in(self) -> int:
        """Stored steps that tables and figures leave out; of "auto" there are none.

        ``run[0].get_chain()`` has them all.
        """
        if self.search is not None:
            return 0
        betas = ladder_of([move for move, _ in self.moves])
        return burn_in_of([sampler.backend for sampler in self], betas)

    def __len__(self) -> int:
        """Return the number of ensembles."""
        return len(self.samplers)

    @overload
    def __getitem__(self, index: int) -> emcee.EnsembleSampler: ...
    @overload
    def __getitem__(self, index: slice) -> Run: ...

    def __getitem__(self, index: int | slice) -> emcee.EnsembleSampler | Run:
        """Return the sampler of one ensemble, or a run of several."""
        if isinstance(index, slice):
            return replace(self, samplers=self.samplers[index])
        return self.samplers[index]

    def _parts(self) -> Parts:
        steps = [sampler.iteration for sampler in self.samplers]
        walkers = self.samplers[0].nwalkers
        ended = ENDED.get(self.stopped)
        yield (
            f"{len(self)} ensemble{'s' * (len(self) > 1)} of {walkers} walkers, "
            f"{min(steps)} steps"
            + (f" ({self.burn_in} of them burn-in)" if self.burn_in else "")
            + f", {self.solves:,} solves"
            + (f"; the run ended when {ended}" if ended else "")
        )
        how = self.search.sentence if self.search else describe_moves(self.moves)
        yield f"Moves: {how}"
        if self.failures is not None and self.failures.causes:
            yield f"Failed solves: {dict(self.failures.causes)}"


@dataclass(frozen=True, eq=False)
class Chains:
    """Chains of one posterior, and what is known of how they came about.

    Attributes:
        names: Parameter names.
        draws: ``(steps, ensembles, walkers, d)``; of a tempered run its cold walkers.
        log_prob: Log-posteriors ``(steps, ensembles, walkers)``.
        acceptance: Of each walker, ``(ensembles, walkers)``; NaN where not known.
        blobs: The rest of the rows, ``(steps, ensembles, walkers, columns - 1)``; None
            where there is none, or not asked for.
        posterior: What was sampled, None where it is not known.
        search: What "auto" found, None if it did not run.
        betas: Powers of the likelihood of the blocks of walkers; one if untempered.
        kind: "chain", "population" (annealed), or "weighted" (draws of a certificate).
        moves: In words.
        seed: In words.
        origin: How the chain began, in words.
        failures: Failed solves by cause.
        solves: Model solves spent; 0 where not known.
        starts_given: Whether the walkers started where a user said.
        doubts: What was warned of before the run, of the model or the prior.
        stopped: Why the run ended, as in :class:`Run`.
        discard: Stored steps that were left out before these, as burn-in.
        initial: The row at the prior mean, as of a file; None where not known.
        plain: Whether they are of emcee alone, and of nothing that :func:`run` takes.
        log_box: Of the box that is the prior of a bare log-likelihood; else NaN.
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
        effective_size: As many independent draws would know the mean as well, ``(d,)``.
        solves: Model solves spent.
        failed_solves: Of these, how many failed and were taken for impossible.
        problems: Why no standard error can be claimed; usually none.
        units: Of the parameters that have one, by name.
        doubts: What was warned of before.
        log_box: Of the box that is the prior of a bare log-likelihood; else NaN.
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

    def as_chains(self) -> Chains:
        """Return the members as one walker, in the order of their lineages."""
        return Chains(
            self.names,
            self.theta[:, None, None],
            self.rows[:, None, None, 0],
            self.acceptance[-1:, None],
            self.rows[:, None, None, 1:],
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
        columns: list[Column] = [
            ("parameter", "", list(self.names)),
            *unit_column(self.units.get(name, "") for name in self.names),
            ("mean", ".5g", self.theta.mean(axis=0)),
            ("sd", ".4g", self.theta.std(axis=0, ddof=1)),
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
                f"{self.failed_solves} solves failed: the evidence takes the "
                "likelihood for zero there"
            )


def about_box(log_box: float) -> Iterator[str]:
    """Say of what a bare log-probability's evidence is, if there is a box."""
    if np.isfinite(log_box):
        yield (
            "The prior is uniform in the box. For the integral of a function that "
            f"holds its prior already add {log_box:.4f}, ln of its volume."
        )


@dataclass(frozen=True, eq=False, repr=False)
class SearchRecord(Report):
    """The result of the search of "auto"; ``print`` it.

    A mode here is a separate part of the posterior: one component of the proposal, or
    several that overlap.

    Attributes:
        mixture: The frozen proposal; its last two components cover the others.
        mode_of: The mode of each component, -1 for those that cover.
        weights: Each mode's share of the posterior by importance sampling; NaN if
            unknown.
        errors: Standard errors of the weights.
        found_by: Climbs of each ensemble that ended in each mode, ``(ensembles, g)``.
        starts: Share of each ensemble's walkers that start there, ``(ensembles, g)``.
        pareto_k: Pareto k of the proposal's importance weights.
        efficiency: Effective share of these weights.
        log_weights: ln(p / q) of some draws of the proposal; -inf where p is zero.
        points: How many points were searched.
        climbs: How many climbs there were.
        annealed: Whether an annealed population was asked.
        solves: Evaluations in all.
        share: The share of independence proposals among the moves.
        trajectories: Arguments of a Hamiltonian move, where that pays; else None.
        screened: Independence proposals for each solve, by a response surface.
        surface: Arguments of that surface, where there is one and it is kept.
        from_prior: How many climbs began at draws of the prior, whatever their height.
        followed: By experiment, the number that each mode of the structure at the prior
            mean has at the maxima, ``(g, p)``; 0 where it lost its shape.
        kurtosis: Of each parameter, by the weighted draws, ``(d,)``; 0 if unknown.
    """

    mixture: Mixture
    mode_of: Labels
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

    @property
    def followed_in(self) -> int:
        """Solves by which modes were followed, which no evaluator counted."""
        return len(self.followed) * (len(self.weights) + 2)

    @property
    def proposal(self) -> IndependenceMove:
        """The frozen proposal as a move."""
        mixture = self.mixture
        return IndependenceMove(
            mixture.weights, mixture.means, mixture.matrices, mixture.df
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
            moves.append((HamiltonianMove(**self.trajectories), HAMILTONIAN))
            share += HAMILTONIAN
        return [*moves, (DEMCMove(mode_jump=JUMPS), 1.0 - share)]

    @property
    def sentence(self) -> str:
        """What was done, in words."""
        modes = len(self.weights)
        parts = [f"{100 * s:.0f} % {type(m).__name__}" for m, s in self.moves(None)]
        return (
            f"a search by {self.points} points and {self.climbs} climbs found "
            f"{'one mode' if modes == 1 else f'{modes} separated modes'}; "
            f"{'an annealed population, ' if self.annealed else ''}"
            f"{len(self.mixture.weights)} Student-t components refined by importance "
            f"weights, {100 * self.efficiency:.0f} % efficient (Pareto k "
            f"{self.pareto_k:.2f}); {self.solves} evaluations in all; then "
            f"{', '.join(parts)}"
        )

    def _parts(self) -> Parts:
        return (self.sentence,)

    def label(self, theta: Floats) -> Labels:
        """Return the mode of each point ``(n,)``."""
        return label(theta, self.mixture, self.mode_of)

    def to_json(self) -> dict[str, Any]:
        """Return the record as JSON types."""
        fields = asdict(self)
        fields["mixture"] = [*fields["mixture"].values()]
        return dict(json.loads(json.dumps(fields, default=np.ndarray.tolist)))

    @classmethod
    def from_json(cls, record: dict[str, Any]) -> Self:
        """Return the record that :meth:`to_json` wrote."""
        *lists, df = record["mixture"]
        weights, means, matrices = map(np.array, lists)
        mixture = Mixture(weights, means, matrices, df)
        return cls(**_as_arrays(record | {"mixture": mixture}))


def _as_arrays(value: Any) -> Any:
    """Return a value with arrays for lists, in mappings too."""
    if type(value) is dict:
        return {key: _as_arrays(part) for key, part in value.items()}
    return np.array(value) if type(value) is list else value


def read_backends(
    backends: Sequence[Backend],
    betas: Floats,
    *,
    discard: int = 0,
    thin: int = 1,
    blobs: bool = False,
    hot: bool = False,
) -> Chains:
    """Return what is stored in emcee backends, of walkers without names."""
    steps = min(backend.iteration for backend in backends) - discard
    if steps < thin:
        raise ValueError(f"discard: no steps are left after {discard} (thin={thin})")
    shapes = {backend.shape for backend in backends}
    if len(shapes) > 1:
        shape = "one shape (walkers, parameters)"
        raise ValueError(f"source: expected ensembles of {shape}, got {sorted(shapes)}")
    kept = slice(0, backends[0].shape[0] // (1 if hot else len(betas)))

    def gather(name: str) -> Floats:
        parts = [b.get_value(name, discard=discard, thin=thin) for b in backends]
        return np.stack([part[: steps // thin, kept] for part in parts], axis=1)

    acceptance = [backend.accepted[kept] / backend.iteration for backend in backends]
    return Chains(
        (),
        gather("chain"),
        gather("log_prob"),
        np.array(acceptance),
        gather("blobs") if blobs and backends[0].has_blobs() else None,
        betas=betas,
        discard=discard,
    )


def burn_in_of(backends: Sequence[Backend], betas: Floats) -> int:
    """Return the burn-in of chains in emcee backends, by the walkers of all betas."""
    if not min(backend.iteration for backend in backends):
        return 0
    chains = read_backends(backends, betas, hot=True)
    return find_burn_in(chains.draws, len(betas))


def separate(mixture: Mixture) -> Labels:
    """Return the mode of each component ``(k,)``; those that overlap share one.

    The last components cover the others and belong to none.
    """
    k = len(mixture.weights) - len(COVERS)
    apart = mixture.means[:k, None] - mixture.means[:k]
    sums = mixture.matrices[:k, None] + mixture.matrices[:k]
    solved = np.linalg.solve(sums, apart[..., None])[..., 0]
    distances = np.einsum("ijd,ijd->ij", apart, solved)
    modes = connected_components(distances < MODES_APART, directed=False)[1]
    return np.append(modes, [NO_MODE] * len(COVERS)).astype(np.intp)


def label(theta: Floats, mixture: Mixture, mode_of: Labels) -> Labels:
    """Return the mode of each point ``(n,)``: that of its likeliest component."""
    owners = np.flatnonzero(mode_of != NO_MODE)
    likeliest = np.argmax(mixture.log_parts(theta)[:, owners], axis=1)
    return np.asarray(mode_of[owners][likeliest])


def weigh(labels: Labels, log_weights: Floats, count: int) -> tuple[Floats, Floats]:
    """Return the weight of each mode by importance sampling, and standard errors."""
    if not np.isfinite(log_weights).any():
        return np.full(count, np.nan), np.full(count, np.nan)
    weights = softmax(log_weights)
    inside = labels[:, None] == np.arange(count)
    shares = weights @ inside
    return shares, np.sqrt(weights**2 @ (inside - shares) ** 2)
