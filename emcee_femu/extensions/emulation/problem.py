r"""What is solved in full for an emulator, and what its errors mean to the data.

The standard deviation of the measurement error of ordinate i of a response is

.. math:: \sigma_i = \Big[ \sum_{terms} F_{ii} \Big]^{-1/2}

with the Fisher information :math:`F_{ii}` that the terms have about it. An emulator's
error in these units says whether it matters.
"""

from collections.abc import Mapping

import numpy as np

from ...contracts import (
    Floats,
    Model,
    Parameters,
    Response,
    Variable,
    gather_tangents,
    modal_variables,
    read,
    read_declared,
)
from ...models.function import DensityModel
from ...models.paired import PairedModel
from ...posterior.experiments import expand, tangents_of
from ...posterior.log_posterior import LogPosterior
from ...posterior.plausibility import doubt, doubt_prior, is_constant, same_response
from ...search.coordinates import Coordinates
from .emulated import as_modal
from .encoding import Named

PAIRS = 0.1  # error allowed in shapes that are only used to pair modes
UNREAD = 3.0  # times the usual error: a mode that no term reads matters less
# Variables beside the others.
SLOPES_SUFFIX, DERIVATIVES_KNOWN = " by parameter", "derivatives known"
TERM_STEP = 1e-3  # of a variable's size, for terms that cannot be linearized


class Recorder:
    """A model whose response is nothing but the variables that are to be emulated.

    Args:
        problem: What is emulated.

    Attributes:
        model: The full model, inside of its pairing.
        raw: The variables that are recorded of it.
        names: The parameters that there are.
        paired: The pairing, of whose candidates it is recorded at the sensors.
        columns: Those of the parameters by which derivatives are recorded too.
        inputs: The names of these.
        variables: What is recorded.
    """

    one_by_one = True  # as they are asked for, so that a failure is known

    def __init__(self, problem: "EmulationProblem") -> None:
        self.raw, self.paired = problem.variables, problem.paired
        self.model: Model = (problem.paired or problem.posterior).model
        self.names = problem.posterior.names
        self.columns = problem.inputs if problem.derivatives else []
        self.inputs = [self.names[i] for i in self.columns]
        self.variables = dict(self.raw)
        if self.inputs:
            for name, v in self.raw.items():
                coords = {**v.coords, "by parameter": self.inputs}
                self.variables[name + SLOPES_SUFFIX] = Variable(coords)
            self.variables[DERIVATIVES_KNOWN] = Variable({})

    def __call__(self, parameters: Parameters) -> Named:
        """Solve in full; zero are derivatives that the model refuses at a point.

        Where two modes coincide, say. Then it is called again, without them.
        """
        try:
            if self.inputs:
                return self._differentiate(parameters)
        except ValueError:
            pass
        n = len(next(iter(parameters.values())))
        zeros = {name: np.zeros((n, *v.shape)) for name, v in self.variables.items()}
        return zeros | self._read(self.model(parameters))

    def _differentiate(self, parameters: Parameters) -> Named:
        """Return variables and derivatives.

        Raises:
            TypeError: If those of a variable are not there.
            ValueError: If they are not finite, or the model refuses them.
        """
        copies = {name: value.copy() for name, value in parameters.items()}
        response, slopes = read_declared(self.model, "jacobian")(copies)
        tangents = gather_tangents("model: jacobian", response, slopes, self.names)
        if missing := [name for name in self.raw if name not in tangents]:
            raise TypeError(
                f"model: jacobian returned no derivatives of {missing}, which are "
                "emulated; return {variable: {parameter: array}} for them too, or call "
                "emulate(..., derivatives=False)"
            )
        recorded = self._read(response)
        moves = [
            self._read({name: tangent[..., j] for name, tangent in tangents.items()})
            for j in self.columns
        ]
        for name in self.raw:
            tangent = np.stack([move[name] for move in moves], axis=-1)
            if not np.isfinite(tangent).all():
                raise ValueError(f"jacobian: derivatives of {name} are not finite")
            recorded[name + SLOPES_SUFFIX] = tangent
        recorded[DERIVATIVES_KNOWN] = np.ones(len(tangent))
        return recorded

    def _read(self, response: Response) -> Named:
        """Return the raw variables of a response, or of its derivatives."""
        if self.paired is not None:
            candidates = self.paired.read_candidates(response)
            return dict(zip(("frequency", "shapes"), candidates, strict=True))
        return {name: read(response, name) for name in self.raw}


def compare_nothing(parameters: Parameters, response: Response) -> Floats:
    """Return a likelihood of one, for variables that are only recorded."""
    return np.zeros(len(next(iter(parameters.values()))))


