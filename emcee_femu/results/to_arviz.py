"""Chains to ArviZ objects.

``arviz.from_emcee`` writes sampler arguments of any type into ``observed_data`` and
cannot read structured blobs, so the groups are built here.
"""

import json
from collections.abc import Hashable, Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import Any, NamedTuple

import emcee
import numpy as np

from .. import checks
from ..evaluation.evaluator import Solver
from ..interfaces import Floats, Variable
from ..likelihoods.term import Term
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import (
    GaussianPrior,
    IndependentPrior,
    prior_centre,
    summarize_prior,
)
from .arviz_objects import Dataset, InferenceData, is_arviz, samples, wrap
from .chains import Chains, read_chains

PRIOR_DRAWS = 1_000


class Labelled(NamedTuple):
    """An array, and what its axes after those of the samples are."""

    values: Floats
    variable: Variable


NUMBER = Variable({})


def to_inference_data(
    source: object,
    posterior: LogPosterior | None = None,
    discard: int = 0,
    thin: int = 1,
) -> InferenceData:
    """Convert runs of one posterior to an ArviZ object, with every walker as a chain.

    Tables, figures and :func:`identifiability` do so themselves where they are given a
    run; converted once it can be given to all of them, without its burn-in.

    ============================ ====================================================
    group                        holds
    ============================ ====================================================
    ``posterior``                the parameters by name; ``attrs["sampled"]`` lists
                                 them, so that derived quantities can be added
    ``sample_stats``             lp, log_prior
    ``log_prior``                of each parameter, where the prior knows it (its
                                 ``logpdfs``)
    ``log_likelihood``           by term: each datum's where it factorises (for
                                 ``arviz.loo``), else the whole term's
    ``response``                 the model's stored variables, without measurement
                                 noise
    ``posterior_predictive``     a new measurement for each sample, noise included,
                                 where a term can draw one (``arviz.plot_ppc``)
    ``prior``                    1,000 draws of the prior
    ``observed_data``            what was measured, by the name of the variable; a
                                 second measurement as ``frequency[term]``
    ``constant_data``            lower and upper bounds; prior_mean and prior_sd inside
                                 them; ``initial``, a Gaussian prior's own mean or else
                                 the prior mean; ``initial_<variable>``, the response
                                 there, NaN where it cannot be solved; is_error, whether
                                 only terms read the parameter (noise, discrepancy)
    ============================ ====================================================

    Walkers of one ensemble are not independent chains: the coordinate ``ensemble`` says
    which belong together. Draws count from 0; the coordinate ``step`` is the stored
    step. For tempered runs only the cold walkers are converted. At its peak the
    conversion needs some four times the memory of the chains and blobs that are kept.
    Of chains whose posterior is not known, as of another log-probability, there are
    the groups ``posterior`` and ``sample_stats`` only. With several terms ``arviz.loo``
    wants the name of one (``var_name=``); ``arviz.plot_ppc`` draws every sample unless
    told how many (``num_pp_samples=``), which takes minutes.

    Args:
        source: What :func:`run` returned, any EnsembleSampler of the posterior, a
            backend or the name of a run's file; or what :func:`anneal` returned, whose
            members are then one chain. An ArviZ object is returned as it is.
        posterior: The sampled posterior, where the source does not know it.
        discard: Stored steps to drop as burn-in.
        thin: Keep every ``thin``-th stored step.

    Returns:
        ``arviz.InferenceData`` (ArviZ < 1) or ``xarray.DataTree`` (ArviZ >= 1).

    Raises:
        TypeError: If discard or thin is not a whole number, or posterior no
            LogPosterior.
        ValueError: If nothing is left, or a chain is not of this posterior.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> idata = ef.to_inference_data(run, discard=50)
        >>> dict(idata["posterior"]["k1"].sizes)
        {'chain': 20, 'draw': 50}
    """
    return read_samples(source, posterior, discard, thin, "source")[0]


