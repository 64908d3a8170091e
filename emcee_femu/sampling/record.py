"""What sampling leaves: a run of emcee samplers, and chains wherever they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, overload

import emcee
import numpy as np

from ..contracts import Floats, Move
from ..evaluation.failures import FailureLog
from ..evaluation.samplers import describe_moves
from ..posterior.log_posterior import LogPosterior
from ..table import Parts, Report

if TYPE_CHECKING:
    from .search_record import SearchRecord


@dataclass(frozen=True, eq=False, repr=False)
class Run(Report, Sequence[emcee.EnsembleSampler]):
    """A run: emcee's samplers, one per ensemble, and what is known of them.

    Attributes:
        samplers: One per ensemble; indexing and iterating the run gives them.
        posterior: What was sampled.
        seed: Of the run.
        moves: Those of the first ensemble, with weights; each has copies of its own.
        search: What the search of "auto" found; None where the moves were given.
        evaluations: Log-posterior evaluations before the stored chains, of the search
            or the starts.
        failures: Solves that failed; None where a failure is an error.
        starts_given: Whether the walkers started from ``starts``.
        doubts: What was warned of before the search or the starts.
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

    @property
    def solves(self) -> int:
        """Solves of all ensembles, those before the stored chains too."""
        solves: int = self.samplers[0].evaluator.whole.solves
        return solves

    def __len__(self) -> int:
        """Return the number of ensembles."""
        return len(self.samplers)

    @overload
    def __getitem__(self, index: int) -> emcee.EnsembleSampler: ...
    @overload
    def __getitem__(self, index: slice) -> Run: ...

    def __getitem__(self, index: int | slice) -> emcee.EnsembleSampler | Run:
        """Return the sampler of an ensemble, or a run of some of them."""
        if isinstance(index, slice):
            return replace(self, samplers=self.samplers[index])
        return self.samplers[index]

    def _parts(self) -> Parts:
        steps = [sampler.iteration for sampler in self.samplers]
        walkers = self.samplers[0].nwalkers
        yield f"{len(self)} ensembles of {walkers} walkers, {min(steps)} steps"
        if self.search is not None:
            yield f"Moves: {self.search.sentence}"
        else:
            yield "Moves: " + describe_moves(self.moves)
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
        initial: The row at the prior mean, as of a file; None where not known.
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
    initial: Floats | None = None
