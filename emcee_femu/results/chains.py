"""Chains as one record, wherever they are: runs, samplers, backends, files, ArviZ.

Its autocorrelation times, by which all judgements count, are computed here too.
"""

import json
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial

import emcee
import numpy as np
from emcee.backends import Backend

from .. import checks
from ..contracts import Move, read_declared
from ..evaluation.ensemble import describe_moves, moves_of
from ..evaluation.pools import unwrap
from ..evaluation.resume import LOG_BOX
from ..evaluation.store import Store, StoredChain
from ..moves.proposing import ladder_of
from ..posterior.log_posterior import LogPosterior
from ..sampling.record import Run, burn_in_of, read_backends
from ..search.record import Chains, SearchRecord
from .arviz_objects import InferenceData, dataset, is_arviz, samples, samples_of

# Attributes of ArviZ objects that say which steps were left out, and their defaults.
HDF5 = b"\x89HDF"  # with which such a file begins
STEPS_LEFT_OUT = {"discard": 0, "thin": 1}
# Other attributes, which are texts.
TOLD = "kind", "moves", "seed", "origin", "stopped"
# Other attributes, which are stored as JSON.
STORED = (
    "acceptance betas doubts failures log_box plain search solves starts_given"
).split()


def read_chains(
    source: object,
    posterior: LogPosterior | None = None,
    discard: int | None = None,
    thin: int = 1,
    *,
    blobs: bool = False,
    hot: bool = False,
    argument: str = "source",
) -> Chains:
    """Return the chains of any source that holds some.

    Ensembles of different lengths, as in the file of an unfinished run, are cut
    to the shortest.

    Args:
        source: What :func:`run` or :func:`anneal` returned; emcee samplers or backends,
            one or several; the name of a run's file; an ArviZ object, or a result that
            holds one.
        posterior: What was sampled, where the source does not know it.
        discard: Stored steps to drop as burn-in. None for those of a run, in memory or
            in a file, and for none of other sources.
        thin: Keep every ``thin``-th stored step; of an ArviZ object all are kept.
        blobs: Whether to read them too.
        hot: Whether to keep the hot walkers of a tempered run.
        argument: What the user calls the source.

    Raises:
        TypeError: If source is none of these.
        ValueError: If no steps are left.
    """
    if discard is not None:
        discard = checks.whole_number("discard", discard)
    thin = checks.whole_number("thin", thin, 1)
    if posterior is not None:
        checks.instance("posterior", posterior, LogPosterior)
    source = samples_of(source)
    if (as_chains := read_declared(source, "as_chains")) is not None:
        if discard or thin > 1:
            raise ValueError(
                "discard, thin: a population has no burn-in and no order to thin, "
                f"expected 0 and 1, got {discard} and {thin}"
            )
        held: Chains = as_chains()
        return replace(held, posterior=posterior)
    if is_arviz(source):
        return _of_arviz(source, posterior, discard or 0)
    read = partial(read_backends, thin=thin, blobs=blobs, hot=hot)
    if isinstance(source, str | os.PathLike):
        try:
            store = Store(os.fspath(source), read_only=True)
        except ValueError as error:
            if _is_hdf5(source):
                raise ValueError(
                    f"{argument}: {source} is an HDF5 file; give what reads it, as "
                    "emcee.backends.HDFBackend(...) or arviz.from_netcdf(...)"
                ) from None
            raise ValueError(f"{argument}: {error}") from None
        return _of_file(store, posterior, discard, read)
    samplers = checks.one_or_several(source)
    backends = [getattr(sampler, "backend", sampler) for sampler in samplers]
    if not backends or not all(isinstance(b, Backend) for b in backends):
        remedy = "; run(...) its .posterior first" if "posterior" in dir(source) else ""
        raise TypeError(
            f"{argument}: expected what run returned, emcee samplers or backends, the "
            f"name of a run's file or an ArviZ object, got {type(source).__name__}"
            + remedy
        )
    names: tuple[str, ...] = ()
    weighted = list[tuple[Move, float]]()
    if isinstance(samplers[0], emcee.EnsembleSampler):
        function = unwrap(samplers[0].log_prob_fn)
        function = getattr(function, "posterior", function)  # if it is an evaluator
        if posterior is None and isinstance(function, LogPosterior):
            posterior = function
        names, weighted = _given_names(samplers[0]), moves_of(samplers[0])
    run = source if isinstance(source, Run) else None
    if discard is None:
        discard = 0 if run is None else run.burn_in
    betas = ladder_of([move for move, _ in weighted])
    chains = read(backends, betas, discard=discard)
    d = chains.draws.shape[-1]
    if posterior is not None and posterior.ndim == d:
        names = posterior.names
    chains = replace(
        chains,
        names=names or tuple(f"theta{i + 1}" for i in range(d)),
        posterior=posterior,
        moves=describe_moves(weighted) or Chains.moves,
        plain=posterior is None,
        log_box=posterior.log_box if posterior else np.nan,
    )
    if run is None:
        return chains
    return replace(
        chains,
        search=run.search,
        seed=str(run.seed),
        origin="" if run.search is None else run.search.sentence,
        failures={} if run.failures is None else dict(run.failures.causes),
        solves=run.solves,
        stopped=run.stopped,
        starts_given=run.starts_given,
        doubts=run.doubts,
    )


