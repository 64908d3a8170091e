"""A readable record of what is sampled, which a resumed run must match.

What can be read of the posterior is compared by entry; what cannot, such as the code
of a model and the files that it reads, is found by ``probe.probe``.
"""

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence, Set
from importlib.metadata import version
from inspect import signature
from math import isclose
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from ..posterior.log_posterior import LogPosterior
from .arguments import Settings

PACKAGES = ("emcee_femu", "emcee", "numpy", "scipy")
SHOWN = 512  # numbers of an array; of a larger one the digest is kept
ABSENT = "absent"
OWN = __name__.partition(".")[0]


def describe_run(settings: Settings) -> dict[str, Any]:
    """Return what is sampled and how, as JSON has it."""
    return describe(
        settings.posterior,
        moves="auto" if settings.moves is None else settings.moves,
        nwalkers=settings.nwalkers,
        ensembles=settings.ensembles,
        thin_by=settings.thin_by,
        seed=settings.seed,
        initial=None if settings.initial is None else _digest(settings.initial),
    )


def describe(posterior: LogPosterior, **settings: Any) -> dict[str, Any]:
    """Return a posterior, and the settings of what samples it, as JSON has it."""
    variables = posterior.variables.items()
    terms = zip(posterior.term_names, posterior.terms, strict=True)
    entries = {
        "parameters": posterior.names,
        "bounds": dict(zip(posterior.names, posterior.prior.bounds, strict=True)),
        "prior": posterior.prior,
        "terms": {name: _term(term) for name, term in terms},
        "stored": {
            name: dict(zip(v.dims, v.shape, strict=True)) for name, v in variables
        },
        **settings,
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in PACKAGES},
        },
    }
    described: dict[str, Any] = json.loads(json.dumps(_readable(entries)))
    return described


def _term(term: Any) -> Any:
    """Describe a term of this package by its settings, another by what it measured."""
    if _package(type(term)) == OWN:
        parts = _settings(term)
        if parts.get("covariance") is not None:
            parts.pop("beta", None)  # its eigenvalues: another CPU has other digits
        return {"type": type(term).__name__, **parts}
    return {"type": type(term).__name__, "observed": getattr(term, "observed", None)}


def _readable(value: Any, depth: int = 0) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic | np.ndarray):
        array = np.asarray(value)
        if array.dtype.kind == "O":
            return _readable(array.tolist(), depth)
        readable = array.size <= SHOWN and array.dtype.kind in "biufU"
        return array.tolist() if readable else _digest(array)
    if isinstance(value, Mapping):
        return {str(key): _readable(part, depth) for key, part in value.items()}
    if isinstance(value, complex):
        return str(value)
    if isinstance(value, Set):  # in the same order in every process
        return sorted(map(str, value))
    if isinstance(value, Sequence):
        return [_readable(part, depth) for part in value]
    kind = type(value).__name__
    if hasattr(value, "dist") and hasattr(value, "kwds"):  # frozen, of scipy
        parts = {"args": value.args, "kwds": value.kwds}
        kind = value.dist.name
    elif callable(value) and hasattr(value, "__name__"):
        return "function"  # its name tells nothing of what it does
    elif depth > 3 or isinstance(value, LogPosterior):
        return kind
    else:
        parts = _settings(value)
    found = {name: _readable(part, depth + 1) for name, part in parts.items()}
    return {"type": kind, **found}


def _settings(value: Any) -> dict[str, Any]:
    """Return the arguments of an object, or, if it does not keep them, attributes.

    Attributes of a user's object that are no arguments may be counters.
    """
    kind, package = type(value), _package(type(value))
    try:
        signature(kind)
    except ValueError:  # of what is written in C
        text = repr(value)
        return {} if " at 0x" in text else {"value": text}
    users = package not in (OWN, "emcee", "scipy")
    names = _arguments(kind, all_bases=users)
    kept = {name: getattr(value, name) for name in names if hasattr(value, name)}
    if users or (names and len(kept) == len(names)):
        return kept
    attributes = getattr(value, "__dict__", {})
    hidden = package == "emcee"  # where a factor is kept as its logarithm only
    return {name: v for name, v in attributes.items() if hidden or name[0] != "_"}


def _arguments(kind: type, all_bases: bool) -> list[str]:
    """Return the arguments of a class, and of its bases that take its ``**kwargs``."""
    names: list[str] = []
    for base in kind.__mro__[:-1]:
        if "__init__" in vars(base):
            try:
                _, *given = signature(vars(base)["__init__"]).parameters.values()
            except ValueError:  # of what is written in C
                break
            fixed = [
                p.name for p in given if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)
            ]
            names += [name for name in fixed if name not in names]
            if not all_bases and all(p.kind != p.VAR_KEYWORD for p in given):
                break
    return names


def _package(kind: type) -> str:
    return kind.__module__.partition(".")[0]


def _digest(array: NDArray[Any]) -> dict[str, Any]:
    content = np.ascontiguousarray(array).tobytes()
    return {"shape": array.shape, "sha256": hashlib.sha256(content).hexdigest()[:16]}


def check_same(path: str, stored: dict[str, Any], now: dict[str, Any]) -> None:
    """Refuse to go on with another run, naming every difference; versions only warn."""
    kept = {name: value for name, value in stored.items() if name in now}
    lines = list(differences(kept, now))
    versions = [line for line in lines if line.startswith("versions.")]
    lines = [line for line in lines if line not in versions]
    if lines:
        raise ValueError(
            f"resume: {path} holds a run of something else:\n  "
            + "\n  ".join(lines)
            + "\nGo on with what it was, or give another file name"
        )
    if versions:
        warn(
            f"resume: {'; '.join(versions)}. The chain goes on, but to the bit only as "
            "far as these compute alike",
            stacklevel=6,
        )


def differences(stored: Any, now: Any, path: str = "") -> Iterator[str]:
    """Yield a line per entry that differs; none of the parts of another type."""
    if isinstance(stored, dict) and isinstance(now, dict):
        keys = {**stored, **now}
        if stored.get("type") != now.get("type"):
            keys = {"type": None}
        for key in keys:
            own = f"{path}.{key}".lstrip(".")
            yield from differences(stored.get(key, ABSENT), now.get(key, ABSENT), own)
    elif isinstance(stored, list) and isinstance(now, list) and len(stored) == len(now):
        for i, pair in enumerate(zip(stored, now, strict=True)):
            yield from differences(*pair, f"{path}[{i}]")
    elif isinstance(stored, float) and isinstance(now, float) and stored == stored:
        if not isclose(stored, now, rel_tol=1e-12, abs_tol=1e-300):  # of another CPU
            yield f"{path}: was {_short(stored)}, is {_short(now)}"
    elif json.dumps(stored) != json.dumps(now):  # NaN is NaN
        yield f"{path}: was {_short(stored)}, is {_short(now)}"


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 200 else f"{text[:197]}..."
