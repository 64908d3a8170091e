"""What is solved in full for an emulator, and what its errors mean to the data."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..interfaces import (
    Floats,
    ModalSolution,
    Parameters,
    Variable,
    modal_variables,
    read,
)
from ..models.paired import PairedModel
from ..posterior.differences import gather_tangents
from ..posterior.log_posterior import LogPosterior
from ..posterior.marginal import expand
from ..posterior.units import find_units

Response = dict[str, Floats]  # the raw variables, {name: (n, *shape)}


@dataclass(frozen=True)
class Recorder:
    """A model whose response is nothing but the variables that are to be emulated.

    Attributes:
        model: The full model, of which the variables are read; for a
            :class:`PairedModel` those of all its candidates, at the sensors.
        variables: What is recorded.
    """

    model: Any
    variables: dict[str, Variable]

    @property
    def names(self) -> tuple[str, ...] | None:
        """The parameters that the model reads."""
        return getattr(self.model, "names", None)

    @property
    def one_by_one(self) -> bool:
        """Whether it solves one parameter set after another."""
        return bool(getattr(self.model, "one_by_one", False))

    def __call__(self, parameters: Parameters) -> Response:
        """Solve in full."""
        if isinstance(self.model, PairedModel):
            response = self.model.model(parameters)
            frequency, shapes = self.model.read_candidates(response)
            return {"frequency": frequency, "shapes": shapes}
        response = self.model(parameters)
        return {name: read(response, name) for name in self.variables}


@dataclass(frozen=True)
class Nothing:
    """A likelihood of one: what is recorded is not yet compared with anything."""

    names: tuple[str, ...]
    name: str = "recorded"

    def __call__(self, parameters: Parameters, response: Any) -> Floats:
        """Return zeros."""
        return np.zeros(len(next(iter(parameters.values()))))


@dataclass(frozen=True)
class Known:
    """A model of which the response is known, perhaps with directions of change."""

    variables: dict[str, Variable]
    response: Any
    directions: Any = None

    def __call__(self, parameters: Parameters) -> Any:
        """Return the response."""
        return self.response

    def spread(self, parameters: Parameters) -> Any:
        """Return the response and how it changes."""
        return self.response, self.directions


@dataclass(frozen=True, eq=False)
class EmulationProblem:
    """A posterior whose model is to be emulated.

    Attributes:
        posterior: The posterior.
        variables: The raw variables that its terms need.
        inputs: Columns of the parameters that the model reads.
    """

    posterior: LogPosterior
    variables: dict[str, Variable]
    inputs: list[int]

    @classmethod
    def of(cls, posterior: LogPosterior) -> "EmulationProblem":
        """Return what is to be emulated of a posterior.

        Raises:
            ValueError: If there are several experiments, or it cannot be told what
                the model returns.
        """
        if len(posterior.experiments) > 1:
            names = [experiment.name for experiment in posterior.experiments]
            raise ValueError(
                f"posterior: expected one experiment to emulate, got {names}; write "
                "one model that solves for all of them, its variables named by "
                "experiment (FunctionModel(..., variables=...)), and terms that read "
                "them"
            )
        errors = posterior.error_names
        inputs = [i for i, name in enumerate(posterior.names) if name not in errors]
        return cls(posterior, _find_variables(posterior), inputs)

    def recorder(self) -> LogPosterior:
        """Return the posterior whose rows store the raw variables of a full solve."""
        model = Recorder(self.posterior.model, self.variables)
        prior = self.posterior.prior
        return LogPosterior(model, Nothing(tuple(prior.names)), prior)

    def replace_model(self, model: Any) -> LogPosterior:
        """Return the posterior with another source of the raw variables."""
        return self.posterior.with_models(lambda _: self._pair(model))

    def _pair(self, model: Any) -> Any:
        full = self.posterior.model
        return full.around(model) if isinstance(full, PairedModel) else model

    def deviate(self, theta: Floats, response: Response, other: Response) -> Floats:
        r"""Return how far apart two responses are, ``(n,)``, for the data.

        .. math:: \Big[\sum_i (r_i - r'_i)^2 / \sigma_i^2\Big]^{1/2}

        with the independent deviations of all terms; of a term that does not tell them
        the difference of the log-likelihoods counts.
        """
        parameters = self.posterior.parameters(theta)
        seen = [self._compare(parameters, one) for one in (response, other)]
        total = np.zeros(len(theta))
        for term in self.posterior.terms:
            with np.errstate(all="ignore"):
                if hasattr(term, "deviations"):
                    (r, sd), (s, _) = (term.deviations(parameters, x) for x in seen)
                    total += (((r - s) / sd) ** 2).sum(axis=1)
                else:
                    values = [term(parameters, x) for x in seen]
                    total += (values[0] - values[1]) ** 2
        result: Floats = np.sqrt(total)
        return result

    def _compare(self, parameters: Parameters, response: Response) -> Any:
        """Return a response as the terms see it, paired."""
        return self._pair(Known(self.variables, _modal(response)))(parameters)

    def predict_error(self, emulated: LogPosterior, theta: Floats) -> Floats:
        """Return the predicted root mean square of ``deviate``, ``(n,)``."""
        parameters = emulated.parameters(theta)
        response, directions = emulated.model.spread(parameters)  # type: ignore[attr-defined]
        information = self._inform(parameters, response, directions)
        result: Floats = np.sqrt(information.sum(axis=1))
        return result

    def units(self, theta: Floats, response: Response) -> Response:
        """Return the measurement error of each raw number, ``{variable: (*shape)}``."""
        model = self._pair(Known(self.variables, None))
        parameters = self.posterior.parameters(theta)
        return find_units(model, self.posterior.terms, parameters, _modal(response))

    def _inform(self, parameters: Parameters, response: Any, directions: Any) -> Floats:
        """Return what the data know of each direction, ``(n, q)``."""
        labels = dict.fromkeys(d for found in directions.values() for d in found)
        moved = gather_tangents("spread", response, directions, [*labels])
        n = len(next(iter(parameters.values())))
        moved |= dict.fromkeys(parameters, np.zeros((n, len(labels))))
        total = np.zeros((n, len(labels)))
        for term in self.posterior.terms:
            with np.errstate(all="ignore"):
                value = term(parameters, response)
                curvature = expand(term, parameters, response, moved, value)[1]
            own = np.diagonal(curvature, axis1=1, axis2=2)
            total += np.where(np.isfinite(own), own, 0.0)
        return total


def _find_variables(posterior: LogPosterior) -> dict[str, Variable]:
    """Return the raw variables that the terms need, with their shapes."""
    model: Any = posterior.model
    if isinstance(model, PairedModel):
        dofs = model.measurements.dofs
        sensors = range(len(np.asarray(model.measurements.shapes)))
        labels = sensors if dofs is None else dofs.tolist()
        modes = modal_variables(model.candidates, labels)
        return {name: Variable(own.coords, own.unit) for name, own in modes.items()}
    declared: dict[str, Variable] = dict(getattr(model, "variables", None) or {})
    found: dict[str, Variable] = {}
    for term, label in zip(posterior.terms, posterior.term_names, strict=True):
        reads = getattr(term, "reads", None)
        if reads is None and not declared:
            raise ValueError(
                f"posterior: neither the term {label!r} says what it reads (reads) nor "
                "the model what it returns (variables); declare one of the two, so "
                "that it is known what to emulate"
            )
        for name, own in (declared if reads is None else reads).items():
            if name == "shapes" and name not in declared:
                raise ValueError(
                    "posterior: the model does not say at which DOFs it returns mode "
                    "shapes; put a PairedModel around it, or declare its variables"
                )
            usual: Variable = posterior.variables.get(name, own)
            found[name] = declared.get(name, usual)
    if "frequency" in found and "shapes" in declared:  # to tell which mode is which
        found["shapes"] = declared["shapes"]
    return {name: Variable(own.coords, own.unit) for name, own in found.items()}


def _modal(response: Response) -> Any:
    """Return a response as models of modes give it."""
    if "frequency" in response and {*response} <= {"frequency", "shapes"}:
        return ModalSolution(response["frequency"], response.get("shapes"))
    return response
