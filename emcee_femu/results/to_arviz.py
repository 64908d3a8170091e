"""Chains to ArviZ objects.

``arviz.from_emcee`` writes sampler arguments of any type into ``observed_data`` and
cannot read structured blobs, so the groups are built here.
"""

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import emcee
import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..contracts import Floats, Places, Variable
from ..likelihoods.residuals import FitRecord
from ..posterior.compatibility import RESERVED
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import KnownPrior, prior_centre, summarize_prior
from ..search.record import Chains
from .arviz_objects import (
    Dataset,
    InferenceData,
    groups,
    is_arviz,
    samples,
    samples_of,
    wrap,
)
from .chains import STORED, TOLD, read_chains
from .fit import SOLVED_AGAIN, judge_data, write_records
from .measured import ONE_NUMBER, Labelled, gather_by_terms, gather_observed

FIT = "fit"  # attribute of the posterior group
# Samples whose log-posterior is lower than the best one's by d and this have not
# arrived: of a Gaussian it is lower by d / 2 on average, and by more than this once in
# a thousand times.
LOST = 5.0
PRIOR_STORED = 1_000
PREDICTIVE_DRAWS = 500  # which ArviZ draws in seconds


def to_inference_data(
    source: object,
    posterior: LogPosterior | None = None,
    discard: int | None = None,
    thin: int = 1,
    names: Sequence[str] | None = None,
    term: str | None = None,
    prior_predictive: int = 0,
) -> InferenceData:
    """Convert a run to an ArviZ object, with every walker as a chain.

    Use it to drop the burn-in, to work with ArviZ, or to save a run as netCDF. Tables,
    figures and :func:`identifiability` also accept a run and convert it themselves.
    What the samples say of the data is stored too, for the statement on the fit, with
    as many solves as :func:`diagnose` takes for it.

    ============================ ====================================================
    group                        contents
    ============================ ====================================================
    ``posterior``                the parameters by name, with ``attrs["units"]`` if
                                 known; ``attrs["sampled"]`` of the group lists them, so
                                 that you can add derived quantities; ``attrs`` also has
                                 the posterior's ``notes``
    ``sample_stats``             lp, log_prior
    ``log_prior``                of each parameter, if the prior has ``logpdfs``
    ``log_likelihood``           of each datum if its term factorises, otherwise of the
                                 whole term; by the term's name or, with several terms,
                                 side by side as ``data``
    ``response``                 the model's stored variables, without measurement
                                 noise
    ``new_measurement``          a new measurement for each sample, noise included, if
                                 a term can draw one
    ``posterior_predictive``     500 draws of these, for ``arviz.plot_ppc``
    ``prior``                    1,000 draws of the prior
    ``prior_predictive``         a new measurement for each of the first
                                 ``prior_predictive`` of these
    ``observed_data``            the measurements, by the name of the variable; a
                                 second measurement as ``frequency[term]``
    ``constant_data``            lower and upper bounds; prior_mean and prior_sd inside
                                 them; ``initial``, a Gaussian prior's own mean, or else
                                 the prior mean; ``initial_<variable>``, the response
                                 there (one solve, unless the run stored it), NaN if it
                                 cannot be solved; is_error, whether only terms read the
                                 parameter (noise, discrepancy)
    ============================ ====================================================

    Walkers of one ensemble are not independent chains; the coordinate ``ensemble``
    shows which belong together. Draws count from 0; the coordinate ``step`` is the
    stored step. For tempered runs only the cold walkers are converted. At its peak the
    conversion needs about four times the memory of the chains and blobs that are kept.
    If the posterior is unknown, as for any other log-probability function, the groups
    are ``posterior``, ``sample_stats`` and, if the function returned blobs, ``blobs``:
    named as in a structured ``blobs_dtype``, otherwise ``blob``, or ``blob0``,
    ``blob1``, ... if they differ in shape.

    Args:
        source: The result of :func:`run`, any EnsembleSampler, a backend, or the name
            of a run's file; or the result of :func:`anneal`, whose members become one
            chain. An ArviZ object, also one that a result holds, is returned as it is.
            A LogPosterior has no samples yet, and gives the groups ``prior``,
            ``prior_predictive``, ``observed_data`` and ``constant_data``.
        posterior: The sampled posterior, if the source does not hold it.
        discard: Number of stored steps to drop as burn-in. None for those that a run
            by given moves found itself (``run.burn_in``), and for none of other
            sources. ``attrs["discard"]`` has the number.
        thin: Keep every ``thin``-th stored step.
        names: Parameter names for a sampler without a LogPosterior; ``theta1`` and so
            on by default.
        term: Label of a term whose data are independent, of a run or its file, to
            convert what was measured for this term alone, as ``arviz.plot_loo_pit``
            and ``arviz.loo_pit`` need it: ``log_likelihood`` and
            ``posterior_predictive`` have the name of the measured variable, and all
            draws of the chains.
        prior_predictive: Number of draws of the prior, at most 1,000, at which to
            predict new measurements for a prior predictive check: as many solves, in
            this process.

    Returns:
        ``arviz.InferenceData`` (ArviZ < 1) or ``xarray.DataTree`` (ArviZ >= 1).

    Raises:
        TypeError: If a number is not whole, posterior is not a LogPosterior or is
            missing where ``term`` or ``prior_predictive`` needs it, or names are not
            text.
        ValueError: If no step is left, a chain does not belong to this posterior, names
            are not needed or do not match the number of parameters, or the term's data
            are not independent.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> idata = ef.to_inference_data(run, discard=50)
        >>> dict(idata["posterior"]["k1"].sizes)
        {'chain': 20, 'draw': 50}
        >>> before = ef.to_inference_data(posterior, prior_predictive=100)
        >>> dict(before["prior_predictive"]["frequency"].sizes)
        {'chain': 1, 'draw': 100, 'mode': 5}
    """
    count = checks.whole_number("prior_predictive", prior_predictive)
    if count > PRIOR_STORED:
        raise ValueError(
            f"prior_predictive: expected at most {PRIOR_STORED}, the draws of the "
            f"prior that are stored, got {count}"
        )
    if isinstance(source, LogPosterior):
        of_samples = posterior, names, term
        if discard or thin != 1 or any(given is not None for given in of_samples):
            raise ValueError(
                "source: a LogPosterior has no samples yet; give a run, or leave out "
                "posterior, discard, thin, names and term"
            )
        data, posterior = wrap(_fixed_groups(source, {}, source.initial)), source
    elif names is None:
        told = "source", term, True
        data, posterior = read_samples(source, posterior, discard, thin, *told)
    else:
        chains = read_chains(source, posterior, discard, thin, blobs=True)
        names = checks.parameter_names("names", names)
        if is_arviz(source) or chains.posterior is not None:
            raise ValueError(f"names: {list(chains.names)} are known; leave it out")
        if len(names) != (d := len(chains.names)):
            raise ValueError(f"names: expected one for each of {d} parameters")
        data = convert(replace(chains, names=names), thin, term)
    if not count:
        return data
    posterior = checks.instance("posterior", posterior, LogPosterior)
    theta = posterior.prior.sample(np.random.default_rng(0), PRIOR_STORED)[:count]
    rows = posterior(theta)[:, None, None]
    new = gather_by_terms(posterior, theta[:, None, None], rows)["new_measurement"]
    if not new:
        raise ValueError(
            "prior_predictive: no likelihood term draws new measurements, as of a bare "
            "log-likelihood; leave it out"
        )
    return wrap(groups(data) | {"prior_predictive": _dataset(new, {}, {})})