class EmulationProblem:
    """A posterior whose model is to be emulated.

    Args:
        posterior: The posterior.
        derivatives: Whether those that the model may have are wanted.

    Attributes:
        posterior: The posterior.
        variables: The raw variables that its terms need.
        inputs: Columns of the parameters that the model reads.
        paired: The model that pairs modes, if there is one.
        derivatives: Whether those that the model has are recorded and learned.
        coordinates: Those in which the first design and fit see the parameters.

    Raises:
        ValueError: If it cannot be told what the model returns, or there is none.
    """

    def __init__(self, posterior: LogPosterior, derivatives: bool) -> None:
        errors, model = posterior.error_names, posterior.model
        if isinstance(model, DensityModel):
            raise ValueError(
                "posterior: expected a model with a response, got a bare "
                "log-likelihood, which spans too many orders of magnitude between "
                "draws of the prior to be learned from few solves; give LogPosterior "
                "the model and its terms apart, or sample it with workers="
            )
        self.posterior, self.paired = posterior, posterior.experiments[0].paired
        self.coordinates = Coordinates.of(posterior.prior)
        names = enumerate(posterior.names)
        self.inputs = [i for i, name in names if name not in errors]
        if self.paired is None:
            variables = _find_variables(posterior)
        else:  # the candidates, at the sensors
            dofs = self.paired.variables["shapes"].coords["dof"]
            variables = modal_variables(self.paired.candidates, dofs)
        self.variables = {n: Variable(v.coords, v.unit) for n, v in variables.items()}
        known = read_declared(model, "jacobian") is not None
        self.derivatives = derivatives and known

    def recorder(self) -> LogPosterior:
        """Return the posterior whose rows store the raw variables of a full solve."""
        return LogPosterior(Recorder(self), compare_nothing, self.posterior.prior)

    def part(self, recorded: Named) -> tuple[Named, Named]:
        """Return raw variables, and their derivatives; NaN where they are not known.

        ``{variable: (n, *shape)}`` and ``{variable: (n, *shape, d)}``.
        """
        response = {name: recorded[name] for name in self.variables}
        if not self.derivatives:
            return response, {}
        tangents = {n: recorded[n + SLOPES_SUFFIX].copy() for n in self.variables}
        for tangent in tangents.values():
            tangent[recorded[DERIVATIVES_KNOWN] == 0] = np.nan
        return response, tangents

    def replace_model(self, model: Model) -> LogPosterior:
        """Return the posterior with another source of the raw variables."""
        if (paired := self.paired) is None:
            return self.posterior.with_models(lambda _: model)
        whole = PairedModel(
            model,
            paired.measurements,
            candidates=paired.candidates,
            min_mac=paired.min_mac,
            min_gap=paired.min_gap,
        )
        return self.posterior.with_models(lambda _: whole)

    def compared(self, response: Named) -> Response:
        """Return a response as the terms see it, paired."""
        if self.paired is not None:  # whose candidates are recorded at the sensors
            return self.paired.match(response["frequency"], response["shapes"])
        return as_modal(response)

    def doubt(self, recorded: Named) -> list[str]:
        """Say what is far from the measured at all solves of a first design.

        And what they, or the prior, leave in doubt besides.
        """
        slips = doubt_prior(self.posterior)
        if not (n := len(next(iter(recorded.values())))):
            return slips
        raw = [recorded[name].reshape(n, -1) for name in self.variables]
        if n > 1 and all(map(is_constant, raw)):
            slips.append(same_response("model", n))
        response = self.compared(self.part(recorded)[0])
        stored = {name: read(response, name) for name in self.posterior.variables}
        return doubt(self.posterior, stored, "the first design") + slips

    def deviate(self, theta: Floats, response: Named, emulated: LogPosterior) -> Floats:
        r"""Return how far an emulator is from full solves, ``(n,)``, for the data.

        .. math:: \Big[\sum_i (r_i - r'_i)^2 / \sigma_i^2\Big]^{1/2}

        with the independent deviations of all terms; of a term that does not tell them
        the difference of the log-likelihoods counts.
        """
        parameters = self.posterior.parameters(theta)
        full, close = self.compared(response), emulated.model(parameters)
        total = np.zeros(len(theta))
        for term in self.posterior.terms:
            with np.errstate(all="ignore"):
                here = term.deviations(parameters, full)
                there = term.deviations(parameters, close)
                if here is not None and there is not None:
                    total += (((here[0] - there[0]) / here[1]) ** 2).sum(axis=1)
                else:
                    total += (term(parameters, full) - term(parameters, close)) ** 2
        return np.asarray(np.sqrt(total))

    def predict_error(self, emulated: LogPosterior, theta: Floats) -> Floats:
        """Return the mean square of ``deviate`` that an emulator predicts, ``(n,)``."""
        parameters = emulated.parameters(theta)
        response, directions = emulated.model.spread(parameters)  # type: ignore[attr-defined]
        moves = tangents_of("spread", parameters, response, directions)
        return np.asarray(self._inform(parameters, response, moves).sum(axis=1))

    def measurement_errors(self, theta: Floats, response: Named) -> Named:
        """Return the measurement error of each raw number, ``{variable: (*shape)}``.

        Of the variables that the terms read. Modes that are not compared get three
        times the usual relative error. Shapes have one for all sensors of a mode.
        Information is averaged over the points.

        Raises:
            ValueError: If the terms have no information about any variable.
        """
        compared = self.compared(response)
        reads = {n for term in self.posterior.terms for n in term.reads or response}
        units = {}
        for name in [name for name in response if name in reads]:
            raw, value = response[name], np.asarray(read(compared, name), float)
            information = self._information(theta, compared, name, value)
            if not (information > 0).any():
                continue
            by_mode = name == "shapes" and raw.ndim == 3
            if by_mode:
                raw, value = (np.linalg.norm(x, axis=1) for x in (raw, value))
                information = information.mean(axis=1)
            relative = information * value**2
            if self.paired is not None:  # from the measured modes to the candidates
                placed = np.full(raw.shape, np.nan)
                np.put_along_axis(placed, compared.model_mode - 1, relative, axis=1)
                relative = placed
            count = np.maximum(np.isfinite(relative).sum(axis=0), 1)
            mean = np.nansum(relative, axis=0) / count
            errors = np.sqrt(1 / np.where(mean > 0, mean, np.nan))
            errors = np.nan_to_num(errors, nan=UNREAD * np.nanmedian(errors))
            unit = errors * np.sqrt((raw**2).mean(axis=0))
            shape = response[name].shape[1:]
            units[name] = np.broadcast_to(unit, shape).copy() if by_mode else unit
        if not units:
            raise ValueError(
                "terms: none of them uses what the model returns, so it is unknown "
                "which emulator errors matter"
            )
        if self.paired is not None and "shapes" not in units:
            sizes = np.sqrt((response["shapes"] ** 2).mean(axis=(0, 1)))
            units["shapes"] = np.tile(PAIRS * sizes, (response["shapes"].shape[1], 1))
        return units

    def _information(
        self, theta: Floats, compared: Response, name: str, value: Floats
    ) -> Floats:
        """Return what the data know of each ordinate of a variable, ``(n, *shape)``."""
        parameters, size = self.posterior.parameters(theta), value[0].size
        step = TERM_STEP * max(float(np.abs(value).mean()), 1e-300)
        move = (step * np.eye(size)).reshape(*value.shape[1:], size)
        moves = dict.fromkeys(parameters, np.zeros((len(theta), size)))
        moves[name] = np.broadcast_to(move, (*value.shape, size))
        information = self._inform(parameters, compared, moves) / step**2
        return information.reshape(value.shape)

    def _inform(
        self, parameters: Parameters, response: Response, moves: Mapping[str, Floats]
    ) -> Floats:
        """Return what the data know of each direction of moves, ``(n, q)``."""
        total = np.zeros(moves[next(iter(parameters))].shape)
        for term in self.posterior.terms:
            with np.errstate(all="ignore"):
                value = term(parameters, response)
                curvature = expand(term, parameters, response, moves, value)[1]
            information = np.diagonal(curvature, axis1=1, axis2=2)
            total += np.where(np.isfinite(information), information, 0.0)
        return total


def _find_variables(posterior: LogPosterior) -> dict[str, Variable]:
    """Return the raw variables that the terms need, with their shapes."""
    variables = read_declared(posterior.model, "variables") or {}
    declared = {
        name: variable
        for name, variable in variables.items()
        if variable.coords or variable.stored  # else it may be there, of any shape
    }
    needed: dict[str, Variable] = {}
    for term, label in zip(posterior.terms, posterior.term_names, strict=True):
        if term.reads is None and not declared:
            raise ValueError(
                f"posterior: neither the term {label!r} says what it reads (reads) nor "
                "the model what it returns (variables); declare one of the two, so "
                "that it is known what to emulate"
            )
        for name, variable in (declared if term.reads is None else term.reads).items():
            if name == "shapes" and name not in declared:
                raise ValueError(
                    "posterior: the model does not say at which DOFs it returns mode "
                    "shapes; put a PairedModel around it, or declare its variables"
                )
            stored = posterior.variables.get(name, variable)
            needed[name] = declared.get(name, stored)
    if "frequency" in needed and "shapes" in declared:  # to tell which mode is which
        needed["shapes"] = declared["shapes"]
    return needed
