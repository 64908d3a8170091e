"""Is it still the same posterior? The stored last generation, evaluated again.

A stored chain holds log-probabilities that are never computed again, so a solver that
changed meanwhile, in its code, its version or the files that it reads, would mix two
posteriors silently. What does not show at these points passes.
"""

import logging
from typing import Any

import emcee
import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from .starts import Evaluation

logger = logging.getLogger("emcee_femu")
FLOOR = 1e-3  # of the largest value of a variable, to which the tolerance is relative


def probe(evaluation: Evaluation, states: list[emcee.State], path: str) -> None:
    """Refuse to go on if ``states`` are evaluated to other columns than were stored.

    Raises:
        ValueError: If a column differs by more than ``probe_tolerance``, with the
            parameters by name; or if the solver is not deterministic.
    """
    posterior = evaluation.settings.posterior
    tolerance = evaluation.settings.probe_tolerance
    logger.info(
        "resume: %d evaluations tell whether %s is of the same posterior",
        sum(len(state.coords) for state in states),
        path,
    )
    sampler = evaluation.uncounted().sampler()
    for number, state in enumerate(states, 1):
        stored = np.column_stack([state.log_prob, state.blobs])
        now = np.column_stack(sampler.compute_log_prob(state.coords))
        apart = _apart(stored, now, posterior, tolerance)
        if not apart.any():
            continue
        again = np.column_stack(sampler.compute_log_prob(state.coords))
        changing = _apart(now, again, posterior, tolerance)
        if changing.any():
            where, values = _first(changing, state.coords, posterior)
            raise ValueError(
                "resume: the solver is not deterministic: evaluated twice at the same "
                f"parameters, {where[2]} was {now[where[:2]]:.12g}, then "
                f"{again[where[:2]]:.12g}, of walker {where[0]} of ensemble {number} "
                f"at {values}. Make it so (fixed seeds and starts, one thread), or set "
                "probe_tolerance to what it scatters by"
            )
        where, values = _first(apart, state.coords, posterior)
        raise ValueError(
            f"resume: {path} holds a run of another posterior: {where[2]} of walker "
            f"{where[0]} of ensemble {number} was {stored[where[:2]]:.12g} and is "
            f"{now[where[:2]]:.12g} at {values} ({int(apart.any(axis=1).sum())} of "
            f"{len(apart)} walkers differ by more than probe_tolerance={tolerance:g}). "
            "Restore model, files and versions, or give another file name"
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
    apart: NDArray[np.bool_], coords: Floats, posterior: LogPosterior
) -> tuple[tuple[int, int, str], dict[str, Any]]:
    """Return walker, column, its label, and the parameters of the first difference.

    The log-posterior is a sum: another column says more, if there is one.
    """
    walker = int(np.argmax(apart.any(axis=1)))
    columns = np.flatnonzero(apart[walker])
    column = int(columns[1 if len(columns) > 1 and columns[0] == 0 else 0])
    values = dict(zip(posterior.names, coords[walker].tolist(), strict=True))
    return (walker, column, posterior.labels[column]), values
