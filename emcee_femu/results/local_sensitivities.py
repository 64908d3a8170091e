"""What the data say near a maximum of the posterior, before any sampling."""

from typing import Any

import numpy as np
from scipy import special

from ..interfaces import Floats, read
from ..posterior.differences import place
from ..posterior.laplace import draw_inside, is_inside, moments_inside
from ..posterior.priors import summarize_prior
from ..sampling.found_map import FoundMap
from .sampled_sensitivities import shares_at_bounds


def describe_locally(found: FoundMap) -> dict[str, Any]:
    """Return the fields of an ``Identifiability`` about the heaviest maximum."""
    posterior, best = found.posterior, found.maxima[0]
    bounds = posterior.prior.bounds
    prior_mean, prior_sd = summarize_prior(posterior.prior)
    law = best.theta, best.covariance, *bounds.T
    mean, covariance = moments_inside(*law)
    at_bound = np.zeros_like(bounds)
    if not is_inside(*law):
        draws, log_weights = draw_inside(*law)
        weights = special.softmax(log_weights)
        at_bound = shares_at_bounds(draws, bounds, prior_sd, weights)
    sd = np.sqrt(np.diag(covariance))
    is_error = np.isin(posterior.names, posterior.error_names)
    modes, sensitivities = _differentiate(posterior, best.theta)
    sensitivities[:, is_error] = np.nan
    k = len(found.maxima)
    which = f"the maximum of weight {found.weights[0]:.2f}, one of {k}"
    return {
        "names": posterior.names,
        "is_error": is_error,
        "prior_sd": prior_sd,
        "bounds": bounds,
        "sd_ratio": sd / prior_sd,
        "shift": (mean - prior_mean) / prior_sd,
        "correlation": covariance / np.outer(sd, sd),
        "at_bound": at_bound,
        "from_bound": np.abs(bounds - mean[:, None]) / sd[:, None],
        "modes": modes,
        "sensitivities": sensitivities * prior_sd,
        "r_squared": np.full(len(modes), np.nan),
        "local": (
            f"Local: of the Gaussian about {which if k > 1 else 'the maximum'}, not of "
            "samples. Where the posterior is not Gaussian samples may say otherwise."
        ),
    }


def _differentiate(posterior: Any, theta: Floats) -> tuple[tuple[str, ...], Floats]:
    """Return the modes of all experiments, in words, and d ln(lambda) (m, d)."""
    labels: list[str] = []
    parts = [np.empty((0, posterior.ndim))]
    stencil: Any = None
    rows = None
    if not posterior.differentiable:
        stencil = place(posterior.prior, theta[None], posterior.scale)
        rows = posterior(stencil.points)
    for experiment in posterior.experiments:
        if "frequency" not in experiment.variables:
            continue
        if rows is None:
            frequency, slopes = _ask(posterior, experiment, theta)
        else:
            name = experiment.full_name("frequency")
            values = rows[:, posterior.columns[name]]
            frequency, slopes = values[0], stencil.derive(values[None])[0]
        labels += [
            f"{experiment.name} mode {i + 1}".strip() for i in range(len(slopes))
        ]
        # Rigid-body modes have no logarithm.
        inverse = np.where(
            frequency > 0, 2 / np.where(frequency > 0, frequency, 1), np.nan
        )
        parts.append(slopes * inverse[:, None])
    return tuple(labels), np.concatenate(parts)


def _ask(posterior: Any, experiment: Any, theta: Floats) -> tuple[Floats, Floats]:
    """Return the frequencies (m,) of a model with ``jacobian``, and slopes (m, d)."""
    response, derivatives = experiment.model.jacobian(posterior.parameters(theta[None]))
    frequency = np.asarray(read(response, "frequency"))[0]
    slopes = np.zeros((len(frequency), posterior.ndim))
    for column, name in enumerate(posterior.names):
        if name in derivatives["frequency"]:
            slopes[:, column] = derivatives["frequency"][name][0]
    return frequency, slopes
