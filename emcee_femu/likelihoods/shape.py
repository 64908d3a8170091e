"""The likelihood of measured mode shapes, by their MAC or sensor by sensor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..contracts import Floats, PairedSolution, Parameters, Response, Variable, read
from ..measurements import Measurements
from ..measurements.modes import compares, doubt_percent
from ..models.sensors import at_sensors
from .residuals import MODE, SENSOR, ComparedShapes, Residuals
from .term import MOST_RELATIVE, Deviations, Term, error_array, log_normal

# In words and as a formula in HTML, for reports, with the symbol of its error.
BY_SENSOR = (
    "Each measured mode shape is compared with the model's, sensor by sensor. γ scales "
    "the model's shape to fit best; σ is the standard deviation of a sensor.",
    "φ<sub><i>si</i></sub><sup>m</sup> − γ<sub><i>i</i></sub> "
    "φ<sub><i>si</i></sub>(θ) ~ N(0, σ<sub><i>si</i></sub><sup>2</sup>)",
    "",
)
BY_MAC = (
    "Each measured mode shape is compared with the model's by their MAC; scale and "
    "sign do not matter. δ is the standard deviation of each sensor for a shape of "
    "unit length, n<sub>s</sub> the number of sensors.",
    "ln <i>p</i> = −Σ<sub><i>i</i></sub> [(1 − MAC<sub><i>i</i></sub>) / (2 "
    "δ<sup>2</sup>) + ½ (<i>n</i><sub>s</sub> − 1) ln 2π δ<sup>2</sup>]",
    "δ",
)
TINY = np.finfo(float).tiny


class ShapeTerm(Term):
    r"""Gaussian likelihood of measured mode shapes, whatever their scale and sign.

    With ``delta``, the standard deviation of each sensor for a shape of unit length:

    .. math:: \ln p = \sum_i \left[ -\frac{1 - MAC_i}{2 \delta^2}
        - \frac{n_s - 1}{2} \ln 2 \pi \delta^2 \right]

    The shape of mode i at :math:`n_s` sensors is a direction with :math:`n_s - 1`
    degrees of freedom; the corresponding power of delta matters if delta is inferred.
    With ``sd``, the standard deviations at the sensors in the units of the measured
    shapes:

    .. math:: \ln p = \sum_{i,s} \left[ -\frac{(\phi_{si}^m - \gamma_i \phi_{si})^2}
        {2 \sigma_{si}^2} - \tfrac12 \ln 2 \pi \sigma_{si}^2 \right], \qquad
        \gamma_i = \frac{\sum_s \phi_{si}^m \phi_{si} / \sigma_{si}^2}
        {\sum_s \phi_{si}^2 / \sigma_{si}^2}

    where :math:`\gamma_i` scales the model's shape to the best fit. Use the term with a
    :class:`PairedModel`, because measured shapes identify their modes; without one,
    modes are compared in ascending order of frequency.

    Args:
        measured: :class:`Measurements` with shapes, or shapes ``(n_sensors, n_modes)``
            at the rows of the model's shapes. NaN marks a missing sensor, which is left
            out of the sums.
        delta: One number or one per mode; 0.01 to 0.1 is usual.
        discrepancy: Name of a parameter that is delta for all modes, to infer it; a
            suitable prior is ``scipy.stats.halfnorm(scale=0.1)``. If the scatter
            differs between modes, an inferred delta gives too narrow a posterior: chi^2
            was 11 on 5 degrees of freedom in simulated ambient tests.
        sd: Standard deviations at the sensors: a number, ``(n_modes,)``,
            ``(n_sensors, 1)`` or ``(n_sensors, n_modes)``. The default is the
            measurements' ``shape_sd``.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If not exactly one of delta, discrepancy and sd is given.
        ValueError: If there are no shapes or fewer than two sensors, a value is not
            positive, or shapes do not match; if there are rotations beside translations
            without sd. When called: if the model returns no
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

    def __init__(
        self,
        measured: ArrayLike | Measurements,
        *,
        delta: ArrayLike | None = None,
        discrepancy: str | None = None,
        sd: ArrayLike | None = None,
        name: str = "shape",
    ) -> None:
        self.dofs = None
        self._sensors: tuple[str, ...] = ()
        if isinstance(measured, Measurements):
            if measured.shapes is None:
                raise ValueError("measured: these measurements have no shapes")
            if delta is None and discrepancy is None and sd is None:
                if measured.shape_sd is not None:  # that of a missing sensor is unused
                    sd = np.nan_to_num(measured.shape_sd, nan=1.0)
            self.dofs, self._sensors = measured.dofs, measured.sensors
            measured = measured.shapes
        shapes = checks.numeric_array("measured", measured)
        self.there = there = ~np.isnan(shapes)
        filled = np.where(there, shapes, 0.0)
        self.measured = shapes = checks.real_array("measured", filled, 2)
        if not shapes.size or there.sum(0).min() < 2 or not shapes.any(axis=0).all():
            raise ValueError(
                "measured: expected shapes (n_sensors, n_modes) of at least two "
                f"sensors, none of them all zero, got shape {shapes.shape}"
            )
        self.label(name, discrepancy)
        if isinstance(delta, str):
            raise TypeError(f"delta: expected numbers; write discrepancy={delta!r}")
        if sum(value is not None for value in (delta, discrepancy, sd)) != 1:
            raise TypeError(
                "delta, discrepancy, sd: expected exactly one of them, or Measurements "
                "with shape_sd; delta=0.02 is a noise of 2 % of the shape's length"
            )
        n_sensors, self.n_modes = shapes.shape
        self.delta = self.sd = None
        words = BY_MAC if sd is None else BY_SENSOR
        self.statement, self.formula, self.symbol = words
        if delta is not None:
            self.delta = np.ones(self.n_modes)
            self.delta *= error_array("delta", delta, (self.n_modes,))
            doubt_percent("delta", self.delta, MOST_RELATIVE)
        # Sensors whose DOFs are not known are in the order of the model's rows.
        dofs = [None] * n_sensors if self.dofs is None else self.dofs.tolist()
        if sd is None and (there & ~compares(shapes, dofs)).any():
            raise ValueError(
                f"measured: there are rotations beside translations ({dofs}), and one "
                "error for both would depend on the unit of length; give sd= at each "
                "sensor, or leave the rotations out"
            )
        if sd is not None:
            partial = (self.n_modes,), (n_sensors, 1), shapes.shape
            self.sd = np.ones(shapes.shape) * error_array("sd", sd, *partial)
            # Deviations across the shapes have unit standard deviations, and there is
            # one less for each mode than sensors.
            whole = log_normal(np.zeros(1), self.sd[there]).sum()
            across = there.sum() - self.n_modes
            self.log_constants = whole / across + 0.5 * np.log(2 * np.pi)
        each = np.ones(self.n_modes) if self.delta is None else self.delta
        by_datum = np.broadcast_to(each, shapes.shape)[self._across]
        self.stated_sd = np.zeros(1) if discrepancy else by_datum
        coords = {"dof": dofs, "mode": range(1, self.n_modes + 1)}
        self.reads = {"shapes": Variable(coords, stored=False)}

    def deviations(self, parameters: Parameters, response: Response) -> Deviations:
        """Return components of unit shapes normal to the measured ones, and their sd.

        For each mode these are the components along n_s - 1 directions orthogonal to
        the measured shape and to each other; the sum of their squares is 1 - MAC. With
        ``sd``, shapes are first divided by it, and the components are multiplied by the
        length of the measured shape.
        """
        measured, unit, size, _ = self._weigh(response)
        # A Householder reflection takes the measured shape to its first sensor.
        mirror = measured.copy()
        count, modes = self.there.cumsum(axis=0), np.arange(self.n_modes)
        first, second = ((count == i).argmax(axis=0) for i in (1, 2))
        mirror[first, modes] += np.copysign(1.0, mirror[first, modes])
        mirror /= np.linalg.norm(mirror, axis=0)
        turned = unit - 2 * mirror * (mirror * unit).sum(axis=1, keepdims=True)
        # A shape of zeros has a MAC of 0.
        turned[:, second, modes] += ~unit.any(axis=1)
        r = (turned * size)[:, self._across]
        return r, np.broadcast_to(self.standard_deviations(parameters), r.shape)

    def residuals(self, parameters: Parameters, response: Response) -> Residuals:
        """Return what of each measured shape the model's does not explain, by sensor.

        The model's shape is scaled to fit best, which takes one degree of freedom of
        each mode. The sum of squares over the sensors is that of the deviations.
        """
        measured, unit, size, mac = self._weigh(response)
        off = measured - unit * (unit * measured).sum(axis=1, keepdims=True)
        sd = np.ones(self.n_modes) if self.delta is None else self.delta
        if self.discrepancy is not None:
            sd = np.asarray(self.standard_deviations(parameters))[:, :, None]
        z = (off * size / sd)[:, self.there]
        labels = np.array(self._sensors or range(1, 1 + len(self.measured)))
        sensor, mode = np.nonzero(self.there)
        places = {MODE: mode + 1, SENSOR: labels[sensor]}
        both = ComparedShapes(measured[self.there], unit[:, self.there], mac)
        return Residuals(z, z, self.discrepancy is not None, places, both)

    def _weigh(self, response: Response) -> tuple[Floats, Floats, Floats, Floats]:
        """Return measured shapes and the model's at the sensors, both of unit length.

        They are divided by the standard deviations of the sensors first, if these are
        known. The model's have the side of the measured ones; one of zeros stays so.

        Returns:
            Measured ``(n_sensors, n_modes)``, the model's ``(n, n_sensors, n_modes)``,
            what multiplies deviations: 1, or the lengths ``(n_modes,)``; and the MAC
            ``(n, n_modes)``.
        """
        shapes: Floats = read(response, "shapes")
        if shapes.ndim != 3 or shapes.shape[2] < self.n_modes:
            raise ValueError(
                f"measured: the shapes of {self.n_modes} modes were measured, but the "
                f"model returned shapes {shapes.shape}; ask it for more (n_modes=...)"
            )
        if not isinstance(response, PairedSolution):  # whose rows are the sensors
            shapes = at_sensors(shapes, self.dofs, len(self.measured))
        shapes = shapes[:, :, : self.n_modes]
        weights = self.there / (1.0 if self.sd is None else self.sd)
        measured, weighted = weights * self.measured, weights * shapes
        side = np.where((weighted * measured).sum(axis=1) < 0, -1.0, 1.0)
        length = np.sqrt((weighted**2).sum(axis=1))
        scale = np.divide(side, length, out=np.zeros_like(length), where=length > 0)
        size = np.linalg.norm(measured, axis=0)
        factor = np.ones(self.n_modes) if self.sd is None else size
        there = np.where(self.there, shapes, 0.0)
        lengths = (self.measured**2).sum(axis=0) * (there**2).sum(axis=1)
        mac = (there * self.measured).sum(axis=1) ** 2 / np.fmax(lengths, TINY)
        return measured / size, weighted * scale[:, None], factor, mac

    @property
    def _across(self) -> NDArray[np.bool_]:
        """The deviations in use: for each mode, one fewer than its sensors."""
        return self.there & (self.there.cumsum(axis=0) > 1)

    def pointwise(
        self, parameters: Parameters, stored: Mapping[str, Floats]
    ) -> Mapping[str, Floats]:
        """Return each mode's log-likelihood ``(n, n_modes)``; empty without its MAC."""
        if self.sd is not None or "mac" not in stored:
            return {}
        delta = (
            self.standard_deviations(parameters) if self.delta is None else self.delta
        )
        variance = np.square(delta)
        directions = self._across.sum(axis=0)
        lost = 1 - stored["mac"][:, : self.n_modes]
        with np.errstate(over="ignore"):  # so far off the likelihood is zero
            values = lost / variance + directions * np.log(2 * np.pi * variance)
        return {"mac": -0.5 * values}
