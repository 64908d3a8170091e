"""The solves before any sampling: at the prior mean, and at starting points."""

import time
import warnings
from contextlib import suppress

import emcee
import numpy as np

from ..contracts import Floats
from ..posterior.log_posterior import LOG_POSTERIOR, LOG_PRIOR
from ..posterior.plausibility import doubt, doubt_prior, doubt_reach
from ..posterior.priors import prior_centre
from ..posterior.sensors import suspect_sensors
from .ensemble import start_state
from .evaluator import Evaluation
from .resume import StoredEvaluation

REACH_DRAWS = 16  # of the prior, which may reach the data though its mean does not
MOST_START_DRAWS = 100  # of a starting point
TIMED_CALLS = 3  # of which the fastest counts: a first one may import
LONG_CALL = 1.0  # seconds of a call that is not repeated to know it better


def check_first_solve(evaluator: Evaluation) -> tuple[float, list[str]]:
    """Solve at the prior mean, and warn where that is far from all that was measured.

    The solve is counted, and one more where mode shapes were measured, by which a wrong
    sensor is looked for. Only where it looks wrong the model is solved at some draws of
    the prior too: of a wide one, as from 1e1 to 1e9, the mean may be far off, but not
    all draws are to the same side. A solve that fails says nothing here. A resumed run
    has the same outcome from its file, and the row, which tables need.

    Returns:
        The seconds that the solve took, by the number of workers, and the warnings.
    """
    posterior = evaluator.posterior
    if isinstance(evaluator, StoredEvaluation):
        store = evaluator.store
        outcome = store["first solve"] or _compare(evaluator)
        row = store["first row"] or posterior.initial.tolist()
        posterior.initial = np.array(row)
        store["first row"], store["first solve"] = row, outcome
    else:
        outcome = _compare(evaluator)
    solves, doubts, seconds = outcome
    evaluator.solves += solves
    for text in doubts:
        warnings.warn(text, stacklevel=3)
    return float(seconds), doubts


def time_batch(evaluation: Evaluation, most: int) -> float:
    """Return seconds of a solve in a batch of at most so many, which is not counted.

    They are those of the fastest of a few calls. A call that takes long is not
    repeated.
    """
    centre, size = prior_centre(evaluation.posterior.prior), min(REACH_DRAWS, most)
    fastest = np.inf
    for _ in range(TIMED_CALLS):
        begin = time.perf_counter()
        evaluation.again(np.tile(centre, (size, 1)))
        seconds = time.perf_counter() - begin
        fastest, size = min(fastest, seconds / size), most
        if seconds > LONG_CALL:
            break
    return fastest


def _compare(evaluation: Evaluation) -> tuple[int, list[str], float]:
    """Return how many solves were made, what to warn of, and seconds of a solve."""
    posterior = evaluation.posterior
    centre, slips = prior_centre(posterior.prior)[None], doubt_prior(posterior)
    try:
        posterior.check_inside("prior (its mean)", centre)
    except ValueError as error:  # a Gaussian may be cut there, but hardly on purpose
        return 0, [f"{error}; move it, or the bounds", *slips], np.nan
    workers = 1
    if evaluation.pool is not None:
        evaluation.pool.map(int, [0])  # starts them, which is no part of a solve
        workers = max(1, evaluation.pool.n_workers)
    begin = time.perf_counter()
    rows = _solve(evaluation, centre)
    seconds = (time.perf_counter() - begin) / workers
    posterior.initial = rows[0]  # tables then need no other solve
    if doubt(posterior, posterior.unfold(rows)):
        draws = posterior.prior.sample(np.random.default_rng(0), REACH_DRAWS)
        rows = np.concatenate([rows, _solve(evaluation, draws)])
    solves = int(np.count_nonzero(rows[:, LOG_PRIOR] > -np.inf))
    doubts = doubt(posterior, posterior.unfold(rows)) + slips
    if solves:
        with suppress(Exception):  # of any kind, as below
            found, more = suspect_sensors(posterior, centre)
            doubts += ["; or ".join(map(str, alike)) for alike in found if alike]
            solves += more
    return solves, doubts, seconds


def _solve(evaluation: Evaluation, theta: Floats) -> Floats:
    try:
        return evaluation.again(theta)
    except Exception:  # of any kind: the run will meet it, or does without
        return np.tile(evaluation.posterior.rejected(), (len(theta), 1))


def draw_starts(
    evaluator: Evaluation,
    nwalkers: int,
    ensembles: int,
    seed: int,
    points: Floats | None,
) -> list[emcee.State]:
    """Return the evaluated start of each ensemble, with its own random stream.

    Starts from the prior that are impossible, or failed, are drawn again.
    """
    posterior, states = evaluator.posterior, []
    for ensemble, stream in enumerate(np.random.SeedSequence(seed).spawn(ensembles)):
        if points is None:
            theta = posterior.start(nwalkers, stream.spawn(1)[0])
        else:
            theta = points[ensemble].copy()
        rows = evaluator.rows(theta)
        if points is None and not ensemble:
            for text in doubt_reach(posterior, rows):
                warnings.warn(text, stacklevel=3)
        for _ in range(MOST_START_DRAWS if points is None else 0):
            again = np.flatnonzero(~np.isfinite(rows[:, LOG_POSTERIOR]))
            if not len(again):
                break
            theta[again] = posterior.start(len(again), stream.spawn(1)[0])
            rows[again] = evaluator.rows(theta[again])
        finite = np.isfinite(rows[:, LOG_POSTERIOR])
        if not finite.all():
            walker = int(np.argmin(finite))
            values = dict(zip(posterior.names, theta[walker].tolist(), strict=True))
            raise ValueError(
                f"starts: the log-posterior of walker {walker} is "
                f"{rows[walker, LOG_POSTERIOR]} at {values}; every walker must start "
                "where it is finite (for a solve that failed, on_failure='raise' tells "
                "why)"
            )
        states.append(start_state(theta, rows, stream))
    return states
