"""Emulate the models of several experiments, each from solves of its own."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ... import checks
from ...contracts import Floats, Parameters, Response, Variable, read_declared
from ...evaluation.resume import check_path
from ...likelihoods.term import Term
from ...posterior.experiments import Experiment
from ...posterior.log_posterior import LogPosterior
from ...table import Parts, Report
from .emulated import EmulatedModel


@dataclass(frozen=True, eq=False, repr=False)
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


@dataclass(frozen=True, eq=False)
class Others(Term):
    """What other experiments say of the parameters, as a term beside those of one.

    Attributes:
        experiments: Those that can be solved often, cheap ones and emulated ones.
        parameters: All parameters.
        names: Those that the model of the one does not read.
    """

    experiments: tuple[Experiment, ...]
    parameters: tuple[str, ...]
    names: tuple[str, ...]
    name: str = "other experiments"
    reads: Mapping[str, Variable] = field(default_factory=dict)

    def __call__(self, parameters: Parameters, response: Response) -> Floats:
        """Return the log-likelihood of all of them, ``(n,)``."""
        total = np.zeros(len(next(iter(parameters.values()))))
        for experiment in self.experiments:
            solved = experiment.solve(parameters, self.parameters)
            total += np.sum(solved.log_likelihoods, axis=0)
        return total

    def deviations(
        self, parameters: Parameters, response: Response
    ) -> tuple[Floats, Floats]:
        """Return none at all: to the response of another model it is indifferent."""
        nothing = np.zeros((len(next(iter(parameters.values()))), 1))
        return nothing, nothing + 1.0


def emulate_each(
    posterior: LogPosterior,
    cheap: Sequence[str] | None,
    emulate: Callable[..., Any],
    options: dict[str, Any],
) -> EmulatedExperiments:
    """Emulate one experiment after another, each where those before it leave room.

    Args:
        posterior: The joint posterior.
        cheap: Experiments whose models are taken as they are; None for none.
        emulate: Emulates the model of one.
        options: Its other arguments.

    Raises:
        ValueError: If one of cheap is no experiment, or all of them are.
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
    return EmulatedExperiments(models, joint)
