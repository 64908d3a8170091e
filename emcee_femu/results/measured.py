"""Measured variables, and the predictions of an ArviZ object at the same places."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..contracts import Floats, Parameters, Stored, Variable
from ..likelihoods.term import Term
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior
from .arviz_objects import Dataset, InferenceData, dataset, original_name

INTERVAL = (0.025, 0.975)  # quantiles: 95 %
GROUPS = ("observed_data", "response", "constant_data", "new_measurement")


ONE_NUMBER = Variable({})


@dataclass(frozen=True, eq=False)
class Measured:
    """A variable measured at ``m`` places, and predicted there by ``n`` samples.

    Attributes:
        experiment: The experiment of a joint posterior; else an empty string.
        quantity: What was measured, such as ``"frequency"``.
        again: The term that measured it, if another term did so before it.
        unit: Its unit, or an empty string.
        dims: Its dimensions in words, such as ``"mode"``.
        labels: One label per place, such as ``"3"`` or ``"left, 3"``.
        values: What was measured there, ``(m,)``.
        initial: The model's values at the prior mean, ``(m,)``; NaN if unknown.
        predicted: Its values at the samples, ``(n, m)``.
        replicated: New measurements ``(n, m)``; None if no term draws them.
        mac: MAC ``(n, m)`` of paired modes, if it is their frequency; else None.
        model_mode: The model's modes paired with them, ``(n, m)``, or None.
    """

    experiment: str
    quantity: str
    again: str
    unit: str
    dims: str
    labels: tuple[str, ...]
    values: Floats
    initial: Floats
    predicted: Floats
    replicated: Floats | None
    mac: Floats | None
    model_mode: Floats | None

    @property
    def variable(self) -> str:
        """Its name in the response, such as ``"empty.frequency"``."""
        return f"{self.experiment}.{self.quantity}".removeprefix(".")

    @property
    def name(self) -> str:
        """Its name among all that was measured, such as ``"frequency[term]"``."""
        return f"{self.variable}[{self.again}]".removesuffix("[]")

    @property
    def updated(self) -> Floats:
        """The updated values: means of the model's over all samples, ``(m,)``."""
        return np.asarray(self.predicted.mean(axis=0))

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether each value is inside 95 % of new measurements, ``(m,)``.

        It is inside if it lies between their 2.5 % and 97.5 % quantiles. If no new
        measurements are drawn, the model's own predictions take their place.
        """
        new = self.predicted if self.replicated is None else self.replicated
        low, high = np.quantile(new, INTERVAL, axis=0)
        return np.asarray((low <= self.values) & (self.values <= high))

    def sd(self, posterior: LogPosterior | None) -> Floats:
        """Return the standard deviations of the measurement, NaN where unknown."""
        for experiment, term, label in each_term(posterior) if posterior else ():
            for variable, sd in term.error_sd.items():
                same = np.array_equal(np.ravel(term.observed[variable]), self.values)
                same &= (experiment.name, variable) == (self.experiment, self.quantity)
                if same and self.again in ("", label):
                    return np.where(sd > 0, sd, np.nan).ravel()
        return np.full(len(self.values), np.nan)


def measured_variables(idata: InferenceData) -> list[Measured]:
    """Return the measured variables that the response holds.

    Raises:
        ValueError: If there are none.
    """
    if not (every := read_measured(idata)):
        raise ValueError(
            "idata: no likelihood term says what was measured of the response "
            f"{list(dataset(idata, 'response').data_vars)} (its `observed`); a bare "
            "log-likelihood has no data to compare with"
        )
    return every


def measured_frequencies(
    idata: InferenceData, experiment: str | None = None
) -> Measured:
    """Return the measured frequencies, of one experiment of a joint posterior.

    Raises:
        ValueError: If there are none.
    """
    every = measured_variables(idata)
    for part in with_frequencies(every):
        if part.experiment == (experiment or ""):
            return part
    joint = any(part.experiment for part in every)
    remedy = "; name one of the experiments with experiment=" if joint else ""
    name = f"{experiment or ''}.frequency".removeprefix(".")
    raise ValueError(
        f"idata, experiment: no term has measured {name!r}; measured are "
        f"{[part.name for part in every]}{remedy}"
    )


def with_frequencies(every: Iterable[Measured]) -> list[Measured]:
    """Return the frequencies among all that was measured, one of each experiment."""
    return [part for part in every if part.quantity == "frequency" and not part.again]


def find_pairs(idata: InferenceData) -> list[str]:
    """Return the experiments of a joint posterior that pair modes, "" for a single."""
    response = dataset(idata, "response") if "response" in idata else ()
    return [experiment for experiment, last in map(split, response) if last == "mac"]


def split(name: object) -> tuple[str, str]:
    """Return experiment and quantity of a variable of an ArviZ object."""
    experiment, _, quantity = str(name).rpartition(".")
    return experiment, quantity


def read_measured(idata: InferenceData) -> list[Measured]:
    """Return every measured variable that the response holds; there may be none."""
    held: dict[str, Dataset] = {
        group: dataset(idata, group).data_vars if group in idata else {}
        for group in GROUPS
    }
    return [
        _read(held, str(name), variable)
        for name in held["observed_data"]
        if (variable := original_name(str(name), held["response"])) in held["response"]
    ]


def _read(held: Mapping[str, Dataset], name: str, variable: str) -> Measured:
    dims = list(map(str, held["response"][variable].dims))

    def align(values: Dataset) -> Dataset:
        """Return an array with the dimensions of the response."""
        return values.rename({d: original_name(str(d), dims) for d in values.dims})

    observed = align(held["observed_data"][name])

    def at_places(group: str, other: str) -> Dataset:
        """Return samples ``(n, m)`` or constants ``(1, m)`` where it was measured."""
        if other not in held[group]:
            return None
        values = align(held[group][other]).reindex_like(observed)
        if "chain" in values.dims:
            values = values.transpose("chain", "draw", *observed.dims)
        return values.values.reshape(-1, observed.size)

    initial = at_places("constant_data", f"initial_{variable}")
    predicted = at_places("response", variable)
    experiment, quantity = split(variable)
    modal = variable.removesuffix("frequency") if quantity == "frequency" else "no "
    places = product(*(observed[dim].values.tolist() for dim in observed.dims))
    return Measured(
        experiment=experiment,
        quantity=quantity,
        again=name.removeprefix(variable)[1:-1],
        unit=str(observed.attrs.get("units", "")),
        dims=", ".join(split(dim)[1] for dim in observed.dims),
        labels=tuple(", ".join(map(str, place)) for place in places),
        values=np.asarray(observed.values, dtype=float).ravel(),
        initial=np.full(observed.size, np.nan) if initial is None else initial[0],
        predicted=predicted,
        replicated=at_places("new_measurement", name),
        mac=at_places("response", f"{modal}mac"),
        model_mode=at_places("response", f"{modal}model_mode"),
    )


class Labelled(NamedTuple):
    """An array, and what its axes after those of the samples are."""

    values: Floats
    variable: Variable


def each_term(posterior: LogPosterior) -> Iterator[tuple[Experiment, Term, str]]:
    """Yield experiment, term and name of every term of a posterior."""
    for experiment in posterior.experiments:
        for term, name in zip(experiment.terms, experiment.term_names, strict=True):
            yield experiment, term, name


class AtTerm(NamedTuple):
    """What a term was given at samples.

    Attributes:
        experiment: Its experiment.
        term: The term.
        label: Its name, with that of the experiment.
        log_likelihood: The log-likelihood that it returned.
        given: Parameters and response.
    """

    experiment: Experiment
    term: Term
    label: str
    log_likelihood: Floats
    given: tuple[Parameters, Stored]


def at_terms(
    posterior: LogPosterior, draws: Floats, rows: Floats, only: str | None
) -> Iterator[AtTerm]:
    """Yield what each term, or ``only`` one, was given at samples ``(..., d)``."""
    parameters = posterior.parameters(draws.reshape(-1, posterior.ndim))
    response = posterior.unfold(rows.reshape(-1, rows.shape[-1]))
    for column, (experiment, term, name) in enumerate(each_term(posterior), 2):
        label = experiment.full_name(name)
        if only in (None, label):
            given = parameters, experiment.stored(response)
            yield AtTerm(experiment, term, label, rows[..., column], given)


def gather_likelihoods(
    posterior: LogPosterior, draws: Floats, rows: Floats, only: str | None = None
) -> dict[str, Labelled]:
    """Return the log-likelihood of each datum by term, or that of ``only`` one."""
    lead = draws.shape[:-1]
    found: dict[str, Labelled] = {}
    for at in at_terms(posterior, draws, rows, only):
        found[at.label] = Labelled(at.log_likelihood, ONE_NUMBER)
        for variable, values in at.term.pointwise(*at.given).items():
            found[at.label] = _label(at.experiment, at.term, variable, values, *lead)
    return found


def gather_measurements(
    posterior: LogPosterior, draws: Floats, rows: Floats, only: str | None = None
) -> dict[str, Labelled]:
    """Return a new measurement for each sample by variable, where terms draw some."""
    rng = np.random.default_rng(0)  # the same draws at each conversion
    names, lead = _name_measured(posterior), draws.shape[:-1]
    return {
        names[at.label, variable]: _label(at.experiment, at.term, variable, new, *lead)
        for at in at_terms(posterior, draws, rows, only)
        for variable, new in at.term.replicate(rng, *at.given).items()
    }


def side_by_side(parts: Mapping[str, Labelled], lead: int) -> Labelled:
    """Concatenate all parts along one labelled dimension."""
    labels = [
        f"{name}[{', '.join(map(str, place))}]" if place else name
        for name, part in parts.items()
        for place in product(*part.variable.coords.values())
    ]
    flat = [v.reshape(*v.shape[:lead], -1) for v, _ in parts.values()]
    return Labelled(np.concatenate(flat, axis=-1), Variable({"datum": labels}))


def gather_observed(posterior: LogPosterior) -> dict[str, Labelled]:
    """Return measured values by variable, repeated ones with their term's name."""
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
    """Label what a term returns by its dimensions, and split its first axis.

    If the term has no labels, or fewer, those of the response are used.
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
