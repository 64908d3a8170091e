"""Whether model, likelihood terms and prior fit together, before the first FE solve."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Prior, Variable, declared_variables

# Names that ArviZ objects have for other things.
RESERVED = {"chain", "draw", "step", "ensemble", "walker", "parameter"}
CONSTANTS = {"lower", "upper", "initial", "prior_mean", "prior_sd", "is_error"}


def check_types(model: Any, terms: tuple[Any, ...], prior: Any) -> None:
    """Refuse what is not a model, a sequence of terms, or a prior."""
    if not callable(model):
        raise TypeError(f"model: expected a callable, got {model!r}")
    if not terms:
        raise ValueError("terms: expected at least one likelihood term, got none")
    for term in terms:
        if not callable(term):
            raise TypeError(f"terms: expected callables, got {term!r}")
    for attribute in ("names", "bounds", "logpdf", "sample"):
        if not hasattr(prior, attribute):
            raise TypeError(
                f"prior: expected names, bounds, logpdf and sample, but "
                f"{type(prior).__name__} has no {attribute}; see GaussianPrior"
            )
    shape = (len(prior.names), 2)
    if not isinstance(prior.bounds, np.ndarray) or prior.bounds.shape != shape:
        raise TypeError(
            f"prior: expected bounds as an array (low, high) of shape {shape}, one row "
            f"for each of {list(prior.names)}, got {prior.bounds!r}"
        )


def name_terms(terms: tuple[Any, ...]) -> tuple[str, ...]:
    """Return the distinct labels of terms: their name, or that of the function."""
    given = [
        str(getattr(term, "name", None) or getattr(term, "__name__", ""))
        for term in terms
    ]
    # Of a lambda it would be one that netCDF does not take.
    names = tuple(
        f"term{i}" if name in ("", "<lambda>") else name for i, name in enumerate(given)
    )
    return checks.parameter_names("terms (their names)", names)


def check_parameters(models: tuple[Any, ...], terms: Sequence[Any], prior: Any) -> None:
    """Refuse a prior whose names or bounds do not fit the models and terms."""
    lower = dict(zip(prior.names, prior.bounds[:, 0].tolist(), strict=True))
    for reader in (*models, *terms):
        for name in getattr(reader, "positive", ()):
            if lower.get(name, 0.0) < 0:
                raise ValueError(
                    f"prior: {name!r} must stay above zero for "
                    f"{type(reader).__name__}, but its lower bound is "
                    f"{lower[name]:g}; give it bounds with low >= 0"
                )
    for model in models:
        _check_model_bounds(getattr(model, "bounds", None), prior)
    read = {name for term in terms for name in getattr(term, "names", ())}
    required = {name for model in models for name in getattr(model, "required", ())}
    missing = sorted((read | required) - set(prior.names))
    if missing:
        raise ValueError(f"prior: no parameter {missing}, which model or terms need")
    for model in models:
        known = getattr(model, "names", None)
        if known is None:  # the model reads what it likes
            return
        read |= set(known)
    unread = [name for name in prior.names if name not in read]
    if unread:
        raise ValueError(
            f"prior: neither a model nor a term reads {unread}; they read "
            f"{sorted(read)}"
        )


def _check_model_bounds(bounds: Any, prior: Prior) -> None:
    """Refuse a prior that reaches beyond where the model holds."""
    for name, (low, high) in (bounds or {}).items():
        if name not in prior.names:
            continue  # named by the check of what the model needs
        least, most = prior.bounds[prior.names.index(name)].tolist()
        if least < low or most > high:
            raise ValueError(
                f"prior: {name!r} has bounds ({least:g}, {most:g}), but the model "
                f"holds within ({low:g}, {high:g}); give the prior such bounds, as in "
                f"IndependentPrior({{...}}, bounds={{{name!r}: ({low:g}, {high:g})}}), "
                "or widen the model"
            )


def declare(model: Any, terms: Sequence[Any]) -> dict[str, Variable]:
    """Return the variables of a model's response, and check that they suffice.

    A model that declares none is taken at the word of the terms that read it.

    Raises:
        TypeError: If something declared is not a :class:`Variable`.
        ValueError: If nothing is declared, or a term needs what is not declared.
    """
    declared = declared_variables(model)
    needed: dict[str, Variable] = {}
    for term in terms:
        for name, variable in getattr(term, "reads", {}).items():
            if declared is not None:
                _check_read(term, name, variable, declared)
            elif name not in needed or needed[name].size < variable.size:
                needed[name] = variable
    if declared is None:
        declared = needed
        if not needed:
            raise ValueError(
                "model: what does it return? Neither it nor a term declares variables; "
                "write FunctionModel(function, n_modes=...) or FunctionModel(function, "
                "variables={name: Variable(...)}), or give it an attribute variables"
            )
    for name, variable in declared.items():
        if not isinstance(variable, Variable):
            raise TypeError(
                f"model: expected a Variable for {name!r} of its variables, got "
                f"{variable!r}"
            )
    for term in terms:
        _check_observed(term, declared)
    return dict(declared)


def _check_observed(term: Any, declared: Mapping[str, Variable]) -> None:
    """Refuse measured values that no variable has room for."""
    for name, values in getattr(term, "observed", {}).items():
        variable = getattr(term, "reads", {}).get(name) or declared.get(name)
        expected = None if variable is None else variable.shape
        if np.shape(values) != expected:
            raise ValueError(
                f"terms: {getattr(term, 'name', term)!r} observed {name!r} of shape "
                f"{np.shape(values)}, but it is read or returned with {expected}; "
                f"there are {list(declared)}"
            )


def _check_read(
    term: Any, name: str, needed: Variable, declared: Mapping[str, Variable]
) -> None:
    label = repr(getattr(term, "name", term))
    if name not in declared:
        raise ValueError(
            f"terms: {label} reads {name!r}, which the model does not return; it "
            f"returns {list(declared)}" + _REMEDIES.get(name, "")
        )
    given = declared[name]
    if not given.stored and not given.coords:  # of a shape that is not known
        return
    if given.dims != needed.dims:
        raise ValueError(
            f"terms: {label} reads {name!r} with the dimensions {needed.dims}, but the "
            f"model returns {given.dims}"
        )
    if given.unit != needed.unit and given.unit and needed.unit:
        raise ValueError(
            f"terms: {label} measured {name!r} in {needed.unit}, but the model returns "
            f"it in {given.unit}; convert what was measured, or say unit= where both "
            "are the same"
        )
    for dim, labels in needed.coords.items():
        there = list(given.coords[dim])
        if len(labels) > len(there):
            raise ValueError(
                f"terms: {label} compares {len(labels)} of {name!r} along {dim!r}, but "
                f"the model returns {len(there)}; ask it for more"
            )
        if None in labels:  # known by their places only
            continue
        # Terms read by place, the first of the modes for instance; only DOFs that are
        # all there are picked by their numbers.
        picked = dim == "dof" and there == list(range(len(there)))
        if list(labels) != there[: len(labels)] and not (
            picked and set(labels) <= set(there)
        ):
            measured, returned = list(labels), there
            if len(measured) > MOST_SHOWN:  # the first that differ
                pairs = zip(measured, there, strict=False)
                at = [one != other for one, other in pairs].index(True)
                measured, returned = measured[at : at + 3], there[at : at + 3]
            raise ValueError(
                f"terms: {label} was measured at {dim} {measured}, but the model "
                f"returns {name!r} at {returned}; give both the same, in the same order"
            )


MOST_SHOWN = 20
_REMEDIES = {"shapes": "; ask it for shapes (shapes=True, or the DOFs of the sensors)"}
_REMEDIES |= dict.fromkeys(
    ("receptance", "mobility", "accelerance"),
    "; kind= of FRFModel must be that of the measurements",
)


def check_names(
    prior: Any, variables: Mapping[str, Variable], terms: Sequence[str]
) -> None:
    """Refuse names that ArviZ objects need, and dimensions with two meanings."""
    for what, names in (("prior", prior.names), ("model", variables), ("terms", terms)):
        for name in names:
            if name in RESERVED or "/" in name:
                raise ValueError(
                    f"{what}: ArviZ has no place for the name {name!r} (nor for any of "
                    f"{sorted(RESERVED)}, or with a slash); rename it"
                )
    known: dict[str, list[Any]] = {}
    for name, variable in variables.items():
        for dim, labels in variable.coords.items():
            if dim in RESERVED | CONSTANTS or "/" in dim or dim in variables:
                raise ValueError(
                    f"model: ArviZ needs the name of the dimension {dim!r} of {name!r} "
                    "for something else; rename it"
                )
            if known.setdefault(dim, list(labels)) != list(labels):
                raise ValueError(
                    f"model: the dimension {dim!r} of {name!r} has other labels than "
                    "that of another variable; give it a name of its own"
                )
    taken = sorted(set(known) & set(prior.names))
    if taken:
        raise ValueError(f"prior: {taken} are names of dimensions; rename them")
