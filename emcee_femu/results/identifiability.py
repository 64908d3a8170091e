"""What the data say about each parameter, read off the samples."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from ..table import Table, as_html
from .arviz_objects import dataset, samples
from .findings import describe_findings

NEAR = 0.01  # of the range; a uniform density has a share of 0.01 so near a bound
FLAT = 1e-9  # sd of ln(lambda) of a mode that no parameter changes, but rounding
COLLINEAR = 1e-6  # relative singular value of samples that do not span all directions
PER_COEFFICIENT = 3  # different values of a parameter for each fitted coefficient
ENOUGH = 10_000  # samples in a fit; 3,000 gave the same gradients as 72,000


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What :func:`identifiability` found; ``print`` it for tables and findings.

    Attributes:
        names: Parameter names, ``d`` of them.
        is_error: Whether only likelihood terms read it (noise, discrepancy), ``(d,)``.
        prior_sd: Standard deviations of the prior, ``(d,)``.
        bounds: Bounds of the prior, ``(d, 2)``.
        sd_ratio: Posterior by prior standard deviation, ``(d,)``: near 1 the data say
            nothing, near 0 they say everything.
        shift: Posterior minus prior mean in prior standard deviations, ``(d,)``.
        correlation: Correlation matrix of the posterior, ``(d, d)``.
        at_bound: Share of samples within 1 % of the range of the lower and of the
            upper bound, ``(d, 2)``; of a range with an infinite end, within 4 % of a
            prior standard deviation.
        modes: Which mode each row of the sensitivities is, in words.
        sensitivities: d ln(lambda_i) per prior standard deviation of each parameter,
            at the posterior mean, ``(n_modes, d)``; NaN where the samples do not tell,
            and for the parameters of errors.
        r_squared: R^2 of the fits behind the sensitivities, ``(n_modes,)``; NaN for a
            mode that no parameter changes.
        findings: Plain sentences.
    """

    names: tuple[str, ...]
    is_error: NDArray[np.bool_]
    prior_sd: Floats
    bounds: Floats
    sd_ratio: Floats
    shift: Floats
    correlation: Floats
    at_bound: Floats
    modes: tuple[str, ...]
    sensitivities: Floats
    r_squared: Floats
    findings: tuple[str, ...] = ()

    @property
    def table(self) -> Table:
        """One row per parameter: sd ratio, shift, strongest correlation, at a bound."""
        d = len(self.names)
        strongest = (np.abs(self.correlation) - 2 * np.eye(d)).argmax(axis=1)
        partners = [self.names[j] if d > 1 else "" for j in strongest]
        pairs = self.correlation[np.arange(d), strongest]
        largest = np.full(d, np.nan)  # of a response without frequencies
        if self.modes:
            largest = np.abs(self.sensitivities).max(axis=0)
        return Table.from_columns(
            "What the data say",
            [
                ("parameter", "", list(self.names)),
                ("sd/prior sd", ".2f", self.sd_ratio),
                ("shift/prior sd", "+.2f", self.shift),
                ("with", "", partners),
                ("correlation", "+.2f", np.where(d > 1, pairs, np.nan)),
                ("at a bound %", ".1f", 100 * self.at_bound.max(axis=1)),
                ("largest sensitivity %", ".3g", 100 * largest),
            ],
        )

    @property
    def sensitivity_table(self) -> Table:
        """One row per parameter, one column per mode, in percent; last row: R^2."""
        shown = [i for i, error in enumerate(self.is_error) if not error]
        percent = 100 * self.sensitivities[:, shown]
        columns: list[tuple[str, str, Any]] = [
            ("parameter", "", [*(self.names[i] for i in shown), "R^2"])
        ]
        for mode, row, r in zip(self.modes, percent, self.r_squared, strict=True):
            columns.append((mode, ".3g", np.append(row, r)))
        title = "Sensitivity of the eigenvalues: % per prior standard deviation"
        return Table.from_columns(title, columns)

    def _tables(self) -> list[Table]:
        return [self.table, *([self.sensitivity_table] if self.modes else [])]

    def __str__(self) -> str:
        """Return the tables and the findings."""
        return "\n".join([*map(str, self._tables()), *self.findings])

    def _repr_html_(self) -> str:
        """Return the tables and the findings as notebooks show them."""
        return as_html(*self._tables(), *self.findings)


def identifiability(idata: Any) -> Identifiability:
    r"""Say which parameters the data inform, from the samples, without an FE solve.

    The sensitivities are gradients at the posterior mean,

    .. math:: S_{ij} = \mathrm{sd}_{prior,j}
        \frac{\partial \ln \lambda_i}{\partial \theta_j}, \qquad
        \lambda_i = (2 \pi f_i)^2

    of a full quadratic in all parameters, fitted to the predicted frequencies of the
    samples by least squares; its adjusted R^2 says how far they can be believed. (A
    plane is not enough: good data hold the frequencies where they are, and what is
    left of their variation is curvature.) Parameters that only likelihood terms read,
    such as a noise level, have none.

    The findings name a parameter that the data do not inform (sd ratio above 0.9 and
    mean shifted by less than 0.5 prior sd), a pair of which only a combination is
    known well (absolute correlation above 0.95), where three or more are not informed
    the combinations that the data know best, a bound that the posterior is pressed
    against (more than 5 % of the samples within 1 % of the range), an error more than 2
    prior sds above its prior mean, and a mode of R^2 below 0.98. The prior is taken as
    independent.

    Args:
        idata: What :func:`to_inference_data` returns, without burn-in.

    Raises:
        TypeError: If idata is not what :func:`to_inference_data` returns.
        ValueError: If a parameter took fewer different values than three for each of
            the (d + 1)(d + 2) / 2 coefficients of the quadratic.

    Source: Fox and Kapoor (1968), doi:10.2514/3.5008, derive the same gradients from
    the mode shapes.
    """
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
    found = Identifiability(
        names=tuple(names),
        is_error=is_error,
        prior_sd=prior_sd,
        bounds=bounds,
        sd_ratio=sd / prior_sd,
        shift=(mean - constants["prior_mean"].values) / prior_sd,
        correlation=np.corrcoef(draws, rowvar=False).reshape(len(names), -1),
        at_bound=_shares_at_bounds(draws, bounds, prior_sd),
        modes=modes,
        sensitivities=sensitivities,
        r_squared=r_squared,
    )
    return replace(found, findings=tuple(describe_findings(found)))


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


def _shares_at_bounds(draws: Floats, bounds: Floats, prior_sd: Floats) -> Floats:
    low, high = bounds.T
    width = np.where(np.isfinite(high - low), high - low, 4 * prior_sd)
    near = [draws <= low + NEAR * width, draws >= high - NEAR * width]
    return np.stack([share.mean(axis=0) for share in near], axis=1)