def read_samples(
    source: object,
    posterior: LogPosterior | None = None,
    discard: int = 0,
    thin: int = 1,
    argument: str = "idata",
) -> tuple[InferenceData, LogPosterior | None]:
    """Return the ArviZ object of whatever holds samples, and what was sampled if known.

    Tables and figures read nothing else.
    """
    if not is_arviz(source):
        chains = read_chains(
            source, posterior, discard, thin, blobs=True, argument=argument
        )
        return convert(chains, discard, thin), chains.posterior
    if (discard, thin) != (0, 1):
        raise ValueError(
            "discard, thin: expected 0 and 1 for an ArviZ object, got "
            f"{discard} and {thin}; select its draws by isel(draw=...)"
        )
    if posterior is not None:
        check_sampled(posterior, samples(source)[0])
    return source, posterior


def check_sampled(posterior: LogPosterior, names: Sequence[str]) -> None:
    """Refuse what is not the posterior that was sampled, by its parameters."""
    checks.instance("posterior", posterior, LogPosterior)
    if posterior.names != tuple(names):
        raise ValueError(
            f"posterior: expected the sampled one, with the parameters {list(names)}, "
            f"got {list(posterior.names)}"
        )


def convert(chains: Chains, discard: int = 0, thin: int = 1) -> InferenceData:
    """Return the ArviZ object of chains."""
    draws, posterior = chains.draws, chains.posterior
    by_parameter = zip(chains.names, np.moveaxis(draws, -1, 0), strict=True)
    groups: dict[str, dict[str, Labelled]] = {
        "posterior": {name: Labelled(v, NUMBER) for name, v in by_parameter},
        "sample_stats": {"lp": Labelled(chains.log_prob, NUMBER)},
    }
    attributes = {
        "discard": discard,
        "thin": thin,
        "inference_library": "emcee",
        "inference_library_version": emcee.__version__,
        "emcee_femu_version": version("emcee-femu"),
        "numpy_version": np.__version__,
    }
    fixed: dict[str, Dataset] = {}
    if posterior is not None:
        rows = _rows(chains, posterior)
        groups["sample_stats"]["log_prior"] = Labelled(rows[..., 1], NUMBER)
        groups["log_prior"] = _log_prior_by_parameter(posterior, draws)
        groups["response"] = {
            name: Labelled(value, posterior.variables[name])
            for name, value in posterior.unfold(rows).items()
        }
        groups |= _by_terms(posterior, draws, rows)
        fixed = _fixed_groups(posterior, attributes)
    datasets = {
        name: _sampled_dataset(group, discard, thin, attributes)
        for name, group in groups.items()
        if group
    }
    datasets["posterior"].attrs |= _attributes_of(chains)
    return wrap(datasets | fixed)


def _rows(chains: Chains, posterior: LogPosterior) -> Floats:
    """Return what the posterior returned, ``(steps, ensembles, walkers, columns)``."""
    blobs, d = chains.blobs, chains.draws.shape[-1]
    width = len(posterior.rejected()) - 1  # emcee takes the first one as log_prob
    if blobs is None or d != posterior.ndim or blobs.shape[3:] != (width,):
        shape = None if blobs is None else blobs.shape[3:]
        raise ValueError(
            f"source: chains of {d} parameters with blobs of shape {shape} are not "
            f"of this posterior, which has {posterior.ndim} and ({width},)"
        )
    return np.concatenate([chains.log_prob[..., None], blobs], axis=-1)


def _attributes_of(chains: Chains) -> dict[str, Any]:
    """Return what chains know of themselves, as attributes that netCDF can hold."""
    search = None if chains.search is None else chains.search.to_json()
    return {
        "sampled": list(chains.names),
        "acceptance": json.dumps(chains.acceptance.ravel().tolist()),
        "search": json.dumps(search),
        "betas": json.dumps(chains.betas.tolist()),
        "kind": chains.kind,
        "moves": chains.moves,
        "seed": chains.seed,
        "origin": chains.origin,
        "failures": json.dumps(dict(chains.failures)),
        "starts_given": int(chains.starts_given),
    }


def _log_prior_by_parameter(
    posterior: LogPosterior, draws: Floats
) -> dict[str, Labelled]:
    prior = posterior.prior
    if not isinstance(prior, GaussianPrior | IndependentPrior):
        return {}
    densities = prior.logpdfs(draws.reshape(-1, draws.shape[-1])).reshape(draws.shape)
    pairs = zip(posterior.names, np.moveaxis(densities, -1, 0), strict=True)
    return {name: Labelled(density, NUMBER) for name, density in pairs}


