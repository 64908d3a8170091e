"""Emulate the models of several experiments, each from solves of its own."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Floats, Parameters, Response, Variable, read_declared
from ..likelihoods.term import Term
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior
from ..table import Parts, Report
from .emulated import EmulatedModel


@dataclass(frozen=True, eq=False)
class EmulatedExperiments(Report):
    """Emulated models of several experiments; made by :func:`.emulate`.

    Attributes:
        models: The emulated ones, by experiment.
        posterior: The joint posterior with these in place of the full models, ready to
            :func:`run`.
    """

    models: Mapping[str, EmulatedModel]
    posterior: LogPosterior

    @property
    def solves(self) -> int:
        """Solves of all full models that were emulated."""
        return sum(model.solves for model in self.models.values())

    def _parts(self) -> Parts:
        for name, model in self.models.items():
            yield f"{name}: {model}"


class Others(Term):
    """What other experiments say of the parameters, as a term beside those of one.

    Args:
        experiments: Those that can be solved often, cheap ones and emulated ones.
        parameters: All parameters.
        names: Those that the model of the one may not read.
    """

    gaussian, name = False, "other experiments"
    reads: Mapping[str, Variable] = {}

    def __init__(
        self,
        experiments: Iterable[Experiment],
        parameters: Sequence[str],
        names: tuple[str, ...],
    ) -> None:
        self.experiments, self.parameters = tuple(experiments), parameters
        self.names = names

    def __call__(self, parameters: Parameters, response: Response) -> Floats:
        """Return the log-likelihood of all of them, ``(n,)``."""
        total = np.zeros(len(next(iter(parameters.values()))))
        for experiment in self.experiments:
            solved = experiment.solve(parameters, self.parameters)
            total += np.sum(solved.log_likelihoods, axis=0)
        return total

    def linearize(
        self,
        parameters: Parameters,
        response: Response,
        tangents: Mapping[str, Floats],
        steps: Floats,
    ) -> tuple[Floats, Floats | None]:
        """Return no gradient along the response of another model, without a solve."""
        if any(tangents[name].any() for name in parameters):
            return super().linearize(parameters, response, tangents, steps)
        return np.zeros_like(steps), np.zeros((len(steps), 1, steps.shape[1]))


def emulate_each(
    posterior: LogPosterior,
    cheap: Sequence[str],
    emulate: Callable[..., Any],
    options: Mapping[str, Any],
) -> EmulatedExperiments:
    """Emulate one experiment after another, each where those before it leave room.

    Args:
        posterior: The joint posterior.
        cheap: Experiments whose models are taken as they are.
        emulate: Emulates the model of one.
        options: Its other arguments.

    Raises:
        ValueError: If one of cheap is no experiment, or all of them are.
    """
    names = [experiment.name for experiment in posterior.experiments]
    cheap = checks.parameter_names("cheap", cheap) if len(cheap) else ()
    if not {*cheap} < {*names}:
        raise ValueError(
            f"cheap: expected some of the experiments {names}, not all, got {[*cheap]}"
        )
    known = {e.name: e for e in posterior.experiments if e.name in cheap}
    models: dict[str, EmulatedModel] = {}
    for experiment in posterior.experiments:
        if experiment.name in cheap:
            continue
        model, own = experiment.model, dict(options)
        undeclared = read_declared(model, "names") is None
        names_of_others = posterior.error_names if undeclared else posterior.names
        others = Others(known.values(), posterior.names, names_of_others)
        alone = LogPosterior(model, [*experiment.terms, others], posterior.prior)
        if own["backend"] is not None:
            own["backend"] = f"{os.fspath(own['backend'])}.{experiment.name}"
        emulated = emulate(alone, **own)
        assert emulated.posterior is not None
        models[experiment.name] = emulated
        known[experiment.name] = Experiment(
            experiment.name, emulated.posterior.model, experiment.terms
        )
    pairs = {name: (known[name].model, known[name].terms) for name in names}
    joint = LogPosterior.joint(pairs, posterior.prior)
    models = {name: replace(each, posterior=joint) for name, each in models.items()}
    return EmulatedExperiments(models, joint)
