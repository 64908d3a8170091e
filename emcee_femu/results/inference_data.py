"""emcee chains to ArviZ objects.

The only module that imports ArviZ, which takes seconds: it is imported where it is
used. Datasets are built once with xarray and wrapped once, so that both generations
of ArviZ see the same groups and numbers. What the variables are is read only
from the posterior's declarations.
"""

import json
from collections.abc import Hashable, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import emcee
import numpy as np

from ..interfaces import Floats, Variable
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import summarize_prior
from ..posterior.rejecting import GuardedPosterior
from ..sampling.annealing import Annealed
from .arviz_objects import wrap
from .chains import describe_runs, list_runs, stack_chains
from .dimensions import name_apart
from .population import PopulationRun
from .terms import add_by_terms, gather_observed

PRIOR_DRAWS = 1_000
LONGEST_REPR = 200  # of a move, in the attributes


def to_inference_data(
    samplers: emcee.EnsembleSampler | Sequence[emcee.EnsembleSampler] | Annealed,
    posterior: LogPosterior,
    discard: int = 0,
    thin: int = 1,
) -> Any:
    """Convert runs of one posterior to an ArviZ object, with every walker as a chain.

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

    Args:
        samplers: What :func:`run` returned, or any EnsembleSampler of the posterior; or
            what :func:`anneal` returned, whose members are then one chain.
        posterior: The sampled posterior.
        discard: Stored steps to drop as burn-in.
        thin: Keep every ``thin``-th stored step.

    Returns:
        ``arviz.InferenceData`` (ArviZ < 1) or ``xarray.DataTree`` (ArviZ >= 1).

    Raises:
        TypeError: If discard or thin is not a whole number, or posterior is no
            LogPosterior.
        ValueError: If nothing is left, or a chain is not of this posterior.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> samplers = ef.run(posterior, nwalkers=20, nsteps=100, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=50)
        >>> dict(idata["posterior"]["k1"].sizes)
        {'chain': 20, 'draw': 50}
    """
    if not isinstance(posterior, LogPosterior):
        raise TypeError(
            f"posterior: expected a LogPosterior, got {type(posterior).__name__}; for "
            "another log-probability use arviz.from_emcee(sampler, var_names=...)"
        )
    if isinstance(samplers, Annealed):
        runs: list[Any] = [PopulationRun(samplers, discard, thin)]
    else:
        runs = list_runs(samplers)
    chain = stack_chains(runs, "chain", discard, thin)  # (draws, ensembles, walkers, d)
    log_prob = stack_chains(runs, "log_prob", discard, thin)
    blobs = stack_chains(runs, "blobs", discard, thin)
    width = len(posterior.rejected()) - 1  # emcee takes the first one as log_prob
    if chain.shape[-1] != posterior.ndim or blobs.shape[3:] != (width,):
        raise ValueError(
            f"samplers: chains of {chain.shape[-1]} parameters with blobs of shape "
            f"{blobs.shape[3:]} are not of this posterior, which has "
            f"{posterior.ndim} and ({width},)"
        )
    rows = np.concatenate([log_prob[..., None], blobs], axis=-1)
    del blobs
    response = posterior.unfold(rows)
    values: dict[str, dict[str, Floats]] = {
        "posterior": dict(zip(posterior.names, np.moveaxis(chain, -1, 0), strict=True)),
        "sample_stats": {"lp": log_prob, "log_prior": rows[..., 1]},
        "log_prior": _log_prior_by_parameter(posterior, chain),
        "log_likelihood": {
            name: rows[..., i] for i, name in enumerate(posterior.term_names, 2)
        },
        "response": response,
        "posterior_predictive": {},
    }
    variables = {group: dict(posterior.variables) for group in values}
    add_by_terms(posterior, values, variables)
    attributes = _attributes(discard, thin)
    datasets = {
        group: _to_dataset(own, variables[group], discard, thin, attributes)
        for group, own in values.items()
        if own
    }
    datasets["posterior"].attrs |= _run_attributes(runs, posterior)
    return wrap(datasets | _fixed_groups(posterior, attributes))


def _log_prior_by_parameter(posterior: LogPosterior, chain: Floats) -> dict[str, Any]:
    logpdfs = getattr(posterior.prior, "logpdfs", None)
    if logpdfs is None:
        return {}
    own = logpdfs(chain.reshape(-1, chain.shape[-1])).reshape(chain.shape)
    return dict(zip(posterior.names, np.moveaxis(own, -1, 0), strict=True))


