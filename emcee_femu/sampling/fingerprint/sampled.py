"""What is sampled and how, as text: a run may go on only with what it began with.

A stored chain holds log-probabilities that are never computed again, so a model that
changed meanwhile would mix two posteriors silently.
"""

import hashlib
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

from .code import Parts
from .objects import leaf, parts

PACKAGES = ("emcee_femu", "emcee", "numpy", "scipy")
MOST_PARTS = 100  # of a container that is described part by part
ABSENT = "absent"


def fingerprint(posterior: Any, moves: Any, **settings: Any) -> dict[str, str]:
    """Return what a chain depends on, path by path, the same in every process.

    Everything that can be reached from the arguments takes part: numbers and arrays
    (a checksum where there are many), names, distributions, sparse matrices,
    attributes, and of functions and classes that are not of an installed package their
    code, defaults, closures and the global names that they read. Of an installed
    package the name counts, and of numpy, scipy, emcee and this package the version.

    Not compared are the state of random generators and what a function assigns to
    global or outer names. Of moves whose constructor arguments are attributes of the
    same names, as in this package, only these count, not what they counted or cached.
    Another object that changes when it is called, such as one that counts its calls,
    must leave that out of ``__getstate__``, as for a pool. What cannot be looked into,
    such as an open library handle, is named by its type and says so.

    Args:
        posterior: What is sampled; its attributes stand without a prefix.
        moves: As ``emcee.EnsembleSampler`` takes them.
        **settings: Further values, by name.

    Returns:
        ``{path: value or checksum}``, as in the example.

    Example:
        >>> from emcee_femu import DEMCMove, paper
        >>> stored = fingerprint(paper.mass_spring().posterior, DEMCMove(), seed=1)
        >>> stored["terms[0].measured"]
        'float64 (5,): 3.507, 5.149, 7.083, 8.892, 9.426'
        >>> now = fingerprint(paper.mass_spring().posterior, DEMCMove(0.1), seed=2)
        >>> differences(stored, now)
        ['seed: was 1, is 2', 'moves.sigma: was None, is float64 (): 0.1']
    """
    entries = {f"{name} version": version(name) for name in PACKAGES}
    # Code of functions differs between minor versions of Python.
    entries["python version"] = "{}.{}".format(*sys.version_info)
    found = _described({"posterior": posterior, "moves": moves, **settings})
    for path, text in found.items():
        entries[path.removeprefix("posterior.")] = text
    return entries


def changing(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return the paths that differ after evaluation: counters, caches, logs."""
    paths = dict.fromkeys([*before, *after])
    return [path for path in paths if before.get(path) != after.get(path)]


def without(entries: Mapping[str, str], paths: Sequence[str]) -> dict[str, str]:
    """Return the entries but those of the paths, and of what is in them."""
    inside = tuple(path + mark for path in paths for mark in ".[(")
    return {
        path: text
        for path, text in entries.items()
        if path not in paths and not path.startswith(inside)
    }


def differences(stored: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Return a line for each difference of two fingerprints, none if they agree.

    Of an object that was replaced by one of another type, the parts are not listed.
    """
    lines: list[str] = []
    replaced: list[str] = []
    for path in dict.fromkeys([*stored, *now]):
        was, here = stored.get(path, ABSENT), now.get(path, ABSENT)
        within = (path.startswith(tuple(r + mark for mark in ".[(")) for r in replaced)
        if was != here and not any(within):
            lines.append(f"{path}: {_counted(was, here)}was {was}, is {here}")
            replaced.append(path)
    return lines


def _counted(was: str, here: str) -> str:
    """Return how many entries of an array or a sequence differ, where both show all."""
    kind, _, old = was.partition(": ")
    same, _, new = here.partition(": ")
    olds, news = old.split(", "), new.split(", ")
    if kind != same or len(olds) != len(news) or len(olds) == 1:
        return ""
    count = sum(a != b for a, b in zip(olds, news, strict=True))
    return f"{count} of {len(olds)} changed, "


def _described(roots: Mapping[str, Any]) -> dict[str, str]:
    """Describe all that can be reached, nearest first, each object once."""
    entries: dict[str, str] = {}
    whole: dict[str, Any] = {}  # checksums of containers that have too many parts
    known: dict[int, tuple[str, Any]] = {}  # with the object, lest its id be reused
    queue = deque((path, value, "") for path, value in roots.items())
    while queue:
        path, value, owner = queue.popleft()
        while path in entries:  # such as the keys 1 and "1"
            path += "'"
        text, inside = leaf(value), Parts()
        if text is None and id(value) in known:
            text = f"as {known[id(value)][0]}"
        elif text is None:
            known[id(value)] = path, value
            text, inside = parts(value)
        if owner:
            whole[owner].update(f"{path}\0{text}\0".encode())
        else:
            entries[path] = text
            if len(inside) > MOST_PARTS:
                owner, whole[path] = path, hashlib.sha256()
        queue.extend((path + label, part, owner) for label, part in inside)
    for path, checksum in whole.items():
        entries[path] += f", sha256:{checksum.hexdigest()[:16]}"
    return entries
