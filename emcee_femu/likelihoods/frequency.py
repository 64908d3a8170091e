"""The likelihood of measured natural frequencies."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats, Parameters, Variable, modal_variables, read
from ..measurements import Measurements
from .normal import LEAST_SD, linearize_normal

# Log-likelihood that an unpaired mode costs: as much as four standard deviations.
UNPAIRED = 8.0


@dataclass(frozen=True, eq=False, init=False)
class FrequencyTerm:
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

    The scatter of modal tests is often 0.2 %, the error of a good model 1 to 2 %: with
    the measured standard deviations alone the posterior is far too narrow. Give the
    name of a parameter as ``discrepancy`` and a proper prior, such as
    ``scipy.stats.halfnorm(scale=0.02)``. Jeffreys' prior 1 / sigma is no choice here:
    integrated over sigma it leaves (r^T r)^(-m/2), which has no finite integral where
    m residuals can vanish together, as they can unless they outnumber the parameters.
    Distributions of :class:`IndependentPrior` are proper.

    Args:
        measured: Measured natural frequencies in Hz, ``(n_modes,)``, or
            :class:`Measurements`, whose standard deviations or covariance are then
            the default.
        beta: :math:`\beta_c` of Eq. 2.2, one number or one per mode.
        relative_sd: Instead: relative standard deviation, ``beta ** -0.5``.
        sd: Instead: standard deviations in Hz, one number or one per mode.
        covariance: Instead: covariance in Hz^2, ``(n_modes, n_modes)``. For repeated
            tests give that of one test, not of the mean: what they share in error
            (mounting, temperature) does not average out.
        discrepancy: Name of the parameter :math:`\sigma_d`, or None for no such part.
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

    measured: Floats
    beta: Floats  # precisions of r, or of r in its principal axes; infinite if exact
    covariance: Floats | None = field(repr=False)  # in Hz^2, where it was given
    discrepancy: str | None
    name: str
    _axes: Floats | None = field(repr=False)
    _log_constants: Floats = field(repr=False)
    _log_constant: float = field(repr=False)

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
        possible = {
            "beta": beta,
            "relative_sd": relative_sd,
            "sd": sd,
            "covariance": covariance,
        }
        given = {label: v for label, v in possible.items() if v is not None}
        if isinstance(measured, Measurements):
            if not given and measured.covariance is not None:
                given = {"covariance": measured.covariance}
            elif not given and measured.sd is not None:
                given = {"sd": measured.sd}
            measured = measured.frequencies
        frequencies = checks.positive_array("measured", measured, 1)
        if not frequencies.size:
            raise ValueError("measured: expected at least one frequency, got none")
        for label, text in (("name", name), ("discrepancy", discrepancy)):
            left_out = label == "discrepancy" and text is None
            if not left_out and (not isinstance(text, str) or not text):
                raise TypeError(f"{label}: expected a non-empty string, got {text!r}")
        if len(given) > 1 or not (given or discrepancy):
            raise TypeError(
                "beta, relative_sd, sd, covariance: expected exactly one of them "
                "(beta = relative_sd**-2), or a discrepancy alone, got "
                f"{list(given) or 'none'}"
            )
        precision, axes = np.full(len(frequencies), np.inf), None
        for which, value in given.items():
            precision, axes = _relative_precision(which, value, frequencies)
        constant = -np.log(frequencies)
        if discrepancy is None:
            constant += 0.5 * np.log(precision / (2 * np.pi))
        checks.set_fields(
            self,
            measured=frequencies,
            beta=precision,
            covariance=None if axes is None else np.array(given["covariance"], float),
            discrepancy=discrepancy,
            name=name,
            _axes=axes,
            _log_constants=constant,
            _log_constant=float(constant.sum()),
        )

    @property
    def reads(self) -> Mapping[str, Variable]:
        """Frequencies of the measured modes, which the term needs of a response."""
        return modal_variables(len(self.measured))

    @property
    def observed(self) -> Mapping[str, Floats]:
        """What was measured, by the name of the variable."""
        return {"frequency": self.measured}

    @property
    def n_modes(self) -> int:
        """The number of measured modes."""
        return len(self.measured)

    @property
    def error_sd(self) -> Mapping[str, Floats]:
        """Standard deviations of the measured frequencies in Hz; 0 if exact."""
        variances = 1 / self.beta
        if self._axes is not None:
            variances = self._axes**2 @ variances
        return {"frequency": self.measured * np.sqrt(variances)}

    @property
    def names(self) -> tuple[str, ...]:
        """The discrepancy, where there is one, the only parameter that is read."""
        return () if self.discrepancy is None else (self.discrepancy,)

    @property
    def positive(self) -> tuple[str, ...]:
        """All parameters of the term, which must stay above zero."""
        return self.names

    def __call__(self, parameters: Parameters, response: Any) -> Floats:
        """Return the log-likelihood of every parameter set, ``(n,)``."""
        residuals = self._turn(self._residuals(response))
        with np.errstate(over="ignore"):  # so far off the likelihood is zero
            residuals *= residuals
            if self.discrepancy is None:
                residuals *= self.beta
            else:
                variances = self._variances(parameters[self.discrepancy])
                residuals /= variances
                residuals += np.log(2 * np.pi * variances)
        log_likelihood: Floats = np.add.reduce(residuals, axis=1)
        log_likelihood *= -0.5
        log_likelihood += self._log_constant
        unpaired = _find_unpaired(response)
        if unpaired is not None:
            unpaired = unpaired[:, : self.n_modes]
            log_likelihood -= UNPAIRED * np.count_nonzero(unpaired, axis=1)
        return log_likelihood

    def deviations(
        self, parameters: Parameters, response: Any
    ) -> tuple[Floats, Floats]:
        """Return independent relative deviations and their standard deviations."""
        residuals = self._turn(self._residuals(response))
        variances = 1 / self.beta
        if self.discrepancy is not None:
            variances = self._variances(parameters[self.discrepancy])
        return residuals, np.broadcast_to(np.sqrt(variances), residuals.shape)

    def linearize(
        self, parameters: Parameters, response: Any, tangents: Mapping[str, Floats]
    ) -> tuple[Floats, Floats]:
        """Return the gradient of the log-likelihood, and its scores."""
        residuals, sd = self.deviations(parameters, response)
        slopes = tangents["frequency"][:, : self.n_modes] / self.measured[:, None]
        if self._axes is not None:
            slopes = self._axes.T @ slopes
        if self.discrepancy is None:
            return linearize_normal(residuals, sd, slopes)
        sigma = parameters[self.discrepancy][:, None, None]
        d_sd = sigma * tangents[self.discrepancy][:, None] / sd[:, :, None]
        return linearize_normal(residuals, sd, slopes, d_sd)

    def _variances(self, discrepancy: Floats) -> Floats:
        """Return the variances with an inferred error, ``(n, n_modes)``."""
        total: Floats = 1 / self.beta + np.square(discrepancy)[:, None]
        return np.maximum(total, LEAST_SD**2)

    def _turn(self, residuals: Floats) -> Floats:
        """Return residuals along the axes in which they are independent."""
        if self._axes is None:
            return residuals
        # One product per row: its sums round alike.
        turned: Floats = (residuals[:, None] @ self._axes)[:, 0]
        return turned

    def _residuals(self, response: Any) -> Floats:
        predicted = read(response, "frequency")[:, : self.n_modes]
        if predicted.shape[1] < self.n_modes:
            raise ValueError(
                f"measured: {self.n_modes} modes were measured, but the model "
                f"returned {predicted.shape[1]}; ask it for more modes"
            )
        # Contiguous rows: their sums must round alike for one row and for many.
        residuals = np.ascontiguousarray(predicted / self.measured)
        residuals -= 1.0
        return residuals

    def pointwise(
        self, parameters: Parameters, stored: Mapping[str, Floats]
    ) -> dict[str, Floats] | None:
        """Return each mode's log-likelihood ``(n, n_modes)``; None if correlated."""
        if self._axes is not None:
            return None
        squares = self._residuals(stored) ** 2
        if self.discrepancy is None:
            values = self._log_constants - 0.5 * self.beta * squares
        else:
            variances = self._variances(parameters[self.discrepancy])
            logs = np.log(2 * np.pi * variances)
            values = self._log_constants - 0.5 * (squares / variances + logs)
        if "unpaired" in stored:
            values -= UNPAIRED * stored["unpaired"][:, : self.n_modes]
        return {"frequency": values}

    def replicate(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        stored: Mapping[str, Floats],
    ) -> dict[str, Floats]:
        """Return a new measurement for each sample, with all its errors, in Hz."""
        predicted = stored["frequency"][:, : self.n_modes]
        errors = rng.standard_normal(predicted.shape) / np.sqrt(self.beta)
        if self._axes is not None:
            errors = errors @ self._axes.T
        if self.discrepancy is not None:
            sigma = parameters[self.discrepancy][:, None]
            errors = errors + sigma * rng.standard_normal(predicted.shape)
        return {"frequency": predicted + self.measured * errors}


