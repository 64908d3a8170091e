"""The first state of every ensemble: starts and random streams."""

import emcee
import numpy as np

from ..interfaces import Floats
from .evaluation import Evaluation

MOST_DRAWS = 20  # of a starting point


def draw_starts(evaluation: Evaluation) -> list[emcee.State]:
    """Return the evaluated start of each ensemble, with its own random stream.

    If failed solves are rejected, draws from the prior where the posterior is zero are
    drawn again.
    """
    settings = evaluation.settings
    posterior, sampler = settings.posterior, evaluation.sampler()
    states = []
    streams = np.random.SeedSequence(settings.seed).spawn(settings.ensembles)
    for ensemble, stream in enumerate(streams):
        if settings.initial is None:
            start = posterior.start(settings.nwalkers, stream.spawn(1)[0])
        else:
            start = settings.initial[ensemble].copy()
        log_prob, blobs = sampler.compute_log_prob(start)
        redraw = evaluation.failures is not None and settings.initial is None
        for _ in range(MOST_DRAWS if redraw else 0):
            again = np.flatnonzero(~np.isfinite(log_prob))
            if not len(again):
                break
            start[again] = posterior.start(len(again), stream.spawn(1)[0])
            log_prob[again], blobs[again] = sampler.compute_log_prob(start[again])
        _check_finite(log_prob, start, posterior.names)
        random = np.random.RandomState(np.random.MT19937(stream))
        states.append(emcee.State(start, log_prob, blobs, random.get_state()))
    return states


def _check_finite(log_prob: Floats, start: Floats, names: tuple[str, ...]) -> None:
    if not np.isfinite(log_prob).all():
        walker = int(np.argmin(np.isfinite(log_prob)))
        values = dict(zip(names, start[walker].tolist(), strict=True))
        raise ValueError(
            f"initial: the log-posterior of walker {walker} is {log_prob[walker]} at "
            f"{values}; every walker must start where it is finite (for a solve that "
            "failed, on_failure='raise' tells why)"
        )
