"""A model whose modes are in the order of the measured ones.

Modes are paired one-to-one by MAC, and modes too close to distinguish are treated as a
cluster. Derivatives of the paired modes are differences along the derivatives of the
model's modes and cost no solve. The pairing is held fixed; everything else, including
the blending of close modes, is differentiated.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from .. import checks
from ..contracts import (
    Derivatives,
    Floats,
    Model,
    PairedSolution,
    Parameters,
    Response,
    SolveError,
    Variable,
    gather_tangents,
    modal_variables,
    read,
    read_declared,
    show_declared,
)
from ..measurements import Measurements
from .differences import derive_along
from .sensors import at_sensors, match_rows, refuse_mixed_units

Indices: TypeAlias = NDArray[np.intp]
# What a model's jacobian, or its spread, is.
Differentiate: TypeAlias = Callable[[Parameters], tuple[Response, Derivatives]]

# Part of a shape at the sensors compared, below which it is rounding: it rests there.
AT_REST = 1e-9
CLUSTER_DEPENDENT = 1e-8  # a shape that the others of its cluster span at the sensors
# Among coupled modes all candidates share one MAC; their own MAC then decides.
TIE_BREAK = 1e-3
# By which derivatives move shapes, and frequencies as a share of min_gap.
SHAPE_STEP = 1e-4


class PairedModel:
    r"""Pair a model's modes with the measured ones by MAC, at every parameter set.

    .. math:: \max_{\pi} \sum_i MAC(\phi_i^m, \phi_{\pi(i)}), \qquad
        \pi \text{ one-to-one}

    Use it whenever mode shapes were measured and modes may change places: compared in
    ascending order, the frequencies would then belong to different modes. Each measured
    mode :math:`\phi_i^m` is assigned one of the lowest ``candidates`` modes of the
    model (Hungarian algorithm), separately for each parameter set. Pairing costs no
    additional solve.

    The shapes of close modes can be any combination of the shapes that they span. Model
    modes closer to each other than half of ``min_gap`` are therefore treated as one
    subspace: the MAC is computed between the measured shape and its projection onto the
    subspace, and this projection is returned as the paired shape, so that a
    :class:`ShapeTerm` is not affected either. Between half of ``min_gap`` and
    ``min_gap`` the treatment fades out smoothly, so that shapes and MAC are continuous.
    Where two modes change places, their frequencies still jump.

    **Without measured shapes**, ``reference`` stands in for them: the i-th measured
    frequency belongs to the i-th mode of the model at these parameters, and is followed
    by that mode's shape. This assumes, first, that the model at the reference has the
    modes of the test in the same order, with none missing and none in between. The data
    cannot show this, so compare pictures of the modes. It assumes, second, that
    throughout the prior each mode resembles its own reference shape more than any
    other; ``mac`` shows this for each sample.

    **A MAC compares what has one unit**: translations. Rotations, which labels such as
    ``"3:ry"`` tell, are left out, because with them it would depend on the unit of
    length; only modes that do not translate, as in torsion, are compared by rotations.
    Of rows without labels the model must return translations only.

    Args:
        model: A model that returns shapes, such as ``MatrixModel(..., shapes=dofs)``.
        measurements: Measured modes with shapes; each is compared at the sensors that
            measured it. Their ``dofs`` are matched with those of the model's shapes, in
            any order; without ``dofs``, rows and sensors correspond in order. With a
            reference: measured modes without shapes, or frequencies in Hz.
        reference: ``{parameter: value}`` at which the model is solved once, for shapes
            to pair by; None to pair by the measured shapes.
        candidates: Number of the model's lowest modes to choose from; None for twice
            the number of measured modes.
        min_mac: MAC below which a pair counts as unpaired; a :class:`FrequencyTerm`
            then adds a finite penalty.
        min_gap: Relative difference of two frequencies below which their modes are
            treated as one subspace.

    Raises:
        TypeError: If measurements are not Measurements, or model is not callable.
        ValueError: If the measurements have no shapes and there is no reference, or
            both, or the reference cannot be solved, there are fewer model modes
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

    def __init__(
        self,
        model: Model,
        measurements: Measurements | ArrayLike,
        *,
        reference: Mapping[str, float] | None = None,
        candidates: int | None = None,
        min_mac: float = 0.5,
        min_gap: float = 0.02,
    ) -> None:
        checks.function("model", model)
        self.reference = reference
        if reference is not None:
            measurements = _solve_reference(model, measurements, reference)
        test = checks.instance("measurements", measurements, Measurements)
        if test.shapes is None:
            raise ValueError(
                "measurements: no shapes, by which modes are paired; give them, or "
                "reference={parameter: value}, where the model's own are taken"
            )
        self.model, self.measurements = model, test
        self.by_reference = reference is not None  # the shapes are the model's own
        n_modes = test.n_modes
        wanted = 2 * n_modes if candidates is None else candidates
        self.candidates = checks.whole_number("candidates", wanted, n_modes)
        self.min_mac = checks.real_number("min_mac", min_mac, 0.0, 1.0)
        self.min_gap = checks.real_number("min_gap", min_gap, 0.0)
        compared = test.compared
        size = np.sqrt(np.nansum(compared**2, axis=0))
        self._shapes = np.nan_to_num(compared / size)
        # The modes that share their sensors are compared at these.
        there = ~np.isnan(compared)
        sensors, of_mode = np.unique(there, axis=1, return_inverse=True)
        groups = enumerate(sensors.T[:, :, None])
        self._alike = [(each, np.flatnonzero(of_mode == i)) for i, each in groups]
        declared = read_declared(model, "variables")
        self._rows = match_rows(declared, test, read_declared(model, "dofs"))
        if declared is not None and "frequency" in declared:
            self._check_count(declared["frequency"].size)
        labels = [None] * len(self._shapes) if test.dofs is None else test.dofs.tolist()
        refuse_mixed_units(model, test)
        self.variables = modal_variables(n_modes, labels)
        by_mode = Variable(self.variables["frequency"].coords)
        self.variables |= dict.fromkeys(("mac", "model_mode", "unpaired"), by_mode)
        self.names = read_declared(model, "names")
        self.bounds = read_declared(model, "bounds")
        self.one_by_one = read_declared(model, "one_by_one")
        self.geometry = read_declared(model, "geometry")

    @property
    def jacobian(self) -> Differentiate | None:
        """Paired modes and their derivatives; None if the model has no ``jacobian``.

        Frequencies, shapes and MAC have derivatives; mode numbers change in steps.
        """
        return self._pass_on("jacobian")

    @property
    def spread(self) -> Differentiate | None:
        """Like ``jacobian``, for the directions in which an emulator is uncertain."""
        return self._pass_on("spread")

    __repr__ = show_declared

    def __call__(self, parameters: Parameters) -> PairedSolution:
        """Solve, and return the modes in the order of the measured ones."""
        return self.pair(self.model(parameters))

    def pair(self, response: Response) -> PairedSolution:
        """Return the modes of a response in the order of the measured ones."""
        return self.match(*self.read_candidates(response))

    def match(self, frequencies: Floats, shapes: Floats) -> PairedSolution:
        """Return the pairs among candidates, of sensor shapes ``(n, n_sensors, q)``."""
        return self._solution(*self._pair(frequencies, shapes))

    def _pass_on(self, attribute: str) -> Differentiate | None:
        function = read_declared(self.model, attribute)  # goes to other processes
        return function and partial(self._differentiate, function)

    def _differentiate(
        self, differentiate: Differentiate, parameters: Parameters
    ) -> tuple[PairedSolution, Derivatives]:
        """Return paired modes and their derivatives."""
        response, derivatives = differentiate(parameters)
        modes = self.read_candidates(response)
        chosen, paired = self._pair(*modes)
        names = [*dict.fromkeys(name for by in derivatives.values() for name in by)]
        needed = "frequency", "shapes"
        gathered = gather_tangents("jacobian", response, derivatives, names, needed)
        by_f, by_shape = (np.moveaxis(gathered[name], -1, 0) for name in needed)
        tangents = by_f[..., : self.candidates], self._at_sensors(by_shape)

        def pair_again(f: Floats, shapes: Floats) -> dict[str, Floats]:
            return self._pair(f, shapes, chosen)[1]

        speed = (np.abs(tangents[0]) / modes[0]).max(axis=2) / (self.min_gap or 1.0)
        size = np.abs(modes[1]).max(axis=(1, 2))
        speed += np.abs(tangents[1]).max(axis=(2, 3)) / size
        steps = SHAPE_STEP / np.where(speed > 0, speed, 1.0)
        slopes = derive_along(pair_again, modes, tangents, steps, names)
        exact = np.take_along_axis(tangents[0], chosen[None], axis=2)
        slopes["frequency"] = dict(zip(names, exact, strict=True))
        slopes |= {"model_mode": {}, "unpaired": {}}
        return self._solution(chosen, paired), slopes

    def _pair(
        self, frequencies: Floats, shapes: Floats, chosen: Indices | None = None
    ) -> tuple[Indices, dict[str, Floats]]:
        """Return one candidate for each measured mode, one-to-one by MAC.

        Args:
            frequencies: Frequencies of the candidates ``(n, q)``.
            shapes: Their shapes at the sensors ``(n, r, q)``.
            chosen: The assignment ``(n, p)``, if it is already known.

        Returns:
            The candidate of each measured mode, 0 = the lowest, ``(n, p)``;
            frequencies, shapes and MAC in that order.
        """
        measured = self._shapes
        mac = np.empty((len(shapes), measured.shape[1], shapes.shape[2]))  # (n, p, q)
        for sensors, modes in self._alike:
            unit = _scale(shapes, sensors)
            mac[:, modes] = (measured[:, modes].T @ unit) ** 2
        score = mac.copy()
        shared = np.full(frequencies.shape, -1)  # numbers of those that share a space
        projections = np.empty((0, *measured.shape))
        with np.errstate(invalid="ignore"):  # infinite ones, which LogPosterior refuses
            near = np.diff(frequencies) < self.min_gap * frequencies[:, :-1]
        close = near.any(axis=1)
        if close.any():
            coupling = couple_modes(frequencies[close], self.min_gap)
            at, mode = np.nonzero((coupling > 0).sum(axis=2) > 1)
            row = np.flatnonzero(close)[at]
            shared[row, mode] = np.arange(len(row))
            projections = np.empty((len(row), *measured.shape))
            for sensors, modes in self._alike:
                unit, weights = _scale(shapes[row], sensors), coupling[at, mode]
                spanned, projected = _widen(measured[:, modes], unit, weights, sensors)
                mac[row[:, None], modes, mode[:, None]] = spanned
                projections[:, :, modes] = projected
            score = mac + TIE_BREAK * score
        if chosen is None:
            chosen = score.argmax(axis=2)
            ordered = np.sort(chosen, axis=1)
            # Where the best ones differ they are the answer, and usually they do.
            repeated = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
            for one in np.flatnonzero(repeated):
                chosen[one] = linear_sum_assignment(score[one], maximize=True)[1]
        paired = np.take_along_axis(shapes, chosen[:, None], axis=2)
        number = np.take_along_axis(shared, chosen, axis=1)
        row, which = np.nonzero(number >= 0)
        # Of those that share one, the projection of the measured shape on their space.
        paired[row, :, which] = projections[number[row, which], :, which]
        return chosen, {
            "frequency": np.take_along_axis(frequencies, chosen, axis=1),
            "shapes": paired,
            "mac": np.take_along_axis(mac, chosen[:, :, None], axis=2)[:, :, 0],
        }

    def _solution(self, chosen: Indices, paired: dict[str, Floats]) -> PairedSolution:
        f, shapes, mac = paired.values()
        return PairedSolution(f, shapes, mac, chosen + 1, mac < self.min_mac)

    def read_candidates(self, response: Response) -> tuple[Floats, Floats]:
        """Return frequencies and sensor shapes of the candidates in a response."""
        try:
            frequencies, shapes = (
                np.asarray(read(response, name), dtype=np.float64)
                for name in ("frequency", "shapes")
            )
        except TypeError as error:
            raise ValueError(
                f"{error}; pairing needs mode shapes: ask for them (shapes=True)"
            ) from None
        if shapes.ndim != 3 or frequencies.shape != shapes.shape[::2]:
            raise ValueError(
                "model: expected frequencies (n, n_modes) and shapes (n, n_dof, "
                f"n_modes), got {frequencies.shape} and {shapes.shape}"
            )
        if not np.isfinite(shapes).all():
            raise SolveError("not finite", "model: expected finite shapes")
        self._check_count(frequencies.shape[1])
        return frequencies[:, : self.candidates], self._at_sensors(shapes)

    def _check_count(self, available: int) -> None:
        """Raise ValueError if the model returns fewer modes than candidates."""
        wanted, measured = self.candidates, self.measurements.n_modes
        if available < wanted:
            enough = available >= measured
            remedy = f", or give PairedModel(candidates={available})" if enough else ""
            raise ValueError(
                f"candidates: {measured} measured modes are paired with {wanted} "
                f"candidates, but the model returns {available} modes; let it return "
                f"{wanted}{remedy}"
            )

    def _at_sensors(self, shapes: Floats) -> Floats:
        """Return the candidates' shapes ``(..., rows, modes)`` at the sensors."""
        shapes = shapes[..., : self.candidates]
        if self._rows is None:
            return at_sensors(shapes, self.measurements.dofs, len(self._shapes))
        return self._rows.of(shapes)


