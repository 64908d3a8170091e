"""What the data say about each parameter, read off samples, or near a maximum."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ..interfaces import Floats, read
from ..posterior.derivatives import place
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import summarize_prior
from ..sampling.find_map import FoundMap
from ..sampling.quadratic import draw_inside, is_inside, moments_inside
from ..table import Parts, Report, Table
from .arviz_objects import (
    InferenceData,
    dataset,
    describe_certificate,
    samples,
    spread_out,
)
from .findings import describe_findings
from .to_arviz import read_samples

NEAR = 0.01  # of the range; a uniform density has a share of 0.01 so near a bound
FLAT = 1e-9  # sd of ln(lambda) of a mode that no parameter changes, but rounding
COLLINEAR = 1e-6  # relative singular value of samples that do not span all directions
PER_COEFFICIENT = 3  # different values of a parameter for each fitted coefficient
ENOUGH = 10_000  # samples in a fit; 3,000 gave the same gradients as 72,000


@dataclass(frozen=True, eq=False)
class Identifiability(Report):
    """What :func:`.identifiability` found; ``print`` it for tables and findings.

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
        from_bound: Distance of the posterior mean from the lower and from the upper
            bound, in posterior standard deviations, ``(d, 2)``.
        modes: Which mode each row of the sensitivities is, in words.
        sensitivities: d ln(lambda_i) per prior standard deviation of each parameter,
            at the posterior mean, ``(n_modes, d)``; NaN where the samples do not tell,
            and for the parameters of errors.
        r_squared: R^2 of the fits behind the sensitivities, ``(n_modes,)``; NaN for a
            mode that no parameter changes.
        local: Where the numbers are from, if not from samples but from a maximum of the
            posterior.
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
    from_bound: Floats
    modes: tuple[str, ...]
    sensitivities: Floats
    r_squared: Floats
    local: str = ""
    findings: tuple[str, ...] = ()

    @property
    def table(self) -> Table:
        """Sd ratio, shift, strongest correlation, at a bound; one row per parameter."""
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
        """One row per parameter, one column per mode, in percent; R^2 of fits."""
        shown = [i for i, error in enumerate(self.is_error) if not error]
        percent = 100 * self.sensitivities[:, shown]
        labels = [self.names[i] for i in shown]
        if not self.local:  # then nothing was fitted
            labels, percent = [*labels, "R^2"], np.c_[percent, self.r_squared]
        by_mode = zip(self.modes, percent, strict=True)
        columns = [("parameter", "", labels), *((m, ".3g", row) for m, row in by_mode)]
        title = "Sensitivity of the eigenvalues: % per prior standard deviation"
        return Table.from_columns(title, columns)

    def _parts(self) -> Parts:
        sensitivities = [self.sensitivity_table] if self.modes else []
        return self.table, *sensitivities, *self.findings


def identifiability(idata: object) -> Identifiability:
    r"""Say which parameters the data inform, from the samples, without an FE solve.

    Before any sampling what :func:`find_map` found will do: the numbers are then those
    of the Gaussian about its heaviest maximum, cut at the bounds, and said to be local;
    the sensitivities are derivatives there, by one solve if the models have
    ``jacobian``, by ``2 d + 1`` otherwise.

    The sensitivities of samples are gradients at the posterior mean,

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
    against (more than 5 % of the samples within 1 % of the range, and the bound within
    3 posterior sds of the mean), an error more than 2
    prior sds above its prior mean, and a mode of R^2 below 0.98. The prior is taken as
    independent.

    Args:
        idata: What :func:`to_inference_data` returns, without burn-in, or :func:`run`;
            or what :func:`find_map` returns.

    Returns:
        Numbers and findings; ``print`` it.

    Raises:
        TypeError: If idata is neither.
        ValueError: If a parameter took fewer different values than three for each of
            the (d + 1)(d + 2) / 2 coefficients of the quadratic.

    Source: Fox and Kapoor (1968), doi:10.2514/3.5008, derive the same gradients from
    the mode shapes.

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k1"] ** 0.5], n_modes=1)
        >>> term = ef.FrequencyTerm([3.0], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k1"], [8.0], [2.0], [(1.0, 20.0)])
        >>> found = ef.find_map(ef.LogPosterior(model, term, prior), 4, seed=1)
        >>> ef.identifiability(found).sd_ratio.round(2).tolist()
        [0.09]
    """
    if isinstance(idata, FoundMap):
        return _describe_maximum(idata)
    idata, _ = read_samples(idata)
    return _describe_samples(idata)


def _describe(
    prior: tuple[Floats, Floats],
    mean: Floats,
    covariance: Floats,
    said: str,
    **known: Any,
) -> Identifiability:
    """Return numbers and findings; the prior is its mean and standard deviation."""
    (prior_mean, prior_sd), sd = prior, np.sqrt(np.diag(covariance))
    result = Identifiability(
        prior_sd=prior_sd,
        sd_ratio=sd / prior_sd,
        shift=(mean - prior_mean) / prior_sd,
        correlation=covariance / np.outer(sd, sd),
        from_bound=np.abs(known["bounds"] - mean[:, None]) / sd[:, None],
        **known,
    )
    findings = [said] if said else []
    return replace(result, findings=(*findings, *describe_findings(result)))