def _is_hdf5(path: str | os.PathLike[str]) -> bool:
    with suppress(OSError), open(path, "rb") as file:
        return file.read(len(HDF5)) == HDF5
    return False


def _given_names(sampler: emcee.EnsembleSampler) -> tuple[str, ...]:
    """Return the parameter names that emcee was given, empty if there are none."""
    names: dict[int, str] = {}
    given = sampler.parameter_names if sampler.params_are_named else {}
    for name, places in given.items():
        for k, i in enumerate(np.atleast_1d(places).tolist()):
            names[i] = f"{name}[{k}]" if np.ndim(places) else name
    return tuple(names[i] for i in sorted(names))


def _of_file(
    store: Store,
    posterior: LogPosterior | None,
    discard: int | None,
    read: Callable[..., Chains],
) -> Chains:
    """Return the chains in the file of a run, finished or not."""
    manifest, search = store["manifest"], store["search"]
    streams = [stream for stream in sorted(store.lengths()) if stream > 0]
    if not streams:
        raise ValueError(f"source: {store.path} holds no chain (yet)")
    (_, doubts, _), row = store["first solve"], store["first row"]
    stored = [StoredChain(store, stream - 1) for stream in streams]
    betas = np.array(manifest.get("betas") or [1.0])
    # The ensembles run one after another: those that have begun are compared.
    begun = [chain for chain in stored if chain.iteration > (discard or 0)] or stored
    if discard is None:
        steps = min(chain.iteration for chain in begun)
        discard = dict(store["burn-in"] or ()).get(steps)
    if discard is None:  # a run that goes on, or of an older version
        discard = 0 if search else burn_in_of(begun, betas)
    search = None if search is None else SearchRecord.from_json(search)
    moves = "; ".join(map(" ".join, manifest["moves"]))
    return replace(
        read(begun, betas, discard=discard),
        names=tuple(manifest["parameters"]),
        posterior=posterior,
        search=search,
        moves=describe_moves(search.moves(None)) if search else moves,
        seed=str(manifest["seed"]),
        origin="" if search is None else search.sentence,
        starts_given=manifest["starts"] is not None and search is None,
        doubts=doubts,
        stopped=store["stopped"] or "",
        initial=row and np.array(row),
        log_box=manifest.get(LOG_BOX, np.nan),
        solves=store.spent()[0] + (search.followed_in if search else 0),
    )


def _of_arviz(
    idata: InferenceData, posterior: LogPosterior | None, discard: int
) -> Chains:
    """Return the chains of an ArviZ object, ours or that of ``arviz.from_emcee``."""
    names, chains = samples(idata)  # (chains, draws, d)
    group = dataset(idata, "posterior")
    lp = dataset(idata, "sample_stats")["lp"].transpose("chain", "draw").values
    # Without the coordinate all chains are walkers of one ensemble, as emcee's are.
    ensemble = np.zeros(len(chains), dtype=int)
    if "ensemble" in group.coords:
        ensemble = group["ensemble"].values
    counts = np.unique(ensemble, return_counts=True)[1]
    if np.ptp(counts):
        raise ValueError(
            "source: expected an ArviZ object with a coordinate 'ensemble' that "
            f"occurs equally often, got {counts.tolist()} chains by ensemble"
        )
    shape = len(counts), int(counts[0])
    draws = chains.reshape(*shape, -1, len(names)).transpose(2, 0, 1, 3)
    log_prob = lp.reshape(*shape, -1).transpose(2, 0, 1)
    if len(draws) <= discard:
        raise ValueError(f"discard: no steps are left after {discard}")
    told = {k: json.loads(group.attrs[k]) for k in STORED if k in group.attrs}
    told |= {name: group.attrs[name] for name in TOLD if name in group.attrs}
    told = told or {"plain": True}
    fractions = np.array(told.pop("acceptance", []))
    if fractions.size != shape[0] * shape[1]:  # chains were selected
        fractions = np.full(shape, np.nan)
    if told.get("search") is not None:
        told["search"] = SearchRecord.from_json(told["search"])
    told["betas"] = np.array(told.get("betas", [1.0]))
    before, thin = (int(group.attrs.get(k, v)) for k, v in STEPS_LEFT_OUT.items())
    told["discard"] = before + discard * thin
    known = tuple(names), draws[discard:], log_prob[discard:], fractions.reshape(shape)
    return Chains(*known, posterior=posterior, **told)
