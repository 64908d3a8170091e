"""The likelihood of measured mode shapes, by their MAC or sensor by sensor."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..interfaces import Floats, PairedSolution, Parameters, Variable, read
from ..measurements import Measurements
from ..models.pairing import at_sensors
from .normal import LEAST_SD, linearize_normal


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
    ascending order unless the model is a :class:`PairedModel`, which is what you want:
    shapes tell which mode is which.

    Args:
        measured: :class:`Measurements` with shapes, or shapes ``(n_sensors, n_modes)``
            at the rows of the model's shapes.
        delta: A number or one per mode; 0.01 to 0.1 is usual.
        discrepancy: Instead: name of the parameter that is delta for all modes; a prior
            could be ``scipy.stats.halfnorm(scale=0.1)``. Inferred it is too sure of
            itself where the modes' scatter differs: chi^2 was 11 on 5 degrees of
            freedom in simulated ambient tests.
        sd: Instead: ``(n_sensors, n_modes)`` or what broadcasts to it. The default
            is ``shape_sd`` of the measurements.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If not exactly one of delta, discrepancy and sd is given.
        ValueError: If there are no shapes, fewer than two sensors, a value is not
            above zero, or shapes disagree. When called: if the model returns no
            shapes, too few modes or other rows.

    Source: Vanik, Beck and Au (2000), doi:10.1061/(ASCE)0733-9399(2000)126:7(738);
    Simoen, De Roeck and Lombaert (2015), doi:10.1016/j.ymssp.2014.11.001.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import ShapeTerm
        >>> term = ShapeTerm([[1.0], [2.0]], delta=0.1)
        >>> term({}, {"shapes": np.array([[[0.5], [1.1]]])}).round(4).tolist()
        [1.3152]
    """

    measured: Floats
    delta: Floats | None
    discrepancy: str | None
    sd: Floats | None
    name: str
    _dofs: NDArray[np.intp] | None = field(repr=False)

    def __init__(
        self,
        measured: ArrayLike | Measurements,
        *,
        delta: ArrayLike | None = None,
        discrepancy: str | None = None,
        sd: ArrayLike | None = None,
        name: str = "shape",
    ) -> None:
        dofs = None
        if isinstance(measured, Measurements):
            if measured.shapes is None:
                raise ValueError("measured: these measurements have no shapes")
            if delta is None and discrepancy is None and sd is None:
                sd = measured.shape_sd
            dofs, measured = measured.dofs, measured.shapes
        shapes = checks.real_array("measured", measured, 2)
        if len(shapes) < 2 or not shapes.any(axis=0).all():
            raise ValueError(
                "measured: expected shapes (n_sensors, n_modes) of at least two "
                f"sensors, none of them all zero, got shape {shapes.shape}"
            )
        for label, text in (("name", name), ("discrepancy", discrepancy)):
            left_out = label == "discrepancy" and text is None
            if not left_out and (not isinstance(text, str) or not text):
                raise TypeError(f"{label}: expected a non-empty string, got {text!r}")
        if isinstance(delta, str):
            raise TypeError(f"delta: expected numbers; write discrepancy={delta!r}")
        if sum(value is not None for value in (delta, discrepancy, sd)) != 1:
            raise TypeError(
                "delta, discrepancy, sd: expected exactly one of them, or Measurements "
                "with shape_sd; delta=0.02 is a noise of 2 % of the shape's length"
            )
        checks.set_fields(
            self,
            measured=shapes,
            delta=None
            if delta is None
            else _positive("delta", delta, shapes.shape[1:]),
            discrepancy=discrepancy,
            sd=None if sd is None else _positive("sd", sd, shapes.shape),
            name=name,
            _dofs=dofs,
        )

    @property
    def reads(self) -> Mapping[str, Variable]:
        """Shapes at the sensors, which the term needs of a response."""
        n_sensors, n_modes = self.measured.shape
        # Sensors whose DOFs are not known are in the order of the model's rows.
        dofs = [None] * n_sensors if self._dofs is None else self._dofs.tolist()
        coords = {"dof": dofs, "mode": range(1, n_modes + 1)}
        return {"shapes": Variable(coords, stored=False)}

    @property
    def n_modes(self) -> int:
        """The number of measured modes."""
        return len(self.measured.T)

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
        shapes = self._at_sensors(response, read(response, "shapes"))
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
        result = -0.5 * self._by_mac(parameters, squares).sum(axis=1)
        return result

    def _at_sensors(self, response: Any, shapes: Floats) -> Floats:
        """Return the measured modes at the sensors, ``(n, n_sensors, n_modes)``."""
        if shapes.ndim != 3 or shapes.shape[2] < self.n_modes:
            raise ValueError(
                f"measured: the shapes of {self.n_modes} modes were measured, but the "
                f"model returned shapes {shapes.shape}; ask it for more (n_modes=...)"
            )
        if not isinstance(response, PairedSolution):  # whose rows are the sensors
            shapes = at_sensors(shapes, self._dofs, len(self.measured))
        # Contiguous: sums must round alike for one row and for many.
        return np.ascontiguousarray(shapes[:, :, : self.n_modes])

    def deviations(
        self, parameters: Parameters, response: Any
    ) -> tuple[Floats, Floats]:
        """Return what a unit shape has across the measured one, and its deviations.

        There are ``n_sensors - 1`` such directions for each mode; with ``sd`` the
        shapes are in units of the standard deviations.
        """
        shapes = self._at_sensors(response, read(response, "shapes"))
        return self._deviations(parameters, self._unit(shapes)[0])

    def linearize(
        self, parameters: Parameters, response: Any, tangents: Mapping[str, Floats]
    ) -> tuple[Floats, Floats]:
        """Return the gradient of the log-likelihood, and its scores."""
        shapes = self._at_sensors(response, read(response, "shapes"))
        unit, weights = self._unit(shapes)
        d = tangents["shapes"].shape[-1]
        columns = [
            weights * self._at_sensors(response, tangents["shapes"][..., j])
            for j in range(d)
        ]
        slopes = [x - unit * (unit * x).sum(axis=1, keepdims=True) for x in columns]
        across = [self._across(slope) for slope in slopes]
        r, sd = self._deviations(parameters, unit)
        if self.discrepancy is None:
            return linearize_normal(r, sd, np.stack(across, axis=-1))
        d_sd = np.broadcast_to(tangents[self.discrepancy][:, None], (*sd.shape, d))
        return linearize_normal(r, sd, np.stack(across, axis=-1), d_sd)

    def _unit(self, shapes: Floats) -> tuple[Floats, Floats]:
        """Return unit shapes on the side of the measured, and what makes them so."""
        weights = np.ones_like(self.measured) if self.sd is None else 1 / self.sd
        product = (weights**2 * shapes * self.measured).sum(axis=1)
        side = np.where(product < 0, -1.0, 1.0)
        weighted = weights * shapes
        length = np.sqrt((weighted**2).sum(axis=1))
        scale = np.divide(side, length, out=np.zeros_like(length), where=length > 0)
        return weighted * scale[:, None], weights * scale[:, None]

    def _deviations(
        self, parameters: Parameters, unit: Floats
    ) -> tuple[Floats, Floats]:
        deviations = self._across(unit)
        if self.discrepancy is not None:
            sd = np.maximum(parameters[self.discrepancy], LEAST_SD)[:, None]
        else:
            each = np.ones(self.n_modes) if self.delta is None else self.delta
            sd = np.tile(each, len(self.measured) - 1)
        return deviations, np.broadcast_to(sd, deviations.shape)

    def _across(self, shapes: Floats) -> Floats:
        """Return the components across the measured shapes, mode by mode, in rows.

        A Householder reflection takes each measured shape to the first axis.
        """
        weighted = self.measured if self.sd is None else self.measured / self.sd
        length = np.linalg.norm(weighted, axis=0)
        mirror = weighted / length
        mirror[0] += np.copysign(1.0, mirror[0])
        mirror /= np.linalg.norm(mirror, axis=0)
        turned = shapes - 2 * mirror * (mirror * shapes).sum(axis=1, keepdims=True)
        across = turned[:, 1:] * (1.0 if self.sd is None else length)
        return np.ascontiguousarray(across).reshape(len(shapes), -1)

    def _by_mac(self, parameters: Parameters, lost: Floats) -> Floats:
        """Return -2 ln p of each mode ``(n, n_modes)`` for ``lost``, 1 - MAC."""
        if self.discrepancy is not None:
            sd = np.maximum(parameters[self.discrepancy], LEAST_SD)
            variance = np.square(sd)[:, None]
        else:
            variance = np.square(np.asarray(self.delta))[None]
        directions = len(self.measured) - 1
        with np.errstate(over="ignore"):  # so far off the likelihood is zero
            values: Floats = lost / variance + directions * np.log(2 * np.pi * variance)
        return values

    def pointwise(
        self, parameters: Parameters, stored: Mapping[str, Floats]
    ) -> dict[str, Floats] | None:
        """Return each mode's log-likelihood ``(n, n_modes)``; None without its MAC."""
        if self.sd is not None or "mac" not in stored:
            return None
        lost = 1 - stored["mac"][:, : self.n_modes]
        return {"mac": -0.5 * self._by_mac(parameters, lost)}


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
