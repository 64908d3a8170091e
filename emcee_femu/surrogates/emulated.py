"""A model emulated by Gaussian processes, which knows how uncertain it is."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..interfaces import (
    Floats,
    ModalSolution,
    Parameters,
    Variable,
    modal_variables,
    read,
)
from ..models.parameters import columns, read_inside
from ..table import Parts, Report, Table
from .gaussian_process import Processes, fit_processes
from .outputs import Outputs, choose_outputs

SMALL = 0.02  # in units of measurement error: what no direction of doubt is kept for
LEAST = 1e-300  # whose logarithm is taken in place of that of zero
MOST = 24  # directions of doubt, the largest ones


@dataclass(frozen=True, eq=False)
class EmulatedModel(Report):
    """A model emulated by Gaussian processes; fitted to full solves.

    What is emulated are smooth quantities of the response in units of measurement
    error, each by a Gaussian process with a linear trend. ``spread`` says how uncertain
    the response is, and a :class:`LogPosterior` takes that into its likelihood: while
    the emulator is poor the posterior is broad, and nothing is excluded early. The
    error that is predicted understates the true one; ``history`` has both.

    Attributes:
        bounds: ``{parameter: (low, high)}``; the model refuses values outside.
        variables: What it returns.
        outputs: What is emulated.
        processes: The Gaussian processes, in whitened coordinates.
        solves: Solves of the full model spent, all of them.
        history: One row per round: solves, predicted and true error in units of
            measurement error; None if nobody kept it.
        posterior: The posterior with this model in place of the full one, ready to
            :func:`run`; None if nobody made it.

    Examples:
        >>> import numpy as np
        >>> import emcee_femu as ef
        >>> full = ef.FunctionModel(lambda p: [p["k"] ** 0.5])
        >>> term = ef.FrequencyTerm([3.0], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> model = ef.emulate(ef.LogPosterior(full, term, prior), 12, seed=1)
        >>> model({"k": np.array([9.0])}).frequency.round(2).tolist()
        [[3.0]]
    """

    bounds: Mapping[str, tuple[float, float]]
    variables: Mapping[str, Variable]
    outputs: Outputs = field(repr=False)
    processes: Processes = field(repr=False)
    solves: int
    _whiten: tuple[Floats, Floats] = field(repr=False)  # mean, and to coordinates
    _directions: Floats = field(repr=False)  # (size, r)
    _logs: NDArray[np.bool_] = field(repr=False)  # parameters seen by logarithms, (d,)
    history: Table | None = field(default=None, repr=False)
    posterior: Any = field(default=None, repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the model depends on."""
        return tuple(self.bounds)

    @property
    def required(self) -> tuple[str, ...]:
        """All parameters, for without each of them there is no model."""
        return self.names

    def __getattr__(self, attribute: str) -> Any:
        """Return ``n_modes`` of a modal model (interfaces.py)."""
        if attribute == "n_modes" and "frequency" in self.__dict__.get("variables", {}):
            return self.variables["frequency"].shape[-1]
        raise AttributeError(attribute)

    def _parts(self) -> Parts:
        error = self.leave_one_out()
        lines = [
            f"{self.outputs.size} outputs of {len(self.names)} parameters emulated "
            f"from {len(self.processes.points)} points, {self.solves} full solves",
            f"leaving one out, errors of {error.mean():.2g} measurement sd "
            f"(root mean square), {error.max():.2g} of the worst output",
        ]
        return *lines, *([] if self.history is None else [self.history])

    def __call__(self, parameters: Parameters) -> Any:
        """Return the response for values of shape ``(n,)``.

        Raises:
            ValueError: If a parameter is missing or outside the bounds.
        """
        mean = self.processes.predict(self._coordinates(parameters))[0]
        return self._respond(self.outputs.decode(mean))

    def spread(
        self, parameters: Parameters
    ) -> tuple[Any, dict[str, dict[int, Floats]]]:
        """Return the response, and how it moves along each direction of doubt.

        ``{variable: {direction: (n, *shape)}}``, by one standard deviation; directions
        are independent.

        Raises:
            ValueError: As a call does.
        """
        points = self._coordinates(parameters)
        mean = self.processes.predict(points)[0]
        moves = self.processes.doubt(points)[:, None, None] * self._directions
        response, slopes = self.outputs.decode_slopes(mean, moves, finite=True)
        directions = range(self._directions.shape[1])
        return self._respond(response), {
            name: {k: slope[..., k] for k in directions}
            for name, slope in slopes.items()
        }

    def jacobian(
        self, parameters: Parameters
    ) -> tuple[Any, dict[str, dict[str, Floats]]]:
        """Return the response and its derivatives, those of the mean.

        Raises:
            ValueError: As a call does.
        """
        theta = self._theta(parameters)
        points = self.coordinates(theta)
        mean = self.processes.predict(points)[0]
        by_parameter = self.processes.slopes(points) @ self._whiten[1]
        by_parameter /= np.where(self._logs, theta, 1.0)[:, None]
        response, slopes = self.outputs.decode_slopes(mean, by_parameter)
        return self._respond(response), {
            name: {key: slope[..., j] for j, key in enumerate(self.names)}
            for name, slope in slopes.items()
        }

    def leave_one_out(self) -> Floats:
        """Return the root mean square error of each output, from the other points.

        In units of measurement error, ``(size,)``.
        """
        errors = self.processes.leave_one_out()[0]
        result: Floats = np.sqrt((errors**2).mean(axis=0))
        return result

    def coordinates(self, theta: Floats) -> Floats:
        """Return whitened coordinates ``(n, d)`` of parameters in their order."""
        mean, turn = self._whiten
        found: Floats = (_take_logs(theta, self._logs) - mean) @ turn.T
        return found

    def _coordinates(self, parameters: Parameters) -> Floats:
        return self.coordinates(self._theta(parameters))

    def _theta(self, parameters: Parameters) -> Floats:
        values, n = read_inside(parameters, self.bounds, "emulate")
        return columns(values, self.names, n)

    def _respond(self, found: dict[str, Floats]) -> Any:
        if "frequency" in found and {*found} <= {"frequency", "shapes"}:
            return ModalSolution(found["frequency"], found.get("shapes"))
        return found


def fit_emulated(
    points: Floats,
    response: Any,
    units: Mapping[str, Floats],
    bounds: Mapping[str, tuple[float, float]],
    *,
    variables: Mapping[str, Variable] | None = None,
    whiten: tuple[Floats, Floats] | None = None,
    start: EmulatedModel | None = None,
    solves: int | None = None,
    logs: ArrayLike = False,
) -> EmulatedModel:
    """Return a model that emulates responses at some points.

    Args:
        points: Parameters ``(N, d)``, in the order of ``bounds``.
        response: The variables at the points, ``(N, *shape)``.
        units: Standard deviations of the measurement error, ``{variable: (*shape)}``;
            the variables that are emulated.
        bounds: ``{parameter: (low, high)}`` within which the model may be called.
        variables: What the model declares; None for dimensions of numbers.
        whiten: Mean ``(d,)`` and covariance ``(d, d)`` of the parameters that matter,
            those of the current posterior, of logarithms where logs are taken; None
            for those of the points.
        start: An earlier fit, from whose lengths this one begins.
        solves: Full solves spent; None for the number of points.
        logs: Of which parameters, all above zero, the logarithms are taken, ``(d,)``.

    Raises:
        TypeError: If a variable is missing or not real.
        ValueError: If shapes do not fit, or numbers are not finite.
    """
    points = checks.real_array("points", points, 2)
    if points.shape[1] != len(bounds):
        raise ValueError(
            f"points: expected columns of {[*bounds]}, got shape {points.shape}"
        )
    logs = np.broadcast_to(np.asarray(logs, dtype=bool), points.shape[1]).copy()
    points = _take_logs(points, logs)
    mean, covariance = whiten or (points.mean(axis=0), np.diag(points.var(axis=0)))
    # The directions of a covariance in units of its own spreads, so that a parameter
    # of 1e10 and one of 1 are alike.
    sd = np.sqrt(np.diag(covariance))
    factor = sd[:, None] * np.linalg.cholesky(covariance / np.outer(sd, sd))
    turn = np.linalg.inv(factor)
    coordinates = (points - mean) @ turn.T
    lengths = None if start is None else start.processes.lengths
    outputs = choose_outputs(coordinates, response, units, lengths)
    processes = fit_processes(coordinates, outputs.encode(response), lengths)
    if variables is None:
        variables = _declare(response, units)
    return EmulatedModel(
        bounds={
            name: (float(low), float(high)) for name, (low, high) in bounds.items()
        },
        variables={name: variables[name] for name in units},
        outputs=outputs,
        processes=processes,
        solves=len(points) if solves is None else solves,
        _whiten=(np.asarray(mean, dtype=float), turn),
        _directions=_find_directions(processes),
        _logs=logs,
    )


def _take_logs(theta: Floats, logs: NDArray[np.bool_]) -> Floats:
    """Return parameters ``(n, d)``, of some the logarithms."""
    taken = theta.copy()
    taken[:, logs] = np.log(np.maximum(theta[:, logs], LEAST))
    return taken


def _find_directions(processes: Processes) -> Floats:
    """Return the independent directions ``(q, r)`` in which the processes err.

    They are those of a doubt of one; outputs that err together share them.
    """
    squares, axes = np.linalg.eigh(processes.covariance)
    largest = (processes.leave_one_out()[1] / processes.amplitudes).max()
    kept = np.sqrt(np.maximum(squares, 0.0)) * largest > SMALL
    kept[:-MOST] = False
    kept[-1] = True
    directions: Floats = axes[:, kept] * np.sqrt(np.maximum(squares[kept], 0.0))
    return directions[:, ::-1]


def _declare(response: Any, units: Mapping[str, Floats]) -> dict[str, Variable]:
    """Return variables with numbers for labels."""
    found = {}
    for name in units:
        shape = np.shape(read(response, name))[1:]
        axes = {f"{name}_{i}": range(size) for i, size in enumerate(shape)}
        found[name] = Variable(axes)
    if "frequency" in found:
        dofs = range(found["shapes"].shape[0]) if "shapes" in found else ()
        found |= modal_variables(found["frequency"].shape[0], dofs)
    return found
