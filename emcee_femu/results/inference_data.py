"""emcee chains to ArviZ: InferenceData before ArviZ 1, xarray's DataTree since.

The only module that imports ArviZ, which takes seconds: it is imported where it is
used. Datasets are built once with xarray and wrapped once, so that both generations
of ArviZ see the same groups and numbers.
"""

from collections.abc import Hashable, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import emcee
import numpy as np

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import prior_summary
from .chains import as_list as as_list
from .chains import cold as cold
from .chains import stacked as stacked

GROUPS = (
    "posterior",
    "sample_stats",
    "log_likelihood",
    "posterior_predictive",
    "observed_data",
    "constant_data",
)


def to_inference_data(
    samplers: emcee.EnsembleSampler | Sequence[emcee.EnsembleSampler],
    posterior: LogPosterior,
    discard: int = 0,
    thin: int = 1,
) -> Any:
    """Convert runs of one posterior to an ArviZ object, every walker a chain.

    Groups: ``posterior`` by parameter name; ``sample_stats`` (lp, log_prior);
    ``log_likelihood`` by term; ``posterior_predictive`` (frequency, by mode, the
    model's prediction without measurement noise; where modes are paired also mac and
    model_mode); ``observed_data``;
    ``constant_data`` (bounds, ``initial`` parameters and the frequencies there, mean
    and sd of the prior inside the bounds). Walkers of one ensemble are not independent
    chains: the coordinate ``ensemble`` says which belong together. Of tempered runs the
    cold walkers alone are converted.

    At its peak the conversion needs twice the memory of what it returns, which is
    ``8 * (ndim + 1 + blobs)`` bytes a walker and draw, and before that some 4 MB a
    parameter for the prior's summary. Of a file only the draws that are kept are read,
    one ensemble after the other. Where the system tells how much memory is available
    (Linux does), too large a conversion is refused before anything is read.

    Args:
        samplers: What :func:`run` returned, or any EnsembleSampler of the posterior.
        posterior: The sampled posterior.
        discard: Stored steps to drop as burn-in.
        thin: Keep every ``thin``-th stored step.

    Returns:
        ``arviz.InferenceData`` (ArviZ < 1) or ``xarray.DataTree`` (ArviZ >= 1).

    Raises:
        TypeError: If discard or thin is not a whole number.
        ValueError: If nothing is left, or a chain is not of this posterior.
    """
    runs = as_list(samplers)
    columns = posterior.columns
    width = columns["model_mode"].stop - 1  # emcee takes the first one as log_prob
    attributes = _attributes(runs, discard, thin)
    # Before the chains are read: the draws of the prior take memory for a moment.
    fixed = {
        "observed_data": _observed(posterior, attributes),
        "constant_data": _constants(posterior, attributes),
    }
    chain = stacked(runs, "chain", discard, thin)  # (draws, ensembles, walkers, d)
    log_prob = stacked(runs, "log_prob", discard, thin)
    blobs = stacked(runs, "blobs", discard, thin)
    if chain.shape[-1] != posterior.ndim or blobs.shape[3:] != (width,):
        raise ValueError(
            f"samplers: chains of {chain.shape[-1]} parameters with blobs of shape "
            f"{blobs.shape[3:]} are not of this posterior, which has "
            f"{posterior.ndim} and ({width},)"
        )
    predictions = {
        label: blobs[..., where.start - 1 : where.stop - 1]
        for label, where in columns.items()
        if label != "densities" and where.stop > where.start
    }
    by_chain = {
        "posterior": dict(zip(posterior.names, np.moveaxis(chain, -1, 0), strict=True)),
        "sample_stats": {"lp": log_prob, "log_prior": blobs[..., 0]},
        "log_likelihood": {
            name: blobs[..., 1 + i] for i, name in enumerate(posterior.term_names)
        },
        "posterior_predictive": predictions,
    }
    datasets = {
        group: _sample_dataset(values, discard, thin, attributes)
        for group, values in by_chain.items()
    }
    return wrapped({**datasets, **fixed})


def _sample_dataset(
    values: Mapping[str, Floats], discard: int, thin: int, attributes: dict[str, Any]
) -> Any:
    import xarray

    n_draws, n_ensembles, n_walkers = next(iter(values.values())).shape[:3]
    variables = {}
    for name, value in values.items():
        # (draws, ensembles, walkers, ...) -> (chain, draw, ...)
        chains = np.moveaxis(value, 0, 2)
        chains = chains.reshape(n_ensembles * n_walkers, n_draws, *value.shape[3:])
        variables[name] = (("chain", "draw", "mode")[: chains.ndim], chains)
    coordinates: dict[Hashable, Any] = {
        "chain": np.arange(n_ensembles * n_walkers),
        "draw": discard + thin * (1 + np.arange(n_draws)) - 1,
        "ensemble": ("chain", np.repeat(np.arange(n_ensembles), n_walkers)),
        "walker": ("chain", np.tile(np.arange(n_walkers), n_ensembles)),
    }
    modes = [v.shape[2] for _, v in variables.values() if v.ndim == 3]
    if modes:
        coordinates["mode"] = np.arange(1, modes[0] + 1)
    return xarray.Dataset(
        variables, coordinates, {**attributes, "sample_dims": ["chain", "draw"]}
    )


