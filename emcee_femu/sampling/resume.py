"""Where a run in a file begins: its starts and moves as text, and how it goes on."""

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import emcee
import numpy as np

from ..moves import DEMCMove, IndependenceMove
from ..posterior.failures import FailureLog
from .auto import FIRST, Recipe
from .fingerprint import changing, differences, without
from .run_file import RunFile
from .run_file.creation import check_new

START = "start"  # the entry beside the fingerprint; not part of what must agree
STAGES = ("burn-in", "second-fit")  # of "auto", each in a file of its own


def place(path: str | PathLike[str]) -> str:
    """Return the absolute path, since a solver may change the directory.

    Raises:
        ImportError: If h5py is not installed.
        ValueError: If it is a directory, or there is no file and none can be made.
    """
    given = os.fspath(path)
    if os.path.isdir(given):
        raise ValueError(f"backend: expected the name of a file, got {given!r}")
    if not os.path.lexists(given):
        check_new(given)
    return os.path.abspath(given)


@dataclass(frozen=True)
class StoredRun:
    """A run in a file, and in files beside it during the burn-in of "auto".

    Attributes:
        path: The file.
        ensembles: How many.
        fingerprint: What is sampled and how, before anything was evaluated.
        describe: The same of now.
        log: Who counts failures, if anyone does.
    """

    path: str
    ensembles: int
    fingerprint: dict[str, str]
    describe: Callable[[], dict[str, str]]
    log: FailureLog | None

    def check_new(self) -> None:
        """Refuse to begin where there is something to go on with.

        Raises:
            ValueError: If the file exists, or one of a burn-in.
        """
        for path in [self.path, *(f"{self.path}.{stage}" for stage in STAGES)]:
            if os.path.lexists(path):
                raise ValueError(
                    f"backend: {path} exists; go on with it by resume=True, or give a "
                    "new file name"
                )

    def begin(
        self, moves: Any, automatic: bool, nsteps: int, first: Callable[..., Recipe]
    ) -> tuple[list[RunFile], Recipe]:
        """Go on with the file, or make it from ``first(backends=...)``.

        Starts and moves are stored, so that nothing is evaluated again when it goes
        on: a burn-in of "auto" can cost as much as the chain.

        Raises:
            ValueError: If the file is not that of such a run, naming every difference.
        """
        if os.path.lexists(self.path):
            backends, start = self._opened(self.path)
            states = [
                own.get_last_sample() if own.iteration else _state_of_lists(lists)
                for own, lists in zip(backends, start["states"], strict=True)
            ]
            if start["moves"] is not None:
                moves = _moves_of_lists(start["moves"])
            recipe = Recipe(moves, states, start["evaluations"], start["sentence"])
        else:
            recipe = first(backends=self._burn_in)
            start = {
                "states": [_state_as_lists(state) for state in recipe.states],
                "moves": _moves_as_lists(recipe.moves) if automatic else None,
                "evaluations": recipe.evaluations,
                "sentence": recipe.sentence,
            }
            backends = self._created(self.path, recipe.states, nsteps, start)
        for stage in STAGES:  # of which nothing is needed any more
            if automatic and os.path.lexists(f"{self.path}.{stage}"):
                self._opened(f"{self.path}.{stage}", counts=False)
                os.remove(f"{self.path}.{stage}")
        return backends, recipe

    def _burn_in(self, stage: str, states: list[emcee.State]) -> list[RunFile]:
        path = f"{self.path}.{stage}"
        if os.path.lexists(path):
            return self._opened(path)[0]
        return self._created(path, states, FIRST, {})

    def _created(
        self, path: str, states: list[emcee.State], nsteps: int, start: dict[str, Any]
    ) -> list[RunFile]:
        start |= {
            "counts": [] if self.log is None else self.log.counts,
            # What evaluations change, such as counters and caches, tells no two runs
            # apart.
            "volatile": changing(self.fingerprint, self.describe()),
        }
        nwalkers, ndim = states[0].coords.shape
        backends = RunFile.create(
            path,
            nwalkers,
            ndim,
            nsteps,
            blobs=states[0].blobs.shape[1],
            ensembles=self.ensembles,
            fingerprint={**self.fingerprint, START: json.dumps(start)},
        )
        return self._logged(backends)

    def _opened(
        self, path: str, counts: bool = True
    ) -> tuple[list[RunFile], dict[str, Any]]:
        """Return the backends of a file of this run, and what it began with."""
        backends = RunFile.resume(path, self.ensembles)
        stored = backends[0].fingerprint
        start = json.loads(stored.pop(START))
        volatile = start["volatile"]
        found = differences(
            without(stored, volatile), without(self.fingerprint, volatile)
        )
        if found:
            raise ValueError(
                f"resume: {path} holds a run of something else:\n  "
                + "\n  ".join(found)
                + "\nGo on with what it was, or give another file name"
            )
        if counts and self.log is not None:
            # One ensemble runs after the other, and the counts only grow.
            known = [start["counts"], *(own.counts for own in backends)]
            self.log.restore(max(known))
        return self._logged(backends), start

    def _logged(self, backends: list[RunFile]) -> list[RunFile]:
        for own in backends:
            own.log = self.log
        return backends


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
