"""What ``run`` is asked for, checked once."""

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing.pool import Pool, ThreadPool
from typing import Any

import emcee
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats
from ..moves import DEMCMove
from ..moves.stock_faults import refuse_sequential
from ..moves.tempering import ladder
from ..posterior.log_posterior import LogPosterior
from .pools.evaluation_pool import usable
from .pools.pickling import pickled


@dataclass(frozen=True, eq=False, kw_only=True)
class Settings:
    """The arguments of :func:`run.run`; once checked, some have become another.

    Attributes:
        moves: Emcee moves; those of the burn-in if they shall be found.
        automatic: Whether moves were "auto".
        nwalkers: Walkers per ensemble.
        initial: Starts ``(ensembles, nwalkers, ndim)``, or None.
        backend: One backend per ensemble, None for emcee's own.
        path: Of the file in place of backends, or None.
    """

    posterior: LogPosterior
    moves: Any
    nwalkers: Any
    nsteps: int
    ensembles: int
    seed: int
    vectorize: bool
    backend: Any
    thin_by: int
    progress: bool | str
    initial: Any
    resume: bool
    on_failure: str
    max_failures: float
    probe_tolerance: float
    automatic: bool = False
    path: str | None = None

    def checked(self) -> "Settings":
        """Return the settings, checked, with defaults and files resolved.

        Raises:
            TypeError, ValueError: As :func:`run.run`.
        """
        posterior = self.posterior
        if not isinstance(posterior, LogPosterior):
            raise TypeError(
                f"posterior: expected a LogPosterior, got {type(posterior).__name__}; "
                "for a bare log-probability function use emcee.EnsembleSampler"
            )
        ensembles = checks.whole_number("ensembles", self.ensembles, 1)
        automatic = isinstance(self.moves, str)
        if automatic and self.moves != "auto":
            raise ValueError(
                f"moves: expected emcee moves or 'auto', got {self.moves!r}"
            )
        moves = DEMCMove() if automatic or self.moves is None else self.moves
        check_moves("moves", moves)
        nwalkers = check_walkers(moves, self.nwalkers, posterior.ndim)
        check_progress(self.progress)
        path = check_path(self.backend, self.resume)
        own = None if path else list_backends(self.backend, ensembles)
        return replace(
            self,
            moves=moves,
            automatic=automatic,
            nwalkers=nwalkers,
            nsteps=checks.whole_number("nsteps", self.nsteps, 1),
            ensembles=ensembles,
            seed=checks.whole_number("seed", self.seed),
            vectorize=checks.flag("vectorize", self.vectorize),
            backend=own,
            path=path,
            thin_by=checks.whole_number("thin_by", self.thin_by, 1),
            initial=check_starts(self.initial, posterior, ensembles, nwalkers),
            probe_tolerance=checks.real_number(
                "probe_tolerance", self.probe_tolerance, 0.0
            ),
        )


def check_moves(argument: str, moves: Any) -> None:
    """Refuse what emcee would take for a move, a list of moves or weighted pairs.

    Raises:
        TypeError: If something is no move, or pairs are mixed with moves.
        ValueError: If there is no move, or weights are negative or all zero.
    """
    given = list_moves(moves)
    if not given:
        raise ValueError(f"{argument}: expected at least one move, got none")
    for move in given:
        if isinstance(move, type) or not hasattr(move, "propose"):
            raise TypeError(
                f"{argument}: expected an emcee move, a list of moves or of (move, "
                f"weight), got {move!r}"
            )
    if not isinstance(moves, Sequence):
        return
    pairs = [item for item in moves if isinstance(item, Sequence)]
    if not pairs:
        return
    if len(pairs) < len(moves) or any(len(pair) != 2 for pair in pairs):
        raise TypeError(
            f"{argument}: expected (move, weight) throughout, got {moves!r}"
        )
    weights = [
        checks.real_number(f"{argument} (their weights)", weight, 0.0)
        for _, weight in pairs
    ]
    if not sum(weights) > 0:
        raise ValueError(f"{argument}: expected a weight above zero, got {weights}")


def list_moves(moves: Any) -> list[Any]:
    """Return the moves of what emcee accepts: a move, a list, or weighted pairs."""
    if not isinstance(moves, Sequence):
        return [moves]
    return [
        item[0] if isinstance(item, Sequence) and len(item) else item for item in moves
    ]


def check_walkers(moves: Any, nwalkers: Any, ndim: int) -> int:
    """Return the number of walkers, checked against what each move needs.

    The default is 4 per parameter, at least 16, and as many for each temperature.

    Raises:
        TypeError, ValueError, RuntimeError: If nwalkers does not fit.
    """
    given = list_moves(moves)
    tempered = ladder(given)  # refuses temperatures that differ
    if nwalkers is None:
        nwalkers = max(16, 4 * ndim)
        if tempered is not None:
            nwalkers = tempered.default_walkers(ndim)
    number = checks.whole_number("nwalkers", nwalkers, 1)
    for move in given:
        refuse_sequential("moves", move)
        if hasattr(move, "check"):
            move.check(number, ndim)
    return number


def check_progress(progress: Any) -> None:
    """Refuse what is neither True, False nor the name of a bar of tqdm."""
    if not isinstance(progress, str):
        checks.flag("progress", progress)
        return
    bars = emcee.pbar.tqdm
    if bars is not None and not hasattr(bars, f"tqdm_{progress}"):
        raise ValueError(
            f"progress: expected True, False or a bar of tqdm, such as 'notebook', got "
            f"{progress!r}"
        )


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


def check_pool(pool: Any, vectorize: bool, function: Any) -> None:
    """Refuse what is no pool, and, naming the part to blame, what it cannot be sent."""
    if vectorize and pool is not None:
        raise ValueError("vectorize: emcee ignores the pool then; give one of the two")
    if pool is not None and (isinstance(pool, type) or not usable(pool)):
        raise TypeError(f"pool: expected something with a map, got {pool!r}")
    of_processes = isinstance(pool, ProcessPoolExecutor | Pool)
    if of_processes and not isinstance(pool, ThreadPool):
        pickled(function)


def check_path(backend: Any, resume: Any) -> str | None:
    """Return the absolute path of a file, since a solver may change the directory."""
    if isinstance(backend, str | os.PathLike):
        name = os.fspath(checks.file_name("backend", backend))
        checks.flag("resume", resume)
        return os.path.abspath(name) if os.path.basename(name) else name
    if checks.flag("resume", resume):
        raise TypeError(
            f"resume: expected backend to be the name of a file, got {backend!r}"
        )
    return None


def list_backends(backend: Any, ensembles: int) -> list[Any]:
    """Return one empty backend per ensemble, or None for emcee's own.

    Raises:
        TypeError: If one is no backend.
        ValueError: If there are too few or too many, or one holds steps.
    """
    if backend is None:
        return [None] * ensembles
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
    return backends
