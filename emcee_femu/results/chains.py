"""Chains as one record, wherever they are: runs, samplers, backends, files, ArviZ.

And how long they remember: autocorrelation times, which all judgements count here.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import emcee
import numpy as np
from emcee.backends import Backend
from numpy.typing import NDArray
from scipy import stats

from .. import checks
from ..evaluation.samplers import Sampler, moves_of, unwrap
from ..evaluation.store import Store, StoredChain
from ..interfaces import Floats
from ..moves.tempering import find_ladder
from ..posterior.log_posterior import LogPosterior
from ..sampling.anneal import Annealed
from ..sampling.run import Run
from ..sampling.search_record import SearchRecord
from .arviz_objects import InferenceData, dataset, is_arviz, is_weighted, samples

LONGEST_REPR = 200  # of a move, in the attributes
FEWEST_ENSEMBLES = 3  # of which the scatter is known
LEVEL = 1e-4  # of a false alarm, over all parameters
TAU_KNOWN_TO = 1.5  # ratio by which a variance claimed from tau may be too small


@dataclass(frozen=True, eq=False)
class Chains:
    """Chains of one posterior, and what is known of how they came about.

    Attributes:
        names: Parameter names.
        draws: ``(steps, ensembles, walkers, d)``; of a tempered run its cold walkers.
        log_prob: Log-posteriors ``(steps, ensembles, walkers)``.
        blobs: The rest of the rows, ``(steps, ensembles, walkers, columns - 1)``; None
            where there is none, or not asked for.
        posterior: What was sampled, None where it is not known.
        acceptance: Of each walker, ``(ensembles, walkers)``; NaN where not known.
        search: What "auto" found, None if it did not run.
        betas: Powers of the likelihood of the blocks of walkers; one if untempered.
        kind: "chain", "population" (annealed), or "weighted" (draws of a certificate).
        moves: In words.
        seed: In words.
        origin: How the chain began, in words.
        failures: Failed solves by cause.
        starts_given: Whether the walkers started where a user said.
    """

    names: tuple[str, ...]
    draws: Floats
    log_prob: Floats
    blobs: Floats | None = None
    posterior: LogPosterior | None = None
    acceptance: Floats = field(default_factory=lambda: np.empty((0, 0)))
    search: SearchRecord | None = None
    betas: Floats = field(default_factory=lambda: np.ones(1))
    kind: str = "chain"
    moves: str = "unknown (read from a backend)"
    seed: str = "unknown (not started by run)"
    origin: str = ""
    failures: Mapping[str, int] = field(default_factory=dict)
    starts_given: bool = False

    def __post_init__(self) -> None:
        """Say that acceptance is not known where nothing was said."""
        if not self.acceptance.size:
            shape = self.draws.shape[1:3]
            object.__setattr__(self, "acceptance", np.full(shape, np.nan))


def read_chains(
    source: object,
    posterior: LogPosterior | None = None,
    discard: int = 0,
    thin: int = 1,
    *,
    blobs: bool = False,
    hot: bool = False,
    argument: str = "source",
) -> Chains:
    """Return the chains of whatever holds some.

    Ensembles of different lengths, as in the file of a run that still goes on, are cut
    to the shortest.

    Args:
        source: What :func:`run` or :func:`anneal` returned; emcee samplers or backends,
            one or several; the name of a run's file; or an ArviZ object.
        posterior: What was sampled, where the source does not know it.
        discard: Stored steps to drop as burn-in.
        thin: Keep every ``thin``-th stored step.
        blobs: Whether to read them too.
        hot: Whether to keep the hot walkers of a tempered run.
        argument: What the user calls the source.

    Raises:
        TypeError: If it is nothing of all this.
        ValueError: If no steps are left.
    """
    discard = checks.whole_number("discard", discard)
    thin = checks.whole_number("thin", thin, 1)
    if posterior is not None:
        checks.instance("posterior", posterior, LogPosterior)
    if isinstance(source, Annealed):
        return _of_population(source, posterior, discard, thin)
    if is_arviz(source):
        return _of_arviz(source, posterior, discard, thin)
    read = partial(_read, discard=discard, thin=thin, blobs=blobs, hot=hot)
    if isinstance(source, str | os.PathLike):
        try:
            store = Store(os.fspath(source), read_only=True)
        except ValueError as error:
            raise ValueError(f"{argument}: {error}") from None
        return _of_file(store, posterior, discard, read)
    samplers = list(source) if isinstance(source, Sequence) else [source]
    if not samplers:
        raise ValueError(f"{argument}: expected at least one sampler, got none")
    backends = []
    for sampler in samplers:
        stored = getattr(sampler, "backend", sampler)
        if not isinstance(stored, Backend):
            raise TypeError(
                f"{argument}: expected what run returned, emcee samplers or backends, "
                "the name of a run's file or an ArviZ object, got "
                f"{type(sampler).__name__}"
            )
        backends.append(stored)
    weighted = moves_of(samplers[0])
    ladder = find_ladder([move for move, _ in weighted])
    betas = np.ones(1) if ladder is None else ladder.betas
    chains = read(backends, betas)
    known = source.posterior if isinstance(source, Run) else _sampled_by(samplers[0])
    chains = replace(
        chains,
        names=_names(samplers[0], posterior or known, chains.draws.shape[-1]),
        posterior=posterior or known,
        moves=describe_moves(weighted) or Chains.moves,
    )
    if not isinstance(source, Run):
        return chains
    return replace(
        chains,
        search=source.search,
        seed=str(source.seed),
        origin="" if source.search is None else source.search.sentence,
        failures={} if source.failures is None else dict(source.failures.causes),
        starts_given=source.starts_given,
    )


def _read(
    backends: Sequence[Backend],
    betas: Floats,
    *,
    discard: int,
    thin: int,
    blobs: bool,
    hot: bool,
) -> Chains:
    """Return what is stored in emcee backends, of walkers without names."""
    parts: dict[str, list[Floats]] = {"chain": [], "log_prob": [], "blobs": []}
    acceptance = []
    for backend in backends:
        if not backend.iteration:
            raise ValueError("source: one has no stored steps; run it first")
        if backend.iteration < discard + thin:
            raise ValueError(
                f"discard: no steps are left after {discard} (thin={thin})"
            )
        kept = slice(0, backend.shape[0] // (1 if hot else len(betas)))
        for name, values in parts.items():
            if name != "blobs" or (blobs and backend.has_blobs()):
                stored = backend.get_value(name, discard=discard, thin=thin)
                values.append(stored[:, kept])
        acceptance.append(backend.accepted[kept] / backend.iteration)
    shapes = {part.shape[1:] for part in parts["chain"]}
    if len(shapes) > 1:
        raise ValueError(
            "source: expected ensembles of one shape (walkers, parameters), got "
            f"{sorted(shapes)}"
        )
    steps = min(map(len, parts["chain"]))
    draws, log_prob, rest = (
        [part[:steps] for part in values] for values in parts.values()
    )
    return Chains(
        (),
        np.stack(draws, axis=1),
        np.stack(log_prob, axis=1),
        np.stack(rest, axis=1) if rest else None,
        acceptance=np.array(acceptance),
        betas=betas,
    )


def _sampled_by(sampler: object) -> LogPosterior | None:
    """Return the posterior of an emcee sampler, None where it is of something else."""
    if isinstance(sampler, Sampler):
        return sampler.evaluator.posterior
    if isinstance(sampler, emcee.EnsembleSampler):
        function = unwrap(sampler.log_prob_fn)
        return function if isinstance(function, LogPosterior) else None
    return None


def _names(
    sampler: object, posterior: LogPosterior | None, ndim: int
) -> tuple[str, ...]:
    """Return the posterior's names, or those that emcee was given."""
    if posterior is not None and posterior.ndim == ndim:
        return posterior.names
    names = [f"theta{i + 1}" for i in range(ndim)]
    if isinstance(sampler, emcee.EnsembleSampler) and sampler.params_are_named:
        for name, place in sampler.parameter_names.items():
            places = np.atleast_1d(place).tolist()
            for i in places:
                names[i] = name if len(places) == 1 else f"{name}[{places.index(i)}]"
    return tuple(names)


