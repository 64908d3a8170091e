"""What the data say about each parameter, from samples or near a maximum."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import skew

from ..contracts import Floats
from ..digits import show
from ..posterior.derivatives import place
from ..posterior.priors import summarize_prior
from ..search.find_map import FoundMap
from ..search.quadratic import draw_inside, moments_inside
from ..table import Column, Parts, Report, Table
from .arviz_objects import (
    InferenceData,
    dataset,
    note_of,
    prior_draws,
    samples,
)
from .bounds import find_density
from .sensitivities import Fit, by_mode, fit_sensitivities
from .to_arviz import read_samples

PRIOR_COMPARED = 4_000
CLEAR = 0.2  # by which the skewness of a prior exceeds that of its logarithm
PER_COEFFICIENT = 3  # different samples for each fitted coefficient
UNINFORMED = 0.9  # sd ratio above which a parameter is as uncertain as before
MORE = 1 / UNINFORMED  # and above which it is more so
SURPRISING = 2.0  # prior sds by which an error may exceed its prior mean
FOLLOWED = 4.0  # prior sds by which data may move a parameter without a doubt
TOGETHER = 0.95  # |correlation| above which only a combination is known well
MANY = 3  # uninformed parameters from which on the known combinations are named
INFORMED = 0.5  # sd ratio below which a combination is worth naming
MOST_COMBINATIONS, SMALL_PART = 3, 0.15
GOOD_FIT = 0.98  # R^2; below it, gradients were off by 10 % and more (H structure)
SMALL_EFFECT = 0.1  # effects and percentages are printed to two digits of this


@dataclass(frozen=True, eq=False, repr=False)
class Identifiability(Report):
    """The result of :func:`.identifiability`; ``print`` it for tables and findings.

    Attributes:
        names: Parameter names, ``d`` of them.
        is_error: Whether only likelihood terms read it (noise, discrepancy), ``(d,)``.
        prior_mean: Means of the prior, ``(d,)``.
        prior_sd: Standard deviations of the prior, ``(d,)``.
        bounds: Bounds of the prior, ``(d, 2)``.
        mean: Means of the posterior, ``(d,)``.
        covariance: Covariance matrix of the posterior, ``(d, d)``.
        at_bound: Density at the lower and the upper bound, relative to the highest
            anywhere, ``(d, 2)``, estimated from tenths of the samples; for positive
            parameters that of the logarithm. 0 at an infinite bound, and at a bound of
            zero, which nature sets.
        pressed: Whether the posterior is pressed against these bounds, ``(d, 2)``: that
            density is at least 0.75, and twice the prior's. Never an error against its
            lower bound: it may well be as small.
        modes: The label of each row of the sensitivities.
        sensitivities: d ln(lambda_i) per prior standard deviation of each parameter
            (of its logarithm where ``logarithms`` are not NaN), at the posterior mean,
            ``(n_modes, d)``; NaN for a mode without a positive frequency, and for error
            parameters.
        r_squared: R^2 of the fits behind the sensitivities, ``(n_modes,)``; NaN for a
            mode that no parameter changes.
        effect: Change of all measured quantities, including shapes, in standard errors
            per prior standard deviation of each parameter, or of its logarithm, as for
            ``sensitivities``, ``(d,)``; NaN if unknown and for error parameters.
        logarithms: Mean and standard deviation of the logarithm, of the prior and then
            of the posterior, ``(4, d)``. NaN unless the parameter is positive and its
            prior is more symmetrical on the log scale (e.g. lognormal).
        local: The source of the numbers if it is a maximum of the posterior, not
            samples.
        note: What is noted of the samples, such as the verdict of :func:`.certify`.
    """

    names: tuple[str, ...]
    is_error: NDArray[np.bool_]
    prior_mean: Floats
    prior_sd: Floats
    bounds: Floats
    mean: Floats
    covariance: Floats
    at_bound: Floats
    pressed: NDArray[np.bool_]
    modes: tuple[str, ...]
    sensitivities: Floats
    r_squared: Floats
    effect: Floats
    logarithms: Floats
    local: str = ""
    note: str = ""

    @property
    def sd_ratio(self) -> Floats:
        """Posterior over prior standard deviation; near 1 the data say nothing.

        Computed on the log scale if the prior is (e.g. lognormal).
        """
        ratio = np.sqrt(np.diag(self.covariance)) / self.prior_sd
        _, before, _, after = self.logarithms
        return np.where(np.isnan(before), ratio, after / before)

    @property
    def shift(self) -> Floats:
        """Posterior minus prior mean in prior standard deviations, ``(d,)``.

        Computed on the log scale if the prior is (e.g. lognormal).
        """
        shift = (self.mean - self.prior_mean) / self.prior_sd
        mean, sd, after, _ = self.logarithms
        return np.where(np.isnan(sd), shift, (after - mean) / sd)

    @property
    def correlation(self) -> Floats:
        """The correlation matrix of the posterior, ``(d, d)``."""
        sd = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(sd, sd))

    @property
    def surprising(self) -> tuple[str, ...]:
        """Errors that are inferred to be far above their prior."""
        far = self.is_error & (self.shift > SURPRISING)
        return tuple(self.names[i] for i in np.flatnonzero(far))

    @property
    def findings(self) -> tuple[str, ...]:
        """What the data leave open, bounds that matter, and doubts, in sentences."""
        first = [text for text in (self.local, self.note) if text]
        pressed, small = self.find_pressed(), self._find_unknown()
        if not pressed and not small:
            least = int(self.sd_ratio.argmax())
            small = [
                f"The data inform every parameter, {self.names[least]} least (sd ratio "
                f"{self.sd_ratio[least]:.2f})."
            ]
        doubts = *self.find_followed(), *self.find_doubts()
        return (*first, *pressed, *small, *doubts)

    def _find_unknown(self) -> list[str]:
        """Name what the data leave open, and what they determine nevertheless."""
        names, correlation = self.names, self.correlation
        together = np.triu(np.abs(correlation) > TOGETHER, 1)
        uninformed = np.flatnonzero(self.sd_ratio > UNINFORMED)
        compared = "as uncertain as", "more uncertain than"
        sentences = [
            f"The data leave {names[i]} {compared[bool(ratio > MORE)]} before (sd "
            f"ratio {ratio:.3g}), and move it by {self.shift[i]:+.1f} prior standard "
            "deviations."
            for i, ratio in zip(uninformed, self.sd_ratio[uninformed], strict=True)
        ]
        for pair in np.argwhere(together):
            variances, directions = self._principal(pair)
            first, second = directions[:, 0] / self.prior_sd[pair]
            (a, b), ratios = (names[k] for k in pair), self.sd_ratio[pair]
            sentences.append(
                f"Only {_add(a, second / first, b)} is known well, not {a} and {b} by "
                f"themselves: sd ratio {np.sqrt(variances[0]):.2g}, against "
                f"{ratios[0]:.2g} and {ratios[1]:.2g} (correlation "
                f"{correlation[*pair]:+.3f})."
            )
        if (~self.is_error[uninformed]).sum() >= MANY:
            sentences.append(self._name_combinations())
        return sentences

    def _name_combinations(self) -> str:
        """Name the directions in which the posterior is narrowest, in prior sds."""
        structural = np.flatnonzero(~self.is_error)
        variances, directions = self._principal(structural)
        narrow = np.flatnonzero(np.sqrt(variances) < INFORMED)
        if not len(narrow):
            return "No combination of the parameters is known well either."
        words = []
        for k in narrow[:MOST_COMBINATIONS]:
            text, vector = "", directions[:, k] * np.sign(directions[:, k].sum())
            for i in np.argsort(-np.abs(vector)):
                if np.abs(vector[i]) >= SMALL_PART:
                    text = _add(text, vector[i], self.names[structural[i]], ".2f")
            words.append(f"{text} (sd ratio {np.sqrt(variances[k]):.2g})")
        return (
            f"{len(narrow)} of {len(structural)} independent combinations are known "
            f"well (sd ratio below {INFORMED}), best, in prior standard deviations: "
            f"{'; '.join(words)}."
        )

    def _principal(self, which: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Return variances and directions of parameters in prior sds, least first."""
        scaled = self.covariance / np.outer(self.prior_sd, self.prior_sd)
        variances, directions = np.linalg.eigh(scaled[np.ix_(which, which)])
        return np.maximum(variances, 0.0), directions

    def find_pressed(self) -> list[str]:
        """Name bounds that the posterior is pressed against."""
        what = "the Gaussian's" if self.local else "its"
        return [
            f"{self.names[i]} is pressed against its {('lower', 'upper')[side]} bound "
            f"{self.bounds[i, side]:.5g}, where {what} density is highest. Widen that "
            "bound unless nature sets it, or question the model."
            for i, side in np.argwhere(self.pressed)
        ]

    def find_followed(self) -> list[str]:
        """Name parameters that the data moved further than the prior makes likely."""
        far = ~self.is_error & (np.abs(self.shift) > FOLLOWED)
        return [
            f"{self.names[i]} is {self.shift[i]:+.1f} prior standard deviations from "
            "its prior mean: is something wrong in the model or in the test (a unit, a "
            "mass, a sensor), or is the prior too narrow?"
            for i in np.flatnonzero(far)
        ]

    def find_doubts(self) -> list[str]:
        """Name errors that are larger than expected, and rough sensitivities."""
        return [
            f"{self.names[i]} is inferred at {self.mean[i]:.2g}, {self.shift[i]:.1f} "
            "prior standard deviations above its prior mean: model and data disagree "
            "by more than was expected. Look for what the model lacks, and for what is "
            "wrong in the test; widen this prior only if such an error is credible."
            for i in map(self.names.index, self.surprising)
        ] + [
            f"The sensitivities of {self.modes[i]} are rough, for ln(lambda) is not a "
            f"quadratic over the samples (R^2 {self.r_squared[i]:.2f})."
            for i in np.flatnonzero(self.r_squared < GOOD_FIT)
        ]

    @property
    def table(self) -> Table:
        """Sd ratio, shift, strongest correlation and share at a bound, by parameter."""
        d = len(self.names)
        strongest = (np.abs(self.correlation) - 2 * np.eye(d)).argmax(axis=1)
        partners = [self.names[j] if d > 1 else "" for j in strongest]
        pairs = self.correlation[np.arange(d), strongest]
        effect = show(self.effect, np.fmax(self.effect, SMALL_EFFECT))
        return Table.from_columns(
            "What the data say",
            [
                ("parameter", "", list(self.names)),
                ("sd/prior sd", ".2f", self.sd_ratio),
                ("shift/prior sd", "+.2f", self.shift),
                ("with", "", partners),
                ("correlation", "+.2f", np.where(d > 1, pairs, np.nan)),
                ("at a bound %", ".1f", 100 * self.at_bound.max(axis=1)),
                ("effect/error", effect, self.effect),
            ],
        )

    @property
    def sensitivity_table(self) -> Table:
        """One row per parameter, one column per mode, in percent; R^2 of fits."""
        percent = 100 * self.sensitivities[:, ~self.is_error]
        labels = np.array(self.names)[~self.is_error].tolist()
        if not self.local:  # then nothing was fitted
            labels, percent = [*labels, "R^2"], np.c_[percent, self.r_squared]
        rows = zip(self.modes, percent, strict=True)
        columns: list[Column] = [("parameter", "", labels)]
        columns += [(mode, show(row, SMALL_EFFECT), row) for mode, row in rows]
        title = "Sensitivity of the eigenvalues: % per prior standard deviation"
        logged = ~np.isnan(self.logarithms[1])
        if logged.any():
            title += f" (of the logarithm of {', '.join(np.array(self.names)[logged])})"
        return Table.from_columns(title, columns)

    def _parts(self) -> Parts:
        sensitivities = [self.sensitivity_table] if self.modes else []
        return self.table, *sensitivities, *self.findings


