"""Names in brackets: second measurements, and dimensions with other labels.

A variable that a second term measured is stored under its name and the term's, as in
``frequency[again]``; a dimension along which fewer places were measured has the name
of the term or variable, as in ``mode[again]``. What stands before the bracket is the
name in the response.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def name_apart(
    coords: Mapping[str, Mapping[str, Sequence[Any]]],
) -> dict[str, dict[str, list[Any]]]:
    """Return ``{variable: {dimension: labels}}`` with one meaning per dimension.

    Of dimensions that differ in their labels the longest keeps its name; xarray would
    fill up the others with NaN.
    """
    taken: dict[str, list[Any]] = {}
    renamed = {}
    triples = [
        (name, dim, list(labels))
        for name, own in coords.items()
        for dim, labels in own.items()
    ]
    for name, dim, labels in sorted(triples, key=lambda triple: -len(triple[2])):
        suffix = name.removeprefix(f"{dim.rpartition('.')[0]}.")  # the experiment's
        if name.endswith("]"):
            suffix = name[:-1].partition("[")[2]
        for free in (dim, f"{dim}[{suffix}]", f"{dim}[{name}]"):
            if taken.setdefault(free, labels) == labels:
                renamed[name, dim] = free
                break
    return {
        name: {renamed[name, dim]: list(labels) for dim, labels in own.items()}
        for name, own in coords.items()
    }


def original_name(name: str, known: Iterable[Any]) -> str:
    """Return which of the ``known`` names a name is, or is with brackets; else it."""
    candidates = [str(k) for k in known if f"{name}[".startswith(f"{k}[")]
    return max(candidates, key=len, default=name)
