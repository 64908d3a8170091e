"""A model whose modes are in the order of the measured ones."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..interfaces import (
    Floats,
    Model,
    PairedSolution,
    Pairing,
    Parameters,
    SolveError,
    Variable,
    declared_variables,
    modal_variables,
    read,
)
from ..measurements import Measurements
from .pairing import at_sensors, couple_modes, one_to_one, share_shapes
from .pairing_sensitivity import differentiate_pairing, read_slopes

# Among coupled modes all candidates share one MAC; their own MAC then decides.
TIE_BREAK = 1e-3


@dataclass(frozen=True, eq=False, init=False)
class PairedModel:
    r"""A model whose modes are put in the order of the measured ones, by their shapes.

    .. math:: \max_{\pi} \sum_i MAC(\phi_i^m, \phi_{\pi(i)}), \qquad
        \pi \text{ one-to-one}

    Every measured mode gets one mode of the model (the Hungarian method), out of the
    lowest ``candidates``, for each parameter set anew: frequencies may cross inside the
    bounds, and compared in ascending order they would then be those of other modes.

    Shapes of close modes turn freely in the space that they span. Model modes nearer to
    each other than half of ``min_gap`` therefore share one: the MAC is that of the
    measured shape with its projection on their span, and this projection is returned as
    the paired shape, so that a :class:`ShapeTerm` does not see the turning either. From
    there to ``min_gap`` the sharing fades smoothly, so that shapes and MAC have no
    step. Where two modes change places, their frequencies still do.

    Args:
        model: A model that returns shapes, such as ``MatrixModel(..., shapes=dofs)``.
        measurements: Measured modes with shapes. Their ``dofs`` are matched with those
            at which the model returns shapes, in any order; where they are None, rows
            and sensors correspond in order.
        candidates: How many of the model's modes are searched; None for twice the
            number of measured ones, as is usual.
        min_mac: A pair below it counts as unpaired, which a
            :class:`FrequencyTerm` answers with a finite penalty.
        min_gap: Relative distance of two frequencies below which modes share their
            space.

    Raises:
        TypeError: If measurements are not Measurements, or model is not callable.
        ValueError: If the measurements have no shapes, there are fewer model modes
            than candidates, or fewer candidates than measured modes, or the model has
            no shapes at a sensor. When called: if the model returns no shapes, or too
            few modes or rows.

    Source: Simoen, De Roeck and Lombaert (2015), doi:10.1016/j.ymssp.2014.11.001;
    D'Ambrogio and Fregolent (2003) for the subspace MAC,
    doi:10.1006/mssp.2002.1554.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import MassSpringModel, Measurements, PairedModel
        >>> springs = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
        >>> model = MassSpringModel([1.0, 1.0], springs, shapes=True)
        >>> measured = Measurements([0.66], shapes=[[1.9], [-1.0]])  # the second mode
        >>> paired = PairedModel(model, measured)
        >>> paired({"k1": np.array([10.0])}).frequencies.round(3).tolist()
        [[0.658]]
    """

    model: Model
    measurements: Measurements
    candidates: int
    min_mac: float
    min_gap: float
    _shapes: Floats = field(repr=False)
    _rows: NDArray[np.intp] | None = field(repr=False)

    def __init__(
        self,
        model: Model,
        measurements: Measurements,
        *,
        candidates: int | None = None,
        min_mac: float = 0.5,
        min_gap: float = 0.02,
    ) -> None:
        if not callable(model):
            raise TypeError(f"model: expected a callable, got {model!r}")
        if not isinstance(measurements, Measurements):
            raise TypeError(
                "measurements: expected Measurements, got "
                f"{type(measurements).__name__}"
            )
        if measurements.shapes is None:
            raise ValueError("measurements: no shapes, by which modes are paired")
        measured = measurements.n_modes
        if candidates is None:
            candidates = 2 * measured
        candidates = checks.whole_number("candidates", candidates, measured)
        available = getattr(model, "n_modes", None)
        if available is not None and available < candidates:
            raise _too_few(candidates, measured, available)
        min_mac = checks.real_number("min_mac", min_mac, 0.0)
        min_gap = checks.real_number("min_gap", min_gap, 0.0)
        if min_mac > 1:
            raise ValueError(f"min_mac: expected a number from 0 to 1, got {min_mac:g}")
        shapes = measurements.shapes
        checks.set_fields(
            self,
            model=model,
            measurements=measurements,
            candidates=candidates,
            min_mac=min_mac,
            min_gap=min_gap,
            _shapes=shapes / np.linalg.norm(shapes, axis=0),
            _rows=_match_rows(declared_variables(model), measurements),
        )

    @property
    def variables(self) -> dict[str, Variable]:
        """Frequencies, MAC and numbers of the paired modes, which a response holds."""
        dofs = self.measurements.dofs
        labels = [None] * len(self._shapes) if dofs is None else dofs.tolist()
        modal = modal_variables(self.n_modes, labels)
        by_mode = Variable(modal["frequency"].coords)
        return {**modal, "mac": by_mode, "model_mode": by_mode, "unpaired": by_mode}

    @property
    def n_modes(self) -> int:
        """The number of measured modes."""
        return self.measurements.n_modes

    @property
    def names(self) -> tuple[str, ...] | None:
        """The parameters that the model reads, None if it does not say."""
        return getattr(self.model, "names", None)

    def __getattr__(self, attribute: str) -> Any:
        """Return what else the model says of itself (interfaces.py)."""
        if attribute in ("jacobian", "spread"):
            return partial(self._differentiate, getattr(self.model, attribute))
        if attribute in ("required", "positive", "bounds", "one_by_one"):
            return getattr(self.model, attribute)
        raise AttributeError(attribute)

    def around(self, model: Model) -> "PairedModel":
        """Return the same pairing of another model's modes."""
        return PairedModel(
            model,
            self.measurements,
            candidates=self.candidates,
            min_mac=self.min_mac,
            min_gap=self.min_gap,
        )

    def __call__(self, parameters: Parameters) -> PairedSolution:
        """Solve, and return the modes in the order of the measured ones."""
        return self.pair(self.model(parameters))

    def pair(self, response: Any) -> PairedSolution:
        """Return the modes that the model inside returned, in that order."""
        return self._pair(*self.read_candidates(response))

    def _differentiate(
        self, differentiate: Callable[[Parameters], Any], parameters: Parameters
    ) -> tuple[PairedSolution, Any]:
        """Return the paired modes and what the model's jacobian or spread gives.

        Of frequency, shapes and MAC; numbers of modes change in steps.
        """
        response, derivatives = differentiate(parameters)
        modes = self.read_candidates(response)
        solution = self._pair(*modes)
        names, slopes = read_slopes(response, derivatives, modes, self._at_sensors)
        chosen = solution.model_mode - 1
        found = differentiate_pairing(self._shapes, modes, slopes, chosen, self.min_gap)
        named = [{name: part[:, i] for i, name in enumerate(names)} for part in found]
        paired = dict(zip(("frequency", "shapes", "mac"), named, strict=True))
        return solution, {**paired, "model_mode": {}, "unpaired": {}}

    def _pair(self, frequencies: Floats, shapes: Floats) -> PairedSolution:
        norms = np.linalg.norm(shapes, axis=1)
        unit = np.divide(
            shapes, norms[:, None], out=np.zeros_like(shapes), where=norms[:, None] > 0
        )
        # (n, n_measured, candidates); one product per row, so that rows round alike
        single = (self._shapes.T @ unit) ** 2
        with np.errstate(invalid="ignore"):  # infinite ones, which LogPosterior refuses
            close = np.diff(frequencies, axis=1) < self.min_gap * frequencies[:, :-1]
        rows = np.flatnonzero(close.any(axis=1))
        mac, score = single, single
        if len(rows):
            coupling = couple_modes(frequencies[rows], self.min_gap)
            (which, modes), shared_mac, shared = share_shapes(
                self._shapes, unit[rows], coupling
            )
            mac, score = single.copy(), single.copy()
            mac[rows[which], :, modes] = shared_mac
            score[rows] = mac[rows] + TIE_BREAK * single[rows]
        chosen = one_to_one(score)
        paired = np.take_along_axis(shapes, chosen[:, None, :], axis=2)
        if len(rows):
            # The projection of each measured shape on the space of its mode.
            number = np.full(frequencies.shape, -1)
            number[rows[which], modes] = np.arange(len(which))
            number = np.take_along_axis(number, chosen, axis=1)
            at, measured = np.nonzero(number >= 0)
            paired[at, :, measured] = shared[number[at, measured], :, measured]
        found = np.take_along_axis(mac, chosen[:, :, None], axis=2)[:, :, 0]
        return PairedSolution(
            np.take_along_axis(frequencies, chosen, axis=1),
            paired,
            Pairing(found, chosen + 1, found < self.min_mac),
        )

    def read_candidates(self, response: Any) -> tuple[Floats, Floats]:
        """Return frequencies and shapes at the sensors of a response's candidates."""
        try:
            found = [read(response, name) for name in ("frequency", "shapes")]
        except TypeError as error:
            raise ValueError(
                f"{error}; modes are paired by their shapes: ask for them (shapes=True)"
            ) from None
        frequencies, shapes = map(_check_floats, found)
        if shapes.ndim != 3 or frequencies.shape != shapes.shape[::2]:
            raise ValueError(
                "model: expected frequencies (n, n_modes) and shapes (n, n_dof, "
                f"n_modes), got {frequencies.shape} and {shapes.shape}"
            )
        if not np.isfinite(shapes).all():
            raise SolveError("not finite", "model: expected finite shapes")
        n_modes = frequencies.shape[1]
        if n_modes < self.candidates:
            raise _too_few(self.candidates, self.measurements.n_modes, n_modes)
        wanted = slice(self.candidates)
        return frequencies[:, wanted], self._at_sensors(shapes)[:, :, wanted]

    def _at_sensors(self, shapes: Floats) -> Floats:
        if self._rows is None:
            return at_sensors(shapes, self.measurements.dofs, len(self._shapes))
        return np.ascontiguousarray(shapes[:, self._rows])


