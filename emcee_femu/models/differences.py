"""Central differences of what a response is computed from, which take no solve."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from ..contracts import Derivatives, Floats


def derive_along(
    function: Callable[..., Mapping[str, Floats]],
    values: Sequence[Floats],
    tangents: Sequence[Floats],
    steps: Floats,
    names: Iterable[str],
) -> Derivatives:
    """Differentiate the values of a function by central differences.

    This calls the function, but solves nothing.

    Args:
        function: From arrays to ``{variable: (n, *shape)}``.
        values: The arrays, each ``(n, ...)``.
        tangents: How each array changes along d directions, ``(d, n, ...)``.
        steps: How far along each direction, ``(d, n)``.
        names: What the directions are called.
    """

    def widen(step: Floats, value: Floats) -> Floats:
        return step.reshape(-1, *[1] * (value.ndim - 1))

    slopes: Derivatives = {}
    for j, (name, step) in enumerate(zip(names, steps, strict=True)):
        moves = [widen(step, v) * t[j] for v, t in zip(values, tangents, strict=True)]
        ahead = function(*map(np.add, values, moves))
        behind = function(*map(np.subtract, values, moves))
        for variable, value in ahead.items():
            slope = (value - behind[variable]) / widen(2 * step, value)
            slopes.setdefault(variable, {})[name] = slope
    return slopes
