r"""The standard deviations of measurement errors, for what a model returns.

.. math:: \sigma_i = \Big[ \sum_{terms} F_{ii} \Big]^{-1/2}

with the Fisher information :math:`F_{ii}` that the terms have about ordinate i of a
response. An emulator's error in these units says whether it matters.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..interfaces import Floats, Parameters, read
from ..models.paired import PairedModel
from .marginal import expand

UNREAD = 3.0  # times the usual error: a mode that no term reads matters less
STEP = 1e-3  # of a variable's size, for terms that cannot be linearized


def find_units(
    model: Any, terms: Sequence[Any], parameters: Parameters, response: Any
) -> dict[str, Floats]:
    """Return the standard deviations ``{variable: (*shape)}`` of an experiment.

    Those of a response that the terms read; for a :class:`PairedModel` those of the
    model inside. Modes that are not compared get three times the usual relative error.
    Shapes have one for all sensors of a mode. Information is averaged over the points.

    Args:
        model: That of the experiment.
        terms: Its terms.
        parameters: ``{name: (n,)}``, inferred errors among them.
        response: What the model returned there; of a PairedModel what the model inside
            returned.

    Raises:
        ValueError: If the terms have no information about any variable.
    """
    compared, chosen = response, None
    if isinstance(model, PairedModel):
        compared = model.pair(response)
        chosen = compared.model_mode - 1
    names = _read_variables(model, terms)
    values = {name: np.asarray(read(compared, name), dtype=float) for name in names}
    known = _inform(terms, parameters, compared, values) if names else {}
    units = {}
    for name, information in known.items():
        if not (information > 0).any():
            continue
        size = np.abs(values[name])
        if name == "shapes" and information.ndim == 3:
            size = np.linalg.norm(values[name], axis=1)
            information = information.mean(axis=1)
        relative = information * size**2  # (n, *shape), or (n, n_modes)
        raw = np.asarray(read(response, name), dtype=float)
        if name == "shapes" and raw.ndim == 3:
            size = np.linalg.norm(raw, axis=1)
        elif chosen is not None:
            size = np.abs(raw)
        if chosen is not None and name in ("frequency", "shapes"):
            relative = _place(relative, chosen, size.shape)
        unit = _divide(relative, np.sqrt((size**2).mean(axis=0)))
        if name == "shapes" and raw.ndim == 3:
            unit = np.broadcast_to(unit, raw.shape[1:]).copy()
        units[name] = unit
    if not units:
        raise ValueError(
            "terms: they tell nothing about what the model returns; give units, "
            "{variable: standard deviations of its measurement error}"
        )
    return units


def _read_variables(model: Any, terms: Sequence[Any]) -> list[str]:
    """Return the variables that the terms read, all if one does not say which."""
    if all(hasattr(term, "reads") for term in terms):
        return list(dict.fromkeys(name for term in terms for name in term.reads))
    declared = getattr(model, "variables", None) or {}
    found = {name for name, variable in declared.items() if variable.stored}
    found |= {name for term in terms for name in getattr(term, "reads", {})}
    return sorted(found - {"mac", "model_mode", "unpaired"})


def _inform(
    terms: Sequence[Any],
    parameters: Parameters,
    response: Any,
    values: dict[str, Floats],
) -> dict[str, Floats]:
    """Return the information ``{variable: (n, *shape)}`` about each ordinate."""
    n = len(next(iter(values.values())))
    scales = {
        name: STEP * max(float(np.abs(value).mean()), 1e-300)
        for name, value in values.items()
    }
    sizes = [value[0].size for value in values.values()]
    ends = np.cumsum([0, *sizes])
    tangents = {name: np.zeros((n, ends[-1])) for name in parameters}
    for (name, value), begin in zip(values.items(), ends, strict=False):
        unit = np.zeros((value[0].size, ends[-1]))
        unit[:, begin : begin + len(unit)] = scales[name] * np.eye(len(unit))
        unit = unit.reshape(*value.shape[1:], -1)
        tangents[name] = np.broadcast_to(unit, (n, *unit.shape))
    total = np.zeros((n, ends[-1]))
    for term in terms:
        log_density = term(parameters, response)
        information = expand(term, parameters, response, tangents, log_density)[1]
        found = np.diagonal(information, axis1=1, axis2=2)
        total += np.where(np.isfinite(found), found, 0.0)
    return {
        name: total[:, begin : begin + value[0].size].reshape(value.shape)
        / scales[name] ** 2
        for (name, value), begin in zip(values.items(), ends, strict=False)
    }


def _place(relative: Floats, chosen: Any, shape: tuple[int, ...]) -> Floats:
    """Return what is known of measured modes at the candidates, NaN elsewhere."""
    placed = np.full(shape, np.nan)
    np.put_along_axis(placed, chosen, relative, axis=1)
    return placed


def _divide(relative: Floats, size: Floats) -> Floats:
    """Return the standard deviations; where nothing is known, some usual ones."""
    there = np.isfinite(relative)
    count = np.maximum(there.sum(axis=0), 1)
    mean = np.where(there, relative, 0.0).sum(axis=0) / count
    errors = np.sqrt(np.divide(1.0, mean, out=np.zeros_like(mean), where=mean > 0))
    result: Floats = size * np.where(
        mean > 0, errors, UNREAD * np.median(errors[mean > 0])
    )
    return result
