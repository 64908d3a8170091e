"""What was measured, and what an ArviZ object holds at the same places."""

from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..interfaces import Floats
from .arviz_objects import dataset
from .dimensions import original_name


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


def measured_variables(idata: Any) -> list[Measured]:
    """Return the measured variables that the response holds.

    Raises:
        ValueError: If there are none.
    """
    response = dataset(idata, "response")
    every = [_measured(idata, str(name)) for name in _observed(idata)]
    found = [own for own in every if own.variable in response]
    if not found:
        raise ValueError(
            "idata: no likelihood term says what it measured of the response "
            f"{list(response.data_vars)}"
        )
    return found


def measured_frequencies(idata: Any, experiment: str | None = None) -> Measured:
    """Return the measured frequencies, of one experiment of a joint posterior.

    Raises:
        ValueError: If there are none.
    """
    name = "frequency" if experiment is None else f"{experiment}.frequency"
    observed = _observed(idata)
    if name not in observed:
        joint = any("." in str(other) for other in observed)
        raise ValueError(
            f"idata, experiment: no term has measured {name!r}; measured are "
            f"{list(observed)}"
            + ("; name one of the experiments with experiment=" if joint else "")
        )
    return _measured(idata, name)


def at_places(idata: Any, group: str, variable: str, like: Measured) -> Floats | None:
    """Return a variable where another one was measured, None if there is none.

    Samples have shape ``(n, m)``, constants ``(1, m)``.
    """
    try:
        values = dataset(idata, group)[variable]
    except (KeyError, ValueError):
        return None
    dims = _response_dims(idata, like.variable)
    observed = _rename(_observed(idata)[like.name], dims)
    values = _rename(values, dims).reindex_like(observed)
    if "chain" in values.dims:
        values = values.transpose("chain", "draw", *observed.dims)
    result: Floats = values.values.reshape(-1, observed.size)
    return result


def _observed(idata: Any) -> dict[str, Any]:
    try:
        return dict(dataset(idata, "observed_data").data_vars)
    except ValueError:  # nothing was measured
        return {}


def _response(idata: Any) -> Any:
    try:
        return dataset(idata, "response")
    except ValueError:
        return {}


def _response_dims(idata: Any, variable: str) -> list[str]:
    response = _response(idata)
    return list(map(str, response[variable].dims)) if variable in response else []


def _rename(values: Any, dims: list[str]) -> Any:
    """Return an array with the dimensions of the response."""
    return values.rename({dim: original_name(str(dim), dims) for dim in values.dims})


def _measured(idata: Any, name: str) -> Measured:
    values = _observed(idata)[name]
    variable = original_name(name, _response(idata))
    values = _rename(values, _response_dims(idata, variable))
    places = product(*(values[dim].values.tolist() for dim in values.dims))
    return Measured(
        name=name,
        variable=variable,
        unit=str(values.attrs.get("unit", "")),
        dims=", ".join(str(dim).rpartition(".")[2] for dim in values.dims),
        labels=tuple(", ".join(map(str, place)) for place in places),
        values=np.asarray(values.values, dtype=float).ravel(),
    )
