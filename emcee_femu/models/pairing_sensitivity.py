r"""Derivatives of modes that are paired with measured ones, and share their space.

Which mode is whose is fixed, as are the order in which neighbours are made orthogonal
and the link that is the weakest: they change in steps, where frequencies and shapes of
a :class:`PairedModel` have steps or kinks themselves. All else is differentiated, the
fading of the sharing too.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats, read
from .pairing import DEPENDENT, couple_modes


class ModeSlopes(NamedTuple):
    """Derivatives of frequencies ``(n, d, q)`` and of shapes ``(n, d, r, q)``."""

    frequencies: Floats
    shapes: Floats


def differentiate_pairing(
    measured: Floats,
    modes: tuple[Floats, Floats],
    slopes: ModeSlopes,
    chosen: NDArray[np.intp],
    min_gap: float,
) -> tuple[Floats, Floats, Floats]:
    """Return derivatives of frequencies, shapes and MAC of the paired modes.

    Args:
        measured: Unit shapes ``(r, p)``.
        modes: Frequencies ``(n, q)`` and shapes ``(n, r, q)`` of the model.
        slopes: Their derivatives by d parameters.
        chosen: The mode of each measured one, ``(n, p)``.
        min_gap: See :class:`PairedModel`.

    Returns:
        ``(n, d, p)``, ``(n, d, r, p)`` and ``(n, d, p)``.
    """
    frequencies, shapes = modes
    pick = chosen[:, None]  # (n, 1, p)
    changes = np.take_along_axis(slopes.frequencies, pick, axis=2)
    turns = np.take_along_axis(slopes.shapes, pick[:, None], axis=3)
    unit, bends = _normalise(np.take_along_axis(shapes, pick, axis=2), turns)
    along = (unit * measured).sum(axis=1)[:, None]
    macs = 2 * along * (bends * measured).sum(axis=2)
    if not (np.diff(frequencies) < min_gap * frequencies[:, :-1]).any():
        return changes, turns, macs
    coupling = couple_modes(frequencies, min_gap)
    coupled = (coupling > 0).sum(axis=2) > 1
    row, which = np.nonzero(np.take_along_axis(coupled, chosen, axis=1))
    if len(row):
        mode = chosen[row, which]
        unit, bends = _normalise(shapes[row], slopes.shapes[row])
        weights = coupling[row, mode]
        fading = _fade(
            frequencies[row], slopes.frequencies[row], weights, mode, min_gap
        )
        macs[row, :, which], turns[row, :, :, which] = _differentiate_sharing(
            measured[:, which].T, (unit, bends), (weights, fading)
        )
    return changes, turns, macs


def read_slopes(
    response: Any,
    derivatives: Any,
    modes: tuple[Floats, Floats],
    at_sensors: Callable[[Floats], Floats],
) -> tuple[list[str], ModeSlopes]:
    """Return names of parameters and the derivatives of modes that a model gave.

    Args:
        response: The response of the model.
        derivatives: Those of its ``jacobian``; a missing parameter changes nothing.
        modes: Frequencies ``(n, q)`` and shapes ``(n, r, q)`` of the lowest modes, at
            the sensors.
        at_sensors: Returns the rows of shapes that belong to the sensors.

    Raises:
        ValueError: If frequencies or shapes have no derivatives, or one is not as large
            as what it is the derivative of.
    """
    found: dict[str, Mapping[str, Floats]] = {}
    for variable in ("frequency", "shapes"):
        by_parameter = derivatives.get(variable)
        if by_parameter is None:
            raise ValueError(
                f"model: its jacobian returned no derivatives of {variable!r}, by "
                "which modes are paired; return {variable: {parameter: array}}"
            )
        shape = np.shape(read(response, variable))
        for name, value in by_parameter.items():
            if np.shape(value) != shape:
                raise ValueError(
                    f"model: expected its jacobian to return the derivative of "
                    f"{variable!r} by {name!r} of shape {shape}, got {np.shape(value)}"
                )
        found[variable] = by_parameter
    names = list(dict.fromkeys(name for of in found.values() for name in of))
    (n, q), d = modes[0].shape, len(names)
    slopes = ModeSlopes(np.zeros((n, d, q)), np.zeros((n, d, *modes[1].shape[1:])))
    for i, name in enumerate(names):
        if name in found["frequency"]:
            slopes.frequencies[:, i] = found["frequency"][name][:, :q]
        if name in found["shapes"]:
            slopes.shapes[:, i] = at_sensors(found["shapes"][name])[:, :, :q]
    return names, slopes


def _normalise(shapes: Floats, slopes: Floats) -> tuple[Floats, Floats]:
    """Return unit shapes ``(n, r, q)`` and their derivatives ``(n, d, r, q)``."""
    norms = np.sqrt((shapes**2).sum(axis=1, keepdims=True))
    inverse = np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0)
    unit = (shapes * inverse)[:, None]
    bends = slopes * inverse[:, None]
    return unit[:, 0], bends - unit * (unit * bends).sum(axis=2, keepdims=True)


def _fade(
    frequencies: Floats,
    slopes: Floats,
    weights: Floats,
    mode: NDArray[np.intp],
    min_gap: float,
) -> Floats:
    """Return derivatives ``(n, d, q)`` of how far ``mode`` is coupled to each mode.

    ``weights (n, q)`` is that coupling, :func:`couple_modes`.
    """
    n, q = weights.shape
    below = min_gap * frequencies[:, :-1]
    gaps = np.diff(frequencies, axis=1) / below
    x = np.clip(2 * gaps - 1, 0.0, 1.0)
    links = 1.0 - x * x * (3.0 - 2.0 * x)
    widening = (
        np.diff(slopes, axis=2) - (gaps * min_gap)[:, None] * slopes[:, :, :-1]
    ) / below[:, None]
    of_links = (-12.0 * x * (1.0 - x))[:, None] * widening  # (n, d, q - 1)
    # The weakest link between the mode and each other one: the first that is as weak.
    link, other = np.arange(q - 1), np.arange(q)[:, None]
    own = mode[:, None, None]
    between = (link >= np.minimum(own, other)) & (link < np.maximum(own, other))
    weakest = (between & (links[:, None] == weights[:, :, None])).argmax(axis=2)
    fading: Floats = np.take_along_axis(of_links, weakest[:, None], axis=2)
    fading[np.arange(n), :, mode] = 0.0
    return fading


def _differentiate_sharing(
    measured: Floats, modes: tuple[Floats, Floats], coupling: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Return derivatives of MAC ``(n, d)`` and shape ``(n, d, r)`` of coupled modes.

    Args:
        measured: Unit shapes ``(n, r)``.
        modes: Unit shapes of all modes ``(n, r, q)`` and their derivatives.
        coupling: Of one mode with all ``(n, q)``, and its derivatives.
    """
    order = np.argsort(-coupling[0], axis=1, kind="stable")
    most = int((coupling[0] > 0).sum(axis=1).max())
    known: list[tuple[Floats, Floats]] = []  # orthonormal shapes, their derivatives
    first = second = np.zeros((len(measured), 1))
    of_first = of_second = np.zeros(modes[1].shape[:2])
    turns = np.zeros(modes[1].shape[:3])
    rows = np.arange(len(measured))
    for place in order.T[:most]:
        q, dq = modes[0][rows, :, place][:, None], modes[1][rows, :, :, place]
        for base, slope in known * 2:  # Gram-Schmidt, twice for accuracy
            dot = _dot(base, q)
            dq = dq - slope * dot - base * (_dot(slope, q) + _dot(base, dq))
            q = q - base * dot
        length = np.sqrt(_dot(q, q))
        inverse = np.divide(
            1.0, length, out=np.zeros_like(length), where=length > DEPENDENT
        )
        q = q * inverse
        dq = (dq - q * _dot(q, dq)) * inverse
        known.append((q, dq))
        w, dw = coupling[0][rows, place][:, None], coupling[1][rows, :, place]
        t, dt = ((part * measured[:, None]).sum(axis=2) for part in (q, dq))
        first, second = first + w * t**2, second + (w * t) ** 2
        of_first = of_first + dw * t**2 + 2 * w * t * dt
        of_second = of_second + 2 * w * t * (dw * t + w * dt)
        turns += dq * (w * t)[:, :, None] + q * (dw * t + w * dt)[:, :, None]
    share = np.divide(first, second, out=np.zeros_like(first), where=second > 0)
    return share * (2 * of_first - share * of_second), turns


def _dot(a: Floats, b: Floats) -> Floats:
    product: Floats = (a * b).sum(axis=2, keepdims=True)
    return product