def read_samples(
    source: object,
    posterior: LogPosterior | None = None,
    discard: int | None = None,
    thin: int = 1,
    argument: str = "idata",
    term: str | None = None,
    judged: bool = False,
) -> tuple[InferenceData, LogPosterior | None]:
    """Return the ArviZ object of any source of samples, and its posterior if known.

    All tables and figures read samples through it. If ``judged``, what samples say of
    the data is stored too.
    """
    held = getattr(source, "posterior", None)  # of a result beside its samples
    if posterior is None and isinstance(held, LogPosterior):
        posterior = held
    if not is_arviz(source := samples_of(source)):
        chains = read_chains(
            source, posterior, discard, thin, blobs=True, argument=argument
        )
        data = convert(chains, thin, term)
        if judged and chains.posterior is not None:
            data = store_fit(data, judge_samples(chains))
        return data, chains.posterior
    if (discard or 0, thin, term) != (0, 1, None):
        raise ValueError(
            "discard, thin, term: expected 0, 1 and None for an ArviZ object, got "
            f"{discard}, {thin} and {term!r}; select its draws by isel(draw=...), and "
            "a term when you convert the run"
        )
    if posterior is not None:
        check_sampled(posterior, samples(source)[0])
    return source, posterior


def read_samples_and_model(
    source: object, posterior: LogPosterior | None
) -> tuple[InferenceData, LogPosterior]:
    """Return the ArviZ object of any source of samples, and what was sampled."""
    idata, known = read_samples(source, posterior)
    if known is None:
        raise TypeError(
            "posterior: expected the sampled LogPosterior, whose model is needed here; "
            "an ArviZ object holds samples only, so give the posterior after it"
        )
    return idata, checks.instance("posterior", known, LogPosterior)


