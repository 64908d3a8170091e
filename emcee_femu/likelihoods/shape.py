"""The likelihood of measured mode shapes, by their MAC or sensor by sensor."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..interfaces import Floats, ModalSolution, Parameters
from ..measurements import Measurements
from ..models.pairing import at_sensors


@dataclass(frozen=True, eq=False, init=False)
class ShapeTerm:
    r"""Errors of measured mode shapes; scale and sign of a shape do not matter.

    With ``delta``, the standard deviation of each sensor for a shape of unit length:

    .. math:: \ln p = \sum_i \left[ -\frac{1 - MAC_i}{2 \delta^2}
        - \frac{n_s - 1}{2} \ln 2 \pi \delta^2 \right]

    A shape of :math:`n_s` sensors is a direction, with :math:`n_s - 1` ways to err;
    this power of delta matters as soon as delta is inferred. With ``sd``, the standard
    deviations of the sensors themselves, in the units of the measured shapes:

    .. math:: \ln p = \sum_{i,s} \left[ -\frac{(\phi_{si}^m - \gamma_i \phi_{si})^2}
        {2 \sigma_{si}^2} - \tfrac12 \ln 2 \pi \sigma_{si}^2 \right], \qquad
        \gamma_i = \frac{\sum_s \phi_{si}^m \phi_{si} / \sigma_{si}^2}
        {\sum_s \phi_{si}^2 / \sigma_{si}^2}

    where :math:`\gamma_i` scales the model's shape to fit best. Modes are compared in
    ascending order unless the model is a :class:`models.paired.PairedModel`, which is
    what you want: shapes tell which mode is which.

    Args:
        measured: :class:`Measurements` with shapes, or shapes ``(n_sensors, n_modes)``
            at the rows of the model's shapes.
        delta: A number, one a mode, or the name of the parameter that is delta of all
            modes (0.01 to 0.1 is usual; ``scipy.stats.halfnorm(scale=0.1)`` a prior).
            Inferred it is too sure of itself where the modes' scatter differs: of
            simulated ambient tests chi^2 was 11 on 5 degrees of freedom.
        sd: Instead: ``(n_sensors, n_modes)`` or what broadcasts to it. The default
            is ``shape_sd`` of the measurements.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If not exactly one of delta and sd is given.
        ValueError: If there are no shapes, fewer than two sensors, a value is not
            above zero, or shapes disagree. When called: if the model returns no
            shapes, too few modes or other rows.

    Source: Vanik, Beck and Au (2000), doi:10.1061/(ASCE)0733-9399(2000)126:7(738);
    Simoen, De Roeck and Lombaert (2015), doi:10.1016/j.ymssp.2014.11.001.

    Example:
        >>> term = ShapeTerm([[1.0], [2.0]], delta=0.1)
        >>> modes = ModalSolution(np.array([[10.0]]), np.array([[[0.5], [1.1]]]))
        >>> term({}, modes).round(4).tolist()
        [1.3152]
    """

    measured: Floats
    delta: Floats | str | None
    sd: Floats | None
    name: str
    _dofs: NDArray[np.intp] | None = field(repr=False)

    def __init__(
        self,
        measured: ArrayLike | Measurements,
        *,
        delta: ArrayLike | str | None = None,
        sd: ArrayLike | None = None,
        name: str = "shape",
    ) -> None:
        """See the class."""
        dofs = None
        if isinstance(measured, Measurements):
            if measured.shapes is None:
                raise ValueError("measured: these measurements have no shapes")
            if delta is None and sd is None:
                sd = measured.shape_sd
            dofs, measured = measured.dofs, measured.shapes
        shapes = checks.real_array("measured", measured, 2)
        if len(shapes) < 2 or not shapes.any(axis=0).all():
            raise ValueError(
                "measured: expected shapes (n_sensors, n_modes) of at least two "
                f"sensors, none of them all zero, got shape {shapes.shape}"
            )
        if not isinstance(name, str) or not name:
            raise TypeError(f"name: expected a non-empty string, got {name!r}")
        if (delta is None) == (sd is None):
            raise TypeError(
                "delta, sd: expected exactly one of the two, or Measurements with "
                "shape_sd"
            )
        scale: Floats | str | None = None
        if isinstance(delta, str):
            if not delta:
                raise ValueError("delta: expected a parameter name, got ''")
            scale = delta
        elif delta is not None:
            scale = _positive("delta", delta, shapes.shape[1:])
        object.__setattr__(self, "measured", shapes)
        object.__setattr__(self, "delta", scale)
        object.__setattr__(
            self, "sd", None if sd is None else _positive("sd", sd, shapes.shape)
        )
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "_dofs", dofs)

    @property
    def n_modes(self) -> int:
        """The number of measured modes."""
        return len(self.measured.T)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the term reads: delta, where it is a name."""
        return (self.delta,) if isinstance(self.delta, str) else ()

    @property
    def positive(self) -> tuple[str, ...]:
        """The parameters that must stay above zero: all."""
        return self.names

    def __call__(self, parameters: Parameters, modes: ModalSolution) -> Floats:
        """Return the log-likelihood of every parameter set, ``(n,)``."""
        if modes.shapes is None or modes.shapes.shape[2] < self.n_modes:
            got = (
                "none" if modes.shapes is None else f"those of {modes.shapes.shape[2]}"
            )
            raise ValueError(
                f"measured: the shapes of {self.n_modes} modes were measured, but the "
                f"model returned {got}; ask it for them (shapes=..., n_modes=...)"
            )
        shapes = at_sensors(modes.shapes, self._dofs, len(self.measured))
        # Contiguous: sums must round alike for one row and for many.
        shapes = np.ascontiguousarray(shapes[:, :, : self.n_modes])
        # Residuals of the best fit: 1 - MAC would lose its digits near 1.
        weights = np.ones_like(self.measured) if self.sd is None else self.sd**-2.0
        weighted = weights * shapes
        square = (weighted * shapes).sum(axis=1)
        product = (weighted * self.measured).sum(axis=1)
        gamma = np.divide(product, square, out=np.zeros_like(square), where=square > 0)
        residuals = shapes * gamma[:, None]
        residuals -= self.measured
        squares = (weights * residuals**2).sum(axis=1)  # (n, n_modes)
        if self.sd is not None:
            constant = -np.log(self.sd * np.sqrt(2 * np.pi)).sum()
            result: Floats = constant - 0.5 * squares.sum(axis=1)
            return result
        squares /= np.square(self.measured).sum(axis=0)  # 1 - MAC
        if isinstance(self.delta, str):
            variance = np.square(parameters[self.delta])[:, None]
        else:
            variance = np.square(np.asarray(self.delta))[None]
        directions = len(self.measured) - 1
        terms = squares / variance + directions * np.log(2 * np.pi * variance)
        result = -0.5 * terms.sum(axis=1)
        return result


def _positive(argument: str, value: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """Return numbers above zero, one for each of ``shape``."""
    numbers = checks.positive_array(argument, value)
    try:
        return np.broadcast_to(numbers, shape).copy()
    except ValueError:
        raise ValueError(
            f"{argument}: expected one number or one for each of {shape}, got shape "
            f"{numbers.shape}"
        ) from None
