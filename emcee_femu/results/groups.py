"""The groups of the ArviZ object of some chains, each made when it is asked for.

``arviz.from_emcee`` writes sampler arguments of any type into ``observed_data`` and
cannot read structured blobs, so the groups are built here.
"""

import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import emcee
import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..contracts import Floats, Places, Variable, read_declared
from ..evaluation.resume import installed_version
from ..posterior.compatibility import RESERVED
from ..posterior.log_posterior import LOG_PRIOR, LogPosterior
from ..posterior.priors import prior_centre, summarize_prior
from ..search.record import Chains
from .arviz_objects import Dataset, Groups
from .chains import STORED, TOLD
from .measured import (
    ONE_NUMBER,
    Labelled,
    gather_likelihoods,
    gather_measurements,
    gather_observed,
    side_by_side,
)

PRIOR_STORED = 1_000
PREDICTIVE_DRAWS = 500  # which ArviZ draws in seconds


def convert(
    chains: Chains,
    thin: int = 1,
    term: str | None = None,
    whole: Callable[[], Chains] | None = None,
) -> Groups:
    """Return the groups of chains, or of what was measured for one term.

    Args:
        chains: The chains, with their blobs or without.
        thin: By what they were thinned.
        term: The label of the term.
        whole: What returns them with their blobs, which are read only if a group needs
            them; None where ``chains`` have them.
    """
    made = Conversion(chains, thin, term, whole or (lambda: chains))
    of_any = {"posterior": made.posterior, "sample_stats": made.sample_stats}
    if chains.posterior is None:
        if term is not None:
            checks.instance("posterior", None, LogPosterior)
        return Groups(of_any | {"blobs": made.blobs})
    makers = of_any | {
        "log_prior": made.log_prior,
        "response": made.response,
        "log_likelihood": made.log_likelihood,
        "new_measurement": lambda: made.new_measurement,
        "posterior_predictive": made.posterior_predictive,
    }
    initial = chains.posterior.initial if chains.initial is None else chains.initial
    fixed = fixed_groups(chains.posterior, made.attributes, initial)
    return Groups(makers | fixed)


