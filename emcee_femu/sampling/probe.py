"""Is it still the same posterior? The stored last generation, evaluated again.

A stored chain holds log-probabilities that are never computed again, so a solver that
changed meanwhile, in its code, its version or the files that it reads, would mix two
posteriors silently. What does not show at these points passes.
"""

import logging

import emcee
import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from .evaluation import Evaluation

logger = logging.getLogger("emcee_femu")
FLOOR = 1e-3  # of the largest value of a variable, to which the tolerance is relative


def probe(
    evaluation: Evaluation, states: list[emcee.State], path: str, tolerance: float
) -> None:
    """Refuse to go on if ``states`` are evaluated to other columns than were stored.

    A solver that is not deterministic is told apart by a second evaluation.
    """
    posterior = evaluation.posterior
    logger.info(
        "resume: %d evaluations tell whether %s is of the same posterior",
        sum(len(state.coords) for state in states),
        path,
    )
    evaluation = evaluation.uncounted()
    for number, state in enumerate(states, 1):
        stored = np.column_stack([state.log_prob, state.blobs])
        now = evaluation.rows(state.coords)
        apart = _apart(stored, now, posterior, tolerance)
        if not apart.any():
            continue
        again = evaluation.rows(state.coords)
        changing = _apart(now, again, posterior, tolerance)
        if changing.any():
            where = _first(changing, now, again, state.coords, posterior)
            raise ValueError(
                f"resume: the solver is not deterministic: in ensemble {number} "
                f"{where}. Fix its seeds, starts and threads, or set probe_tolerance "
                "to what it scatters by"
            )
        where = _first(apart, stored, now, state.coords, posterior)
        raise ValueError(
            f"resume: {path} holds a run of another posterior: in ensemble {number} "
            f"{where} ({int(apart.any(axis=1).sum())} of {len(apart)} walkers differ "
            f"by more than probe_tolerance={tolerance:g}). Restore model, files and "
            "versions, or give another file name"
        )


def _apart(
    one: Floats, other: Floats, posterior: LogPosterior, tolerance: float
) -> NDArray[np.bool_]:
    """Return which columns differ; infinities and NaN are equal to themselves."""
    finite = np.where(np.isfinite(one), np.abs(one), 0.0)
    scale = finite.copy()
    for part in posterior.columns.values():
        scale[:, part] += FLOOR * finite[:, part].max(initial=0.0)
    same = (one == other) | (np.isnan(one) & np.isnan(other))
    with np.errstate(invalid="ignore"):  # of infinities
        within = np.abs(one - other) <= tolerance * scale
    differs: NDArray[np.bool_] = ~(same | within)
    return differs


def _first(
    apart: NDArray[np.bool_],
    one: Floats,
    other: Floats,
    coords: Floats,
    posterior: LogPosterior,
) -> str:
    """Return the first difference in words, with the parameters by name.

    The log-posterior is a sum: unless the solve failed, another column says more.
    """
    walker = int(np.argmax(apart.any(axis=1)))
    columns = np.flatnonzero(apart[walker])
    parts = columns[columns > 0]
    solved = other[walker, 0] > -np.inf
    column = int(parts[0] if solved and len(parts) else columns[0])
    values = dict(zip(posterior.names, coords[walker].tolist(), strict=True))
    return (
        f"{posterior.labels[column]} of walker {walker} was "
        f"{one[walker, column]:.12g} and is {other[walker, column]:.12g} at {values}"
    )
