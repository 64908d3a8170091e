"""Whether model, likelihood terms and prior fit together, before the first FE solve."""

from collections.abc import Mapping, Sequence

import numpy as np

from .. import checks
from ..contracts import Model, Prior, Variable, read_declared
from ..likelihoods.term import ERROR_PRIOR, Term

# Names that ArviZ objects have for other things.
RESERVED = {"chain", "draw", "step", "ensemble", "walker", "parameter"}
CONSTANTS = {"lower", "upper", "initial", "prior_mean", "prior_sd", "is_error"}
# What a model was perhaps not asked for.
REMEDIES = {"shapes": "; ask it for shapes (shapes=True, or the DOFs of the sensors)"}
REMEDIES |= dict.fromkeys(
    ("receptance", "mobility", "accelerance"),
    "; kind= of FRFModel must be that of the measurements",
)
ORDER = "the order is LogPosterior(model, terms, prior)"


def check_prior(prior: Prior) -> None:
    """Refuse what is not a prior."""
    if missing := {"names", "bounds", "logpdf", "sample"}.difference(dir(prior)):
        cure = "see GaussianPrior"
        if isinstance(prior, Mapping):
            cure = "IndependentPrior(..) makes a prior of it"
        elif callable(prior):
            cure = ORDER
        elif isinstance(prior, list | tuple | np.ndarray) and len(prior):
            if np.shape(prior[0]) == (2,):
                first = ", ".join(map(str, prior[0]))
                cure = f'bounds need names: IndependentPrior({{"a": ({first}), ...}})'
            elif isinstance(prior[0], str):
                example = f"{{{prior[0]!r}: (low, high), ...}}"
                cure = f"names need bounds: IndependentPrior({example})"
        raise TypeError(
            "prior: expected names, bounds, logpdf and sample, but "
            f"{type(prior).__name__} has no {min(missing)}; {cure}"
        )
    names, bounds = [*prior.names], prior.bounds
    if len({*names}) < len(names):
        raise ValueError(f"prior: expected different names, got {names}")
    shape = (len(names), 2)
    usable = type(bounds) is np.ndarray and bounds.shape == shape
    if not usable or bounds.dtype.kind != "f":
        raise TypeError(
            f"prior: expected bounds as an array of floats (low, high), of shape "
            f"{shape}, one row for each of {names}, got {bounds!r}"
        )
    for name, (low, high) in zip(names, bounds.tolist(), strict=True):
        if not low < high:  # never for NaN
            raise ValueError(
                f"prior: expected bounds (low, high) with low < high, got ({low:g}, "
                f"{high:g}) for {name!r}"
            )


def check_terms(model: object, terms: Sequence[object]) -> None:
    """Refuse what is not a model, or a sequence of terms."""
    if not terms:
        raise ValueError("terms: expected at least one likelihood term, got none")
    for argument, part in (("model", model), *(("terms", term) for term in terms)):
        checks.function(argument, part)
    if read_declared(model, "reads") is not None:  # as terms do
        raise TypeError(f"model: {type(model).__name__} is a likelihood term; {ORDER}")


def check_parameters(
    models: Sequence[Model], terms: Sequence[Term], prior: Prior
) -> None:
    """Refuse a prior whose names or bounds do not fit the models and terms."""
    read: set[str] = set()
    for reader in (*models, *terms):
        names = read_declared(reader, "names") or ()
        bounds = read_declared(reader, "bounds") or {}
        if missing := sorted({*names} - {*prior.names}):
            remedy = f"; add {missing[0]!r}: {ERROR_PRIOR}, or its own range"
            raise ValueError(
                f"prior: no parameter {missing}, which {type(reader).__name__} needs; "
                f"there are {[*prior.names]}{remedy * (reader in terms)}"
            )
        read |= {*names, *bounds}
        for name in bounds.keys() & {*prior.names}:
            least, most = prior.bounds[prior.names.index(name)].tolist()
            low, high = bounds[name]
            if least < low or most > high:
                raise ValueError(
                    f"prior: {name!r} has bounds ({least:g}, {most:g}), but "
                    f"{type(reader).__name__} holds within ({low:g}, {high:g}); give "
                    "the prior bounds inside these, as IndependentPrior({...}, "
                    f"bounds={{{name!r}: ({low:g}, {high:g})}}), or widen the model"
                )
    unread = [name for name in prior.names if name not in read]
    # A model that declares no names reads what it likes.
    if unread and all(read_declared(model, "names") is not None for model in models):
        raise ValueError(f"prior: no model or term reads {unread}, only {sorted(read)}")


