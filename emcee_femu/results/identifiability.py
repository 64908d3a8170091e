"""What the data say about each parameter, read off samples, or near a maximum."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from ..sampling.found_map import FoundMap
from ..table import Parts, Report, Table
from .arviz_objects import describe_certificate
from .findings import describe_findings
from .local_sensitivities import describe_locally
from .sampled_sensitivities import describe_samples


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
        columns: list[tuple[str, str, Any]] = [("parameter", "", labels)]
        columns += [
            (mode, ".3g", row) for mode, row in zip(self.modes, percent, strict=True)
        ]
        title = "Sensitivity of the eigenvalues: % per prior standard deviation"
        return Table.from_columns(title, columns)

    def _parts(self) -> Parts:
        sensitivities = [self.sensitivity_table] if self.modes else []
        return self.table, *sensitivities, *self.findings


def identifiability(idata: Any) -> Identifiability:
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
        idata: What :func:`to_inference_data` returns, without burn-in, or what
            :func:`find_map` returns.

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
    local = isinstance(idata, FoundMap)
    fields = describe_locally(idata) if local else describe_samples(idata)
    found = Identifiability(**fields)
    said = found.local or ("" if local else describe_certificate(idata).strip(" ()"))
    findings = [*([said] if said else []), *describe_findings(found)]
    return replace(found, findings=tuple(findings))
