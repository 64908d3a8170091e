"""Bounds and points of a reduction: corners of the box, independent test points."""

from collections.abc import Mapping
from itertools import product

import numpy as np

from .. import checks
from ..interfaces import Floats


def corners(d: int, rng: np.random.Generator) -> Floats:
    """Return the corners of the unit cube in random order, at most 1024 of them."""
    if d <= 10:
        every = np.array([*product((0.0, 1.0), repeat=d)])
    else:
        every = np.unique(rng.integers(0, 2, size=(1024, d)), axis=0).astype(float)
    rng.shuffle(every)
    return every


def independent_points(
    outer: Floats, candidates: Floats, count: int, rng: np.random.Generator
) -> Floats:
    """Return points, half uniform and half corners that were no candidates.

    Where too few such corners are left, more points are uniform.
    """
    used = {tuple(point) for point in candidates.tolist()}
    free = np.array([c for c in outer.tolist() if tuple(c) not in used])
    chosen = free.reshape(-1, outer.shape[1])[: count // 2]
    return np.concatenate(
        [chosen, rng.uniform(size=(count - len(chosen), outer.shape[1]))]
    )


def check_bounds(
    bounds: Mapping[str, tuple[float, float]], names: tuple[str, ...]
) -> dict[str, tuple[float, float]]:
    """Return the bounds in the order of ``names``; every name must have them."""
    if not names:
        raise ValueError("bounds: the model has no parameters; solve it once instead")
    given, result = checks.by_name("bounds", bounds, names), {}
    for name in names:
        if name not in given:
            raise ValueError(f"bounds: {name!r} has none; expected (low, high) for all")
        pair = checks.real_array(f"bounds[{name!r}]", given[name], 1)
        if len(pair) != 2 or not pair[0] < pair[1]:
            raise ValueError(
                f"bounds[{name!r}]: expected (low, high) with low < high, "
                f"got {given[name]!r}"
            )
        result[name] = (float(pair[0]), float(pair[1]))
    return result
