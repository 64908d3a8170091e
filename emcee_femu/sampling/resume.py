"""Where a run in a file begins, and how it goes on."""

import os
from typing import Any

from ..moves import IndependenceMove
from ..moves.tempering import find_ladder
from .arguments import list_moves
from .auto import Recipe, mixture, prepare
from .evaluation import Evaluation
from .manifest import check_same, describe_run
from .probe import probe
from .run_file import RunFile
from .run_file.log import COUNTS, check_new
from .starts import draw_starts


def begin_in_file(evaluation: Evaluation) -> tuple[list[RunFile], Recipe]:
    """Go on with the file of a run, or make it.

    Starts, moves and burn-in of "auto" are stored, so that they are not found again: a
    burn-in can cost as much as the chain. During it there is another file beside the
    file, ``.burn-in``.
    """
    settings = evaluation.settings
    path = str(settings.path)
    beside = f"{path}.burn-in"
    manifest = describe_run(settings)
    if not settings.resume:
        check_new(beside)
    if settings.resume and os.path.isfile(path):
        backends = _open(path, evaluation, manifest)
        recipe = _stored_recipe(evaluation, backends)
        _go_on(path, evaluation, backends, recipe.states)
    else:
        check_new(path)
        recipe = _begin(evaluation, beside, manifest)
        found = {}
        if settings.moves is None:
            found["recipe"] = _recipe_as_lists(recipe)
        elif ladder := find_ladder(list_moves(settings.moves)):
            found["betas"] = ladder.betas.tolist()  # the file tells its cold walkers
        backends = RunFile.create(
            path, recipe.states, {**manifest, **found}, _counts(evaluation)
        )
    if settings.moves is None and os.path.lexists(beside):
        _open(beside, evaluation, manifest)  # refuses the file of another run
        os.remove(beside)
    for own in backends:
        own.failures = evaluation.failures
    return backends, recipe


def _begin(evaluation: Evaluation, beside: str, manifest: dict[str, Any]) -> Recipe:
    """Return how a run begins that has no file yet, but may have that of a burn-in."""
    ensembles = evaluation.settings.ensembles
    if evaluation.settings.moves is not None:
        return prepare(evaluation, draw_starts(evaluation), [])
    if os.path.lexists(beside):
        stages = _open(beside, evaluation, manifest)
        states = [own.get_last_sample() for own in stages[:ensembles]]
        pairs = zip(states, stages[ensembles:], strict=True)
        latest = [s.get_last_sample() if s.iteration else state for state, s in pairs]
        _go_on(beside, evaluation, stages, latest)
    else:
        states = draw_starts(evaluation)
        stages = RunFile.create(beside, states, manifest, _counts(evaluation), 2)
    for own in stages:
        own.failures = evaluation.failures
    return prepare(evaluation, states, stages)


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
    path: str, evaluation: Evaluation, backends: list[RunFile], states: list[Any]
) -> None:
    """Probe the posterior, then count failures from where the file ends."""
    probe(evaluation, states, path)
    if evaluation.failures is not None:
        evaluation.failures.restore(backends[0].counts)


def _counts(evaluation: Evaluation) -> list[int]:
    log = evaluation.failures
    return [0] * COUNTS if log is None else log.counts


def _recipe_as_lists(recipe: Recipe) -> dict[str, Any]:
    moves: Any = recipe.moves
    (fitted, share), _ = moves
    laws = fitted.weights, fitted.means, fitted.scale_matrices
    return {
        "fitted": [*(law.tolist() for law in laws), fitted.df],
        "share": share,
        "evaluations": recipe.evaluations,
        "sentence": recipe.sentence,
    }


def _stored_recipe(evaluation: Evaluation, backends: list[RunFile]) -> Recipe:
    """Return where the ensembles are, and the moves to the bit."""
    states = [own.get_last_sample() for own in backends]
    if evaluation.settings.moves is not None:
        return prepare(evaluation, states, [])
    stored = backends[0].manifest["recipe"]
    moves = mixture(IndependenceMove(*stored["fitted"]), stored["share"])
    return Recipe(moves, states, stored["evaluations"], stored["sentence"])
