"""Whether model, likelihood terms and prior fit together, before the first FE solve."""

from typing import Any

from ..interfaces import Prior

RESERVED = {"chain", "draw", "ensemble", "walker", "mode"}  # dimensions in ArviZ


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


def check_names(model: Any, terms: tuple[Any, ...], prior: Prior) -> None:
    """Refuse a prior whose names or bounds do not fit the model and the terms."""
    reserved = sorted(RESERVED & set(prior.names))
    if reserved:
        raise ValueError(f"prior: ArviZ needs the names {reserved} itself; rename them")
    lower = dict(zip(prior.names, prior.bounds[:, 0].tolist(), strict=True))
    for reader in (model, *terms):
        for name in getattr(reader, "positive", ()):
            if lower.get(name, 0.0) < 0:
                raise ValueError(
                    f"prior: {name!r} must stay above zero for "
                    f"{type(reader).__name__}, but its lower bound is "
                    f"{lower[name]:g}; give it bounds with low >= 0"
                )
    _check_model_bounds(getattr(model, "bounds", None), prior)
    read = {name for term in terms for name in getattr(term, "names", ())}
    missing = sorted((read | set(getattr(model, "required", ()))) - set(prior.names))
    if missing:
        raise ValueError(f"prior: no parameter {missing}, which model or terms need")
    known = getattr(model, "names", None)
    if known is None:  # the model reads what it likes
        return
    unread = [name for name in prior.names if name not in read | set(known)]
    if unread:
        raise ValueError(
            f"prior: neither the model nor a term reads {unread}; the model reads "
            f"{sorted(known)}"
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


def stored_modes(model: Any, terms: tuple[Any, ...]) -> int:
    """Return how many frequencies of a solution are stored."""
    compared = max((getattr(term, "n_modes", 0) for term in terms), default=0)
    available = getattr(model, "n_modes", None)
    if available is None:
        if not compared:
            raise ValueError(
                "model: how many frequencies does it return? Neither the model nor a "
                "term has n_modes; write FunctionModel(function, n_modes=...)"
            )
        return int(compared)
    if compared > available:
        raise ValueError(
            f"terms: {compared} modes were measured, but the model returns "
            f"{available}; ask it for more modes"
        )
    return int(available)
