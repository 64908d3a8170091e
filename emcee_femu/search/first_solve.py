"""The solves before any sampling: at the prior mean, and at starting points."""

import time
import warnings
from collections.abc import Mapping
from contextlib import suppress

import emcee
import numpy as np

from ..contracts import Floats
from ..evaluation.evaluator import Evaluation
from ..evaluation.resume import StoredEvaluation
from ..evaluation.samplers import start_state
from ..posterior.log_posterior import LOG_POSTERIOR, LOG_PRIOR, LogPosterior
from ..posterior.priors import prior_centre, summarize_prior
from ..posterior.sensors import suspect_sensors

FAR_RATIO = 3.0  # median ratio to what was measured, or its inverse, which is suspected
LIKE_TURN = 1.25  # ratio to 2 pi up to which it is taken for one
REACH_DRAWS = 16  # of the prior, which may reach the data though its mean does not
LARGE_ERROR = 0.3  # prior mean of a relative error: most are meant to be a few percent
NARROW_PRIOR = 9e-5  # sd by mean of a prior, 1e-4 less the error of both by sampling
# Relative difference of responses that a solver's rounding may make.
SAME_RESPONSE = 1e-9
MOST_START_DRAWS = 100  # of a starting point


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
    for doubt in doubts:
        warnings.warn(doubt, stacklevel=3)
    return float(seconds), doubts


def time_batch(evaluation: Evaluation) -> float:
    """Return seconds of a solve in a batch, which is not counted."""
    centre = prior_centre(evaluation.posterior.prior)
    begin = time.perf_counter()
    evaluation.again(np.tile(centre, (REACH_DRAWS, 1)))
    return (time.perf_counter() - begin) / REACH_DRAWS


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


def doubt_prior(posterior: LogPosterior) -> list[str]:
    """Name priors that are hardly meant so, as by slips in what scipy.stats takes."""
    with np.errstate(invalid="ignore", over="ignore"):  # of infinite draws
        mean, sd = summarize_prior(posterior.prior)
    errors = {term.discrepancy for term in posterior.terms}
    doubts = []
    for name, centre, spread in zip(posterior.names, mean, sd, strict=True):
        if name in errors and centre > LARGE_ERROR:
            doubts.append(
                f"prior: the error {name!r} has a mean of {100 * centre:.3g} %; 2 % is "
                "0.02, as in halfnorm(scale=0.02): scipy.stats takes loc before scale"
            )
        if spread < NARROW_PRIOR * abs(centre):
            doubts.append(
                f"prior: {name!r} has an sd of {spread:.3g}, {spread / abs(centre):.1g}"
                f" of its mean {centre:.4g}, so data can hardly change it; scipy.stats "
                "has norm(mean, sd), and lognorm(s, scale=median)"
            )
    return doubts


def doubt_reach(posterior: LogPosterior, rows: Floats) -> list[str]:
    """Say which models gave one response, and likelihood, at all draws of the prior.

    A likelihood that depends on an inferred error besides may differ.

    Args:
        posterior: The posterior.
        rows: Its rows at several points.
    """
    # A term may reject what could be solved.
    response = rows[:, posterior.columns["densities"].stop :]
    solved, doubts = rows[np.isfinite(response).all(axis=1)], []
    likelihoods = iter(solved.T[2:])
    for experiment in posterior.experiments:
        read = [
            posterior.columns[experiment.full_name(n)] for n in experiment.variables
        ]
        parts = [solved[:, columns] for columns in read]
        for term in experiment.terms:
            value = next(likelihoods)[:, None]
            if term.names is None or {*term.names} - {term.discrepancy}:
                parts.append(value)
        if read and len(solved) > 1 and all(map(is_constant, parts)):
            doubts.append(same_response(experiment.full_name("model"), len(solved)))
    return doubts


def same_response(label: str, number: int) -> str:
    """Say that a model does not respond to its parameters."""
    return (
        f"{label}: the same response at all of {number} parameter sets: do the "
        "parameters reach the solver, and does the model read its new result?"
    )


def is_constant(values: Floats) -> bool:
    """Return whether all rows of ``values (n, m)`` are the same, but for rounding."""
    return bool(np.isclose(values, values[:1], SAME_RESPONSE, 0.0).all())


def doubt(
    posterior: LogPosterior,
    response: Mapping[str, Floats],
    place: str = "the prior mean",
) -> list[str]:
    """Say what is far from the measured at all points, or in another order at a place.

    The order of frequencies matters where modes are compared by their numbers.

    Args:
        posterior: The posterior.
        response: Its stored variables, ``{name: (n, *shape)}``.
        place: What the first of the points is.
    """
    doubts = []
    for experiment in posterior.experiments:
        by_number = "model_mode" not in experiment.variables
        for variable, data in [p for t in experiment.terms for p in t.observed.items()]:
            name, measured = experiment.full_name(variable), np.ravel(data)
            if name not in response:
                continue
            part = slice(None), *map(slice, np.shape(data))
            values = response[name][part].reshape(-1, len(measured))
            text = doubt_units(values, measured, posterior.variables[name].unit)
            orders = np.argsort(values[0]), np.argsort(measured)
            if not text and by_number and variable == "frequency":
                if np.isfinite(values[0]).all() and not np.array_equal(*orders):
                    text = "the model's modes are in another order than the measured: "
                    text += "sort both, or pair them by shape (PairedModel)"
            if text:
                doubts.append(f"{name} at {place}: {text}")
    return doubts


def doubt_units(predicted: Floats, measured: Floats, unit: str) -> str:
    """Say how far off predictions are, if most are, and all to the same side.

    Args:
        predicted: What the model gives, ``(n, m)``; rows of NaN say nothing.
        measured: What was measured, ``(m,)``.
        unit: That of both.

    Returns:
        Both numbers, of the first value, and the median ratio; an empty text if that
        is near at any of the points, or any prediction to the other side.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.log(np.abs(predicted / measured))
    if not np.isfinite(ratios[0]).all():
        return ""
    solved = ratios[~np.isnan(ratios).any(axis=1)]
    medians = np.median(solved, axis=1)
    less = medians[0] < 0
    if np.abs(medians).min() <= np.log(FAR_RATIO) or ((solved < 0) != less).any():
        return ""
    times = np.exp(np.abs(medians[0]))
    turn = 1 / LIKE_TURN < times / (2 * np.pi) < LIKE_TURN and unit == "Hz"
    unit = f" {unit}".rstrip()
    return (
        f"model {predicted[0, 0]:.3g}{unit}, measured {measured[0]:.3g}{unit}: the "
        f"model is {times:.3g} times too {'low' if less else 'high'}; "
        + ("was rad/s given for Hz?" if turn else "do the units agree?")
    )


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
            for doubt in doubt_reach(posterior, rows):
                warnings.warn(doubt, stacklevel=3)
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
