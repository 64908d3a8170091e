"""The chains that :func:`diagnose` judges, of samplers or of an ArviZ object."""

import json
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Floats
from .arviz_objects import dataset, is_weighted, samples
from .chains import describe_runs, list_runs, stack_chains


def judged_chains(samplers: Any, discard: int) -> tuple[list[str], Floats, Any]:
    """Return names, ``draws (steps, ensembles, walkers, d)``, and what is known."""
    if not hasattr(samplers, "posterior"):
        runs = list_runs(samplers)
        draws = stack_chains(runs, "chain", discard)
        return _names(runs[0], draws.shape[-1]), draws, describe_runs(runs)
    names, chains = samples(samplers)
    posterior = dataset(samplers, "posterior")
    if is_weighted(samplers):
        raise ValueError(
            "samplers: expected chains, got the weighted draws of a certificate; print "
            "the certificate, and diagnose the chain of the emulated posterior"
        )
    if posterior.attrs.get("population"):
        raise ValueError(
            "samplers: expected chains, got an annealed population, which has no "
            "convergence to judge; run it again with other seeds and compare"
        )
    ensemble = posterior["ensemble"].values if "ensemble" in posterior.coords else []
    counts = np.unique(ensemble, return_counts=True)[1]
    if len(set(counts.tolist())) != 1:
        raise ValueError(
            "samplers: expected an ArviZ object with a coordinate 'ensemble' that "
            "occurs equally often, as to_inference_data returns it, got "
            f"{counts.tolist()} chains by ensemble"
        )
    kept = chains[:, checks.whole_number("discard", discard) :]
    draws = kept.reshape(len(counts), counts[0], -1, len(names))
    return names, draws.transpose(2, 0, 1, 3), posterior.attrs


def acceptance(known: Any, shape: tuple[int, ...]) -> Floats:
    """Return the acceptance of every walker, NaN where it is not known."""
    fractions = np.array(json.loads(known.get("acceptance", "[]")))
    if fractions.size != np.prod(shape):  # chains were selected
        return np.full(shape, np.nan)
    return fractions.reshape(shape)


def _names(run: Any, ndim: int) -> list[str]:
    """Return the posterior's names, or those that emcee was given."""
    function = getattr(getattr(run, "log_prob_fn", None), "f", None)
    names = getattr(function, "names", None)
    if names is not None and len(names) == ndim:
        return list(names)
    result = [f"theta{i + 1}" for i in range(ndim)]
    for name, place in getattr(run, "parameter_names", {}).items():
        places = np.atleast_1d(place).tolist()
        for i in places:
            result[i] = name if len(places) == 1 else f"{name}[{places.index(i)}]"
    return result