def _by_terms(
    posterior: LogPosterior, draws: Floats, rows: Floats
) -> dict[str, dict[str, Labelled]]:
    """Return the log-likelihood of each datum, and new measurements, by term."""
    lead = draws.shape[:-1]
    parameters = posterior.parameters(draws.reshape(-1, posterior.ndim))
    response = posterior.unfold(rows.reshape(-1, rows.shape[-1]))
    rng = np.random.default_rng(0)  # the same draws at each conversion
    likelihood: dict[str, Labelled] = {}
    predictive: dict[str, Labelled] = {}
    column = 2
    for experiment in posterior.experiments:
        stored = {
            name: response[experiment.full_name(name)] for name in experiment.variables
        }
        for term, name in zip(experiment.terms, experiment.term_names, strict=True):
            label = experiment.full_name(name)
            data = term.pointwise(parameters, stored)
            for variable, values in data.items():
                key = f"{label}[{variable}]" if len(data) > 1 else label
                array = values.reshape(*lead, *values.shape[1:])
                likelihood[key] = _label(experiment, term, variable, array, len(lead))
            if not data:
                likelihood[label] = Labelled(rows[..., column], NUMBER)
            for variable, values in term.replicate(rng, parameters, stored).items():
                key = _name_measured(experiment, name, variable, predictive)
                array = values.reshape(*lead, *values.shape[1:])
                predictive[key] = _label(experiment, term, variable, array, len(lead))
            column += 1
    return {"log_likelihood": likelihood, "posterior_predictive": predictive}


def _observed(posterior: LogPosterior) -> dict[str, Labelled]:
    """Return what was measured, by variable; a second time by the term's name too."""
    measured: dict[str, Labelled] = {}
    for experiment in posterior.experiments:
        for term, name in zip(experiment.terms, experiment.term_names, strict=True):
            for variable, values in term.observed.items():
                key = _name_measured(experiment, name, variable, measured)
                measured[key] = _label(experiment, term, variable, np.asarray(values))
    return measured


def _name_measured(
    experiment: Experiment, name: str, variable: str, taken: Mapping[str, Labelled]
) -> str:
    """Return a measured variable's label; only the first measurement has its name."""
    pairs = zip(experiment.terms, experiment.term_names, strict=True)
    measured_by = [other for term, other in pairs if variable in term.observed]
    label = experiment.full_name(variable)
    first = name in (measured_by[:1] or [name]) and label not in taken
    return label if first else f"{label}[{name}]"


def _label(
    experiment: Experiment, term: Term, name: str, values: Floats, lead: int = 0
) -> Labelled:
    """Return what a term says with its dimensions, after ``lead`` axes of samples.

    Where a term knows but the places, or fewer of them, the labels are those of the
    response.
    """
    returned = experiment.variables.get(name)
    variable = (term.reads or {}).get(name) or returned or NUMBER
    coords = {}
    for size, (dim, labels) in zip(
        values.shape[lead:], variable.coords.items(), strict=True
    ):
        known = returned.coords.get(dim, ()) if returned else ()
        places = None in labels and len(known) >= len(labels)
        coords[experiment.full_name(dim)] = list(known if places else labels)[:size]
    unit = variable.unit or (returned.unit if returned else "")
    return Labelled(values, Variable(coords, unit))


