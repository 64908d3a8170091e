"""Likelihood terms: each turns a batch of modal solutions into log-likelihoods."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from . import checks
from .interfaces import Floats, ModalSolution, Parameters


@dataclass(frozen=True, eq=False, init=False)
class FrequencyTerm:
    r"""Gaussian errors of the natural frequencies, relative to the measured ones.

    .. math:: \ln p = -\tfrac12 \sum_i \beta_i
        \left(\frac{f_i^m - f_i}{f_i^m}\right)^2
        - \sum_i \ln\left(f_i^m \sqrt{2\pi / \beta_i}\right)

    where :math:`f_i^m` are the measured and :math:`f_i` the model's frequencies, so
    that :math:`\beta_i^{-1/2}` is the relative standard deviation of mode i. The
    lowest ``n_modes`` frequencies of the model are compared, in ascending order.

    Args:
        measured: Measured natural frequencies in Hz, ``(n_modes,)``.
        beta: :math:`\beta_c` of Eq. 2.2, one number or one a mode.
        relative_sd: The same as ``beta**-0.5``; give one of the two.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If not exactly one of beta and relative_sd is given.
        ValueError: If a frequency, beta or sd is not above zero, or shapes disagree.

    Source: Eq. 2.2 of Sherri, Boulkaibet, Marwala and Friswell.

    Example:
        >>> term = FrequencyTerm([10.0, 20.0], relative_sd=0.01)
        >>> modes = ModalSolution(np.array([[10.1, 20.0]]))
        >>> term({}, modes).round(4).tolist()
        [1.5741]
    """

    measured: Floats
    beta: Floats
    name: str
    _log_constant: float = field(repr=False)

    def __init__(
        self,
        measured: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        relative_sd: ArrayLike | None = None,
        name: str = "frequency",
    ) -> None:
        """See the class."""
        frequencies = checks.positive_array("measured", measured, 1)
        if not frequencies.size:
            raise ValueError("measured: expected at least one frequency, got none")
        if not isinstance(name, str) or not name:
            raise TypeError(f"name: expected a non-empty string, got {name!r}")
        if beta is not None and relative_sd is None:
            precision, which = checks.positive_array("beta", beta), "beta"
        elif relative_sd is not None and beta is None:
            which = "relative_sd"
            precision = checks.positive_array(which, relative_sd) ** -2
        else:
            raise TypeError(
                "beta, relative_sd: expected exactly one of the two "
                "(beta = relative_sd**-2)"
            )
        if precision.shape not in ((), frequencies.shape):
            raise ValueError(
                f"{which}: expected one number or one for each of "
                f"{frequencies.size} modes, got shape {precision.shape}"
            )
        precision = np.broadcast_to(precision, frequencies.shape).copy()
        constant = 0.5 * np.log(precision / (2 * np.pi)) - np.log(frequencies)
        object.__setattr__(self, "measured", frequencies)
        object.__setattr__(self, "beta", precision)
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "_log_constant", float(constant.sum()))

    @property
    def n_modes(self) -> int:
        """The number of measured modes."""
        return len(self.measured)

    def __call__(self, parameters: Parameters, modes: ModalSolution) -> Floats:
        """Return the log-likelihood of every parameter set, ``(n,)``."""
        predicted = modes.frequencies[:, : self.n_modes]
        if predicted.shape[1] < self.n_modes:
            raise ValueError(
                f"measured: {self.n_modes} modes were measured, but the model "
                f"returned {predicted.shape[1]}; ask it for more modes"
            )
        # Contiguous rows: their sums must round alike for one row and for many.
        residuals = np.ascontiguousarray(predicted / self.measured)
        residuals -= 1.0
        residuals *= residuals
        residuals *= self.beta
        log_likelihood: Floats = np.add.reduce(residuals, axis=1)
        log_likelihood *= -0.5
        log_likelihood += self._log_constant
        return log_likelihood
