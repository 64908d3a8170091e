"""What is hardly meant so: units, the order of modes, priors, a model that is deaf."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..contracts import Floats, read_declared
from ..measurements.modes import find_duplicates
from .experiments import Experiment
from .log_posterior import LogPosterior
from .priors import describe_marginal, summarize_prior

FAR_RATIO = 3.0  # median ratio to what was measured, or its inverse, that is suspected
# Ratios of frequencies by known slips, which are suspected from half as far on: up to
# this factor, a ratio is taken for one.
LIKE_SLIP = 1.15
SLIPS = {2 * np.pi: "was rad/s given for Hz?", 9.81**0.5: "was weight given as mass?"}
# Measured modes that are doubted to be one: relative difference of their frequencies,
# MAC, and sensors of which fewer tell shapes apart badly.
TWIN_FREQUENCY, TWIN_MAC, TWIN_SENSORS = 0.1, 0.95, 4
LARGE_ERROR = 0.3  # prior mean of a relative error: most are meant to be a few percent
NARROW_PRIOR = 9e-5  # sd by mean of a prior, 1e-4 less the error of both by sampling
# Relative difference of responses that a solver's rounding may make.
SAME_RESPONSE = 1e-9


def doubt_prior(posterior: LogPosterior) -> list[str]:
    """Name priors that are hardly meant so, as by slips in what scipy.stats takes."""
    with np.errstate(invalid="ignore", over="ignore"):  # of infinite draws
        mean, sd = summarize_prior(posterior.prior)
    errors = {term.discrepancy for term in posterior.terms}
    doubts = []
    laws = read_declared(posterior.prior, "marginals") or {}
    for name, centre, spread in zip(posterior.names, mean, sd, strict=True):
        if name in laws and _is_shifted_only(laws[name]):
            doubts.append(
                f"prior: {name!r} is {describe_marginal(laws[name])}, of loc "
                f"{laws[name].args[-1]:.4g} and scale 1: scipy.stats takes loc before "
                "scale, as in lognorm(s, scale=median) and halfnorm(scale=0.02)"
            )
        elif name in errors and centre > LARGE_ERROR:
            doubts.append(
                f"prior: the error {name!r} has a mean of {100 * centre:.3g} %; 2 % is "
                "0.02, as in halfnorm(scale=0.02)"
            )
        elif spread < NARROW_PRIOR * abs(centre):
            doubts.append(
                f"prior: {name!r} has an sd of {spread:.3g}, {spread / abs(centre):.1g}"
                f" of its mean {centre:.4g}, so data can hardly change it; scipy.stats "
                "has norm(mean, sd), and lognorm(s, scale=median)"
            )
    return doubts


def _is_shifted_only(marginal: Any) -> bool:
    """Return whether a law of scipy.stats other than norm has a loc, but no scale."""
    law = getattr(marginal, "dist", None)  # a frozen one of scipy.stats
    if law is None or law.name == "norm" or "scale" in marginal.kwds:
        return False
    return bool(len(marginal.args) == law.numargs + 1)


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
        doubts += _name_twins(experiment)
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


def _name_twins(experiment: Experiment) -> list[str]:
    """Name measured modes that are perhaps one, identified twice."""
    if (paired := experiment.paired) is None or paired.by_reference:
        return []
    test = paired.measurements
    shapes = np.nan_to_num(test.compared)
    return [
        f"{experiment.full_name('shapes')}: measured modes {i + 1} and {j + 1} "
        f"({test.frequencies[i]:.4g} and {test.frequencies[j]:.4g} Hz) have nearly one "
        "shape: is one mode listed twice?"
        for i, j in find_duplicates(test.frequencies, shapes, TWIN_FREQUENCY, TWIN_MAC)
        if len(shapes) >= TWIN_SENSORS
    ]


def doubt_units(predicted: Floats, measured: Floats, unit: str) -> str:
    """Say how far off predictions are, if most are, and all to the same side.

    Args:
        predicted: What the model gives, ``(n, m)``; rows of NaN say nothing.
        measured: What was measured, ``(m,)``.
        unit: That of both.

    Returns:
        Both numbers, of the first value, and the median ratio at the first point; an
        empty text if it is near at any of the points, or any prediction to the other
        side.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.log(np.abs(predicted / measured))
    if not np.isfinite(ratios[0]).all():
        return ""
    solved = ratios[~np.isnan(ratios).any(axis=1)]
    medians = np.median(solved, axis=1)
    less = medians[0] < 0
    far, nearest = np.abs(medians[0]), np.abs(medians).min()
    asked, least = "do the units agree?", np.log(FAR_RATIO)
    for factor, slip in SLIPS.items() if unit == "Hz" else ():
        if np.abs(far - np.log(factor)) < np.log(LIKE_SLIP):
            asked, least = slip, far / 2
    if nearest <= least or ((solved < 0) != less).any():
        return ""
    unit = f" {unit}".rstrip()
    return (
        f"model {predicted[0, 0]:.3g}{unit}, measured {measured[0]:.3g}{unit}: the "
        f"model is {np.exp(far):.3g} times too {'low' if less else 'high'} in the "
        f"median; {asked}"
    )