def _find_unpaired(response: Any) -> Any:
    """Return where modes have no pair, None if the model pairs none."""
    if isinstance(response, Mapping):
        return response.get("unpaired")
    return getattr(response, "unpaired", None)


def _relative_precision(
    which: str, value: ArrayLike, frequencies: Floats
) -> tuple[Floats, Floats | None]:
    """Return precisions of the relative errors, and their axes unless independent."""
    n = len(frequencies)
    if which == "covariance":
        C = checks.real_array(which, value, 2)
        if C.shape != (n, n) or np.abs(C - C.T).max() > 1e-8 * np.abs(C).max():
            raise ValueError(
                f"covariance: expected a symmetric ({n}, {n}) matrix for {n} modes, "
                f"got {C.tolist()}"
            )
        variances, axes = np.linalg.eigh(C / np.outer(frequencies, frequencies))
        if not variances[0] > 1e-12 * variances[-1]:
            raise ValueError(
                "covariance: expected a positive definite matrix; that of repeats "
                "needs more of them than modes"
            )
        return 1 / variances, axes
    numbers = checks.positive_array(which, value)
    if numbers.shape not in ((), (n,)):
        raise ValueError(
            f"{which}: expected one number or one for each of {n} modes, got shape "
            f"{numbers.shape}"
        )
    if which == "sd":
        numbers = numbers / frequencies
    precision = numbers if which == "beta" else numbers**-2
    return np.broadcast_to(precision, (n,)).copy(), None
