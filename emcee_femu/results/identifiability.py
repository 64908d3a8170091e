"""What the data say about each parameter, read off the samples alone."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..interfaces import Floats
from ..table import Table
from .inference_data import dataset, samples

UNINFORMED = 0.9  # sd ratio above which a parameter is as uncertain as before
MOVED = 0.5  # prior sds; data that leave 0.9 of the sd move the mean by 0.4 or so
TOGETHER = 0.95  # |correlation| above which only a combination is known well
NEAR, CROWDED = 0.01, 0.05  # a uniform density has a share of 0.01 so near a bound
GOOD_FIT = 0.98  # R^2 below which gradients were off by 10 % and more (H structure)
FLAT = 1e-9  # sd of ln(lambda) of a mode that no parameter changes, but rounding
COLLINEAR = 1e-6  # relative singular value of samples that do not span all directions
PER_COEFFICIENT = 3  # different values of a parameter for each fitted coefficient
ENOUGH = 10_000  # samples in a fit; 3,000 gave the same gradients as 72,000


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What :func:`identifiability` found; ``print`` it for tables and findings.

    Attributes:
        names: Parameter names, ``d`` of them.
        sd_ratio: Posterior by prior standard deviation, ``(d,)``: near 1 the data say
            nothing, near 0 they say everything.
        shift: Posterior minus prior mean in prior standard deviations, ``(d,)``; NaN
            where idata does not hold ``prior_mean``.
        correlation: Of the posterior, ``(d, d)``.
        at_bound: Share of samples within 1 % of the range of the lower and of the
            upper bound, ``(d, 2)``; of a range with an infinite end, within 4 % of a
            prior standard deviation.
        sensitivities: d ln(lambda_i) per prior standard deviation of each parameter,
            at the posterior mean, ``(n_modes, d)``; NaN where the samples do not tell.
        r_squared: Of the fits behind the sensitivities, ``(n_modes,)``; NaN for a mode
            that no parameter changes.
        findings: Plain sentences.
    """

    names: tuple[str, ...]
    sd_ratio: Floats
    shift: Floats
    correlation: Floats
    at_bound: Floats
    sensitivities: Floats
    r_squared: Floats
    findings: tuple[str, ...]

    @property
    def table(self) -> Table:
        """A row a parameter: sd ratio, shift, strongest correlation, at a bound."""
        partners = _strongest(self.correlation)
        rows = tuple(
            (
                name,
                float(self.sd_ratio[i]),
                float(self.shift[i]),
                "" if j is None else self.names[j],
                np.nan if j is None else float(self.correlation[i, j]),
                100 * float(self.at_bound[i].max()),
                100 * float(np.abs(self.sensitivities[:, i]).max(initial=0.0)),
            )
            for i, (name, j) in enumerate(zip(self.names, partners, strict=True))
        )
        columns = (
            "parameter",
            "sd/prior sd",
            "shift/prior sd",
            "with",
            "correlation",
            "at a bound %",
            "largest sensitivity %",
        )
        formats = ("", ".2f", "+.2f", "", "+.2f", ".1f", ".3g")
        return Table("What the data say", columns, formats, rows)

    @property
    def sensitivity_table(self) -> Table:
        """A row a parameter and a column a mode, in percent; the last row is R^2."""
        m = len(self.sensitivities)
        rows = [
            (name, *map(float, 100 * column))
            for name, column in zip(self.names, self.sensitivities.T, strict=True)
        ]
        return Table(
            "Sensitivity of the eigenvalues: % per prior standard deviation",
            ("parameter", *(f"mode {i + 1}" for i in range(m))),
            ("", *m * (".3g",)),
            (*rows, ("R^2", *map(float, self.r_squared))),
        )

    def __str__(self) -> str:
        """Return the tables and the findings."""
        tables = [str(self.table), str(self.sensitivity_table)]
        return "\n".join([*tables, *self.findings])