def describe_moves(weighted: Sequence[tuple[object, float]]) -> str:
    """Return moves with their weights in words."""
    words = []
    for move, weight in weighted:
        text = repr(move)
        if len(text) > LONGEST_REPR:  # of a fitted mixture, all its numbers
            text = f"{type(move).__name__}(...)"
        words.append(f"{weight:g} x {text}")
    return "; ".join(words)


def _of_file(
    store: Store,
    posterior: LogPosterior | None,
    discard: int,
    read: Callable[[Sequence[Backend], Floats], Chains],
) -> Chains:
    """Return the chains in the file of a run, which may still go on."""
    manifest, known = store["manifest"], store["search"]
    streams = [stream for stream in sorted(store.lengths()) if stream > 0]
    if not streams:
        raise ValueError(f"source: {store.path} holds no chain (yet)")
    stored = [StoredChain(store, stream - 1) for stream in streams]
    # The ensembles run one after another: those that have begun are compared.
    begun = [chain for chain in stored if chain.iteration > discard]
    betas = np.array(manifest.get("betas") or [1.0])
    search = None if known is None else SearchRecord.from_json(known)
    return replace(
        read(begun or stored, betas),
        names=tuple(manifest["parameters"]),
        posterior=posterior,
        search=search,
        moves=manifest["moves"] if search is None else describe_moves(search.moves),
        seed=str(manifest["seed"]),
        origin="" if search is None else search.sentence,
        starts_given=manifest["starts"] is not None and search is None,
    )