def check_sampled(posterior: LogPosterior, names: Sequence[str]) -> None:
    """Refuse a posterior whose parameters are not the sampled ones."""
    checks.instance("posterior", posterior, LogPosterior)
    if posterior.names != tuple(names):
        raise ValueError(
            f"posterior: expected the sampled one, with the parameters {list(names)}, "
            f"got {list(posterior.names)}"
        )


def convert(chains: Chains, thin: int = 1, term: str | None = None) -> InferenceData:
    """Return the ArviZ object of chains, or of what was measured for one term."""
    draws, posterior = chains.draws, chains.posterior
    if term is not None:
        checks.instance("posterior", posterior, LogPosterior)
    units = posterior.units if posterior else {}
    parts: dict[str, dict[str, Labelled]] = {
        "posterior": _by_parameter(chains.names, draws, units),
        "sample_stats": {"lp": Labelled(chains.log_prob, ONE_NUMBER)},
    }
    attributes = {
        "discard": chains.discard,
        "thin": thin,
        "inference_library": "emcee",
        "inference_library_version": emcee.__version__,
        "emcee_femu_version": version("emcee-femu"),
        "numpy_version": np.__version__,
    }
    fixed: dict[str, Dataset] = {}
    if posterior is not None:
        rows = _rows(chains, posterior)
        parts["sample_stats"]["log_prior"] = Labelled(rows[..., 1], ONE_NUMBER)
        if isinstance(posterior.prior, KnownPrior):
            densities = posterior.prior.logpdfs(draws.reshape(-1, posterior.ndim))
            densities = densities.reshape(draws.shape)
            parts["log_prior"] = _by_parameter(chains.names, densities, {})
        parts["response"] = {
            name: Labelled(value, posterior.variables[name])
            for name, value in posterior.unfold(rows).items()
        }
        parts |= gather_by_terms(posterior, draws, rows, term)
        initial = posterior.initial if chains.initial is None else chains.initial
        fixed = _fixed_groups(posterior, attributes, initial)
    elif chains.blobs is not None:
        parts["blobs"] = _name_blobs(chains.blobs)
    steps, ensembles, walkers, _ = draws.shape
    coords = {
        "step": ("draw", chains.discard + thin * (1 + np.arange(steps)) - 1),
        "ensemble": ("chain", np.repeat(np.arange(ensembles), walkers)),
        "walker": ("chain", np.tile(np.arange(walkers), ensembles)),
    }
    there = [(name, part) for name, part in parts.items() if part]
    datasets = {name: _dataset(part, attributes, coords) for name, part in there}
    if "new_measurement" in datasets:
        new = datasets["new_measurement"]  # all, where ArviZ weighs every draw
        datasets["posterior_predictive"] = pick_some(new) if term is None else new
    datasets["posterior"].attrs |= _attributes_of(chains)
    if posterior is not None:
        datasets["posterior"].attrs |= posterior.notes or {}
    return wrap(datasets | fixed)