def _observed(posterior: LogPosterior, attributes: dict[str, Any]) -> Any:
    import xarray

    measured = {
        name: np.asarray(term.measured)
        for name, term in zip(posterior.term_names, posterior.terms, strict=True)
        if hasattr(term, "measured")
    }
    measured = {name: value for name, value in measured.items() if value.ndim == 1}
    length = max(map(len, measured.values()), default=0)
    padded = {
        name: ("mode", np.append(value, np.full(length - len(value), np.nan)))
        for name, value in measured.items()
    }
    return xarray.Dataset(padded, {"mode": np.arange(1, length + 1)}, attributes)


def _constants(posterior: LogPosterior, attributes: dict[str, Any]) -> Any:
    import xarray

    mean, sd = prior_summary(posterior.prior)
    # A Gaussian prior starts at its own mean, wherever its bounds cut it.
    initial = np.asarray(getattr(posterior.prior, "mean", mean), dtype=float)
    frequencies = posterior(initial)[posterior.columns["frequency"]]
    return xarray.Dataset(
        {
            "lower": ("parameter", posterior.prior.bounds[:, 0]),
            "upper": ("parameter", posterior.prior.bounds[:, 1]),
            "initial": ("parameter", initial),
            "prior_mean": ("parameter", mean),
            "prior_sd": ("parameter", sd),
            "initial_frequency": ("mode", frequencies),
        },
        {
            "parameter": list(posterior.names),
            "mode": np.arange(1, posterior.n_modes + 1),
        },
        attributes,
    )


def _attributes(runs: list[Any], discard: int, thin: int) -> dict[str, Any]:
    moves = getattr(runs[0], "_moves", ())  # emcee keeps them nowhere else
    weights = getattr(runs[0], "_weights", ())
    return {
        "moves": "; ".join(
            f"{weight:g} x {move!r}"
            for move, weight in zip(moves, weights, strict=True)
        )
        or "unknown (read from a backend)",
        "seed": str(getattr(runs[0], "seed", "unknown (not started by run)")),
        "recipe": str(getattr(runs[0], "recipe", "")),
        "discard": discard,
        "thin": thin,
        "inference_library": "emcee",
        "inference_library_version": emcee.__version__,
        "emcee_femu_version": version("emcee-femu"),
        "numpy_version": np.__version__,
    }


def wrapped(datasets: Mapping[str, Any]) -> Any:
    """Return xarray Datasets as the installed ArviZ's own container."""
    import arviz
    import xarray

    if int(arviz.__version__.split(".")[0]) < 1:
        return arviz.InferenceData(**datasets)
    return xarray.DataTree.from_dict(dict(datasets))


def dataset(idata: Any, group: str) -> Any:
    """Return a group as an xarray Dataset, whatever ArviZ made of it.

    Raises:
        TypeError: If idata is not what :func:`to_inference_data` returns.
        ValueError: If it lacks the group.
    """
    if not hasattr(idata, "children") and not hasattr(idata, "groups"):
        raise TypeError(
            "idata: expected what to_inference_data returns, got "
            f"{type(idata).__name__}"
        )
    try:
        found = idata[group]
    except KeyError:
        raise ValueError(f"idata: it has no group {group!r}") from None
    return found.to_dataset() if hasattr(found, "to_dataset") else found


def samples(idata: Any) -> tuple[list[str], Floats]:
    """Return parameter names and draws ``(chains, draws, d)`` of the posterior."""
    posterior = dataset(idata, "posterior")
    names = [str(name) for name in posterior.data_vars]
    ordered = [posterior[name].transpose("chain", "draw").values for name in names]
    return names, np.stack(ordered, axis=-1)


def rhat(chains: Floats) -> Floats:
    """Return the rank-normalised split R-hat of ``chains (m, n, d)``, ``(d,)``."""
    import arviz

    return _by_parameter(arviz.rhat, chains)


def effective_sizes(chains: Floats) -> tuple[Floats, Floats]:
    """Return bulk and tail (5 %, 95 %) ESS of ``chains (m, n, d)``, each ``(d,)``."""
    import arviz

    bulk = _by_parameter(arviz.ess, chains, method="bulk")
    # The quantiles are named because their default differs between ArviZ 0.x and 1.x.
    tail = _by_parameter(arviz.ess, chains, method="tail", prob=(0.05, 0.95))
    return bulk, tail


def _by_parameter(statistic: Any, chains: Floats, **options: Any) -> Floats:
    import xarray

    data = {
        f"p{i}": (("chain", "draw"), chains[:, :, i]) for i in range(chains.shape[2])
    }
    # Walkers that never move make ArviZ divide by zero; diagnose names them.
    with np.errstate(divide="ignore", invalid="ignore"):
        result = statistic(
            xarray.Dataset(data, attrs={"sample_dims": ["chain", "draw"]}), **options
        )
    return np.array([float(result[f"p{i}"]) for i in range(chains.shape[2])])
