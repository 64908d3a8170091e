"""The likelihood of measured displacements."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats, Parameters, Response, Variable, read
from ..measurements.directions import along_axis
from ..measurements.modes import LARGE_ERROR_PRIOR, doubt_percent
from .term import MODEL_ERROR, Deviations, Term, choose_error, error_array


class DisplacementTerm(Term):
    r"""Gaussian likelihood of the displacements measured in a static test.

    .. math:: \ln p = \sum_{c,i} \ln N(u_{ci} - u_{ci}^m; 0, v_{ci}), \qquad
        v_{ci} = \sigma_{ci}^2 + (\sigma_d u_{ci}^m)^2

    Use it with a :class:`StaticModel`. The sum is over load cases c and points i; v is
    the variance. :math:`\sigma_d` is the relative standard deviation of the
    discrepancy, which the model cannot represent. To infer it, name a parameter as
    ``discrepancy`` and give it a proper prior, as for a :class:`FrequencyTerm`.

    Args:
        measured: Measured displacements ``(cases, points)``, in the unit of the model.
        sd: Standard deviations in that unit: one number, one per point, or
            ``(cases, points)``.
        relative_sd: Standard deviations divided by the measured displacements; give
            either sd or relative_sd.
        discrepancy: Name of the parameter :math:`\sigma_d`; None for no discrepancy.
        cases: Names of the load cases, which must match the model's. By default, cases
            correspond by order.
        points: Labels of the points, likewise. For a gauge that points backwards, write
            ``"2:-ux"``: the sign is reversed and the label becomes ``"2:ux"``.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If not exactly one of sd and relative_sd is given (none is allowed
            with a discrepancy).
        ValueError: If a number is not finite, a standard deviation is not positive, a
            relative one belongs to a displacement of zero, or shapes do not match.

    Source: Simoen, De Roeck and Lombaert (2015), doi:10.1016/j.ymssp.2014.11.001, for
    the sum of measurement and model errors.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import DisplacementTerm
        >>> term = DisplacementTerm([[0.5, 2.5]], sd=0.1)
        >>> term({}, {"displacement": np.array([[[0.5, 2.6]]])}).round(4).tolist()
        [2.2673]
    """

    symbol = MODEL_ERROR
    statement = (
        "The deviations of the displacements from the measured ones are Gaussian. σ is "
        "the standard deviation of the measurement."
    )
    formula = (
        "<i>u<sub>i</sub></i>(θ) − <i>u<sub>i</sub></i><sup>m</sup> ~ N(0, "
        "σ<sub><i>i</i></sub><sup>2</sup> + (σ<sub>d</sub> "
        "<i>u<sub>i</sub></i><sup>m</sup>)<sup>2</sup>)"
    )

    def __init__(
        self,
        measured: ArrayLike,
        *,
        sd: ArrayLike | None = None,
        relative_sd: ArrayLike | None = None,
        discrepancy: str | None = None,
        cases: Sequence[str] | None = None,
        points: Sequence[Hashable] | None = None,
        name: str = "displacement",
    ) -> None:
        self.measured = u = checks.real_array("measured", measured)
        if u.ndim != 2:
            raise ValueError(
                f"measured: expected (n_cases, n_points), got {u.shape}; displacements "
                "of one load case are [[..]]"
            )
        if not u.size:
            raise ValueError("measured: expected at least one displacement, got none")
        self.label(name, discrepancy)
        errors = {"sd": sd, "relative_sd": relative_sd}
        error, value = choose_error(errors, discrepancy)
        self.sd = np.zeros(u.shape)
        if error:
            numbers = error_array(error, value, u.shape[1:], u.shape)
            if error == "relative_sd":
                doubt_percent(error, numbers, LARGE_ERROR_PRIOR)
            self.sd += numbers * (np.abs(u) if error == "relative_sd" else 1.0)
        if not (self.sd > 0).all() and (error or not u.all()):
            raise ValueError("measured: zero has no relative error; give sd")
        labels = _read_labels("cases", cases, u.shape[0])
        given = _read_labels("points", points, u.shape[1])
        along, signs = zip(*map(along_axis, given), strict=True)
        self.measured = u = u * signs
        self.stated_sd, self.scale = self.sd.ravel(), u.ravel()
        self.reads = {"displacement": Variable({"load_case": labels, "point": along})}
        self.observed, self.error_sd = {"displacement": u}, {"displacement": self.sd}

    def deviations(self, parameters: Parameters, response: Response) -> Deviations:
        """Return deviations and their standard deviations, ``(n, m)`` each."""
        cases, points = self.measured.shape
        u = read(response, "displacement")[:, :cases, :points]
        r = (u - self.measured).reshape(len(u), -1)
        return r, np.broadcast_to(self.standard_deviations(parameters), r.shape)

    def restore(self, deviations: Floats) -> Floats:
        """Return displacements ``(n, cases, points)``."""
        return self.measured + deviations.reshape(-1, *self.measured.shape)


def _read_labels(
    argument: str, labels: Sequence[Hashable] | None, size: int
) -> list[Hashable]:
    """Return one label for each; None if they correspond by position."""
    if labels is None:
        return [None] * size
    given = checks.sequence(argument, labels, "labels")
    if len(given) != size or len({*given}) != size:
        raise ValueError(f"{argument}: expected {size} different labels, got {labels}")
    return given
