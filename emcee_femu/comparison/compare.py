"""The same posterior under several moves: one table and one conclusion."""

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from warnings import warn

import numpy as np

from .. import checks
from ..interfaces import Floats, Model, Parameters
from ..moves.stock_faults import find_stock_fault
from ..posterior.log_posterior import LogPosterior
from ..results.diagnostics import FEWEST_STEPS, Diagnosis, diagnose
from ..results.inference_data import to_inference_data
from ..sampling.arguments import (
    check_moves,
    check_progress,
    check_walkers,
    count_cost,
    list_moves,
)
from ..sampling.run import run
from ..table import Parts, Report, Table
from .ranking import Entry, conclusion, known_moments, table


@dataclass(frozen=True, eq=False)
class Comparison(Report):
    """What :func:`.compare_moves` found; ``print`` it for the table and the conclusion.

    Attributes:
        table: One row per move.
        idata: ArviZ object of the kept steps, by label.
        diagnoses: :class:`.Diagnosis`, by label.
        ess_per_1000: Bulk ESS of the worst parameter per 1000 evaluations, one number
            per ensemble ``(ensembles,)``, by label.
        winner: Label of the move that is best beyond the spread; None if none is.
        conclusion: The outcome in words, one sentence per line.
        posterior: The sampled posterior.
    """

    table: Table
    idata: dict[str, Any]
    diagnoses: dict[str, Diagnosis]
    ess_per_1000: dict[str, Floats]
    winner: str | None
    conclusion: str
    posterior: LogPosterior = field(repr=False)

    def _parts(self) -> Parts:
        return self.table, self.conclusion


def compare_moves(
    posterior: LogPosterior,
    moves: Mapping[str, Any],
    nwalkers: int | None = None,
    nsteps: int | None = None,
    *,
    max_evaluations: int | None = None,
    ensembles: int = 4,
    seed: int,
    discard: int | None = None,
    reference: Mapping[str, tuple[float, float]] | None = None,
    progress: bool | str = False,
) -> Comparison:
    r"""Sample one posterior with several moves from the same starts, and rank them.

    .. math:: e = \frac{1000\, \min_j ESS_j}{N_{walkers}\, N_{kept}\, N_{ensembles}}

    A move wins if it has converged (:func:`diagnose`) and its e is ahead of that of
    every other converged move by more than two combined standard errors over the
    ensembles.

    Args:
        posterior: What to sample.
        moves: By label, what :func:`run` takes: an emcee move, a weighted list, or
            "auto".
        nwalkers: Walkers per ensemble; None for as many as :func:`run` takes, the
            most that any of the moves has.
        nsteps: Stored generations per ensemble. Give either this or max_evaluations.
        max_evaluations: Log-posterior evaluations that each move may spend on the
            stored chains of all ensembles; those of the starts and of the search of
            "auto" come on top and are reported. Where "auto" turns to Hamiltonian
            moves, whose trajectories cost several each, it spends more, and the
            conclusion says how many.
        ensembles: Independent ensembles, at least 2, started by draws from the prior.
        seed: A whole number, the same for every move.
        discard: Stored steps to drop as burn-in; None for a quarter of them.
        reference: Known ``(mean, sd)`` of the posterior by parameter name, some or all.
        progress: Whether to show a progress bar per ensemble (needs tqdm);
            "notebook" for the bar of notebooks (needs ipywidgets too).

    Returns:
        A table, its winner and a conclusion in words; ``print`` it.

    Raises:
        TypeError: If not exactly one of nsteps and max_evaluations is given, or an
            argument is of a wrong type.
        ValueError: If a move does not fit the ensemble, a number is out of range, or
            too few steps are left to judge. All are raised before sampling.
        ImportError: If progress is "notebook" and ipywidgets is not installed.

    Warns:
        UserWarning: If one of emcee's own moves is known, and found, to sample wrongly.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> moves = {"DE-MC": ef.DEMCMove(), "crossover": ef.CrossoverMove()}
        >>> comparison = ef.compare_moves(posterior, moves, 20, 20, ensembles=2, seed=1)
        >>> print(comparison.conclusion)
        No winner: no move has converged; run longer.
    """
    if not isinstance(posterior, LogPosterior):
        raise TypeError(
            f"posterior: expected a LogPosterior, got {type(posterior).__name__}"
        )
    ensembles = checks.whole_number("ensembles", ensembles, 2)
    seed = checks.whole_number("seed", seed)
    check_progress(progress)
    nwalkers = _check_moves(moves, nwalkers, posterior)
    most = max(count_cost(move) for move in moves.values())
    nsteps = _steps(nsteps, max_evaluations, round(nwalkers * ensembles * most))
    dropped = _count_dropped(discard, nsteps)
    known = known_moments(reference, posterior.names)
    # The same walkers and seed: all moves start from the same draws of the prior.
    size = {"nwalkers": nwalkers, "nsteps": nsteps, "ensembles": ensembles}
    entries = []
    for label, move in moves.items():
        if progress:
            print(f"{label}:", file=sys.stderr)  # the bars name only the ensemble
        settings = {**size, "seed": seed, "progress": progress}
        entries.append(_sample(posterior, label, move, dropped, settings))
    winner, words = conclusion(entries)
    if max_evaluations is not None:
        for entry in (own for own in entries if own.chain > max_evaluations):
            words += (
                f"\n{entry.label}: {entry.chain} evaluations of the chain, more than "
                f"max_evaluations, as it turned to Hamiltonian moves."
            )
    title = (
        f"Moves compared: {ensembles} ensembles of {nwalkers} walkers, the first "
        f"{dropped} of {nsteps} steps dropped; ESS per 1000 log-posterior evaluations"
    )
    return Comparison(
        table=table(title, entries, known),
        idata={entry.label: entry.idata for entry in entries},
        diagnoses={entry.label: entry.diagnosis for entry in entries},
        ess_per_1000={entry.label: entry.ess_per_1000 for entry in entries},
        winner=winner,
        conclusion=words,
        posterior=posterior,
    )


