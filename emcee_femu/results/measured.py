"""What was measured, and what an ArviZ object holds at the same places."""

from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from .arviz_objects import InferenceData, dataset
from .to_arviz import original_name


class Measured(NamedTuple):
    """A measured variable.

    Attributes:
        name: Its name, such as ``"frequency"``, ``"empty.frequency"`` or, measured a
            second time, ``"frequency[term]"``.
        variable: Its name in the response, such as ``"frequency"``.
        unit: Its unit, or an empty string.
        dims: Its dimensions in words, such as ``"mode"``.
        labels: One label per place, such as ``"3"`` or ``"left, 3"``.
        values: What was measured there, ``(m,)``.
    """

    name: str
    variable: str
    unit: str
    dims: str
    labels: tuple[str, ...]
    values: Floats


def measured_variables(idata: InferenceData) -> list[Measured]:
    """Return the measured variables that the response holds.

    Raises:
        ValueError: If there are none.
    """
    response = dataset(idata, "response")
    every = [_measured(idata, str(name)) for name in _group(idata, "observed_data")]
    among = [measured for measured in every if measured.variable in response]
    if not among:
        raise ValueError(
            "idata: no likelihood term says what it measured of the response "
            f"{list(response.data_vars)}"
        )
    return among


def measured_frequencies(
    idata: InferenceData, experiment: str | None = None
) -> Measured:
    """Return the measured frequencies, of one experiment of a joint posterior.

    Raises:
        ValueError: If there are none.
    """
    name = "frequency" if experiment is None else f"{experiment}.frequency"
    observed = [str(other) for other in _group(idata, "observed_data")]
    if name not in observed:
        joint = any("." in other for other in observed)
        raise ValueError(
            f"idata, experiment: no term has measured {name!r}; measured are {observed}"
            + ("; name one of the experiments with experiment=" if joint else "")
        )
    return _measured(idata, name)


def at_places(
    idata: InferenceData, group: str, variable: str, like: Measured
) -> Floats | None:
    """Return a variable where another one was measured, None if there is none.

    Samples have shape ``(n, m)``, constants ``(1, m)``.
    """
    values = _group(idata, group).get(variable)
    if values is None:
        return None
    observed = _aligned(idata, _group(idata, "observed_data")[like.name], like.variable)
    values = _aligned(idata, values, like.variable).reindex_like(observed)
    if "chain" in values.dims:
        values = values.transpose("chain", "draw", *observed.dims)
    result: Floats = values.values.reshape(-1, observed.size)
    return result


def mac_at_places(
    idata: InferenceData, measured: Measured, what: str = "mac"
) -> Floats | None:
    """Return the MAC ``(n, m)`` of measured frequencies, None if none were paired."""
    experiment, dot, variable = measured.variable.rpartition(".")
    if variable != "frequency":
        return None
    return at_places(idata, "response", f"{experiment}{dot}{what}", measured)


def measurement_sd(measured: Measured, posterior: LogPosterior) -> Floats:
    """Return the standard deviations of what was measured, NaN where unknown."""
    for experiment in posterior.experiments:
        for term, label in zip(experiment.terms, experiment.term_names, strict=True):
            for variable, sd in term.error_sd.items():
                name = experiment.full_name(variable)
                if measured.name in (name, f"{name}[{label}]") and np.array_equal(
                    np.ravel(term.observed[variable]), measured.values
                ):
                    return np.where(sd > 0, sd, np.nan).ravel()
    return np.full(len(measured.values), np.nan)


def total_average_error(measured: Floats, frequencies: Floats) -> Floats:
    """Return the mean of ``|f_m - f| / f_m`` over the measured modes, in percent."""
    errors = np.abs(frequencies[..., : len(measured)] / measured - 1)
    result: Floats = 100 * errors.mean(axis=-1)
    return result


def _group(idata: InferenceData, group: str) -> Any:
    """Return the variables of a group; none of a group that is not there."""
    try:
        return dataset(idata, group).data_vars
    except ValueError:
        return {}


def _aligned(idata: InferenceData, values: Any, variable: str) -> Any:
    """Return an array with the dimensions of a variable of the response."""
    response = _group(idata, "response")
    dims = list(map(str, response[variable].dims)) if variable in response else []
    return values.rename({dim: original_name(str(dim), dims) for dim in values.dims})


def _measured(idata: InferenceData, name: str) -> Measured:
    variable = original_name(name, _group(idata, "response"))
    values = _aligned(idata, _group(idata, "observed_data")[name], variable)
    places = product(*(values[dim].values.tolist() for dim in values.dims))
    return Measured(
        name=name,
        variable=variable,
        unit=str(values.attrs.get("unit", "")),
        dims=", ".join(str(dim).rpartition(".")[2] for dim in values.dims),
        labels=tuple(", ".join(map(str, place)) for place in places),
        values=np.asarray(values.values, dtype=float).ravel(),
    )