def identifiability(idata: object) -> Identifiability:
    r"""Report which parameters the data determine, from samples, without an FE solve.

    Use it after :func:`run` to see what was learned, or before with the result of
    :func:`find_map`. The numbers are then those of the Gaussian at the heaviest
    maximum, truncated at the bounds, and are marked as local; the sensitivities are
    finite differences, which take ``2 d + 1`` solves.

    The sensitivities from samples are gradients at the posterior mean,

    .. math:: S_{ij} = \mathrm{sd}_{prior,j}
        \frac{\partial \ln \lambda_i}{\partial \theta_j}, \qquad
        \lambda_i = (2 \pi f_i)^2

    of a full quadratic in all parameters, fitted to the predicted frequencies of the
    samples by least squares. Its adjusted R^2 shows how reliable they are. (A linear
    fit is not enough: good data keep the frequencies nearly constant, and most of the
    remaining variation is curvature.) Parameters that only likelihood terms read, such
    as a noise level, have no sensitivities. The effect in standard errors includes all
    measured quantities, such as shapes and deflections; it follows from the curvature
    of the log-likelihood, which is fitted in the same way. Ratios, shifts,
    sensitivities and effects are those of the logarithm of a parameter whose prior is
    more symmetrical there (e.g. lognormal): for it, the standard deviation in the
    formula is that of the logarithm, and the derivative is multiplied by the parameter.

    The findings list

    - what the data leave open: a parameter as uncertain as before (sd ratio above 0.9),
      a pair that is well known only in combination (absolute correlation above
      0.95), and, if three or more parameters are not determined, the best known
      combinations;
    - bounds that the posterior is pressed against: its density is highest there (of the
      logarithm of a positive parameter), and at least twice that of the prior. A bound
      of zero is never named: no positive parameter can go beyond it;
    - doubts: a parameter more than 4 prior sds from its prior mean, an error more than
      2 above it, and a mode with R^2 below 0.98.

    The prior is assumed to be independent.

    Args:
        idata: The result of :func:`run`, or of :func:`to_inference_data` without
            burn-in; or the result of :func:`find_map`.

    Returns:
        Numbers and findings; ``print`` it.

    Raises:
        TypeError: If idata is none of these.
        ValueError: If there are fewer distinct samples than three for each of the
            (d + 1)(d + 2) / 2 coefficients of the quadratic.

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
    return describe_samples(read_samples(idata)[0])


def describe_samples(idata: InferenceData, fitted: bool = True) -> Identifiability:
    """Describe samples; without ``fitted``, no sensitivities are computed."""
    names, chains = samples(idata)
    draws, d = chains.reshape(-1, len(names)), len(names)
    constants = dataset(idata, "constant_data")
    is_error = constants["is_error"].values.astype(bool)
    needed = PER_COEFFICIENT * (d + 1) * (d + 2) // 2
    if fitted and (different := len(np.unique(draws, axis=0))) < needed:
        raise ValueError(
            f"idata: expected at least {needed} different samples for {d} "
            f"parameter(s), got {different}; run longer"
        )
    known = (
        tuple(names),
        is_error,
        constants["prior_mean"].values,
        constants["prior_sd"].values,
        constants[["lower", "upper"]].to_array().values.T,
    )
    fit: Fit = (), np.empty((0, d)), np.empty(0), np.full(d, np.nan)
    if fitted:
        fit = fit_sensitivities(idata, draws / known[3])
    moments = draws.mean(axis=0), np.atleast_2d(np.cov(draws, rowvar=False))
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # for parameters that may be negative
        logs = np.log(draws).mean(axis=0), np.log(draws).std(axis=0)
    weights, before = np.ones(len(draws)), prior_draws(idata, names)
    said = note_of(idata)
    by_draws = before, draws, weights, *moments, logs
    return _describe(known, *by_draws, fit, moments[0], "", said)


def _describe_maximum(maxima: FoundMap) -> Identifiability:
    """Describe the Gaussian at the heaviest maximum."""
    posterior, best = maxima.posterior, maxima.maxima[0]
    bounds = posterior.prior.bounds
    prior_mean, prior_sd = summarize_prior(posterior.prior)
    is_error = np.isin(posterior.names, posterior.error_names)
    gaussian = *best.gaussian, *bounds.T
    mean, covariance = moments_inside(*gaussian)
    draws, weights = draw_inside(*gaussian)
    stencil = place((posterior.prior, posterior.scale), best.theta[None])
    stacked = posterior.stack(stencil.points, "deviations")
    rows, r, sd = (stacked[:, part] for part in posterior.split(stacked))
    modes, log_eigenvalues = by_mode(posterior.unfold(rows))
    slopes = stencil.derive(log_eigenvalues)[0] * prior_sd
    effect = np.linalg.norm(stencil.derive(r)[0] / sd[0][:, None], axis=0) * prior_sd
    with np.errstate(divide="ignore", invalid="ignore"):
        # A Gaussian about a maximum says nothing about places far from it.
        logs = np.log(mean), np.sqrt(np.diag(covariance)) / mean
    before = posterior.prior.sample(np.random.default_rng(0), PRIOR_COMPARED)
    which, k = "the maximum", len(maxima.maxima)
    if k > 1:
        which += f" of weight {maxima.weights[0]:.2f}, one of {k}"
    said = (
        f"Local: these are numbers of the Gaussian about {which}. Samples of a "
        "posterior that is not Gaussian may say otherwise."
    )
    known = posterior.names, is_error, prior_mean, prior_sd, bounds
    by_draws = before, draws, weights, mean, covariance, logs
    fit = modes, slopes, np.full(len(modes), np.nan), effect
    return _describe(known, *by_draws, fit, best.theta, said)


def _describe(
    known: tuple[tuple[str, ...], NDArray[np.bool_], Floats, Floats, Floats],
    before: Floats,
    draws: Floats,
    weights: Floats,
    mean: Floats,
    covariance: Floats,
    logs: tuple[Floats, Floats],
    fit: Fit,
    at: Floats,
    local: str = "",
    note: str = "",
) -> Identifiability:
    """Return the description of draws of the posterior, compared with the prior.

    The log scale is used where the prior is clearly more symmetrical on it, but never
    for errors, which may well be zero.

    Args:
        known: The first five attributes of the result.
        before: Draws of the prior.
        draws: Draws of the posterior, ``(n, d)``.
        weights: Weights of these.
        mean: Mean of the posterior.
        covariance: Covariance of the posterior.
        logs: Mean and standard deviation of the posterior's logarithm.
        fit: Modes, sensitivities, R^2 and effects, per prior standard deviation.
        at: Where they were derived, ``(d,)``.
        local: As in the result.
        note: As in the result.
    """
    names, is_error, prior_mean, prior_sd, bounds = known
    at_bound, pressed = find_density(bounds, before, draws, weights)
    pressed[:, 0] &= ~is_error
    with np.errstate(divide="ignore", invalid="ignore"):
        logged = np.log(before)
        skews = [np.abs(skew(values, axis=0)) for values in (logged, before)]
        apt = skews[0] + CLEAR < skews[1]  # never for NaN
        moments = np.stack([logged.mean(axis=0), logged.std(axis=0), *logs])
    modes, slopes, r_squared, effect = fit
    slopes, effect = (np.where(is_error, np.nan, x) for x in (slopes, effect))
    moments = np.where(apt & ~is_error, moments, np.nan)
    # d/d ln(x) is x d/dx.
    scale = np.where(np.isnan(moments[1]), 1.0, at * moments[1] / prior_sd)
    slopes, effect = slopes * scale, effect * scale
    return Identifiability(
        names=names,
        is_error=is_error,
        prior_mean=prior_mean,
        prior_sd=prior_sd,
        bounds=bounds,
        mean=mean,
        covariance=covariance,
        at_bound=at_bound,
        pressed=pressed,
        modes=modes,
        sensitivities=slopes,
        r_squared=r_squared,
        effect=effect,
        logarithms=moments,
        local=local,
        note=note,
    )


def _add(text: str, factor: float, name: str, spec: str = ".3g") -> str:
    """Add one more multiple of a parameter to a sum in words."""
    if not text:
        return f"{factor:{spec}} {name}"
    return f"{text} {'+' if factor > 0 else '-'} {abs(factor):{spec}} {name}"
