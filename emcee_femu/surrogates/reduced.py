"""A model reduced to a few shapes, which knows its bounds and its certified error."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from ..interfaces import Floats, ModalSolution, Parameters, Variable, modal_variables
from ..models.eigen.dense import Eigenproblem
from ..models.eigen.sensitivity import Derivatives, unit_slopes
from ..models.parameters import columns, describe, read_inside
from ..table import Parts, Report


@dataclass(frozen=True, eq=False)
class ReducedModel(Report):
    """A modal model in a Ritz basis, solved for all parameter sets at once.

    Made by :func:`reduce_model`. Like any Ritz approximation it bounds each
    frequency from above (massless DOFs get a little mass, which lowers it by a small
    share of the tolerance). **Certified** is ``max_error``: the largest relative error
    of any frequency at ``test_points`` points that were not used to build the basis,
    half of them corners of the bounds, each solved in full. This is no bound over the
    whole box: after n points drawn at random, with 95 % confidence less than 3 / n of
    the box errs more. **Shapes are measured, not certified**: ``shape_error`` is the
    largest 1 - MAC there (mass-weighted, over all DOFs), each shape against the space
    of the full modes within 2 % of its frequency, because single shapes of close modes
    turn into each other. It grows like the frequency error divided by the gap, and is
    not held below the tolerance.

    Attributes:
        bounds: ``{parameter: (low, high)}``; the model refuses values outside.
        n_modes: Number of frequencies.
        shape_dofs: DOFs of the full model at which shapes are returned; () for none.
        tolerance: The demanded frequency error.
        max_error: The certified relative frequency error, below the tolerance.
        shape_error: Largest 1 - MAC at the test points.
        test_points: Number of points of the certificate.
        size: Number of basis vectors.
        full_size: Number of DOFs of the full model.
        full_solves: Full solves spent, the certificate included.
        speed_up: Time of the full model over that of this one, per parameter set, in
            a batch of 16; measured when the model was made.

    Examples:
        >>> import numpy as np
        >>> from scipy.sparse import csc_array, diags_array
        >>> import emcee_femu as ef
        >>> n = 1000  # masses in a row; the springs of either half have one stiffness
        >>> unit = csc_array(np.eye(n))
        >>> B = csc_array(diags_array([np.ones(n), -np.ones(n - 1)], offsets=[0, -1]))
        >>> halves = {"low": B[: n // 2], "high": B[n // 2 :]}
        >>> K = {name: half.T @ half for name, half in halves.items()}
        >>> full = ef.MatrixModel(0 * unit, unit, K, n_modes=2)
        >>> bounds = {"low": (0.5, 2.0), "high": (0.5, 2.0)}
        >>> small = ef.reduce_model(full, bounds, tolerance=1e-3, test_points=4)
        >>> at = {"low": np.array([0.7]), "high": np.array([1.6])}
        >>> bool(np.allclose(small(at).frequencies, full(at).frequencies, rtol=1e-3))
        True
    """

    bounds: Mapping[str, tuple[float, float]]
    n_modes: int
    shape_dofs: tuple[Any, ...] = field(repr=False)
    tolerance: float
    max_error: float
    shape_error: float
    test_points: int
    size: int
    full_size: int
    full_solves: int
    speed_up: float
    _columns: tuple[tuple[str, ...], tuple[str, ...]] = field(repr=False)
    _problem: Eigenproblem = field(repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the model depends on."""
        return tuple(self.bounds)

    @property
    def required(self) -> tuple[str, ...]:
        """All parameters, for without each of them there is no model."""
        return self.names

    @property
    def variables(self) -> Mapping[str, Variable]:
        """Frequencies, and shapes where it returns them."""
        return modal_variables(self.n_modes, self.shape_dofs)

    def _parts(self) -> Parts:
        return (
            f"{self.full_size} DOFs reduced to {self.size} basis vectors, "
            f"{self.n_modes} modes, {len(self.bounds)} parameters",
            f"largest frequency error {self.max_error:.1e} at {self.test_points} test "
            f"points (tolerance {self.tolerance:.0e})",
            f"largest 1 - MAC of a shape there {self.shape_error:.1e} (not certified)",
            f"{self.full_solves} full solves; {self.speed_up:.0f} times faster than "
            "the full model",
        )

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Return frequencies ``(n, n_modes)`` in Hz for values of shape ``(n,)``.

        Raises:
            ValueError: If a parameter is missing or outside the bounds.
        """
        return self._problem.solve(*self._coefficients(parameters))

    def jacobian(self, parameters: Parameters) -> tuple[ModalSolution, Derivatives]:
        """Return the response and its derivatives, those of the reduced model.

        Raises:
            ValueError: As a call does, or if modes coincide that part as a parameter
                changes; see :meth:`MatrixModel.jacobian`.
        """
        k, m, name_set = self._coefficients(parameters)
        return self._problem.jacobian(k, m, unit_slopes(*self._columns), name_set)

    def _coefficients(
        self, parameters: Parameters
    ) -> tuple[Floats, Floats, Callable[[int], str]]:
        """Return the coefficients of K and M, and what names a parameter set."""
        values, n = read_inside(parameters, self.bounds, "reduce")
        k, m = (columns(values, names, n) for names in self._columns)
        return k, m, partial(describe, values, self.names)