def _solve_reference(
    model: Model, measurements: Measurements | ArrayLike, reference: Mapping[str, float]
) -> Measurements:
    """Return the measured frequencies with the model's own shapes at a reference."""
    if not isinstance(measurements, Measurements):
        try:
            measurements = Measurements(measurements)
        except (TypeError, ValueError) as error:
            raise type(error)(f"measurements: {error}") from None
    frequencies, sd = measurements.frequencies, measurements.sd
    if measurements.shapes is not None:
        raise ValueError("reference: the measurements have shapes; give one of both")
    by_name = checks.mapping("reference", reference, "{parameter: value}")
    names = checks.parameter_names("reference", by_name) if by_name else ()
    row = checks.numbers_by_name("reference", by_name, names)
    values = dict(zip(names, row[:, None], strict=True))
    try:
        shapes = np.asarray(read(model(values), "shapes"))[0]
    except (TypeError, ValueError) as error:
        raise ValueError(f"reference: no shapes there: {error}") from error
    if shapes.shape[1] < len(frequencies):
        raise ValueError(
            f"measurements: {len(frequencies)} frequencies, but the model returns "
            f"{shapes.shape[1]} modes; let it return more"
        )
    declared = read_declared(model, "variables")
    labels = None if declared is None else declared["shapes"].coords.get("dof")
    shapes = shapes[:, : len(frequencies)]
    return Measurements(frequencies, sd=sd, shapes=shapes, dofs=labels)


