"""Runs, and chains in the backends of emcee."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import overload

import emcee
import numpy as np
from emcee.backends import Backend

from ..contracts import Floats, Move
from ..evaluation.ensemble import describe_moves
from ..evaluation.failures import FailureLog
from ..moves.proposing import ladder_of
from ..posterior.log_posterior import LogPosterior
from ..search.record import ENDED, Chains, SearchRecord
from ..table import Parts, Report
from ..verdict.burn_in import find_burn_in


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
        doubts: Warnings that were given before the search or the starts.
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
        """Stored steps that tables and figures leave out; none after "auto".

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


def read_backends(
    backends: Sequence[Backend],
    betas: Floats,
    *,
    discard: int = 0,
    thin: int = 1,
    blobs: bool = False,
    hot: bool = False,
) -> Chains:
    """Return the chains that emcee backends hold, without names of parameters."""
    stored = min(backend.iteration for backend in backends)
    if not stored:
        raise ValueError("source: no step is stored; run the sampler first")
    steps = stored - discard
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
    draws, ensembles = gather("chain"), range(len(backends))
    if np.any(acceptance) and len({draws[:, e].tobytes() for e in ensembles}) < len(
        ensembles
    ):
        raise ValueError(
            "source: two ensembles hold the same chain, so that their agreement says "
            "nothing; give each sampler its own seed and starts"
        )
    return Chains(
        (),
        draws,
        gather("log_prob"),
        np.array(acceptance),
        gather("blobs") if blobs and backends[0].has_blobs() else None,
        betas=betas,
        discard=discard,
    )


def burn_in_of(backends: Sequence[Backend], betas: Floats) -> int:
    """Return the burn-in of chains in emcee backends, by the walkers of all betas."""
    steps = min(backend.iteration for backend in backends)
    if not steps:
        return 0
    chains = [backend.get_value("chain")[:steps] for backend in backends]
    return find_burn_in(np.stack(chains, axis=1), len(betas))
