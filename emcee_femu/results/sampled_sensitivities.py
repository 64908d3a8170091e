"""What samples say about each parameter, and the sensitivities that they show."""

from typing import Any

import numpy as np

from ..interfaces import Floats
from .arviz_objects import dataset, samples

NEAR = 0.01  # of the range; a uniform density has a share of 0.01 so near a bound
FLAT = 1e-9  # sd of ln(lambda) of a mode that no parameter changes, but rounding
COLLINEAR = 1e-6  # relative singular value of samples that do not span all directions
PER_COEFFICIENT = 3  # different values of a parameter for each fitted coefficient
ENOUGH = 10_000  # samples in a fit; 3,000 gave the same gradients as 72,000


def describe_samples(idata: Any) -> dict[str, Any]:
    """Return the fields of an ``Identifiability`` from the samples."""
    names, chains = samples(idata)
    draws = chains.reshape(-1, len(names))
    constants = dataset(idata, "constant_data")
    is_error = constants["is_error"].values.astype(bool)
    structural = np.flatnonzero(~is_error)
    _check_enough([names[i] for i in structural], draws[:, structural])
    prior_sd = constants["prior_sd"].values
    mean, sd = draws.mean(axis=0), draws.std(axis=0, ddof=1)
    modes, frequencies = _frequencies(idata, len(draws))
    sensitivities = np.full((len(modes), len(names)), np.nan)
    fitted = np.linspace(0, len(draws) - 1, min(len(draws), ENOUGH)).astype(int)
    gradients, r_squared = _gradients(
        (draws / sd)[np.ix_(fitted, structural)], frequencies[fitted]
    )
    sensitivities[:, structural] = gradients * (prior_sd / sd)[structural]
    bounds = np.column_stack([constants["lower"].values, constants["upper"].values])
    return {
        "names": tuple(names),
        "is_error": is_error,
        "prior_sd": prior_sd,
        "bounds": bounds,
        "sd_ratio": sd / prior_sd,
        "shift": (mean - constants["prior_mean"].values) / prior_sd,
        "correlation": np.corrcoef(draws, rowvar=False).reshape(len(names), -1),
        "at_bound": shares_at_bounds(draws, bounds, prior_sd),
        "from_bound": np.abs(bounds - mean[:, None]) / sd[:, None],
        "modes": modes,
        "sensitivities": sensitivities,
        "r_squared": r_squared,
    }


def _frequencies(idata: Any, n: int) -> tuple[tuple[str, ...], Floats]:
    """Return the modes of all experiments, in words, and their frequencies (n, m)."""
    labels: list[str] = []
    columns = [np.empty((n, 0))]
    for name, values in dataset(idata, "response").data_vars.items():
        experiment, _, variable = str(name).rpartition(".")
        if variable == "frequency":
            array = values.transpose("chain", "draw", ...).values.reshape(n, -1)
            columns.append(array)
            numbers = range(1, array.shape[1] + 1)
            labels += [f"{experiment} mode {i}".strip() for i in numbers]
    return tuple(labels), np.concatenate(columns, axis=1)


def _check_enough(names: list[str], draws: Floats) -> None:
    d = len(names)
    needed = PER_COEFFICIENT * (d + 1) * (d + 2) // 2
    for name, column in zip(names, draws.T, strict=True):
        different = len(np.unique(column))
        if different < needed:
            raise ValueError(
                f"idata: {name!r} took {different} different value(s), but at least "
                f"{needed} are needed for {d} parameter(s); run longer"
            )


def _gradients(draws: Floats, frequencies: Floats) -> tuple[Floats, Floats]:
    """Return gradients ``(m, d)`` of ln(lambda) at the mean of the draws, and R^2."""
    (n, d), m = draws.shape, frequencies.shape[1]
    gradients, r_squared = np.full((m, d), np.nan), np.full(m, np.nan)
    # Whitened, because the squares of correlated draws are nearly collinear.
    U, S, Vt = np.linalg.svd(draws - draws.mean(axis=0), full_matrices=False)
    if not d or not S[-1] > COLLINEAR * S[0]:
        return gradients, r_squared
    white = np.sqrt(n) * U
    i, j = np.triu_indices(d)
    design = np.column_stack([white, white[:, i] * white[:, j], np.ones(n)])
    usable = (frequencies > 0).all(axis=0)  # rigid-body modes have no logarithm
    log_eigenvalues = 2 * np.log(frequencies[:, usable])
    log_eigenvalues -= log_eigenvalues.mean(axis=0)
    coefficients = np.linalg.lstsq(design, log_eigenvalues)[0]
    rest = log_eigenvalues - design @ coefficients
    variance = (rest**2).sum(axis=0) / (n - design.shape[1])
    total = log_eigenvalues.var(axis=0, ddof=1)
    varies = total > FLAT**2
    slopes = np.sqrt(n) * (coefficients[:d].T / S) @ Vt
    gradients[usable] = np.where(varies[:, None], slopes, 0.0)
    r_squared[usable] = np.where(
        varies, 1 - variance / np.maximum(total, FLAT**2), np.nan
    )
    return gradients, r_squared


def shares_at_bounds(
    draws: Floats, bounds: Floats, prior_sd: Floats, weights: Floats | None = None
) -> Floats:
    """Return the shares of the samples near the bounds, ``(d, 2)``."""
    low, high = bounds.T
    width = np.where(np.isfinite(high - low), high - low, 4 * prior_sd)
    near = [draws <= low + NEAR * width, draws >= high - NEAR * width]
    shares = [np.average(share, axis=0, weights=weights) for share in near]
    return np.stack(shares, axis=1)