class Conversion:
    """Each group of the ArviZ object of some chains; see :func:`convert`."""

    def __init__(
        self,
        chains: Chains,
        thin: int,
        term: str | None,
        whole: Callable[[], Chains],
    ) -> None:
        self.chains, self.term, self.whole = chains, term, whole
        self.attributes = {
            "discard": chains.discard,
            "thin": thin,
            "inference_library": "emcee",
            "inference_library_version": emcee.__version__,
            "emcee_femu_version": installed_version("emcee-femu"),
            "numpy_version": np.__version__,
        }
        steps, ensembles, walkers, _ = chains.draws.shape
        self.coords = {
            "step": ("draw", chains.discard + thin * (1 + np.arange(steps)) - 1),
            "ensemble": ("chain", np.repeat(np.arange(ensembles), walkers)),
            "walker": ("chain", np.tile(np.arange(walkers), ensembles)),
        }

    @property
    def sampled(self) -> LogPosterior:
        """What was sampled, which is known."""
        assert self.chains.posterior is not None
        return self.chains.posterior

    @cached_property
    def rows(self) -> Floats:
        """What the posterior returned, ``(steps, ensembles, walkers, columns)``."""
        return read_rows(self.whole(), self.sampled)

    @property
    def at(self) -> tuple[LogPosterior, Floats, Floats, str | None]:
        """What functions that ask the terms take: posterior, draws, rows, one term."""
        return self.sampled, self.chains.draws, self.rows, self.term

    def group(self, parts: Mapping[str, Labelled]) -> Dataset | None:
        """Return arrays at the samples as a Dataset, None for none."""
        return make_dataset(parts, self.attributes, self.coords) if parts else None

    def posterior(self) -> Dataset:
        """Return the parameters, and what is known of the chains."""
        chains, sampled = self.chains, self.chains.posterior
        units = sampled.units if sampled else {}
        by_name = _by_parameter(chains.names, chains.draws, units)
        made = make_dataset(by_name, self.attributes, self.coords)
        noted = sampled.notes if sampled else None
        return made.assign_attrs(_attributes_of(chains) | dict(noted or {}))

    def sample_stats(self) -> Dataset | None:
        """Return log-posteriors and log-priors."""
        parts = {"lp": Labelled(self.chains.log_prob, ONE_NUMBER)}
        if self.chains.posterior is not None:
            parts["log_prior"] = Labelled(self.rows[..., LOG_PRIOR], ONE_NUMBER)
        return self.group(parts)

    def blobs(self) -> Dataset | None:
        """Return the blobs of any other function."""
        blobs = self.whole().blobs
        return None if blobs is None else self.group(_name_blobs(blobs))

    def log_prior(self) -> Dataset | None:
        """Return the log-prior of each parameter, if the prior tells it."""
        prior, draws = self.sampled.prior, self.chains.draws
        if (logpdfs := read_declared(prior, "logpdfs")) is None:
            return None
        densities = logpdfs(draws.reshape(-1, draws.shape[-1]))
        by_name = _by_parameter(prior.names, densities.reshape(draws.shape), {})
        return self.group(by_name)

    def response(self) -> Dataset | None:
        """Return the model's stored variables."""
        values = self.sampled.unfold(self.rows)
        variables = self.sampled.variables
        return self.group({n: Labelled(v, variables[n]) for n, v in values.items()})

    def log_likelihood(self) -> Dataset | None:
        """Return the log-likelihood of each datum."""
        parts = gather_likelihoods(*self.at)
        if self.term is not None:
            drawn = gather_measurements(*self.at)
            both = [*parts.values(), *drawn.values()]
            if len(both) != 2 or both[0].values.shape != both[1].values.shape:
                raise ValueError(
                    f"term: expected one of {list(self.sampled.term_names)} whose "
                    f"data are independent, got {self.term!r}"
                )
            parts = dict.fromkeys(drawn, both[0])
        if len(parts) > 1:  # ArviZ takes one variable
            parts = {"data": side_by_side(parts, self.chains.draws.ndim - 1)}
        return self.group(parts)

    @cached_property
    def new_measurement(self) -> Dataset | None:
        """What a new measurement would be at each sample, None if no term draws one."""
        return self.group(gather_measurements(*self.at))

    def posterior_predictive(self) -> Dataset | None:
        """Return some new measurements; of one term all, by which ArviZ weighs."""
        new = self.new_measurement
        return new if new is None or self.term is not None else pick_some(new)


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


def make_dataset(
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


def read_rows(chains: Chains, posterior: LogPosterior) -> Floats:
    """Return the rows of the posterior, ``(steps, ensembles, walkers, columns)``."""
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


def fixed_groups(
    posterior: LogPosterior, attributes: Mapping[str, object], initial: Floats
) -> dict[str, Callable[[], Dataset | None]]:
    """Return what makes the groups of prior draws, measurements and constants."""
    prior = posterior.prior

    def draws() -> Dataset:
        drawn = prior.sample(np.random.default_rng(0), PRIOR_STORED)[:, None, None]
        by_name = _by_parameter(posterior.names, drawn, posterior.units)
        return make_dataset(by_name, attributes, {})

    def constants() -> Dataset:
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
        held = {name: Labelled(v, parameter) for name, v in by_parameter.items()} | {
            f"initial_{name}": Labelled(value, posterior.variables[name])
            for name, value in posterior.unfold(initial).items()
        }
        for experiment in posterior.experiments:
            if (paired := experiment.paired) is not None:
                number = Labelled(np.array(paired.min_mac), Variable({}))
                held[experiment.full_name("min_mac")] = number
        return make_dataset(held, attributes)

    def observed() -> Dataset | None:
        measured = gather_observed(posterior)
        return make_dataset(measured, attributes) if measured else None

    return {"prior": draws, "constant_data": constants, "observed_data": observed}


def name_apart(
    coords: Mapping[str, Mapping[str, Places]],
) -> dict[str, dict[str, Places]]:
    """Return ``{variable: {dimension: labels}}`` with one meaning per dimension.

    Of dimensions with one name but different labels, the longest keeps the name, since
    xarray would fill up the others with NaN.
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