def _scale(shapes: Floats, sensors: NDArray[np.bool_]) -> Floats:
    """Return shapes ``(n, r, q)`` of unit length at ``sensors (r, 1)``, or zero."""
    size = np.linalg.norm(shapes * sensors, axis=1, keepdims=True)
    moves = size > AT_REST * np.linalg.norm(shapes, axis=1, keepdims=True)
    return np.asarray(shapes * np.divide(1, size, out=np.zeros_like(size), where=moves))


def couple_modes(frequencies: Floats, min_gap: float) -> Floats:
    """Return how far each mode ``(n, q)`` shares its space with each other.

    1 for neighbours nearer than half of ``min_gap``, 0 beyond it, a smooth passage
    between; along a row of close neighbours the weakest link counts.
    """
    n, q = frequencies.shape
    with np.errstate(invalid="ignore", divide="ignore"):  # min_gap may be zero
        gaps = np.diff(frequencies) / (min_gap * frequencies[:, :-1])
    x = np.clip(2.0 * np.nan_to_num(gaps, nan=np.inf) - 1.0, 0.0, 1.0)
    links = 1.0 - x * x * (3.0 - 2.0 * x)  # (n, q - 1)
    coupling = np.ones((n, q, q))
    for mode in range(q - 1):
        weakest = np.minimum.accumulate(links[:, mode:], axis=1)
        coupling[:, mode, mode + 1 :] = coupling[:, mode + 1 :, mode] = weakest
    return coupling


