"""The chains that :func:`diagnose` judges, of samplers or of an ArviZ object."""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..interfaces import Floats
from . import inference_data
from .chains import describe_runs


class JudgedChains(NamedTuple):
    """Chains and what is known about them.

    Attributes:
        names: Parameter names, ``d`` of them.
        draws: ``(steps, ensembles, walkers, d)``.
        acceptance: Fraction of accepted proposals, ``(ensembles, walkers)``, NaN where
            it is not known.
        tempered: Whether the walkers exchanged places with hotter ones.
        starts_given: Whether the starts were the user's.
        failures: Number of rejected solves by cause.
    """

    names: tuple[str, ...]
    draws: Floats
    acceptance: Floats
    tempered: bool
    starts_given: bool
    failures: Mapping[str, int]


def judged_chains(samplers: Any, discard: int) -> JudgedChains:
    """Return the chains of one or several samplers, or of an ArviZ object."""
    if hasattr(samplers, "posterior"):
        return _from_inference_data(samplers, discard)
    return _from_samplers(samplers, discard)


def _from_samplers(samplers: Any, discard: int) -> JudgedChains:
    runs = inference_data.list_runs(samplers)
    ndim = getattr(runs[0], "backend", runs[0]).shape[1]
    draws = inference_data.stack_chains(runs, "chain", discard)
    return _described(_names(runs[0], ndim), draws, describe_runs(runs))


def _from_inference_data(idata: Any, discard: int) -> JudgedChains:
    posterior = inference_data.dataset(idata, "posterior")
    names, draws = inference_data.samples(idata)
    discard = checks.whole_number("discard", discard)
    ensemble = posterior["ensemble"].values if "ensemble" in posterior.coords else []
    counts = np.unique(ensemble, return_counts=True)[1]
    if len(set(counts.tolist())) != 1:
        raise ValueError(
            "samplers: expected an ArviZ object with a coordinate 'ensemble' that "
            "occurs equally often, as to_inference_data returns it, got "
            f"{counts.tolist()} chains by ensemble"
        )
    draws = draws[:, discard:].reshape(len(counts), counts[0], -1, len(names))
    return _described(tuple(names), draws.transpose(2, 0, 1, 3), dict(posterior.attrs))


def _described(
    names: tuple[str, ...], draws: Floats, known: dict[str, Any]
) -> JudgedChains:
    """Return the chains with what :func:`describe_runs` knows of them."""
    shape = draws.shape[1:3]
    acceptance = np.array(json.loads(known.get("acceptance", "[]")))
    if acceptance.size != np.prod(shape):  # chains were selected
        acceptance = np.full(shape, np.nan)
    return JudgedChains(
        names,
        draws,
        acceptance.reshape(shape),
        tempered=bool(known.get("tempered", False)),
        starts_given=bool(known.get("starts_given", False)),
        failures=json.loads(known.get("failures", "{}")),
    )


def _names(run: Any, ndim: int) -> tuple[str, ...]:
    """Return the posterior's names, or those that emcee was given."""
    function = getattr(getattr(run, "log_prob_fn", None), "f", None)
    names = getattr(function, "names", None)
    if names is not None and len(names) == ndim:
        return tuple(names)
    result = [f"theta{i + 1}" for i in range(ndim)]
    for name, place in getattr(run, "parameter_names", {}).items():
        places = np.atleast_1d(place).tolist()
        for i in places:
            result[i] = name if len(places) == 1 else f"{name}[{places.index(i)}]"
    return tuple(result)