def _to_dataset(
    values: Mapping[str, Floats],
    declared: Mapping[str, Variable],
    discard: int,
    thin: int,
    attributes: dict[str, Any],
) -> Any:
    """Return samples ``(draws, ensembles, walkers, ...)`` as an xarray Dataset."""
    import xarray

    n_draws, n_ensembles, n_walkers = next(iter(values.values())).shape[:3]
    apart = name_apart(
        {name: declared[name].coords for name, v in values.items() if v.ndim > 3}
    )
    variables = {}
    for name, value in values.items():
        chains = np.moveaxis(value, 0, 2)  # to (chain, draw, ...)
        chains = chains.reshape(n_ensembles * n_walkers, n_draws, *value.shape[3:])
        variables[name] = (("chain", "draw", *apart.get(name, {})), chains)
    coordinates: dict[Hashable, Any] = {
        "chain": np.arange(n_ensembles * n_walkers),
        "draw": np.arange(n_draws),
        "step": ("draw", discard + thin * (1 + np.arange(n_draws)) - 1),
        "ensemble": ("chain", np.repeat(np.arange(n_ensembles), n_walkers)),
        "walker": ("chain", np.tile(np.arange(n_walkers), n_ensembles)),
    }
    coordinates |= {dim: v for own in apart.values() for dim, v in own.items()}
    return xarray.Dataset(
        variables, coordinates, {**attributes, "sample_dims": ["chain", "draw"]}
    )


def _fixed_groups(
    posterior: LogPosterior, attributes: dict[str, Any]
) -> dict[str, Any]:
    """Return prior draws, what was measured, and constants."""
    import xarray

    mean, sd = summarize_prior(posterior.prior)
    # A Gaussian prior starts at its own mean, wherever its bounds cut it.
    initial = np.asarray(getattr(posterior.prior, "mean", mean), dtype=float)
    row = GuardedPosterior(posterior)(initial)
    row = row if isinstance(row, np.ndarray) else posterior.rejected()
    by_parameter = {
        "lower": posterior.prior.bounds[:, 0],
        "upper": posterior.prior.bounds[:, 1],
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
        labels |= {dim: list(own) for dim, own in variable.coords.items()}
    draws = posterior.prior.sample(np.random.default_rng(0), PRIOR_DRAWS)
    prior = {
        name: (("chain", "draw"), column[None])
        for name, column in zip(posterior.names, draws.T, strict=True)
    }
    groups = {
        "prior": xarray.Dataset(
            prior,
            {"chain": [0], "draw": np.arange(PRIOR_DRAWS)},
            {**attributes, "sample_dims": ["chain", "draw"]},
        ),
        "constant_data": xarray.Dataset(constants, labels, attributes),
    }
    observed, variables = gather_observed(posterior)
    apart = name_apart({name: v.coords for name, v in variables.items()})
    if observed:
        measured = {
            name: (tuple(apart[name]), value, {"unit": variables[name].unit})
            for name, value in observed.items()
        }
        places = {dim: v for own in apart.values() for dim, v in own.items()}
        groups["observed_data"] = xarray.Dataset(measured, places, attributes)
    return groups


def _attributes(discard: int, thin: int) -> dict[str, Any]:
    return {
        "discard": discard,
        "thin": thin,
        "inference_library": "emcee",
        "inference_library_version": emcee.__version__,
        "emcee_femu_version": version("emcee-femu"),
        "numpy_version": np.__version__,
    }


def _run_attributes(runs: list[Any], posterior: LogPosterior) -> dict[str, Any]:
    moves = getattr(runs[0], "_moves", ())  # emcee keeps them nowhere else
    weights = getattr(runs[0], "_weights", ())
    described = []
    for weight, move in zip(weights, moves, strict=True):
        text = repr(move)
        if len(text) > LONGEST_REPR:  # of a fitted mixture, all its numbers
            text = f"{type(move).__name__}(...)"
        described.append(f"{weight:g} x {text}")
    return {
        **describe_runs(runs),
        "moves": "; ".join(described) or "unknown (read from a backend)",
        "seed": str(getattr(runs[0], "seed", "unknown (not started by run)")),
        "burn_in": getattr(getattr(runs[0], "recipe", None), "sentence", ""),
        "recipe": json.dumps(getattr(getattr(runs[0], "recipe", None), "record", None)),
        "sampled": list(posterior.names),
    }