def _widen(
    measured: Floats, unit: Floats, weights: Floats, sensors: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    r"""Return MAC and shape of coupled modes, widened by those they are coupled to.

    .. math:: v = \sum_k c_k q_k q_k^T \phi^m, \qquad
        MAC = \frac{(\sum_k c_k t_k^2)^2}{\sum_k c_k^2 t_k^2}, \quad
        t_k = q_k^T \phi^m

    with the orthonormal :math:`q_k` of the mode itself and its neighbours, in the order
    of their coupling, so that one whose coupling fades takes nothing with it.

    Args:
        measured: Unit shapes ``(r, p)``.
        unit: Unit shapes of all modes, of m rows, ``(m, r, q)``.
        weights: The coupling of one mode of each row with all, ``(m, q)``.
        sensors: Which are compared, ``(r, 1)``; at the others measured is zero, and the
            shapes follow.

    Returns:
        MAC ``(m, p)``, and shapes ``(m, r, p)``.
    """
    row = np.arange(len(unit))
    order = np.argsort(-weights, axis=1, kind="stable")  # itself first
    most = int((weights > 0).sum(axis=1).max(initial=0))
    axes: list[Floats] = []  # orthonormal shapes
    first, second = np.zeros((2, len(unit), measured.shape[1]))
    shapes = np.zeros((len(unit), *measured.shape))
    for place in order.T[:most]:
        axis = unit[row, :, place]
        for earlier in axes * 2:  # Gram-Schmidt, twice for accuracy
            part = (earlier * axis).sum(axis=1, keepdims=True, where=sensors[:, 0])
            axis = axis - earlier * part
        length = np.linalg.norm(axis * sensors[:, 0], axis=1, keepdims=True)
        unlike = length > CLUSTER_DEPENDENT
        axis = axis * unlike / np.where(unlike, length, 1.0)
        axes.append(axis)
        weight, t = weights[row, place][:, None], axis @ measured
        first += weight * t**2
        second += (weight * t) ** 2
        shapes += axis[:, :, None] * (weight * t)[:, None]
    share = np.divide(first, second, out=np.zeros_like(first), where=second > 0)
    return share * first, shapes
