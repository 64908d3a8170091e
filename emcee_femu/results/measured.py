"""What was measured, and what an ArviZ object holds at the same places."""

from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..interfaces import Floats
from .arviz_objects import dataset


class Measured(NamedTuple):
    """A measured variable.

    Attributes:
        name: Name of the variable, such as ``"frequency"`` or ``"empty.frequency"``.
        unit: Its unit, or an empty string.
        dims: Its dimensions in words, such as ``"mode"``.
        labels: One label per place, such as ``"3"`` or ``"left, 3"``.
        values: What was measured there, ``(m,)``.
    """

    name: str
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
    found = [
        _measured(str(name), values)
        for name, values in _observed(idata).items()
        if name in response
    ]
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
        raise ValueError(
            f"idata: no likelihood term has measured {name!r}; measured are "
            f"{list(observed)}. Name an experiment with experiment="
        )
    return _measured(name, observed[name])


def at_places(idata: Any, group: str, variable: str, like: Measured) -> Floats | None:
    """Return a variable where another one was measured, None if there is none.

    Samples have shape ``(n, m)``, constants ``(1, m)``.
    """
    try:
        values = dataset(idata, group)[variable]
    except (KeyError, ValueError):
        return None
    observed = _observed(idata)[like.name]
    values = values.reindex_like(observed)
    if "chain" in values.dims:
        values = values.transpose("chain", "draw", *observed.dims)
    result: Floats = values.values.reshape(-1, observed.size)
    return result


def _observed(idata: Any) -> dict[str, Any]:
    try:
        return dict(dataset(idata, "observed_data").data_vars)
    except ValueError:  # nothing was measured
        return {}


def _measured(name: str, values: Any) -> Measured:
    places = product(*(values[dim].values.tolist() for dim in values.dims))
    return Measured(
        name=name,
        unit=str(values.attrs.get("unit", "")),
        dims=", ".join(str(dim).rpartition(".")[2] for dim in values.dims),
        labels=tuple(", ".join(map(str, place)) for place in places),
        values=np.asarray(values.values, dtype=float).ravel(),
    )
