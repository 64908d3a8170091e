"""The same posterior under several moves: one table and one conclusion."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ... import checks
from ...contracts import Floats, Move
from ...digits import show
from ...moves import HamiltonianMove
from ...posterior.log_posterior import LogPosterior
from ...results.arviz_objects import InferenceData, samples
from ...results.diagnose import diagnose
from ...results.to_arviz import to_inference_data
from ...sampling.arguments import Moves, check_walkers, weigh_moves
from ...sampling.record import Run
from ...sampling.run import run
from ...table import Column, Parts, Report, Table
from ...verdict.burn_in import FEWEST_STEPS
from ...verdict.diagnosis import Diagnosis

MOVE_LEAD = 2.0  # combined standard errors by which a winner must be ahead
UNSURE_PACE = 0.1  # of a pace per second, which changes with the machine's load


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Report):
    """The result of :func:`.compare_moves`; ``print`` it for table and conclusion.

    Attributes:
        table: One row per move.
        idata: ArviZ objects of the kept steps, by label.
        diagnoses: :class:`.Diagnosis` by label.
        ess_per_1000: Bulk ESS of the worst parameter per 1000 evaluations, one number
            per ensemble ``(ensembles,)``, by label.
        efficiency: The same for all ensembles together, and its standard error, by
            label.
        winner: Label of the move that is significantly better than the others; None if
            there is none.
        conclusion: The outcome in words, one sentence per line.
        posterior: The sampled posterior.
    """

    table: Table
    idata: dict[str, InferenceData]
    diagnoses: dict[str, Diagnosis]
    ess_per_1000: dict[str, Floats]
    efficiency: dict[str, tuple[float, float]]
    winner: str | None
    conclusion: str
    posterior: LogPosterior

    def _parts(self) -> Parts:
        return self.table, self.conclusion


def compare_moves(
    posterior: LogPosterior,
    moves: Mapping[str, Moves | str],
    nwalkers: int | None = None,
    steps: int | None = None,
    *,
    max_evaluations: int | None = None,
    ensembles: int = 4,
    seed: int,
    discard: int | None = None,
    reference: Mapping[str, tuple[float, float]] | None = None,
) -> Comparison:
    r"""Sample one posterior with several moves from the same starts, and rank them.

    .. math:: e = \frac{1000\, \min_j ESS_j}{N_{walkers}\, N_{kept}\, N_{ensembles}}

    Use it to choose a move for a posterior, or to test a move of your own. A move wins
    if it has converged (:func:`diagnose`) and its efficiency e exceeds that of every
    other converged move by more than two combined standard errors over the ensembles.

    Args:
        posterior: The posterior to sample.
        moves: ``{label: moves}``, where moves is an emcee move, a weighted list, or
            "auto", as in :func:`run`.
        nwalkers: Walkers per ensemble. By default it is the default of :func:`run`, the
            largest for any of the moves.
        steps: Stored generations per ensemble. Give either steps or max_evaluations.
        max_evaluations: Number of log-posterior evaluations for each move's stored
            chains, over all ensembles. Evaluations for the starts and for the search of
            "auto" are added and reported. If "auto" chooses Hamiltonian moves, whose
            trajectories cost several evaluations each, it exceeds this number, and the
            conclusion says by how much.
        ensembles: Number of independent ensembles, at least 2, started from draws of
            the prior.
        seed: A whole number, the same for every move.
        discard: Stored steps to drop as burn-in. None for those that each run finds
            itself, at most half of them; "auto" has none.
        reference: Known ``(mean, sd)`` of the posterior by parameter name, for some or
            all parameters.

    Returns:
        A table, its winner and a conclusion in words; ``print`` it.

    Raises:
        TypeError: If not exactly one of steps and max_evaluations is given, or an
            argument has the wrong type.
        ValueError: If a move does not suit the ensemble, a number is out of range, or
            too few steps are left to judge. All are raised before sampling.

    Warns:
        UserWarning: If one of emcee's own moves is known to sample incorrectly.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> moves = {"DE-MC": ef.DEMCMove(), "jumps": ef.DEMCMove(mode_jump=0.1)}
        >>> comparison = ef.compare_moves(posterior, moves, 20, 20, ensembles=2, seed=1)
        >>> print(comparison.conclusion)
        No winner: no move has converged; run longer.
    """
    checks.instance("posterior", posterior, LogPosterior)
    ensembles = checks.whole_number("ensembles", ensembles, 2)
    seed = checks.whole_number("seed", seed)
    weighted = _weigh(moves)
    if nwalkers is None:
        nwalkers = max(check_walkers(None, w, posterior) for w in weighted.values())
    for pairs in weighted.values():
        nwalkers = check_walkers(nwalkers, pairs, posterior)
    costs = [_count_cost(pairs) for pairs in weighted.values() if pairs is not None]
    per_step = round(nwalkers * ensembles * max(costs, default=1.0))
    steps = _count_steps(steps, max_evaluations, per_step)
    most = 0 if discard is None else checks.whole_number("discard", discard)
    if steps - most < FEWEST_STEPS:
        raise ValueError(
            f"discard: expected at least {FEWEST_STEPS} steps to judge, got "
            f"{max(steps - most, 0)} of {steps} after a burn-in of {most}; run longer, "
            "or drop less"
        )
    moments = _check_reference(reference, posterior.names)
    entries = []
    for label, move in moves.items():
        # The same walkers and seed: all moves start from the same draws of the prior.
        clock = time.process_time()
        sampled = run(posterior, move, nwalkers, steps, ensembles=ensembles, seed=seed)
        cpu = time.process_time() - clock
        burnt = sampled.burn_in if discard is None else most
        entries.append(Entry(label, sampled, burnt, cpu))
    winner, words = conclude(entries)
    for entry in entries:
        if max_evaluations is not None and entry.chain > max_evaluations:
            words += (
                f"\n{entry.label}: its chain took {entry.chain} evaluations, more than "
                "max_evaluations, because it changed to Hamiltonian moves."
            )
    title = (
        f"Moves compared: {ensembles} ensembles of {nwalkers} walkers, {steps} steps; "
        "ESS per 1000 log-posterior evaluations"
    )
    return Comparison(
        table=_tabulate(title, entries, moments),
        idata={entry.label: entry.idata for entry in entries},
        diagnoses={entry.label: entry.diagnosis for entry in entries},
        ess_per_1000={entry.label: entry.ess_per_1000 for entry in entries},
        efficiency={entry.label: (entry.efficiency, entry.error) for entry in entries},
        winner=winner,
        conclusion=words,
        posterior=posterior,
    )


def _weigh(
    moves: Mapping[str, Moves | str],
) -> dict[str, list[tuple[Move, float]] | None]:
    """Return the weighted moves by label, None for "auto"; refuse what is no move."""
    weighted: dict[str, list[tuple[Move, float]] | None] = {}
    example = "moves, such as {'DE-MC': DEMCMove()}"
    for label, move in checks.by_label("moves", moves, example).items():
        argument = f"moves[{label!r}]"
        weighted[label] = None if move == "auto" else weigh_moves(move, argument)
    return weighted


def _count_cost(weighted: Sequence[tuple[Move, float]]) -> float:
    """Return the evaluations per walker and generation of weighted moves."""
    costs = [m.steps if isinstance(m, HamiltonianMove) else 1 for m, _ in weighted]
    return float(np.average(costs, weights=[weight for _, weight in weighted]))


def _count_steps(steps: int | None, max_evaluations: int | None, per_step: int) -> int:
    """Return the generations per ensemble."""
    if (steps is None) == (max_evaluations is None):
        raise TypeError(
            "steps, max_evaluations: expected exactly one of the two, got "
            f"steps={steps!r} and max_evaluations={max_evaluations!r}"
        )
    if max_evaluations is None:
        return checks.whole_number("steps", steps, 1)
    low = FEWEST_STEPS * per_step
    return checks.whole_number("max_evaluations", max_evaluations, low) // per_step


def _check_reference(
    reference: Mapping[str, tuple[float, float]] | None, names: Sequence[str]
) -> dict[str, Floats]:
    """Return mean and sd by parameter name; empty if there is no reference."""
    moments = {}
    for name, pair in checks.by_name("reference", reference or {}, names).items():
        moments[name] = moment = checks.real_array(f"reference[{name!r}]", pair, 1)
        if moment.shape != (2,) or not moment[1] > 0:
            raise ValueError(
                f"reference[{name!r}]: expected (mean, sd), sd above zero, got {pair!r}"
            )
    return moments


class Entry:
    """What one move achieved; evaluations are those of the log-posterior.

    Args:
        label: The move's name.
        run: The run.
        burnt: Stored steps that are dropped as burn-in.
        cpu: CPU seconds, in total.

    Attributes:
        label: The move's name.
        burnt: Stored steps that were dropped as burn-in.
        diagnosis: The judgement of all its ensembles.
        run: The run.
        idata: ArviZ object of the kept steps.
        chain: Evaluations of all stored steps.
        ess_per_1000: ESS of the worst parameter per 1000 evaluations of the kept steps,
            of each ensemble, ``(ensembles,)``.
        efficiency: ESS of all ensembles per 1000 evaluations of the kept steps.
        error: Standard error of the efficiency, from the spread of the ensembles.
        end_to_end: ESS per 1000 evaluations, including the burn-in and everything
            before.
        per_cpu_second: ESS per CPU second of the kept steps, assuming a constant pace.
    """

    def __init__(self, label: str, run: Run, burnt: int, cpu: float) -> None:
        self.label, self.run, self.burnt = label, run, burnt
        self.diagnosis = diagnose(run, burnt)
        self.idata = to_inference_data(run, discard=burnt)
        evaluations = len(run) * run[0].nwalkers * _count_cost(run.moves)
        kept = round(evaluations * (run[0].iteration - burnt))
        self.chain: int = round(evaluations * run[0].iteration)
        ess = [diagnose(sampler, burnt).ess_bulk.min() for sampler in run]
        self.ess_per_1000: Floats = 1000 * len(run) * np.array(ess) / kept
        self.error = float(self.ess_per_1000.std(ddof=1) / np.sqrt(len(run)))
        every = float(self.diagnosis.ess_bulk.min())
        self.efficiency = 1000 * every / kept
        self.end_to_end = 1000 * every / (self.chain + run.evaluations)
        self.per_cpu_second = every * (self.chain + run.evaluations) / kept / cpu

    def __str__(self) -> str:
        """Return label, efficiency and its standard error."""
        efficiency, error = show([self.efficiency, self.error], self.error)
        return f"{self.label} {efficiency} +- {error}"


def _tabulate(
    title: str, entries: Sequence[Entry], moments: Mapping[str, Floats]
) -> Table:
    """Tabulate the moves, one row each, with numbers of the worst parameter.

    Solves are those of the whole run; "before chain" are evaluations for the starts
    and the search of "auto"; "burn-in" are the steps
    that were left out; ESS per 1000 counts evaluations of the kept steps, +- is
    its standard error over the ensembles; "end to end" counts all evaluations. Errors
    are the largest against a reference, in its standard deviations.
    """
    diagnoses = [entry.diagnosis for entry in entries]
    efficiency, error = [e.efficiency for e in entries], [e.error for e in entries]
    pace = [e.per_cpu_second for e in entries]
    columns: list[Column] = [
        ("move", "", [e.label for e in entries]),
        ("solves", "d", [e.run.solves for e in entries]),
        ("before chain", "d", [e.run.evaluations for e in entries]),
        ("burn-in", "d", [e.burnt for e in entries]),
        ("acceptance", ".2f", [float(d.acceptance.mean()) for d in diagnoses]),
        ("tau", ".0f", [float(d.tau.max()) for d in diagnoses]),
        ("steps/tau", ".0f", [float(d.steps_per_tau.min()) for d in diagnoses]),
        ("ESS bulk", ".0f", [float(d.ess_bulk.min()) for d in diagnoses]),
        ("ESS tail", ".0f", [float(d.ess_tail.min()) for d in diagnoses]),
        ("ESS per 1000", show(efficiency, error), efficiency),
        ("+-", show(error, error), error),
        ("ESS per CPU s", show(pace, UNSURE_PACE * np.array(pace)), pace),
        ("R-hat ensembles", ".3f", [float(d.rhat_between.max()) for d in diagnoses]),
    ]
    if moments:
        off = [_errors(entry.idata, moments) for entry in entries]
        columns.append(("mean error/sd", ".3f", [mean for mean, _ in off]))
        columns.append(("sd error %", ".1f", [sd for _, sd in off]))
    columns += [
        ("end to end", ".3g", [e.end_to_end for e in entries]),
        ("verdict", "", [d.chains.short for d in diagnoses]),
    ]
    return Table.from_columns(title, columns)


def _errors(idata: InferenceData, moments: Mapping[str, Floats]) -> tuple[float, float]:
    """Return the largest error of a mean in sds, and of an sd in percent."""
    draws = samples(idata, list(moments))[1].reshape(-1, len(moments))
    mean, sd = np.array(list(moments.values())).T
    off_sd = 100 * np.abs(draws.std(axis=0, ddof=1) / sd - 1)
    return float(np.abs((draws.mean(axis=0) - mean) / sd).max()), float(off_sd.max())


def conclude(entries: Sequence[Entry]) -> tuple[str | None, str]:
    """Return the label of the winner, or None, and the outcome, one sentence per line.

    The winner has converged, and leads every other converged move by more than two
    combined standard errors.
    """
    ranked = sorted(entries, key=lambda entry: -entry.efficiency)
    able = [entry for entry in ranked if entry.diagnosis.converged]
    winner, lines = None, []
    if not able:
        lines.append("No winner: no move has converged; run longer.")
    else:
        best, *others = able
        lead = {e: best.efficiency - e.efficiency for e in others}
        close = [
            e for e in others if lead[e] <= MOVE_LEAD * np.hypot(best.error, e.error)
        ]
        if close:
            names = [str(entry) for entry in (best, *close)]
            lines.append(
                f"No winner: {', '.join(names[:-1])} and {names[-1]} are within the "
                "spread of the ensembles (ESS per 1000 evaluations)."
            )
        else:
            winner = best.label
            rest = f"the next is {others[0]}" if others else "no other has converged"
            lines.append(f"Winner: {best} ESS per 1000 evaluations; {rest}.")
        first = max(able, key=lambda entry: entry.end_to_end)
        if first is not best:
            lines.append(
                f"End to end, with burn-in counted, {first.label} is ahead: "
                f"{first.end_to_end:.3g} against {best.end_to_end:.3g} of {best.label}."
            )
    unfit = [f"{e.label} ({e.diagnosis.chains.short})" for e in ranked if e not in able]
    if unfit and able:
        lines.append(f"Not converged, so excluded: {', '.join(unfit)}.")
    lines += [
        f"{entry.label}: {entry.run.search.sentence}."
        for entry in entries
        if entry.run.search is not None
    ]
    return winner, "\n".join(lines)