def _describe_samples(idata: InferenceData) -> Identifiability:
    """Return what samples say."""
    names, chains = samples(idata)
    draws = chains.reshape(-1, len(names))
    constants = dataset(idata, "constant_data")
    is_error = constants["is_error"].values.astype(bool)
    structural = np.flatnonzero(~is_error)
    d = len(structural)
    needed = PER_COEFFICIENT * (d + 1) * (d + 2) // 2
    for i in structural:
        if (different := len(np.unique(draws[:, i]))) < needed:
            raise ValueError(
                f"idata: {names[i]!r} took {different} different value(s), but at "
                f"least {needed} are needed for {d} parameter(s); run longer"
            )
    prior_sd, sd = constants["prior_sd"].values, draws.std(axis=0, ddof=1)
    modes, frequencies = _frequencies(idata, len(draws))
    sensitivities = np.full((len(modes), len(names)), np.nan)
    fitted = spread_out(len(draws), ENOUGH)
    gradients, r_squared = _gradients(
        (draws / sd)[np.ix_(fitted, structural)], frequencies[fitted]
    )
    sensitivities[:, structural] = gradients * (prior_sd / sd)[structural]
    bounds = np.column_stack([constants["lower"].values, constants["upper"].values])
    return _describe(
        (constants["prior_mean"].values, prior_sd),
        draws.mean(axis=0),
        np.atleast_2d(np.corrcoef(draws, rowvar=False)) * np.outer(sd, sd),
        describe_certificate(idata).strip(" ()"),
        names=tuple(names),
        is_error=is_error,
        bounds=bounds,
        at_bound=_shares_at_bounds(draws, bounds, prior_sd),
        modes=modes,
        sensitivities=sensitivities,
        r_squared=r_squared,
    )


def _frequencies(idata: InferenceData, n: int) -> tuple[tuple[str, ...], Floats]:
    """Return the modes of all experiments, in words, and their frequencies (n, m)."""
    labels: list[str] = []
    columns = [np.empty((n, 0))]
    for name, values in dataset(idata, "response").data_vars.items():
        experiment, _, variable = str(name).rpartition(".")
        if variable == "frequency":
            array = values.transpose("chain", "draw", ...).values.reshape(n, -1)
            columns.append(array)
            labels += _name_modes(experiment, array.shape[1])
    return tuple(labels), np.concatenate(columns, axis=1)


def _name_modes(experiment: str, count: int) -> list[str]:
    return [f"{experiment} mode {i + 1}".strip() for i in range(count)]


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


def _shares_at_bounds(
    draws: Floats, bounds: Floats, prior_sd: Floats, weights: Floats | None = None
) -> Floats:
    """Return the shares of the samples near the bounds, ``(d, 2)``."""
    low, high = bounds.T
    width = np.where(np.isfinite(high - low), high - low, 4 * prior_sd)
    near = [draws <= low + NEAR * width, draws >= high - NEAR * width]
    shares = [np.average(share, axis=0, weights=weights) for share in near]
    return np.stack(shares, axis=1)


def _describe_maximum(maxima: FoundMap) -> Identifiability:
    """Return what the Gaussian about the heaviest maximum says."""
    posterior, best = maxima.posterior, maxima.maxima[0]
    bounds = posterior.prior.bounds
    prior_mean, prior_sd = summarize_prior(posterior.prior)
    gaussian = best.theta, best.covariance, *bounds.T
    at_bound = np.zeros_like(bounds)
    if not is_inside(*gaussian):
        draws, log_weights = draw_inside(*gaussian)
        weights = special.softmax(log_weights)
        at_bound = _shares_at_bounds(draws, bounds, prior_sd, weights)
    is_error = np.isin(posterior.names, posterior.error_names)
    modes, sensitivities = _differentiate(posterior, best.theta)
    sensitivities[:, is_error] = np.nan
    which, k = "the maximum", len(maxima.maxima)
    if k > 1:
        which += f" of weight {maxima.weights[0]:.2f}, one of {k}"
    local = (
        f"Local: of the Gaussian about {which}, not of samples. Where the posterior is "
        "not Gaussian samples may say otherwise."
    )
    return _describe(
        (prior_mean, prior_sd),
        *moments_inside(*gaussian),
        local,
        names=posterior.names,
        is_error=is_error,
        bounds=bounds,
        at_bound=at_bound,
        modes=modes,
        sensitivities=sensitivities * prior_sd,
        r_squared=np.full(len(modes), np.nan),
        local=local,
    )


def _differentiate(
    posterior: LogPosterior, theta: Floats
) -> tuple[tuple[str, ...], Floats]:
    """Return the modes of all experiments, in words, and d ln(lambda) (m, d)."""
    labels: list[str] = []
    parts = [np.empty((0, posterior.ndim))]
    stencil = place(posterior.prior, theta[None], posterior.scale)
    rows = None if posterior.differentiable else posterior(stencil.points)
    parameters = posterior.parameters(theta[None])
    for experiment in posterior.experiments:
        if "frequency" not in experiment.variables:
            continue
        if rows is None:
            solved = experiment.solve(parameters, posterior.names, derivatives=True)
            frequency = np.asarray(read(solved.response, "frequency"))[0]
            slopes = solved.tangents["frequency"][0]
        else:
            name = experiment.full_name("frequency")
            values = rows[:, posterior.columns[name]]
            frequency, slopes = values[0], stencil.derive(values[None])[0]
        labels += _name_modes(experiment.name, len(slopes))
        usable = frequency > 0  # rigid-body modes have no logarithm
        inverse = np.where(usable, 2 / np.where(usable, frequency, 1), np.nan)
        parts.append(slopes * inverse[:, None])
    return tuple(labels), np.concatenate(parts)