def _sampled_dataset(
    group: Mapping[str, Labelled],
    discard: int,
    thin: int,
    attributes: Mapping[str, object],
) -> Dataset:
    """Return samples ``(draws, ensembles, walkers, ...)`` as an xarray Dataset."""
    import xarray

    n_draws, n_ensembles, n_walkers = next(iter(group.values())).values.shape[:3]
    apart = name_apart({name: part.variable.coords for name, part in group.items()})
    variables = {}
    for name, (values, _) in group.items():
        chains = np.moveaxis(values, 0, 2)  # to (chain, draw, ...)
        chains = chains.reshape(n_ensembles * n_walkers, n_draws, *values.shape[3:])
        variables[name] = (("chain", "draw", *apart[name]), chains)
    coordinates: dict[Hashable, Any] = {
        "chain": np.arange(n_ensembles * n_walkers),
        "draw": np.arange(n_draws),
        "step": ("draw", discard + thin * (1 + np.arange(n_draws)) - 1),
        "ensemble": ("chain", np.repeat(np.arange(n_ensembles), n_walkers)),
        "walker": ("chain", np.tile(np.arange(n_walkers), n_ensembles)),
    }
    coordinates |= {dim: v for dims in apart.values() for dim, v in dims.items()}
    return xarray.Dataset(
        variables, coordinates, {**attributes, "sample_dims": ["chain", "draw"]}
    )


def _fixed_groups(
    posterior: LogPosterior, attributes: Mapping[str, object]
) -> dict[str, Dataset]:
    """Return prior draws, what was measured, and constants."""
    import xarray

    prior = posterior.prior
    mean, sd = summarize_prior(prior)
    initial = prior_centre(prior)
    row = Solver(posterior, reject=True)(("rows", initial))
    row = row if isinstance(row, np.ndarray) else posterior.rejected()
    by_parameter = {
        "lower": prior.bounds[:, 0],
        "upper": prior.bounds[:, 1],
        "initial": initial,
        "prior_mean": mean,
        "prior_sd": sd,
        "is_error": np.isin(posterior.names, posterior.error_names),
    }
    constants: dict[str, Any] = {
        name: ("parameter", value) for name, value in by_parameter.items()
    }
    labels: dict[str, Any] = {"parameter": list(posterior.names)}
    for name, value in posterior.unfold(row).items():
        variable = posterior.variables[name]
        constants[f"initial_{name}"] = (variable.dims, value, {"unit": variable.unit})
        labels |= {dim: list(places) for dim, places in variable.coords.items()}
    draws = prior.sample(np.random.default_rng(0), PRIOR_DRAWS)
    pairs = zip(posterior.names, draws.T, strict=True)
    groups = {
        "prior": xarray.Dataset(
            {name: (("chain", "draw"), column[None]) for name, column in pairs},
            {"chain": [0], "draw": np.arange(PRIOR_DRAWS)},
            {**attributes, "sample_dims": ["chain", "draw"]},
        ),
        "constant_data": xarray.Dataset(constants, labels, attributes),
    }
    if observed := _observed(posterior):
        apart = name_apart({name: v.variable.coords for name, v in observed.items()})
        measured = {
            name: (tuple(apart[name]), values, {"unit": variable.unit})
            for name, (values, variable) in observed.items()
        }
        places = {dim: v for dims in apart.values() for dim, v in dims.items()}
        groups["observed_data"] = xarray.Dataset(measured, places, attributes)
    return groups


def name_apart(
    coords: Mapping[str, Mapping[str, Sequence[Any]]],
) -> dict[str, dict[str, list[Any]]]:
    """Return ``{variable: {dimension: labels}}`` with one meaning per dimension.

    Of dimensions that differ in their labels the longest keeps its name; xarray would
    fill up the others with NaN.
    """
    taken: dict[str, list[Any]] = {}
    renamed = {}
    triples = [
        (name, dim, list(labels))
        for name, dims in coords.items()
        for dim, labels in dims.items()
    ]
    for name, dim, labels in sorted(triples, key=lambda triple: -len(triple[2])):
        suffix = name.removeprefix(f"{dim.rpartition('.')[0]}.")  # the experiment's
        if name.endswith("]"):
            suffix = name[:-1].partition("[")[2]
        for free in (dim, f"{dim}[{suffix}]", f"{dim}[{name}]"):
            if taken.setdefault(free, labels) == labels:
                renamed[name, dim] = free
                break
    return {
        name: {renamed[name, dim]: list(labels) for dim, labels in dims.items()}
        for name, dims in coords.items()
    }


def original_name(name: str, known: Iterable[Any]) -> str:
    """Return which of the ``known`` names a name is, or is with brackets; else it."""
    candidates = [str(k) for k in known if f"{name}[".startswith(f"{k}[")]
    return max(candidates, key=len, default=name)