def _match_rows(variables: Any, measurements: Measurements) -> NDArray[np.intp] | None:
    """Return where the sensors are among the model's rows, None if unknown."""
    if variables is None:
        return None
    if "shapes" not in variables:
        raise ValueError(
            "model: it returns no mode shapes, by which modes are paired; ask for them "
            "(shapes=True)"
        )
    labels = variables["shapes"].coords.get("dof")
    if labels is None or measurements.dofs is None:
        return None
    places = {dof: i for i, dof in enumerate(labels)}
    sensors = measurements.dofs.tolist()
    missing = [dof for dof in sensors if dof not in places]
    if missing:
        raise ValueError(
            f"dofs: the measurements have sensors at {missing}, but the model has no "
            f"shapes there; ask it for shapes={sensors}"
        )
    return np.array([places[dof] for dof in sensors])


def _check_floats(part: Any) -> Floats:
    """Return an array of floats, as it is if it is one."""
    if type(part) is np.ndarray and part.dtype == np.float64:
        return part
    return checks.numeric_array("model", part)


def _too_few(candidates: int, measured: int, available: int) -> ValueError:
    enough = available >= measured
    remedy = f", or give PairedModel(candidates={available})" if enough else ""
    return ValueError(
        f"candidates: {candidates} modes are searched for {measured} measured ones, "
        f"but the model returns {available}; let it return {candidates}{remedy}"
    )