@dataclass(eq=False)
class _CountedModel:
    """A model that counts the parameter sets it is asked to solve."""

    model: Model
    solves: int = 0

    def __call__(self, parameters: Parameters) -> Any:
        response = self.model(parameters)
        self.solves += len(next(iter(parameters.values())))
        return response

    @property
    def jacobian(self) -> Any:
        """That of the model, counted; AttributeError where it has none."""
        jacobian = self.model.jacobian  # type: ignore[attr-defined]

        def counted(parameters: Parameters) -> Any:
            self.solves += len(next(iter(parameters.values())))
            return jacobian(parameters)

        return counted

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "model":  # as pickle asks for
            raise AttributeError(name)
        return getattr(self.model, name)


def _sample(
    posterior: LogPosterior,
    label: str,
    move: Any,
    dropped: int,
    settings: Mapping[str, Any],
) -> Entry:
    """Run one move and measure it."""
    counted = posterior.with_models(_CountedModel)
    clock = time.process_time()
    samplers = run(counted, move, **settings)
    cpu = time.process_time() - clock
    alone = [diagnose(own, dropped).ess_bulk.min() for own in samplers]
    used = [*zip(samplers[0]._moves, samplers[0]._weights, strict=True)]
    per_step = settings["ensembles"] * settings["nwalkers"] * count_cost(used)
    return Entry(
        label=label,
        diagnosis=diagnose(samplers, dropped),
        ess=np.array(alone),
        kept=round(per_step * (settings["nsteps"] - dropped)),
        chain=round(per_step * settings["nsteps"]),
        before=sum(int(getattr(own, "burn_in_evaluations", 0)) for own in samplers),
        solves=sum(e.model.solves for e in counted.experiments),  # type: ignore[attr-defined]
        cpu=cpu,
        recipe=samplers[0].recipe.sentence,
        idata=to_inference_data(samplers, posterior, dropped),
    )


def _steps(nsteps: Any, max_evaluations: Any, per_step: int) -> int:
    """Return the generations per ensemble."""
    if (nsteps is None) == (max_evaluations is None):
        raise TypeError(
            "nsteps, max_evaluations: expected exactly one of the two, got "
            f"nsteps={nsteps!r} and max_evaluations={max_evaluations!r}"
        )
    if max_evaluations is None:
        return checks.whole_number("nsteps", nsteps, 1)
    low = FEWEST_STEPS * per_step
    return checks.whole_number("max_evaluations", max_evaluations, low) // per_step


def _count_dropped(discard: int | None, nsteps: int) -> int:
    """Return the number of steps to drop."""
    dropped = nsteps // 4
    if discard is not None:
        dropped = checks.whole_number("discard", discard)
    if nsteps - dropped < FEWEST_STEPS:
        raise ValueError(
            f"discard: expected at least {FEWEST_STEPS} steps to judge, got "
            f"{max(nsteps - dropped, 0)} of {nsteps} (discard={dropped}); run longer, "
            "or drop less"
        )
    return dropped


def _check_moves(moves: Any, nwalkers: int | None, posterior: LogPosterior) -> int:
    """Return the walkers per ensemble; refuse what is not a move or does not fit.

    Warns:
        UserWarning: If one of emcee's moves samples wrongly.
    """
    if not isinstance(moves, Mapping) or not moves:
        raise TypeError(
            "moves: expected moves by label, such as {'DE-MC': DEMCMove()}, got "
            f"{type(moves).__name__}"
        )
    faults = []
    for label, move in moves.items():
        if not isinstance(label, str):
            raise TypeError(f"moves: expected labels that are text, got {label!r}")
        if not (isinstance(move, str) and move == "auto"):
            check_moves(f"moves[{label!r}]", move)
            found = (find_stock_fault(own, posterior.ndim) for own in list_moves(move))
            faults += [f"{label}: {fault}" for fault in found if fault]
    given = [[] if isinstance(move, str) else move for move in moves.values()]
    if nwalkers is None:
        nwalkers = max(check_walkers(None, move, posterior) for move in given)
    for move in given:
        nwalkers = check_walkers(nwalkers, move, posterior)
    if faults:
        warn("; ".join(dict.fromkeys(faults)), UserWarning, stacklevel=3)
    return nwalkers
