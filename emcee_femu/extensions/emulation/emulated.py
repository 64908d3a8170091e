"""A model emulated by Gaussian processes, which knows how uncertain it is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ...contracts import (
    Derivatives,
    Floats,
    ModalSolution,
    Parameters,
    Response,
    Variable,
)
from ...models.inputs import columns, read_inside
from ...table import Parts, Report, Table
from .encoding import Outputs
from .gaussian_process import Processes

if TYPE_CHECKING:
    from ...posterior.log_posterior import LogPosterior

SMALL_DIRECTION = 0.02  # in units of measurement error: for less no direction is kept
LEAST_LOGARITHM = 1e-300  # whose logarithm is taken in place of that of zero
MOST_DIRECTIONS = 24  # directions in which the emulator errs, the largest ones
REST = 0.03  # share of the mean square error that all others have


@dataclass(frozen=True, eq=False, repr=False)
class EmulatedModel(Report):
    """A model emulated by Gaussian processes; made by :func:`.emulate`.

    What is emulated are smooth quantities of the response in units of measurement
    error, each by a Gaussian process with a linear trend. ``spread`` says how uncertain
    the response is, and a :class:`LogPosterior` takes that into its likelihood: while
    the emulator is poor the posterior is broad, and nothing is excluded early. The
    error that is predicted understates the true one; ``history`` has both.

    Attributes:
        bounds: ``{parameter: (low, high)}``; the model refuses values outside.
        variables: What it returns.
        outputs: What is emulated.
        processes: The Gaussian processes, in scaled coordinates: some of all outputs,
            or some of each block with lengths of their own.
        solves: Solves of the full model spent, all of them.
        factor: By which the model may err more than the processes say.
        history: One row per round: solves, predicted and true error in units of
            measurement error.
        posterior: The posterior with this model in place of the full one, ready to
            :func:`run`.

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
    outputs: Outputs
    processes: tuple[Processes, ...]
    solves: int
    _scale: tuple[Floats, Floats]  # mean and standard deviation of coordinates
    _logs: NDArray[np.bool_]  # parameters seen by logarithms, (d,)
    factor: float = 1.0
    history: Table | None = None
    posterior: "LogPosterior | None" = None

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the model depends on."""
        return tuple(self.bounds)

    def _parts(self) -> Parts:
        left_out = [each.leave_out(each.values) for each in self.processes]
        error = np.sqrt((np.hstack(left_out) ** 2).mean(axis=0))
        values = self.processes[0].values
        known = int((~np.isnan(values[:, 1:, 0])).any(axis=1).sum())
        logs = np.array(self.names)[self._logs].tolist()
        yield (
            f"{self.outputs.size} outputs of {len(self.names)} parameters emulated "
            f"from {len(values)} points, {self.solves} full solves, "
            + (
                f"with derivatives at {known} points"
                if known
                else "without derivatives"
            )
            + (f"; logarithms of {', '.join(logs)}" if logs else "")
            + ("; each block by lengths of its own" if len(self.processes) > 1 else "")
            + (f"; {len(self.history.rows)} rounds" if self.history else "")
        )
        yield (
            f"leaving one out, errors of {error.mean():.2g} measurement sd "
            f"(root mean square), {error.max():.2g} of the worst output"
        )
        if self.history is not None:
            yield self.history

    def __call__(self, parameters: Parameters) -> Response:
        """Return the response for values of shape ``(n,)``.

        Raises:
            ValueError: If a parameter is missing or outside the bounds.
        """
        points = self.coordinates(self._theta(parameters))
        still = np.empty((len(points), self.outputs.size, 0))
        return self._decode(points, still, ())[0]

    def spread(self, parameters: Parameters) -> tuple[Response, Derivatives]:
        """Return the response, and how it moves along each direction of error.

        ``{variable: {direction: (n, *shape)}}``, by one standard deviation; directions
        are independent.

        Raises:
            ValueError: As a call does.
        """
        points = self.coordinates(self._theta(parameters))
        directions, owners = self._directions
        sds = np.stack([each.unit_sd(points) for each in self.processes], axis=1)
        moves = self.factor * sds[:, None, owners] * directions
        labels = [str(k) for k in range(len(owners))]
        return self._decode(points, moves, labels, finite=True)

    def jacobian(self, parameters: Parameters) -> tuple[Response, Derivatives]:
        """Return the response and its derivatives, those of the mean.

        Raises:
            ValueError: As a call does.
        """
        theta = self._theta(parameters)
        points = self.coordinates(theta)
        steps = np.where(self._logs, theta, 1.0) * self._scale[1]
        slopes = np.hstack([each.slopes(points) for each in self.processes])
        slopes /= steps[:, None]
        return self._decode(points, slopes, self.names)

    def coordinates(self, theta: Floats) -> Floats:
        """Return scaled coordinates ``(n, d)`` of parameters in their order."""
        mean, sd = self._scale
        x = theta.copy()
        x[:, self._logs] = np.log(np.maximum(theta[:, self._logs], LEAST_LOGARITHM))
        return np.asarray((x - mean) / sd)

    @cached_property
    def _directions(self) -> tuple[Floats, NDArray[np.intp]]:
        """The independent directions ``(size, r)`` in which the processes err.

        They are those of a standard deviation of one; outputs that err together share
        them. Beside them stands which processes each is of, ``(r,)``.
        """
        squares, axes = zip(
            *(np.linalg.eigh(each.covariance) for each in self.processes), strict=True
        )
        owners = np.repeat(np.arange(len(squares)), [len(part) for part in squares])
        sizes = np.sqrt(np.maximum(np.concatenate(squares), 0.0))
        order = np.argsort(sizes, kind="stable")
        sizes, owners = sizes[order], owners[order]
        worst = np.array([each.left_out_sd.max() for each in self.processes])
        kept = sizes * worst[owners] > SMALL_DIRECTION
        kept &= np.cumsum(sizes**2) > REST * (sizes**2).sum()
        kept[:-MOST_DIRECTIONS] = False
        kept[-1] = True
        directions = block_diag(*axes)[:, order[kept]] * sizes[kept]
        return np.asarray(directions)[:, ::-1], owners[kept][::-1]

    def _theta(self, parameters: Parameters) -> Floats:
        values, n = read_inside(parameters, self.bounds, "emulate")
        return columns(values, self.names, n)

    def _decode(
        self,
        points: Floats,
        directions: Floats,
        labels: Sequence[str],
        finite: bool = False,
    ) -> tuple[Response, Derivatives]:
        """Return the response, and how it moves along labelled directions."""
        mean = np.hstack([each.predict(points) for each in self.processes])
        response, moves = self.outputs.decode(mean, directions, finite)
        labelled = {
            name: {label: move[..., k] for k, label in enumerate(labels)}
            for name, move in moves.items()
        }
        return as_modal(response), labelled


def as_modal(response: Mapping[str, Floats]) -> Response:
    """Return a response as models of modes give it, if it is one."""
    if "frequency" in response and {*response} <= {"frequency", "shapes"}:
        return ModalSolution(response["frequency"], response.get("shapes"))
    return response
