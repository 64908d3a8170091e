"""The likelihood of measured natural frequencies."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats, Parameters, Response, find, modal_variables, read
from ..measurements import Measurements, modes
from .term import MODEL_ERROR, Deviations, Term, choose_error, error_array

# Log-likelihood that an unpaired mode costs: as much as four standard deviations.
UNPAIRED = 8.0


class FrequencyTerm(Term):
    r"""Gaussian likelihood of measured natural frequencies.

    .. math:: \ln p = -\tfrac12 r^T (R + \sigma_d^2 I)^{-1} r
        - \tfrac12 \ln\det 2\pi (R + \sigma_d^2 I) - \sum_i \ln f_i^m, \qquad
        r_i = \frac{f_i - f_i^m}{f_i^m}

    Here :math:`f_i^m` are the measured and :math:`f_i` the model's frequencies, R is
    the covariance of the relative measurement errors, and :math:`\sigma_d` is the
    relative standard deviation of the discrepancy, which is the model's own error. In
    Eq. 2.2 of the paper R is diagonal with elements :math:`1 / \beta_i`, so that
    :math:`\beta_i^{-1/2}` is the relative standard deviation of mode i, and there is no
    :math:`\sigma_d`. For eigenvalues, the relative deviations
    :math:`f_i^2 / (f_i^m)^2 - 1` are about twice as large.

    The lowest ``n_modes`` frequencies of the model are compared in ascending order. If
    the model is a :class:`PairedModel`, the paired modes are compared instead, and each
    unpaired mode lowers the log-likelihood by a further 8, as a deviation of four
    standard deviations would.

    **Model error.** Repeated modal tests often scatter by 0.2 %, whereas a good model
    is wrong by 1 to 2 %. With the measured standard deviations alone, the posterior is
    then far too narrow. Add an inferred ``discrepancy`` and give it a prior such as
    ``scipy.stats.halfnorm(scale=0.02)``; the known measurement errors keep the
    likelihood finite.

    **Unknown noise.** If the measurement error is unknown, give ``discrepancy="noise"``
    alone. Then R = 0, and :math:`\sigma_d` includes noise and model error, which one
    test cannot separate. If you have :class:`Measurements`, pass their ``frequencies``
    to leave out their standard deviations. Give the noise a prior with a lower bound
    above zero, such as ``(0.001, 0.05)`` in :class:`IndependentPrior`: a model that can
    fit all frequencies exactly, usually one with as many parameters as frequencies,
    makes the likelihood grow without bound as the noise goes to zero. With a
    half-normal prior the posterior is then hard to sample, or even improper if more
    frequencies than parameters are fitted exactly, as when a model is tested with its
    own output. With Jeffreys' prior 1 / sigma it is always improper in this case.

    Args:
        measured: Measured natural frequencies in Hz, ``(n_modes,)``, or
            :class:`Measurements`, whose covariance or standard deviations are used
            unless another error is given. A mode without a standard deviation needs a
            discrepancy, which is then its only error.
        beta: :math:`\beta_c` of Eq. 2.2, one number or one per mode, at least 4, which
            is an error of 50 %; ``relative_sd`` is likewise at most 0.5.
        relative_sd: Relative standard deviations ``beta ** -0.5``, one number or one
            per mode. A value above 0.1 (10 %) causes a warning: was it in percent?
        sd: Standard deviations in Hz, one number or one per mode, with the same warning
            above 10 % of a frequency.
        covariance: Covariance matrix in Hz^2, ``(n_modes, n_modes)``. For repeated
            tests, give the covariance of a single test, not of the mean: errors common
            to all tests (sensor mounting, temperature) do not average out.
        discrepancy: Name of the parameter :math:`\sigma_d`, such as "model error" or,
            without a measurement error, "noise"; None for no discrepancy.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If not exactly one of beta, relative_sd, sd and covariance is given
            (none is allowed with a discrepancy), or a value is not real.
        ValueError: If a value is not positive, shapes do not match, or a covariance is
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
                if measured.sd is not None:  # there is no covariance then
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
                modes.doubt_percent(error, numbers, modes.LARGE_ERROR_PRIOR)
            self.beta[:] = numbers if error == "beta" else numbers**-2
            self.beta[unknown] = np.inf  # the discrepancy is all of their error
        self.stated_sd = self.beta**-0.5
        self.reads = modal_variables(self.n_modes)
        self.observed = {"frequency": self.measured}
        relative = np.sqrt(self._axes**2 @ (1 / self.beta))
        self.error_sd = {"frequency": self.measured * relative}

    def constants(self, response: Response) -> Floats | float:
        """Return each mode's constant, minus the penalty if it is unpaired."""
        if (unpaired := find(response, "unpaired")) is None:
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
        # np.broadcast_to takes four times as long
        return r, self.standard_deviations(parameters) * np.ones_like(r)

    def restore(self, deviations: Floats) -> Floats:
        """Return frequencies ``(n, n_modes)`` in Hz."""
        return self.measured * (1.0 + deviations @ self._axes.T)


def _principal_axes(covariance: ArrayLike, hertz: Floats) -> tuple[Floats, Floats]:
    """Return precisions of relative errors along axes where they are independent."""
    C = modes.covariance(covariance, len(hertz))
    variances, axes = np.linalg.eigh(C / np.outer(hertz, hertz))
    if not variances[0] > 1e-12 * variances[-1]:
        raise ValueError(
            "covariance: expected positive definite; repeats must outnumber the modes"
        )
    return 1 / variances, axes