def declare(model: Model, terms: Sequence[Term]) -> Mapping[str, Variable]:
    """Return the variables of a model's response, and check that they suffice.

    A model that declares none is taken at the word of the terms that read it.

    Raises:
        TypeError: If something declared is not a :class:`Variable`.
        ValueError: If nothing is declared, or a term needs what is not declared.
    """
    needs = [(t, *item) for t in terms for item in (t.reads or {}).items()]
    declared: dict[str, Variable] | None = read_declared(model, "variables")
    if declared is None and not needs:
        raise ValueError(
            "model: what does it return? Neither it nor a term declares variables; "
            "write FunctionModel(function, n_modes=...) or FunctionModel(function, "
            "variables={name: Variable(...)}), or give it an attribute variables"
        )
    if declared is None:  # the largest of each name that terms need
        declared = {}
        for _, name, variable in needs:
            usual = declared.get(name, variable)
            declared[name] = max(usual, variable, key=lambda v: v.size)
    for name, variable in declared.items():
        checks.instance(f"model (its variables, {name!r})", variable, Variable)
    for term, name, variable in needs:
        if name not in declared:
            raise ValueError(
                f"terms: {term.name!r} reads {name!r}, which the model does not "
                f"return; it returns {list(declared)}" + REMEDIES.get(name, "")
            )
        if wrong := _compare(variable, declared[name]):
            raise ValueError(f"terms: {term.name!r} reads {name!r} {wrong}")
    for term in terms:
        for name, values in term.observed.items():
            read = (term.reads or {}).get(name) or declared.get(name)
            if read is None or np.shape(values) != read.shape:
                raise ValueError(
                    f"terms: {term.name!r} observed {name!r} of shape "
                    f"{np.shape(values)}, but it is read or returned with "
                    f"{read and read.shape}; there are {list(declared)}"
                )
    return declared


def _compare(needed: Variable, returned: Variable) -> str:
    """Return how a variable differs from what a term reads; empty if it does not."""
    if not returned.stored and not returned.coords:  # of a shape that is not known
        return ""
    if returned.dims != needed.dims:
        return f"with dimensions {needed.dims}, but the model returns {returned.dims}"
    if returned.unit and needed.unit and returned.unit != needed.unit:
        return (
            f"measured in {needed.unit}, but the model returns it in {returned.unit}; "
            "convert the measurement, or set unit= if both are the same"
        )
    for dim, labels in needed.coords.items():
        there = list(returned.coords[dim])
        if len(labels) > len(there):
            at = f"at {len(labels)} {dim}s"
            return f"{at}, but the model returns {len(there)}; ask it for more"
        # Terms read by place, the first of the modes for instance; only DOFs that are
        # all there are picked by their numbers. None is known by its place only.
        picked = dim == "dof" and there == list(range(len(there)))
        differs = [
            label not in there if picked else label != other
            for label, other in zip(labels, there, strict=False)
        ]
        if None not in labels and any(differs):
            shown = slice(differs.index(True), differs.index(True) + 3)
            return (
                f"measured at {dim} {list(labels[shown])}, but the model returns it at "
                f"{there[shown]}; give both the same, in the same order"
            )
    return ""


def check_names(
    prior: Prior, variables: Mapping[str, Variable], terms: Sequence[str]
) -> None:
    """Refuse names that ArviZ objects need, and dimensions with two meanings."""
    for what, names in (("prior", prior.names), ("model", variables), ("terms", terms)):
        for name in names:
            if name in RESERVED or "/" in name:
                raise ValueError(
                    f"{what}: ArviZ has no place for the name {name!r} (nor for any of "
                    f"{sorted(RESERVED)}, or with a slash); rename it"
                )
    labels_of: dict[str, Sequence[object]] = {}
    taken = RESERVED | CONSTANTS | {*variables, *prior.names}
    for name, variable in variables.items():
        for dim, labels in variable.coords.items():
            same = list(labels_of.setdefault(dim, labels)) == list(labels)
            if dim in taken or "/" in dim or not same:
                raise ValueError(
                    f"model: the name of the dimension {dim!r} of {name!r} is "
                    "already used, for example with other labels; rename it"
                )
