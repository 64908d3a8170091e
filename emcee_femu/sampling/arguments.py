"""What ``run`` is asked for: one record, and the checks that come before it."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, TypeAlias

import emcee
import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Backend, Floats, Move
from ..moves.stock_faults import refuse_sequential
from ..moves.tempering import find_ladder
from ..posterior.log_posterior import LogPosterior

Moves: TypeAlias = Move | Sequence[Move] | Sequence[tuple[Move, float]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Settings:
    """The arguments of :func:`run`, checked, some of them resolved.

    Attributes:
        moves: Emcee moves, None if they are to be found.
        initial: Starts ``(ensembles, nwalkers, ndim)``, or None.
        backends: One per ensemble, None for emcee's own.
        path: The file instead, or None.
    """

    posterior: LogPosterior
    moves: Moves | None
    nwalkers: int
    nsteps: int
    ensembles: int
    seed: int
    vectorize: bool
    backends: list[Backend | None]
    path: str | None
    thin_by: int
    progress: bool | str
    initial: Floats | None
    resume: bool
    on_failure: str
    max_failures: float
    probe_tolerance: float


def check_moves(argument: str, moves: Any) -> None:
    """Refuse what emcee would take for a move, a list of moves or weighted pairs."""
    given = list_moves(moves)
    if not given:
        raise ValueError(f"{argument}: expected at least one move, got none")
    for move in given:
        if isinstance(move, type) or not hasattr(move, "propose"):
            raise TypeError(
                f"{argument}: expected an emcee move, a list of moves or of (move, "
                f"weight), got {move!r}"
            )
    listed = moves if isinstance(moves, Sequence) else []
    pairs = [item for item in listed if isinstance(item, Sequence)]
    if not pairs:
        return
    if len(pairs) < len(moves) or any(len(pair) != 2 for pair in pairs):
        raise TypeError(
            f"{argument}: expected (move, weight) throughout, got {moves!r}"
        )
    name = f"{argument} (their weights)"
    weights = [checks.real_number(name, weight, 0.0) for _, weight in pairs]
    if not sum(weights) > 0:
        raise ValueError(f"{argument}: expected a weight above zero, got {weights}")


def list_moves(moves: Any) -> list[Any]:
    """Return the moves of what emcee accepts: a move, a list, or weighted pairs."""
    if not isinstance(moves, Sequence):
        return [moves]
    return [
        item[0] if isinstance(item, Sequence) and len(item) else item for item in moves
    ]


def count_cost(moves: Any) -> float:
    """Return the evaluations per walker and generation; of "auto" they are not known.

    A walker that another move has moved costs a Hamiltonian one another evaluation.
    """
    if isinstance(moves, str):
        return 1.0
    costs = [float(getattr(move, "cost", 1)) for move in list_moves(moves)]
    pairs = [i for i in moves if isinstance(i, Sequence)] if len(costs) > 1 else []
    return float(np.average(costs, weights=[pair[1] for pair in pairs] or None))


def check_walkers(nwalkers: Any, moves: Any, posterior: LogPosterior) -> int:
    """Return the walkers per ensemble, by default what is usual for the moves."""
    ndim = posterior.ndim
    given = list_moves(moves)
    tempered = find_ladder(given)  # refuses temperatures that differ
    if nwalkers is None:
        usual = max(16, 4 * ndim)
        nwalkers = tempered.default_walkers(ndim) if tempered else usual
    number = checks.whole_number("nwalkers", nwalkers, 1)
    for move in given:
        refuse_sequential("moves", move)
        if hasattr(move, "check"):
            move.check(number, ndim)
        if hasattr(move, "check_with"):
            move.check_with(posterior)
    return number


def check_progress(progress: Any) -> bool | str:
    """Return True, False or the name of a bar of tqdm."""
    if not isinstance(progress, str):
        return checks.flag("progress", progress)
    bars = emcee.pbar.tqdm
    if bars is not None and not hasattr(bars, f"tqdm_{progress}"):
        raise ValueError(
            f"progress: expected True, False or a bar of tqdm, such as 'notebook', got "
            f"{progress!r}"
        )
    if bars is not None and progress == "notebook" and find_spec("ipywidgets") is None:
        raise ImportError(
            "progress: 'notebook' needs ipywidgets: pip install "
            "'emcee-femu[notebooks]'; or take progress=True, which needs none"
        )
    return progress


def check_starts(
    initial: ArrayLike | None, posterior: LogPosterior, ensembles: int, nwalkers: int
) -> Floats | None:
    """Return given starts ``(ensembles, nwalkers, ndim)``, all inside the bounds."""
    if initial is None:
        return None
    # A copy in double precision: emcee would truncate steps from integer starts.
    starts = checks.real_array("initial", initial)
    if starts.ndim == 2 and ensembles == 1:
        starts = starts[None]
    expected = (ensembles, nwalkers, posterior.ndim)
    if starts.shape != expected:
        raise ValueError(
            f"initial: expected shape {expected} (ensembles, nwalkers, ndim), got "
            f"{starts.shape}"
        )
    for start in starts:
        posterior.check_inside("initial", start)
    return starts


def check_file(backend: Any, resume: bool) -> str | None:
    """Return the path of a file, or None."""
    if backend is None and not resume:
        return None
    if not isinstance(backend, str | os.PathLike) and resume:
        raise TypeError(
            f"resume: expected backend to be the name of a file, got {backend!r}"
        )
    name = os.fspath(checks.file_name("backend", backend))
    # Absolute, since a solver may change the directory.
    return os.path.abspath(name) if os.path.basename(name) else name


def check_backends(
    backend: Any, ensembles: int, resume: bool
) -> tuple[list[Backend | None], str | None]:
    """Return one empty backend per ensemble, or the name of a file."""
    if resume or isinstance(backend, str | os.PathLike):
        return [], check_file(backend, resume)
    if backend is None:
        return [None] * ensembles, None
    backends = list(backend) if isinstance(backend, Sequence) else [backend]
    if len(backends) != ensembles:
        raise ValueError(
            f"backend: expected one for each of {ensembles} ensembles, "
            f"got {len(backends)}"
        )
    for own in backends:
        if isinstance(own, type) or not hasattr(own, "initialized"):
            raise TypeError(
                "backend: expected None, the name of a file, or emcee backends, got "
                f"{own!r}"
            )
        if own.initialized and own.iteration:
            raise ValueError(
                f"backend: {own!r} already holds {own.iteration} steps of another "
                "run; give a new file name, or call its reset()"
            )
    return backends, None
