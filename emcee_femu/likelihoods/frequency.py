"""The likelihood of measured natural frequencies."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats, Parameters, Response, modal_variables, read
from ..measurements import Measurements, modes
from .term import (
    MODEL_ERROR,
    Deviations,
    Term,
    add_discrepancy,
    choose_error,
    doubt_percent,
    error_array,
)

# Log-likelihood that an unpaired mode costs: as much as four standard deviations.
UNPAIRED = 8.0


class FrequencyTerm(Term):
    r"""Gaussian errors of the natural frequencies.

    .. math:: \ln p = -\tfrac12 r^T (R + \sigma_d^2 I)^{-1} r
        - \tfrac12 \ln\det 2\pi (R + \sigma_d^2 I) - \sum_i \ln f_i^m, \qquad
        r_i = \frac{f_i - f_i^m}{f_i^m}

    where :math:`f_i^m` are the measured and :math:`f_i` the model's frequencies, R is
    the covariance of the relative measurement errors and :math:`\sigma_d` the relative
    standard deviation of what the model cannot represent. In Eq. 2.2 of the paper R is
    diagonal with :math:`1 / \beta_i`, so that :math:`\beta_i^{-1/2}` is the relative
    standard deviation of mode i, and there is no :math:`\sigma_d`. A term
    on eigenvalues, :math:`f^2 / f_m^2 - 1`, has about twice these deviations.

    The lowest ``n_modes`` frequencies of the model are compared, in ascending order,
    or those of the paired modes, if the model is a :class:`PairedModel`. A mode without
    a pair costs 8 (four standard deviations) on top of its residual.

    Unknown noise is inferred by ``discrepancy="noise"`` without any of the others: then
    R = 0, and :math:`\sigma_d` is noise and model error together, which one test does
    not tell apart. Leave out the standard deviations of :class:`Measurements` too, by
    giving its ``frequencies``. Give this noise a prior with a lower bound above zero,
    such as ``(0.001, 0.05)`` in :class:`IndependentPrior`. If the model can fit all
    frequencies exactly, the likelihood grows without bound as the noise goes to zero.
    It can with as many parameters as frequencies. A prior with density at zero, such as
    a half-normal, then gives a posterior that is hard to sample. Jeffreys' prior
    1 / sigma gives one without a finite integral. If more frequencies than parameters
    fit exactly, as when a model is tested with its own output, a half-normal gives no
    finite integral either.

    The scatter of modal tests is often 0.2 %, the error of a good model 1 to 2 %: with
    the measured standard deviations alone the posterior is far too narrow. Give the
    name of a parameter as ``discrepancy`` beside them, and a prior such as
    ``scipy.stats.halfnorm(scale=0.02)``: the known errors keep the likelihood finite.

    Args:
        measured: Measured natural frequencies in Hz, ``(n_modes,)``, or
            :class:`Measurements`, whose standard deviations or covariance are then
            the default. A mode of which none is known has the discrepancy alone.
        beta: :math:`\beta_c` of Eq. 2.2, one number or one per mode.
        relative_sd: Instead: relative standard deviation, ``beta ** -0.5``. Above 0.1,
            10 %, a warning asks whether percent were meant.
        sd: Instead: standard deviations in Hz, one number or one per mode; the same
            warning above 10 % of a frequency.
        covariance: Instead: covariance in Hz^2, ``(n_modes, n_modes)``. For repeated
            tests give that of one test, not of the mean: what they share in error
            (mounting, temperature) does not average out.
        discrepancy: Name of the parameter :math:`\sigma_d`, such as "model error" or,
            given alone, "noise"; None for no such part.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If not exactly one description of the measurement error is given
            (none at all is possible with discrepancy), or a value is not real.
        ValueError: If a value is not above zero, shapes disagree, or a covariance is
            not symmetric and positive definite.

    Source: Eq. 2.2 of Sherri, Boulkaibet, Marwala and Friswell; Simoen, De Roeck and
    Lombaert (2015), doi:10.1016/j.ymssp.2014.11.001.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import FrequencyTerm
        >>> term = FrequencyTerm([10.0, 20.0], relative_sd=0.01)
        >>> term({}, {"frequency": np.array([[10.1, 20.0]])}).round(4).tolist()
        [1.5741]
    """

    symbol = MODEL_ERROR
    statement = (
        "The relative deviations of the natural frequencies from the measured ones are "
        "Gaussian. R is the covariance of the relative measurement errors."
    )
    formula = (
        "(<i>f<sub>i</sub></i>(θ) − <i>f<sub>i</sub></i><sup>m</sup>) / "
        "<i>f<sub>i</sub></i><sup>m</sup> ~ N(0, R + σ<sub>d</sub><sup>2</sup> I)"
    )

    def __init__(
        self,
        measured: ArrayLike | Measurements,
        *,
        beta: ArrayLike | None = None,
        relative_sd: ArrayLike | None = None,
        sd: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        discrepancy: str | None = None,
        name: str = "frequency",
    ) -> None:
        errors = dict(beta=beta, relative_sd=relative_sd, sd=sd, covariance=covariance)
        unknown = np.zeros(0, dtype=np.intp)  # places of modes without an sd
        if isinstance(measured, Measurements):
            if all(value is None for value in errors.values()):
                errors["covariance"] = measured.covariance
                if measured.covariance is None and measured.sd is not None:
                    unknown = np.flatnonzero(np.isnan(measured.sd))
                    least = np.nanmin(measured.sd)
                    errors["sd"] = np.where(np.isnan(measured.sd), least, measured.sd)
            measured = measured.frequencies
        self.measured = checks.positive_array("measured", measured, 1)
        if not self.measured.size:
            raise ValueError("measured: expected at least one frequency, got none")
        self.label(name, discrepancy)
        if len(unknown) and discrepancy is None:
            raise ValueError(
                f"measured: modes {(unknown + 1).tolist()} have no sd; give sd= or "
                "relative_sd= for all modes, or infer it (discrepancy=)"
            )
        error, value = choose_error(errors, discrepancy, " (beta = relative_sd**-2)")
        self.n_modes = len(self.measured)
        self.log_constants = -np.log(self.measured)
        self.separate = error != "covariance"
        # Precisions of r, or of r in its principal axes; infinite where they are exact.
        self.beta, self._axes = np.full(self.n_modes, np.inf), np.eye(self.n_modes)
        if error == "covariance":
            self.beta, self._axes = _principal_axes(value, self.measured)
        elif error:
            numbers = error_array(error, value, self.measured.shape)
            if error == "sd":
                numbers = numbers / self.measured
            if error != "beta":
                doubt_percent(error, numbers)
            self.beta[:] = numbers if error == "beta" else numbers**-2
            self.beta[unknown] = np.inf  # the discrepancy is all of their error
        self._sd = self.beta**-0.5
        self.reads = modal_variables(self.n_modes)
        self.observed = {"frequency": self.measured}
        relative = np.sqrt(self._axes**2 @ (1 / self.beta))
        self.error_sd = {"frequency": self.measured * relative}

    def constants(self, response: Response) -> Floats | float:
        """Return what each mode adds, less the penalty of those without a pair."""
        unpaired = getattr(response, "unpaired", None)
        if isinstance(response, Mapping):
            unpaired = response.get("unpaired")
        if unpaired is None:
            return self.log_constants
        return np.asarray(self.log_constants - UNPAIRED * unpaired[:, : self.n_modes])

    def deviations(self, parameters: Parameters, response: Response) -> Deviations:
        """Return independent relative deviations and their standard deviations."""
        predicted = read(response, "frequency")[:, : self.n_modes]
        if predicted.shape[1] < self.n_modes:
            raise ValueError(
                f"measured: {self.n_modes} modes were measured, but the model "
                f"returned {predicted.shape[1]}; ask it for more modes"
            )
        r = predicted / self.measured - 1.0
        if not self.separate:
            r = r @ self._axes
        sd = self._sd
        if self.discrepancy is not None:
            sd = add_discrepancy(1 / self.beta, parameters[self.discrepancy][:, None])
        return r, sd * np.ones_like(r)  # np.broadcast_to takes four times as long

    def restore(self, deviations: Floats) -> Floats:
        """Return frequencies ``(n, n_modes)`` in Hz."""
        return self.measured * (1.0 + deviations @ self._axes.T)


def _principal_axes(covariance: ArrayLike, hertz: Floats) -> tuple[Floats, Floats]:
    """Return precisions of relative errors along axes where they are independent."""
    C = modes.covariance(covariance, len(hertz))
    assert C is not None
    variances, axes = np.linalg.eigh(C / np.outer(hertz, hertz))
    if not variances[0] > 1e-12 * variances[-1]:
        raise ValueError(
            "covariance: expected positive definite; repeats must outnumber the modes"
        )
    return 1 / variances, axes
