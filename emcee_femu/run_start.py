"""Where a run in a file begins: its starts and moves as text, and how it goes on."""

import json
from collections.abc import Sequence
from os import PathLike
from typing import Any

import emcee
import numpy as np

from .auto import Recipe
from .fingerprint import differences
from .moves import DEMCMove, IndependenceMove
from .run_file import RunFile

START = "start"  # the entry beside the fingerprint; not part of what must agree


def create(
    path: str | PathLike[str],
    nsteps: int,
    fingerprint: dict[str, str],
    recipe: Recipe,
    automatic: bool,
) -> list[RunFile]:
    """Make the file of a run that has its starts and its moves.

    Both are stored, so that nothing is evaluated again when it goes on: a burn-in of
    "auto" can cost as much as the chain.
    """
    first = recipe.states[0]
    text = json.dumps(
        {
            "states": [_state_as_lists(state) for state in recipe.states],
            "moves": _moves_as_lists(recipe.moves) if automatic else None,
            "evaluations": recipe.evaluations,
            "sentence": recipe.sentence,
        }
    )
    return RunFile.create(
        path,
        len(first.coords),
        first.coords.shape[1],
        nsteps,
        blobs=first.blobs.shape[1],
        ensembles=len(recipe.states),
        fingerprint={**fingerprint, START: text},
    )


def resume(
    path: str | PathLike[str], ensembles: int, fingerprint: dict[str, str], moves: Any
) -> tuple[list[RunFile], Recipe]:
    """Open the file of a run, and return how each ensemble goes on.

    Raises:
        ValueError: If the file is not that of such a run, naming every difference.
    """
    backends = RunFile.resume(path, ensembles)
    stored = backends[0].fingerprint
    start = json.loads(stored.pop(START))
    found = differences(stored, fingerprint)
    if found:
        raise ValueError(
            f"resume: {path} holds a run of something else:\n  "
            + "\n  ".join(found)
            + "\nGo on with what it was, or give another file name"
        )
    states = [
        backend.get_last_sample() if backend.iteration else _state_of_lists(lists)
        for backend, lists in zip(backends, start["states"], strict=True)
    ]
    if start["moves"] is not None:
        moves = _moves_of_lists(start["moves"])
    return backends, Recipe(moves, states, start["evaluations"], start["sentence"])


def _state_as_lists(state: emcee.State) -> dict[str, Any]:
    name, key, *rest = state.random_state
    return {
        "coords": state.coords.tolist(),
        "log_prob": state.log_prob.tolist(),
        "blobs": state.blobs.tolist(),
        "random_state": [name, key.tolist(), *rest],
    }


def _state_of_lists(lists: dict[str, Any]) -> emcee.State:
    name, key, *rest = lists["random_state"]
    return emcee.State(
        np.array(lists["coords"]),
        np.array(lists["log_prob"]),
        np.array(lists["blobs"]),
        (name, np.array(key, dtype=np.uint32), *rest),
    )


def _moves_as_lists(moves: Sequence[tuple[Any, float]]) -> dict[str, Any]:
    """Return the mixture of "auto": an independence proposal and DE-MC."""
    (fitted, share), (local, other) = moves
    return {
        "weights": fitted.weights.tolist(),
        "means": fitted.means.tolist(),
        "scale_matrices": fitted.scale_matrices.tolist(),
        "df": fitted.df,
        "mode_jump": local.mode_jump,
        "shares": [share, other],
    }


def _moves_of_lists(lists: dict[str, Any]) -> list[tuple[Any, float]]:
    laws = (lists[name] for name in ("weights", "means", "scale_matrices", "df"))
    share, other = lists["shares"]
    fitted = IndependenceMove(*laws)
    return [(fitted, share), (DEMCMove(mode_jump=lists["mode_jump"]), other)]
