"""How natural frequencies change with the parameters, by fits to samples."""

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from ..contracts import Floats
from ..verdict.statistics import spread_out
from .arviz_objects import InferenceData, dataset
from .measured import split

FLAT = 1e-9  # sd of ln(lambda) of a mode that only rounding changes
ENOUGH_REGRESSED = 10_000  # samples in a fit; 3,000 gave the same gradients as 72,000

# Modes, gradients of ln(lambda) ``(m, d)``, R^2 of their fits, effects ``(d,)``.
Fit: TypeAlias = tuple[tuple[str, ...], Floats, Floats, Floats]


def fit_sensitivities(idata: InferenceData, draws: Floats) -> Fit:
    """Return modes, gradients of ln(lambda), R^2 of their fits, and effects.

    Args:
        idata: Samples with their response.
        draws: The same samples in prior standard deviations, ``(n, d)``.

    Returns:
        Names ``(m,)``, gradients ``(m, d)``, R^2 ``(m,)``; and the number of standard
        errors by which one prior standard deviation moves all measured quantities,
        ``(d,)``. It follows from the curvature of the log-likelihood; NaN if unknown.
    """
    n = len(draws)
    by_variable = {
        str(name): v.transpose("chain", "draw", ...).values.reshape(n, -1)
        for name, v in dataset(idata, "response").data_vars.items()
    }
    modes, log_eigenvalues = by_mode(by_variable or {"none": np.empty((n, 0))})
    log_likelihood = np.full(n, np.nan)
    if "sample_stats" in idata and "log_prior" in dataset(idata, "sample_stats"):
        known = dataset(idata, "sample_stats").transpose("chain", "draw")
        log_likelihood = (known["lp"] - known["log_prior"]).values.ravel()
    few = spread_out(n, ENOUGH_REGRESSED)
    values = np.column_stack([log_eigenvalues, log_likelihood])[few]
    slopes, r_squared, curvature = _fit_quadratic(draws[few], values)
    effect = np.sqrt(np.maximum(-curvature[-1], 0.0))
    return modes, slopes[:-1], r_squared[:-1], effect


def by_mode(response: Mapping[str, Floats]) -> tuple[tuple[str, ...], Floats]:
    """Return the modes of all experiments, in words, and ln of eigenvalues ``(n, m)``.

    Rigid-body modes have no logarithm: their values are not finite.
    """
    labels: list[str] = []
    columns = [np.empty((len(values), 0)) for values in response.values()][:1]
    for name, values in response.items():
        experiment, variable = split(name)
        if variable == "frequency":
            columns.append(values)
            numbers = range(1, values.shape[1] + 1)
            labels += [f"{experiment} mode {i}".strip() for i in numbers]
    with np.errstate(divide="ignore", invalid="ignore"):
        return tuple(labels), 2 * np.log(np.concatenate(columns, axis=1))


def _fit_quadratic(draws: Floats, values: Floats) -> tuple[Floats, Floats, Floats]:
    """Return gradients ``(m, d)`` at the mean of the draws, R^2 and second derivatives.

    The second derivatives are those along each parameter, ``(m, d)``.
    """
    n, d = draws.shape
    # Whitened, because the squares of correlated draws are nearly collinear.
    U, S, Vt = np.linalg.svd(draws - draws.mean(axis=0), full_matrices=False)
    white, turn = np.sqrt(n) * U, np.sqrt(n) * Vt / S[:, None]
    i, j = np.triu_indices(d)
    design = np.column_stack([white, white[:, i] * white[:, j], np.ones(n)])
    with np.errstate(invalid="ignore"):  # values that are not finite give NaN
        y = values - values.mean(axis=0)
        coefficients = np.linalg.pinv(design) @ y
        rest = y - design @ coefficients
        variance = (rest**2).sum(axis=0) / (n - design.shape[1])
        total = y.var(axis=0, ddof=1)
    still = total <= FLAT**2
    slopes = coefficients[:d].T @ turn
    curvature = 2 * coefficients[d:-1].T @ (turn[i] * turn[j])
    r_squared = 1 - variance / np.maximum(total, FLAT**2)
    slopes = np.where(still[:, None], 0.0, slopes)
    return slopes, np.where(still, np.nan, r_squared), curvature
