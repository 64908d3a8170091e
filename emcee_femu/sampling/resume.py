"""Where a run in a file begins, and how it goes on."""

import os
from typing import Any

from ..moves.tempering import find_ladder
from .arguments import list_moves
from .auto import Budget, find_recipe, plan
from .evaluation import Evaluation
from .journal import Journal
from .manifest import check_same, describe_run
from .probe import probe
from .recipe import Recipe, make_moves
from .run_file import RunFile
from .run_file.log import COUNTS, check_new
from .starts import draw_starts


def begin_in_file(evaluation: Evaluation) -> tuple[list[RunFile], Recipe]:
    """Go on with the file of a run, or make it.

    Starts and what "auto" found are stored, so that they are not sought again: a search
    can cost as much as the chain. During it there is another file beside the file,
    ``.burn-in``, a :class:`Journal`.
    """
    settings = evaluation.settings
    path = str(settings.path)
    manifest = describe_run(settings)
    if not settings.resume and settings.moves is None:
        check_new(_beside(path))
    if settings.resume and os.path.isfile(path):
        backends = _open(path, evaluation, manifest)
        recipe = _stored_recipe(evaluation, backends)
        _go_on(path, evaluation, backends[0].counts, recipe.states)
    else:
        check_new(path)
        found = {}
        if settings.moves is None:
            recipe = _search(_beside(path), evaluation, manifest)
            found["recipe"] = {
                "record": recipe.record,
                "evaluations": recipe.evaluations,
                "sentence": recipe.sentence,
            }
        else:
            recipe = start_given(evaluation)
            if ladder := find_ladder(list_moves(settings.moves)):
                found["betas"] = ladder.betas.tolist()  # the file tells its cold ones
        backends = RunFile.create(
            path, recipe.states, {**manifest, **found}, _counts(evaluation)
        )
    if settings.moves is None and os.path.lexists(_beside(path)):
        # Killed between making one file and removing the other; not that of another.
        _open_journal(_beside(path), evaluation, manifest)
        os.remove(_beside(path))
    for own in backends:
        own.failures = evaluation.failures
    return backends, recipe


def start_given(evaluation: Evaluation) -> Recipe:
    """Return how a chain of given moves begins."""
    settings = evaluation.settings
    states = draw_starts(evaluation)
    return Recipe(settings.moves, states, settings.nwalkers)


def _beside(path: str) -> str:
    return f"{path}.burn-in"


def _search(beside: str, evaluation: Evaluation, manifest: dict[str, Any]) -> Recipe:
    """Run the search, or go on with the one that the file beside holds."""
    settings = evaluation.settings
    journal = _open_journal(beside, evaluation, manifest)
    journal.probe(settings.probe_tolerance)
    return find_recipe(journal, settings, Budget(*journal.header["budget"]))


def _open_journal(
    beside: str, evaluation: Evaluation, manifest: dict[str, Any]
) -> Journal:
    budget = plan(evaluation.settings)
    return Journal(evaluation, beside, {"manifest": manifest, "budget": budget})


def _open(path: str, evaluation: Evaluation, manifest: dict[str, Any]) -> list[RunFile]:
    """Open a file of this run to append to it, or refuse it."""
    backends = RunFile.open(path)
    check_same(path, backends[0].manifest, manifest)
    done = max(own.iteration for own in backends)
    if path == evaluation.settings.path and done > evaluation.settings.nsteps:
        raise ValueError(
            f"nsteps: expected at least the {done} steps that {path} holds already, "
            f"got {evaluation.settings.nsteps}"
        )
    return backends


def _go_on(
    path: str, evaluation: Evaluation, counts: list[int], states: list[Any]
) -> None:
    """Probe the posterior, then count failures from where the file ends."""
    probe(evaluation, states, path, evaluation.settings.probe_tolerance)
    if evaluation.failures is not None:
        evaluation.failures.restore(counts)


def _counts(evaluation: Evaluation) -> list[int]:
    log = evaluation.failures
    return [0] * COUNTS if log is None else log.counts


def _stored_recipe(evaluation: Evaluation, backends: list[RunFile]) -> Recipe:
    """Return where the ensembles are, and the moves to the bit."""
    states = [own.get_last_sample() for own in backends]
    settings = evaluation.settings
    if settings.moves is not None:
        return Recipe(settings.moves, states, settings.nwalkers)
    stored = backends[0].manifest["recipe"]
    return Recipe(
        make_moves(stored["record"]),
        states,
        stored["evaluations"],
        stored["sentence"],
        stored["record"],
    )
