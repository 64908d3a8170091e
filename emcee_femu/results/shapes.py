"""Mode shapes of a model at one parameter set, paired with the measured ones."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..contracts import Floats, Variable, read, read_declared
from ..models.paired import AT_REST, couple_modes
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior

# Shapes of close modes at the sensors, of unit length: their least singular value, at
# which errors of a measured shape are ten times as large in how it combines them.
LEAST_APART = 0.1


@dataclass(frozen=True, eq=False)
class Pairing:
    """The m measured modes, and the model's that they are paired with.

    Attributes:
        measured: Measured shapes ``(n_sensors, m)``.
        hertz: Measured frequencies, ``(m,)``.
        sensors: The DOF of each sensor, or its name where that is not known.
        chosen: The model's mode that is paired with each, from 0, ``(m,)``.
        paired: Its shape at the sensors, ``(n_sensors, m)``; for close modes, the
            combination of their shapes that is nearest to the measured one.
        everywhere: This shape at all DOFs that the model returns, ``(n_dof, m)``; NaN
            where the sensors do not tell how close modes are combined.
        combined: The model's modes of which it is a combination, ``(m, q)``.
        mac: Measured modes against the model's, ``(m, q)``; that of a pair is with the
            subspace of all modes that are combined.
    """

    measured: Floats
    hertz: Floats
    sensors: Sequence[Hashable]
    chosen: NDArray[np.intp]
    paired: Floats
    everywhere: Floats
    combined: NDArray[np.bool_]
    mac: Floats


@dataclass(frozen=True, eq=False)
class ModeShapes:
    """The modes of a model at one parameter set.

    Attributes:
        frequencies: In Hz, ``(q,)``.
        shapes: At all DOFs that the model returns, ``(n_dof, q)``.
        dofs: The labels of these DOFs; their numbers if the model has no labels.
        complete: Whether these are all the DOFs that the model has.
        pairing: With measured modes, if the model pairs them.
    """

    frequencies: Floats
    shapes: Floats
    dofs: Sequence[Hashable]
    complete: bool
    pairing: Pairing | None = None


def choose_experiments(
    posterior: LogPosterior, name: str | None, suits: Callable[[Experiment], object]
) -> list[Experiment]:
    """Return the experiment of a name; without one all that suit, or else the first."""
    tests = [*posterior.experiments]
    if name is None:
        return [test for test in tests if suits(test)] or tests[:1]
    names = [test.name for test in tests]
    return [tests[names.index(checks.one_of("experiment", name, names))]]


def solve_shapes(
    posterior: LogPosterior, experiment: Experiment, theta: Floats
) -> ModeShapes:
    """Return the modes of an experiment at ``theta (d,)``, by one solve.

    Raises:
        ValueError: If the model returns no shapes.
    """
    paired = experiment.paired
    model = experiment.model if paired is None else paired.model
    response = model(posterior.parameters(theta[None]))
    try:
        hertz, shapes = (read(response, name)[0] for name in ("frequency", "shapes"))
    except TypeError as error:
        raise ValueError(f"{error}; let it return mode shapes (shapes=True)") from None
    variables = read_declared(model, "variables") or {}
    declared = variables.get("shapes", Variable({})).coords.get("dof", ())
    dofs: Sequence[Hashable] = [*declared] or range(len(shapes))
    complete = len(shapes) == len(read_declared(model, "dofs") or ())
    if paired is None:
        return ModeShapes(hertz, shapes, dofs, complete)
    measured, solution = paired.measurements, paired.pair(response)
    assert measured.shapes is not None
    candidates = paired.read_candidates(response)
    at_sensors = candidates[1][0]
    chosen = solution.model_mode[0] - 1
    mac = modal_assurance(measured.compared, at_sensors)
    mac[np.arange(len(chosen)), chosen] = solution.mac[0]
    combined = couple_modes(candidates[0], paired.min_gap)[0, chosen] > 0
    own = shapes[:, : at_sensors.shape[1]]
    moving = np.linalg.norm(at_sensors, axis=0) > AT_REST * np.linalg.norm(own, axis=0)
    combined &= moving | (np.arange(len(moving)) == chosen[:, None])
    by_mode = _find_combinations(
        combined, at_sensors, solution.shapes[0], np.isfinite(measured.compared)
    )
    known = np.isfinite(by_mode).all(axis=0)
    sensors: Sequence[Hashable] = dofs if declared else measured.sensors
    if measured.dofs is not None:
        sensors = measured.dofs.tolist()
    if not declared and len(sensors) == len(shapes):  # its rows are the sensors
        dofs = sensors
    pairing = Pairing(
        measured.shapes,
        measured.frequencies,
        sensors,
        chosen,
        np.where(known, at_sensors @ by_mode, solution.shapes[0]),
        own @ by_mode,
        combined,
        mac,
    )
    return ModeShapes(hertz, shapes, dofs, complete, pairing)


def _find_combinations(
    combined: NDArray[np.bool_],
    at_sensors: Floats,
    paired: Floats,
    there: NDArray[np.bool_],
) -> Floats:
    """Return how each paired shape combines the model's modes, ``(q, m)``.

    By least squares; one for a mode that is alone, so that it keeps its own scale, and
    NaN where the shapes of close modes are too much alike at the sensors.

    Args:
        combined: The modes of each, ``(m, q)``.
        at_sensors: Their shapes ``(n_sensors, q)``.
        paired: The paired shapes ``(n_sensors, m)``.
        there: The sensors at which each was measured, ``(n_sensors, m)``.
    """
    by_mode = combined.T.astype(float)
    for i in np.flatnonzero(combined.sum(axis=1) > 1):
        seen, modes = there[:, i], combined[i]
        each = at_sensors[np.ix_(seen, modes)]
        size = np.linalg.norm(each, axis=0)
        unit = each / np.where(size > 0, size, 1.0)
        values, _, _, apart = np.linalg.lstsq(unit, paired[seen, i])
        clear = len(apart) == modes.sum() and apart.min() > LEAST_APART
        by_mode[modes, i] = values / size if clear else np.nan
    return by_mode


def modal_assurance(measured: Floats, shapes: Floats) -> Floats:
    r"""Return the MAC of shapes ``(n_sensors, m)`` with others ``(n_sensors, q)``.

    .. math:: MAC_{ij} = \frac{(\phi_i^T \phi_j)^2}
        {\phi_i^T \phi_i \; \phi_j^T \phi_j}

    Over the sensors that have measured i: a missing one is NaN. Zero for a shape that
    is zero at all of them.

    Examples:
        >>> measured = np.array([[1.0], [2.0], [np.nan]])
        >>> modal_assurance(measured, np.array([[1.0], [2.0], [9.0]])).tolist()
        [[1.0]]
    """
    there = np.isfinite(measured)
    known = np.where(there, measured, 0.0)
    products = (known.T @ shapes) ** 2
    sizes = (known**2).sum(axis=0)[:, None] * (there.T.astype(float) @ shapes**2)
    return np.asarray(products / np.maximum(sizes, np.finfo(float).tiny))