def store_fit(data: InferenceData, records: Sequence[FitRecord]) -> InferenceData:
    """Return an ArviZ object that holds what its samples say of the data."""
    held = groups(data)
    held["posterior"] = held["posterior"].assign_attrs({FIT: write_records(records)})
    return wrap(held)


def judge_samples(
    chains: Chains, weights: Floats | None = None, solves: int = SOLVED_AGAIN
) -> tuple[FitRecord, ...]:
    """Return what samples say of the data, without those that have not arrived.

    Args:
        chains: With their blobs.
        weights: Of the draws, ``(n,)``; None where all are equal.
        solves: How many samples may be solved again.
    """
    if (posterior := chains.posterior) is None:
        return ()
    rows = _rows(chains, posterior).reshape(-1, posterior.row_size)
    theta = chains.draws.reshape(-1, posterior.ndim)
    kept = rows[:, 0] > rows[:, 0].max() - LOST - posterior.ndim
    rows, theta = rows[kept], theta[kept]
    if weights is not None:
        weights = weights[kept]
    initial = posterior.initial if chains.initial is None else chains.initial
    return judge_data(posterior, theta, rows, initial, weights, solves)


def pick_some(measurements: Dataset, weights: Floats | None = None) -> Dataset:
    """Thin draws of new measurements to one chain that ArviZ can plot quickly."""
    import xarray

    n, chains = measurements.sizes["draw"], measurements.sizes["chain"]
    share = None if weights is None else weights / weights.sum()
    size = min(PREDICTIVE_DRAWS, n * chains) if share is None else PREDICTIVE_DRAWS
    rng = np.random.default_rng(0)
    picked = np.sort(rng.choice(n * chains, size, share is not None, share))
    draw, chain = (xarray.DataArray(v, dims="pick") for v in divmod(picked, chains))
    some = measurements.drop_vars(["chain", "draw", "step", "ensemble", "walker"])
    some = some.isel(draw=draw, chain=chain).rename(pick="draw")
    return some.expand_dims("chain").assign_coords(chain=[0], draw=np.arange(size))


def _dataset(
    group: Mapping[str, Labelled],
    attributes: Mapping[str, object],
    coords: Mapping[str, object] | None = None,
) -> Dataset:
    """Return arrays as a Dataset.

    Those of samples, which have coordinates, are ``(steps, ensembles, walkers, ...)``,
    and become ``(chain, draw, ...)``.
    """
    import xarray

    apart = name_apart({name: part.variable.coords for name, part in group.items()})
    variables = {}
    places = {k: v for dims in apart.values() for k, v in dims.items()}
    for name, (values, variable) in group.items():
        dims = [*apart[name]]
        if coords is not None:
            n, _, _, *shape = values.shape
            values = np.moveaxis(values, 0, 2).reshape(-1, n, *shape)
            dims = ["chain", "draw", *dims]
            places |= {"chain": range(len(values)), "draw": range(n)}
        variables[name] = dims, values, {"units": variable.unit}
    sampled = {} if coords is None else {"sample_dims": ["chain", "draw"]}
    return xarray.Dataset(
        variables, places | dict(coords or {}), dict(attributes) | sampled
    )


def _by_parameter(
    names: Sequence[str], values: Floats, units: Mapping[str, str]
) -> dict[str, Labelled]:
    """Return numbers ``(..., d)`` by parameter."""
    return {
        name: Labelled(values[..., i], Variable({}, units.get(name, "")))
        for i, name in enumerate(names)
    }