def identifiability(idata: Any) -> Identifiability:
    r"""Say which parameters the data inform, from the samples, without an FE solve.

    The sensitivities are gradients at the posterior mean,

    .. math:: S_{ij} = \mathrm{sd}_{prior,j}
        \frac{\partial \ln \lambda_i}{\partial \theta_j}, \qquad
        \lambda_i = (2 \pi f_i)^2

    of a full quadratic in all parameters, fitted to the predicted frequencies of the
    samples by least squares; its adjusted R^2 says how far they can be believed. (A
    plane is not enough: good data hold the frequencies where they are, and what is
    left of their variation is curvature.) Of a parameter that only a likelihood term
    reads, such as a noise level, they are zero up to chance.

    The findings name a parameter that the data do not inform (sd ratio above 0.9 and
    mean shifted by less than 0.5 prior sd), a pair of which a combination alone is
    known well (absolute correlation above 0.95), a bound that the posterior is pressed
    against (more than 5 % of the samples within 1 % of the range) and a mode of
    R^2 below 0.98. The prior is taken as independent. Of three or more parameters that
    the data see only together no pair need be correlated so strongly.

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
    _check_enough(names, draws)
    constants = dataset(idata, "constant_data")
    prior_sd = constants["prior_sd"].values
    mean, sd = draws.mean(axis=0), draws.std(axis=0, ddof=1)
    shift = np.full(len(names), np.nan)
    if "prior_mean" in constants:
        shift = (mean - constants["prior_mean"].values) / prior_sd
    predicted = dataset(idata, "response")["frequency"]
    frequencies = predicted.transpose("chain", "draw", "mode").values
    fitted = np.linspace(0, len(draws) - 1, min(len(draws), ENOUGH)).astype(int)
    gradients, r_squared = _gradients(
        draws[fitted] / sd, frequencies.reshape(len(draws), -1)[fitted]
    )
    bounds = np.column_stack([constants["lower"].values, constants["upper"].values])
    correlation = np.corrcoef(draws, rowvar=False).reshape(len(names), -1)
    found: dict[str, Any] = {
        "names": tuple(names),
        "sd_ratio": sd / prior_sd,
        "shift": shift,
        "correlation": correlation,
        "at_bound": _shares_at_bounds(draws, bounds, prior_sd),
        "sensitivities": gradients * (prior_sd / sd),
        "r_squared": r_squared,
    }
    return Identifiability(**found, findings=(*_findings(found, prior_sd, bounds),))


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
    if not S[-1] > COLLINEAR * S[0]:
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


def _strongest(correlation: Floats) -> list[int | None]:
    """Return the parameter with which each one is correlated most."""
    if len(correlation) == 1:
        return [None]
    others = np.abs(correlation) - 2 * np.eye(len(correlation))
    return [int(j) for j in others.argmax(axis=1)]


def _findings(found: dict[str, Any], prior_sd: Floats, bounds: Floats) -> list[str]:
    names, ratios = found["names"], found["sd_ratio"]
    paired = (np.abs(found["correlation"]) > TOGETHER).sum(axis=1) > 1
    sentences = [
        _uninformed(found, int(i), alone=not paired[i])
        for i in np.flatnonzero(ratios > UNINFORMED)
    ]
    sentences += [
        _combination(found, i, j, prior_sd)
        for i, j in np.argwhere(np.triu(np.abs(found["correlation"]) > TOGETHER, 1))
    ]
    if not sentences:
        sentences = [
            f"The data inform every parameter, {names[int(ratios.argmax())]} least (sd "
            f"ratio {ratios.max():.2f})."
        ]
    for i, side in np.argwhere(found["at_bound"] > CROWDED):
        share, which = found["at_bound"][i, side], ("lower", "upper")[side]
        sentences.append(
            f"{names[i]} is pressed against its {which} bound {bounds[i, side]:.5g}: "
            f"{100 * share:.0f} % of the samples lie within 1 % of the range of it. "
            "Widen the bounds, or doubt the model."
        )
    sentences += [
        f"Mode {i + 1}: its sensitivities are rough, for ln(lambda) is not a quadratic "
        f"over the samples (R^2 {found['r_squared'][i]:.2f})."
        for i in np.flatnonzero(found["r_squared"] < GOOD_FIT)
    ]
    if np.isnan(found["sensitivities"]).all():
        sentences.append(
            "There are no sensitivities: the samples do not span all directions of "
            "the parameters. Run longer, or with more walkers."
        )
    return sentences


def _uninformed(found: dict[str, Any], i: int, alone: bool) -> str:
    name, shift = found["names"][i], found["shift"][i]
    if abs(shift) >= MOVED:  # never of NaN
        return (
            f"The data move {name} by {shift:+.1f} prior standard deviations, but "
            f"leave it as uncertain as before (sd ratio {found['sd_ratio'][i]:.2f})."
        )
    reason = ""
    largest = np.abs(found["sensitivities"][:, i]).max(initial=0.0)
    if not np.isnan(largest):
        reason = (
            "; a prior standard deviation of it changes the eigenvalues by "
            f"{100 * largest:.2g} % at most"
        )
    return (
        f"The data say nothing about {name}{'' if alone else ' by itself'}: it is as "
        f"uncertain as before (sd ratio {found['sd_ratio'][i]:.2f}){reason}."
    )


def _combination(found: dict[str, Any], i: int, j: int, prior_sd: Floats) -> str:
    """Say which combination of two parameters is known best, by their prior sds."""
    pair = [i, j]
    ratios, r = found["sd_ratio"][pair], found["correlation"][i, j]
    covariance = np.outer(ratios, ratios) * [[1.0, r], [r, 1.0]]
    variances, directions = np.linalg.eigh(covariance)
    first, second = directions[:, 0] / prior_sd[pair]
    a, b = (found["names"][k] for k in pair)
    sign = "+" if second / first > 0 else "-"
    best = np.sqrt(max(variances[0], 0.0))
    return (
        f"Only {a} {sign} {abs(second / first):.3g} {b} of {a} and {b} is known well: "
        f"sd ratio {best:.2g}, but {ratios[0]:.2g} and {ratios[1]:.2g} of them "
        f"(correlation {r:+.3f})."
    )
