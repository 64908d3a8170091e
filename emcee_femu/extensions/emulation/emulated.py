"""Models emulated by Gaussian processes, with their uncertainty.

One model, or the models of several experiments, each emulated from its own solves.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ... import checks
from ...contracts import (
    Derivatives,
    Floats,
    ModalSolution,
    Parameters,
    Response,
    Variable,
    read_declared,
)
from ...evaluation.resume import check_path
from ...likelihoods.term import Term
from ...models.parameter_sets import read_inside
from ...posterior.experiments import Experiment
from ...posterior.log_posterior import LogPosterior
from ...table import Parts, Report, Table
from .encoding import Outputs
from .gaussian_process import Processes

SETTLED = "settled"  # attribute of samples: whether the emulator was good enough
SMALL_DIRECTION = 0.02  # in measurement errors; smaller directions are dropped
LEAST_LOGARITHM = 1e-300  # used in logarithms instead of zero
MOST_DIRECTIONS = 24  # directions in which the emulator errs, the largest ones
REST = 0.03  # share of the mean square error that may be dropped with the others


@dataclass(frozen=True, eq=False, repr=False)
class EmulatedModel(Report):
    """A model emulated by Gaussian processes; made by :func:`.emulate`.

    Smooth quantities of the response are emulated in units of measurement error, each
    by a Gaussian process with a linear trend. ``spread`` gives the uncertainty of the
    response, and a :class:`LogPosterior` includes it in the likelihood: a poor emulator
    gives a broad posterior, so no region is excluded early. The predicted error is
    smaller than the true error; ``history`` has both.

    Attributes:
        bounds: ``{parameter: (low, high)}``; the model refuses values outside.
        variables: The variables of the response.
        outputs: The emulated quantities.
        processes: The Gaussian processes, in scaled coordinates: common to all outputs,
            or for blocks of outputs with their own lengths.
        solves: Total number of solves of the full model.
        failed_solves: How many of these failed.
        settled: Whether errors were within the tolerance of :func:`.emulate`, or within
            0.1 if that is larger, in the last two rounds; False if its solves were
            spent before.
        factor: Factor by which the model may err more than the processes predict.
        history: One row per round: solves, predicted and true error in units of
            measurement error.
        posterior: The posterior with this model in place of the full one, ready for
            :func:`run`.
    """

    bounds: Mapping[str, tuple[float, float]]
    variables: Mapping[str, Variable]
    outputs: Outputs
    processes: tuple[Processes, ...]
    solves: int
    _scale: tuple[Floats, Floats]  # mean and standard deviation of coordinates
    _logs: NDArray[np.bool_]  # parameters seen by logarithms, (d,)
    failed_solves: int = 0
    settled: bool = False
    factor: float = 1.0
    history: Table | None = None
    posterior: LogPosterior | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the model depends on."""
        return tuple(self.bounds)

    @property
    def notes(self) -> dict[str, object]:
        """What samples of its posterior should say of it, for :func:`.certify`."""
        return {SETTLED: int(self.settled)}  # netCDF has no truth values

    def _parts(self) -> Parts:
        left_out = [each.leave_out(each.values) for each in self.processes]
        error = np.sqrt((np.hstack(left_out) ** 2).mean(axis=0))
        values = self.processes[0].values
        known = int((~np.isnan(values[:, 1:, 0])).any(axis=1).sum())
        logs = np.array(self.names)[self._logs].tolist()
        how = f"with derivatives at {known} points" if known else "without derivatives"
        yield (
            f"{self.outputs.size} outputs of {len(self.names)} parameters emulated "
            f"from {len(values)} points, {self.solves} full solves, {how}"
            + (f"; {self.failed_solves} solves failed" if self.failed_solves else "")
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
        """Return the response and its changes along each direction of error.

        ``{variable: {direction: (n, *shape)}}``, for one standard deviation; directions
        are independent.

        Raises:
            ValueError: As for a call.
        """
        points = self.coordinates(self._theta(parameters))
        directions, owners = self._directions
        sds = np.stack([each.unit_sd(points) for each in self.processes], axis=1)
        moves = self.factor * sds[:, None, owners] * directions
        labels = [str(k) for k in range(len(owners))]
        return self._decode(points, moves, labels, finite=True)

    def jacobian(self, parameters: Parameters) -> tuple[Response, Derivatives]:
        """Return the response and its derivatives, both of the mean prediction.

        Raises:
            ValueError: As for a call.
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

        Each is scaled to one standard deviation; outputs that err together share
        directions. The second result is the process of each direction, ``(r,)``.
        """
        parts = [np.linalg.eigh(each.covariance) for each in self.processes]
        squares, axes = zip(*parts, strict=True)
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
        values, _ = read_inside(parameters, self.bounds, "emulate")
        return np.array([values[name] for name in self.names]).T

    def _decode(
        self,
        points: Floats,
        directions: Floats,
        labels: Sequence[str],
        finite: bool = False,
    ) -> tuple[Response, Derivatives]:
        """Return the response and its changes along labelled directions."""
        mean = np.hstack([each.predict(points) for each in self.processes])
        response, moves = self.outputs.decode(mean, directions, finite)
        labelled = {
            name: {label: move[..., k] for k, label in enumerate(labels)}
            for name, move in moves.items()
        }
        return as_modal(response), labelled


def as_modal(response: Mapping[str, Floats]) -> Response:
    """Return a response as a modal solution, if it is one."""
    if "frequency" in response and {*response} <= {"frequency", "shapes"}:
        return ModalSolution(response["frequency"], response.get("shapes"))
    return response


@dataclass(frozen=True, eq=False, repr=False)
class EmulatedExperiments(Report):
    """Emulated models of several experiments; made by :func:`.emulate`.

    Attributes:
        models: The emulated models, by experiment.
        posterior: The joint posterior with these in place of the full models, ready for
            :func:`run`.
    """

    models: Mapping[str, EmulatedModel]
    posterior: LogPosterior

    @property
    def solves(self) -> int:
        """Total number of solves of all full models that were emulated."""
        return sum(model.solves for model in self.models.values())

    @property
    def failed_solves(self) -> int:
        """How many of these failed."""
        return sum(model.failed_solves for model in self.models.values())

    @property
    def settled(self) -> bool:
        """Whether every emulation ended because errors were below its tolerance."""
        return all(model.settled for model in self.models.values())

    def _parts(self) -> Parts:
        for name, model in self.models.items():
            yield f"{name}: {model}"


@dataclass(frozen=True, eq=False)
class Others(Term):
    """The likelihood of the other experiments, as a term beside those of one.

    Attributes:
        experiments: Experiments that are fast enough: cheap and emulated ones.
        parameters: All parameters.
        names: The parameters that the model of the one does not read.
    """

    experiments: tuple[Experiment, ...]
    parameters: tuple[str, ...]
    names: tuple[str, ...]
    name: str = "other experiments"
    reads: Mapping[str, Variable] = field(default_factory=dict)

    def __call__(self, parameters: Parameters, response: Response) -> Floats:
        """Return the sum of their log-likelihoods, ``(n,)``."""
        total = np.zeros(len(next(iter(parameters.values()))))
        for experiment in self.experiments:
            solved = experiment.solve(parameters, self.parameters)
            total += np.sum(solved.log_likelihoods, axis=0)
        return total

    def deviations(
        self, parameters: Parameters, response: Response
    ) -> tuple[Floats, Floats]:
        """Return none: this term does not depend on the response of this model."""
        nothing = np.zeros((len(next(iter(parameters.values()))), 1))
        return nothing, nothing + 1.0


def emulate_each(
    posterior: LogPosterior,
    cheap: Sequence[str] | None,
    emulate: Callable[..., Any],
    options: dict[str, Any],
) -> EmulatedExperiments:
    """Emulate experiments in turn, each where earlier ones leave the posterior open.

    Args:
        posterior: The joint posterior.
        cheap: Experiments whose models are used as they are; None for none.
        emulate: The function that emulates the model of one experiment.
        options: Its other arguments.

    Raises:
        ValueError: If cheap names an unknown experiment, or all of them.
    """
    names = tuple(experiment.name for experiment in posterior.experiments)
    cheap = () if cheap is None else checks.parameter_names("cheap", cheap)
    if not {*cheap} < {*names}:
        raise ValueError(
            f"cheap: expected some of the experiments {names}, not all, got {cheap!r}"
        )
    files = dict.fromkeys(names)
    if (path := options["backend"]) is not None:
        files = {name: f"{os.fspath(path)}.{name}" for name in names}
        for name in {*names}.difference(cheap):  # before a solve of another
            check_path(files[name], options["resume"])
    known = {e.name: e for e in posterior.experiments if e.name in cheap}
    models: dict[str, EmulatedModel] = {}
    for experiment in posterior.experiments:
        if (place := experiment.name) in cheap:
            continue
        declared = [read_declared(experiment.model, key) for key in ("names", "bounds")]
        reads = {name for part in declared for name in part or ()}
        rest = tuple(name for name in posterior.names if name not in reads)
        own = rest if reads else posterior.error_names
        others = Others((*known.values(),), posterior.names, own)
        terms = [*experiment.terms, others]
        alone = LogPosterior(experiment.model, terms, posterior.prior)
        models[place] = emulated = emulate(alone, **options | {"backend": files[place]})
        known[place] = Experiment(place, emulated.posterior.model, experiment.terms)
    pairs = {name: (known[name].model, known[name].terms) for name in names}
    joint = LogPosterior.joint(pairs, posterior.prior, posterior.units)
    joint.draws = emulated.posterior.draws  # by all experiments: it was the last one
    models = {name: replace(each, posterior=joint) for name, each in models.items()}
    result = EmulatedExperiments(models, joint)
    joint.notes = {SETTLED: int(result.settled)}
    return result