def _name_blobs(blobs: NDArray[Any]) -> dict[str, Labelled]:
    """Return blobs ``(steps, ensembles, walkers, ...)`` by the names of their fields.

    Where they differ in shape or type emcee keeps them as objects, side by side.
    """
    named = {name: blobs[name] for name in blobs.dtype.names or ()}
    if blobs.dtype == object and blobs.ndim > 3:
        named = {f"blob{i}": blobs[..., i] for i in range(blobs.shape[3])}
    labelled = {}
    for name, field in (named or {"blob": blobs}).items():
        try:
            value = np.array(field.tolist()) if field.dtype == object else field
        except ValueError:  # arrays of several shapes
            value = field
        if value.dtype == object:
            warnings.warn(
                f"source: the blobs {name!r} are objects, which ArviZ cannot write to "
                "a file, and are left out; return numbers or arrays of one shape",
                stacklevel=2,
            )
            continue
        axes = enumerate(value.shape[3:])
        coords = {f"{name}_dim_{axis}": range(size) for axis, size in axes}
        free = f"blob_{name}" if name in RESERVED else name
        labelled[free] = Labelled(value, Variable(coords))
    return labelled


def _rows(chains: Chains, posterior: LogPosterior) -> Floats:
    """Return what the posterior returned, ``(steps, ensembles, walkers, columns)``."""
    blobs, d = chains.blobs, chains.draws.shape[-1]
    width = posterior.row_size - 1  # emcee takes the first one as log_prob
    if blobs is None or d != posterior.ndim or blobs.shape[3:] != (width,):
        shape = None if blobs is None else blobs.shape[3:]
        raise ValueError(
            f"source: chains of {d} parameters with blobs of shape {shape} are not "
            f"of this posterior, which has {posterior.ndim} and ({width},)"
        )
    return np.concatenate([chains.log_prob[..., None], blobs], axis=-1)


def _attributes_of(chains: Chains) -> dict[str, object]:
    """Return facts about the chains as attributes that netCDF can store."""
    search = None if chains.search is None else chains.search.to_json()
    if search is not None and search["surface"] is not None:
        search["surface"]["coefficients"] = []  # as many numbers as draws
    stored = {name: vars(chains)[name] for name in STORED} | {"search": search}
    return (
        {"sampled": list(chains.names)}
        | {name: vars(chains)[name] for name in TOLD}
        | {k: json.dumps(v, default=np.ndarray.tolist) for k, v in stored.items()}
    )


def _fixed_groups(
    posterior: LogPosterior, attributes: Mapping[str, object], initial: Floats
) -> dict[str, Dataset]:
    """Return the groups of prior draws, measurements and constants."""
    prior = posterior.prior
    mean, sd = summarize_prior(prior)
    by_parameter: dict[str, Any] = {
        "lower": prior.bounds[:, 0],
        "upper": prior.bounds[:, 1],
        "initial": prior_centre(prior),
        "prior_mean": mean,
        "prior_sd": sd,
        "is_error": np.isin(posterior.names, posterior.error_names),
    }
    parameter = Variable({"parameter": list(posterior.names)})
    constants = {name: Labelled(v, parameter) for name, v in by_parameter.items()} | {
        f"initial_{name}": Labelled(value, posterior.variables[name])
        for name, value in posterior.unfold(initial).items()
    }
    draws = prior.sample(np.random.default_rng(0), PRIOR_STORED)[:, None, None]
    drawn = _by_parameter(posterior.names, draws, posterior.units)
    fixed = {
        "prior": _dataset(drawn, attributes, {}),
        "constant_data": _dataset(constants, attributes),
    }
    if observed := gather_observed(posterior):
        fixed["observed_data"] = _dataset(observed, attributes)
    return fixed


def name_apart(
    coords: Mapping[str, Mapping[str, Places]],
) -> dict[str, dict[str, Places]]:
    """Return ``{variable: {dimension: labels}}`` with one meaning per dimension.

    Of dimensions that differ in their labels the longest keeps its name; xarray would
    fill up the others with NaN.
    """
    longest: dict[str, Places] = {}
    for dims in coords.values():
        for dim, labels in dims.items():
            longest[dim] = max(longest.get(dim, []), list(labels), key=len)

    def rename(name: str, dim: str, labels: Places) -> str:
        if list(labels) == longest[dim]:
            return dim
        measurement = name.removeprefix(f"{dim.rpartition('.')[0]}.")
        if name.endswith("]"):
            measurement = name[:-1].partition("[")[2]
        return f"{dim}[{measurement}]"

    return {
        name: {rename(name, dim, labels): list(labels) for dim, labels in dims.items()}
        for name, dims in coords.items()
    }
