"""What likelihood terms say of each datum: its density, what it was, and a new one."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..interfaces import Floats, Variable
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior


def add_by_terms(
    posterior: LogPosterior,
    values: dict[str, dict[str, Floats]],
    variables: dict[str, dict[str, Variable]],
) -> None:
    """Add the log-likelihood of each datum, and new measurements.

    Args:
        posterior: The sampled posterior.
        values: Samples ``(draws, ensembles, walkers, ...)`` by group and name.
        variables: Their dimensions.

    Raises:
        TypeError: If a term returns no mapping.
        ValueError: If it names an unknown variable, or returns another shape.
    """
    lead = values["sample_stats"]["lp"].shape
    parameters = {name: v.reshape(-1) for name, v in values["posterior"].items()}
    rng = np.random.default_rng(0)  # the same draws at each conversion

    def add(group: str, label: str, variable: Variable, value: Floats) -> None:
        variables[group][label] = variable
        values[group][label] = value.reshape(*lead, *value.shape[1:])

    for experiment in posterior.experiments:
        stored = {
            name: values["response"][experiment.full_name(name)].reshape((-1, *v.shape))
            for name, v in experiment.variables.items()
        }
        for term, own in zip(experiment.terms, experiment.term_names, strict=True):
            n = (int(np.prod(lead)),)
            pointwise = getattr(term, "pointwise", None)
            said = _call(pointwise, parameters, stored)
            data = list(_check(experiment, own, "pointwise", said, n))
            label = experiment.full_name(own)
            if len(data) > 1:
                del values["log_likelihood"][label]  # the sum of the following
            for name, variable, value in data:
                several = f"{label}[{name}]" if len(data) > 1 else label
                add("log_likelihood", several, variable, value)
            replicate = getattr(term, "replicate", None)
            said = _call(replicate, rng, parameters, stored)
            for name, variable, value in _check(experiment, own, "replicate", said, n):
                taken = values["posterior_predictive"]
                label = _label_measured(experiment, own, name, taken)
                add("posterior_predictive", label, variable, value)


def gather_observed(
    posterior: LogPosterior,
) -> tuple[dict[str, Floats], dict[str, Variable]]:
    """Return what was measured, by variable; a second time by the term's name too."""
    values: dict[str, Floats] = {}
    variables = {}
    for experiment in posterior.experiments:
        for term, own in zip(experiment.terms, experiment.term_names, strict=True):
            observed = _observed(term)
            for name, variable, value in _check(experiment, own, "observed", observed):
                label = _label_measured(experiment, own, name, values)
                values[label], variables[label] = value, variable
    return values, variables


def _observed(term: Any) -> Any:
    return getattr(term, "observed", None) or {}


def _call(function: Any, *arguments: Any) -> Any:
    """Return what a term's method says; nothing where it has none or returns None."""
    said = None if function is None else function(*arguments)
    return {} if said is None else said


def _label_measured(
    experiment: Experiment, own: str, name: str, taken: Mapping[str, Any]
) -> str:
    """Return a measured variable's label; only the first measurement has its name."""
    pairs = zip(experiment.terms, experiment.term_names, strict=True)
    measured_by = [other for term, other in pairs if name in _observed(term)]
    label = experiment.full_name(name)
    first = own in (measured_by[:1] or [own]) and label not in taken
    return label if first else f"{label}[{own}]"


def _check(
    experiment: Experiment,
    own: str,
    attribute: str,
    said: Any,
    lead: tuple[int, ...] = (),
) -> Iterator[tuple[str, Variable, Floats]]:
    """Yield name, variable and array of all that a term says; refuse other shapes.

    Where the term does not say what it reads, it may be the first part of the response.
    """
    what = f"terms: {attribute} of {experiment.full_name(own)!r}"
    if not isinstance(said, Mapping):
        raise TypeError(
            f"{what}: expected {{variable: array}}, got {type(said).__name__}"
        )
    term = experiment.terms[experiment.term_names.index(own)]
    reads = getattr(term, "reads", {})
    for name, value in said.items():
        returned = experiment.variables.get(name)
        variable = reads.get(name) or returned
        if variable is None:
            raise ValueError(
                f"{what}: expected variables among "
                f"{sorted({*reads, *experiment.variables})}, got {name!r}"
            )
        array = np.asarray(value)
        coords = {
            dim: _fill_in(labels, returned.coords.get(dim, ()) if returned else ())
            for dim, labels in variable.coords.items()
        }
        sizes = array.shape[len(lead) :]
        if name not in reads and len(sizes) == len(coords):
            pairs = zip(coords.items(), sizes, strict=True)
            coords = {dim: labels[:size] for (dim, labels), size in pairs}
        expected = (*lead, *map(len, coords.values()))
        if array.shape != expected:
            raise ValueError(
                f"{what}: expected {name!r} of shape {expected}, got {array.shape}"
            )
        coords = {experiment.full_name(dim): v for dim, v in coords.items()}
        unit = variable.unit or (returned.unit if returned else "")
        yield name, Variable(coords, unit), array


def _fill_in(labels: Sequence[Any], known: Sequence[Any]) -> list[Any]:
    """Return labels, of the response where a term knows but the places."""
    places = None in labels and len(known) >= len(labels)
    return list(known if places else labels)[: len(labels)]