def _of_population(
    population: Annealed, posterior: LogPosterior | None, discard: int, thin: int
) -> Chains:
    """Return an annealed population as one walker, in the order of its lineages."""
    if discard or thin > 1:
        raise ValueError(
            "discard, thin: a population has no burn-in and no order to thin, "
            f"expected 0 and 1, got {discard} and {thin}"
        )
    rows = population.rows
    return Chains(
        population.names,
        population.theta[:, None, None],
        rows[:, None, None, 0],
        rows[:, None, None, 1:],
        posterior=posterior,
        acceptance=population.acceptance[-1:, None],
        kind="population",
        moves="annealed",
        seed="unknown (annealed)",
        origin=(
            f"annealed through {len(population.sweeps)} powers of the likelihood, "
            f"{population.solves} solves"
        ),
    )


def _of_arviz(
    idata: InferenceData, posterior: LogPosterior | None, discard: int, thin: int
) -> Chains:
    """Return the chains of an ArviZ object, ours or that of ``arviz.from_emcee``."""
    weighted = is_weighted(idata)
    names, chains = samples(idata)  # (chains, draws, d)
    group = dataset(idata, "posterior")
    lp = dataset(idata, "sample_stats")["lp"].transpose("chain", "draw").values
    # Without the coordinate all chains are walkers of one ensemble, as emcee's are.
    ensemble = np.zeros(len(chains), dtype=int)
    if "ensemble" in group.coords:
        ensemble = group["ensemble"].values
    counts = np.unique(ensemble, return_counts=True)[1]
    if len(set(counts.tolist())) != 1:
        raise ValueError(
            "source: expected an ArviZ object with a coordinate 'ensemble' that "
            f"occurs equally often, got {counts.tolist()} chains by ensemble"
        )
    shape = len(counts), int(counts[0])
    draws = chains.reshape(*shape, -1, len(names)).transpose(2, 0, 1, 3)
    log_prob = lp.reshape(*shape, -1).transpose(2, 0, 1)
    kept = slice(discard + thin - 1, None, thin)
    if not len(draws[kept]):
        raise ValueError(f"discard: no steps are left after {discard} (thin={thin})")
    known = group.attrs
    search = json.loads(str(known.get("search", "null")))
    fractions = np.array(json.loads(str(known.get("acceptance", "[]"))))
    if fractions.size != shape[0] * shape[1]:  # chains were selected
        fractions = np.full(shape, np.nan)
    return Chains(
        tuple(names),
        draws[kept],
        log_prob[kept],
        posterior=posterior,
        acceptance=fractions.reshape(shape),
        search=None if search is None else SearchRecord.from_json(search),
        betas=np.array(json.loads(str(known.get("betas", "[1.0]")))),
        kind="weighted" if weighted else str(known.get("kind", "chain")),
        moves=str(known.get("moves", Chains.moves)),
        seed=str(known.get("seed", Chains.seed)),
        origin=str(known.get("origin", "")),
        failures=json.loads(str(known.get("failures", "{}"))),
        starts_given=bool(known.get("starts_given", False)),
    )


def autocorrelation_time(chain: Floats) -> Floats:
    """Return emcee's tau of ``chain (steps, walkers, d)``, ``(d,)``, however short."""
    # tol=0 because diagnose reports steps / tau itself.
    tau: Floats = emcee.autocorr.integrated_time(chain, tol=0)
    return tau


def tau_by_ensemble(values: Floats, moved: NDArray[np.bool_]) -> Floats:
    """Return tau by ensemble, ``(ensembles, d)``, of those walkers that moved."""
    taus = np.full((values.shape[1], values.shape[3]), np.nan)
    for ensemble in np.flatnonzero(moved.any(axis=1)):
        taus[ensemble] = autocorrelation_time(values[:, ensemble, moved[ensemble]])
    return taus


def excess_scatter(values: Floats, tau: Floats) -> Floats:
    r"""Return by how much ensemble means scatter more than they may, ``(d,)``.

    .. math:: \chi^2 = \sum_e \frac{(\bar x_e - \bar x)^2}{v_e},
        \qquad v_e = \frac{s^2 \tau_e}{\mathrm{steps} \cdot \mathrm{walkers}}

    over its quantile for ``ensembles - 1`` degrees of freedom: above 1 the errors that
    tau claims are too small, or an ensemble is somewhere else.

    Args:
        values: Draws, or functions of them, ``(steps, ensembles, walkers, d)``.
        tau: Their autocorrelation times in steps, ``(ensembles, d)``; an ensemble
            whose values never change, NaN, gets the longest of the others.

    Returns:
        The ratios; NaN for fewer than three ensembles, which do not tell.
    """
    steps, n_ensembles, n_walkers, d = values.shape
    if n_ensembles < FEWEST_ENSEMBLES:
        return np.full(d, np.nan)
    tau = np.where(np.isfinite(tau), tau, np.fmax.reduce(tau))  # NaN if all are
    variance = values.var(axis=(0, 1, 2)) * tau / (steps * n_walkers)
    means = values.mean(axis=(0, 2))
    with np.errstate(divide="ignore", invalid="ignore"):  # of what never changes
        centre = (means / variance).sum(axis=0) / (1 / variance).sum(axis=0)
        squares = ((means - centre) ** 2 / variance).sum(axis=0)
    most = stats.chi2.isf(LEVEL / d, n_ensembles - 1)
    ratio: Floats = squares / (TAU_KNOWN_TO * most)
    return ratio
