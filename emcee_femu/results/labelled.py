"""What the terms of a posterior say of samples, with dimensions and labels."""

from collections.abc import Iterator, Mapping
from itertools import product
from typing import NamedTuple

import numpy as np

from ..contracts import Floats, Variable
from ..likelihoods.term import Term
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior


class Labelled(NamedTuple):
    """An array, and what its axes after those of the samples are."""

    values: Floats
    variable: Variable


ONE_NUMBER = Variable({})


def each_term(posterior: LogPosterior) -> Iterator[tuple[Experiment, Term, str]]:
    """Yield experiment, term and name of every term of a posterior."""
    for experiment in posterior.experiments:
        for term, name in zip(experiment.terms, experiment.term_names, strict=True):
            yield experiment, term, name


def gather_by_terms(
    posterior: LogPosterior, draws: Floats, rows: Floats
) -> dict[str, dict[str, Labelled]]:
    """Return the log-likelihood of each datum, and new measurements, by term."""
    lead = draws.shape[:-1]
    parameters = posterior.parameters(draws.reshape(-1, posterior.ndim))
    response = posterior.unfold(rows.reshape(-1, rows.shape[-1]))
    rng = np.random.default_rng(0)  # the same draws at each conversion
    names = _name_measured(posterior)
    likelihood: dict[str, Labelled] = {}
    predictive: dict[str, Labelled] = {}
    for column, (experiment, term, name) in enumerate(each_term(posterior), 2):
        label = experiment.full_name(name)
        stored = {v: response[experiment.full_name(v)] for v in experiment.variables}
        likelihood[label] = Labelled(rows[..., column], ONE_NUMBER)
        for variable, values in term.pointwise(parameters, stored).items():
            likelihood[label] = _label(experiment, term, variable, values, *lead)
        for variable, values in term.replicate(rng, parameters, stored).items():
            key = names[label, variable]
            predictive[key] = _label(experiment, term, variable, values, *lead)
    if len(likelihood) > 1:  # ArviZ takes one variable
        likelihood = {"data": _side_by_side(likelihood, len(lead))}
    return {"log_likelihood": likelihood, "new_measurement": predictive}


def _side_by_side(parts: Mapping[str, Labelled], lead: int) -> Labelled:
    """Return every number of the parts along one dimension, by labels."""
    labels = [
        f"{name}[{', '.join(map(str, place))}]" if place else name
        for name, part in parts.items()
        for place in product(*part.variable.coords.values())
    ]
    flat = [v.reshape(*v.shape[:lead], -1) for v, _ in parts.values()]
    return Labelled(np.concatenate(flat, axis=-1), Variable({"datum": labels}))


def gather_observed(posterior: LogPosterior) -> dict[str, Labelled]:
    """Return what was measured, by variable; a second time by the term's name too."""
    names = _name_measured(posterior)
    return {
        names[experiment.full_name(name), variable]: _label(
            experiment, term, variable, np.asarray(observed)[None]
        )
        for experiment, term, name in each_term(posterior)
        for variable, observed in term.observed.items()
    }


def _name_measured(posterior: LogPosterior) -> dict[tuple[str, str], str]:
    """Return names by term and variable; only the first measurement has its name."""
    names: dict[tuple[str, str], str] = {}
    for experiment, term, name in each_term(posterior):
        for variable in term.observed:
            full = experiment.full_name(variable)
            key = experiment.full_name(name), variable
            names[key] = f"{full}[{name}]" if full in names.values() else full
    return names


def _label(
    experiment: Experiment, term: Term, name: str, values: Floats, *lead: int
) -> Labelled:
    """Return what a term says with its dimensions; its first axis becomes the leading.

    Where a term knows but the places, or fewer of them, the labels are those of the
    response.
    """
    returned = experiment.variables.get(name)
    variable = (term.reads or {}).get(name) or returned or ONE_NUMBER
    shape, coords = values.shape[1:], {}
    for size, (dim, labels) in zip(shape, variable.coords.items(), strict=True):
        of_response = returned.coords.get(dim, ()) if returned else ()
        if None in labels and len(of_response) >= len(labels):
            labels = of_response
        coords[experiment.full_name(dim)] = list(labels)[:size]
    unit = variable.unit or (returned.unit if returned else "")
    return Labelled(values.reshape(*lead, *shape), Variable(coords, unit))
