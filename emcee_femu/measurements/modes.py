"""Checks of measured modes by mode number, and complex shapes turned real."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..interfaces import Floats

# Two modes this near to each other in frequency and MAC are one, identified twice.
SAME_FREQUENCY, SAME_SHAPE = 1e-3, 0.99
COLLINEAR = 0.9  # below it a real shape is a poor picture of the mode
MOST = 1e300  # of which a sum is still a number
Shapes = NDArray[np.float64] | NDArray[np.complex128]


def frequencies(value: ArrayLike) -> Floats:
    """Return measured frequencies in Hz; errors name the mode, 1 = the first."""
    hertz = checks.numeric_array("frequencies", value)
    if hertz.ndim != 1 or not hertz.size:
        raise ValueError(
            "frequencies: expected at least one frequency and one dimension, got "
            f"shape {hertz.shape}"
        )
    for mode, f in enumerate(hertz, 1):
        if not 0 < f < np.inf:
            raise ValueError(
                f"frequencies: expected Hz above zero, but mode {mode} has {f}; leave "
                "out what the identification did not find"
            )
    for i in np.flatnonzero(np.diff(hertz) < 0):
        raise ValueError(
            f"frequencies: expected ascending ones, but mode {i + 2} ({hertz[i + 1]} "
            f"Hz) is below mode {i + 1} ({hertz[i]} Hz); reorder all that you give by "
            "np.argsort(frequencies)"
        )
    return hertz


def shapes(value: ArrayLike, n_modes: int, argument: str = "shapes") -> Shapes:
    """Return real or complex shapes ``(..., n_sensors, n_modes)``, none of them zero.

    Raises:
        TypeError: If they are no numbers.
        ValueError: If the sizes disagree, or a shape is zero or not finite.
    """
    given = checks.complex_array(argument, value)
    if given.ndim < 2 or given.shape[-1] != n_modes or not given.size:
        turned = "; transpose them" if given.shape[:1] == (n_modes,) else ""
        raise ValueError(
            f"{argument}: expected (n_sensors, {n_modes}), a column for each of the "
            f"frequencies, got {given.shape}{turned}"
        )
    for index in np.argwhere(~np.isfinite(given)):
        sensor, mode = index[-2:] + 1
        raise ValueError(
            f"{argument}: expected finite numbers, but mode {mode} has "
            f"{given[tuple(index)]} at sensor {sensor}"
        )
    for index in np.argwhere(~given.any(axis=-2)):
        raise ValueError(f"{argument}: mode {index[-1] + 1} is zero at all sensors")
    return given


def scaled(given: Any) -> Any:
    """Return shapes of a size near 1, divided by powers of two: no digit changes."""
    size = np.maximum(np.abs(given.real), np.abs(given.imag))
    exponent = np.frexp(size.max(axis=-2, keepdims=True, initial=0.0))[1]
    half = exponent // 2  # 2.0**-exponent itself may be too large
    return given * np.ldexp(1.0, -half) * np.ldexp(1.0, half - exponent)


def phases(given: Shapes) -> Shapes:
    """Return the factor a mode that turns its shape to its largest real part."""
    if not np.iscomplexobj(given):
        return np.ones(given.shape[-1])
    unit = given / np.abs(given).max(axis=0)  # squares neither over- nor underflow
    factors: Shapes = np.exp(-0.5j * np.angle((unit * unit).sum(axis=0)))
    return factors


def phase_collinearity(given: Shapes, before: ArrayLike | None = None) -> Floats:
    """Return the MAC of each shape with its own conjugate; 1 for a real shape.

    Args:
        given: Shapes ``(n_sensors, n_modes)``.
        before: What real shapes had before they were turned real, ``(n_modes,)``.

    Raises:
        ValueError: If before is given with complex shapes, or is not from 0 to 1.
    """
    n_modes = given.shape[-1]
    if np.iscomplexobj(given):
        if before is not None:
            raise ValueError(
                "phase_collinearity: that of complex shapes is computed; leave it out"
            )
        unit = given / np.abs(given).max(axis=0)
        ratio = np.abs((unit * unit).sum(axis=0)) / (np.abs(unit) ** 2).sum(axis=0)
        computed: Floats = np.minimum(ratio**2, 1.0)  # above 1 by rounding only
        return computed
    if before is None:
        return np.ones(n_modes)
    mpc = checks.real_array("phase_collinearity", before, 1)
    if mpc.shape != (n_modes,) or mpc.min() < 0 or mpc.max() > 1:
        raise ValueError(
            f"phase_collinearity: expected {n_modes} numbers from 0 to 1, got "
            f"{mpc.tolist()}"
        )
    return mpc


def warn_of_complex(mpc: Floats) -> None:
    """Warn of modes whose real shape leaves much out."""
    which = [f"{i + 1} (MPC {x:.2f})" for i, x in enumerate(mpc) if x < COLLINEAR]
    if which:
        warnings.warn(
            f"shapes: phase collinearity below {COLLINEAR} of mode {', '.join(which)}; "
            "a real shape leaves much out",
            UserWarning,
            stacklevel=3,
        )


def refuse_duplicates(hertz: Floats, real: Floats | None) -> None:
    """Refuse a mode that stands there twice.

    Raises:
        ValueError: If modes have the same frequency and a MAC near 1. Without shapes
            at two sensors at least the same frequency to the last digit suffices.
    """
    blind = real is None or len(real) < 2
    unit = np.ones((1, len(hertz)))
    if real is not None:
        unit = real / np.abs(real).max(axis=0)
        unit /= np.linalg.norm(unit, axis=0)
    gap = 0.0 if blind else SAME_FREQUENCY
    same = np.abs(hertz[:, None] - hertz) <= gap * hertz
    same &= (unit.T @ unit) ** 2 > SAME_SHAPE
    for i, j in np.argwhere(np.triu(same, 1)):
        remedy = "give shapes that tell them apart" if blind else "their MAC is near 1"
        raise ValueError(
            f"frequencies: modes {i + 1} and {j + 1} are the same ({hertz[i]} and "
            f"{hertz[j]} Hz; {remedy}); leave out one of them"
        )


def deviations(
    argument: str, value: ArrayLike | None, shape: tuple[int, ...]
) -> Floats | None:
    """Return standard deviations of the given shape, or None for None."""
    if value is None:
        return None
    sd = checks.numeric_array(argument, value)
    if sd.shape != shape:
        raise ValueError(f"{argument}: expected shape {shape}, got {sd.shape}")
    for index in np.argwhere(~((sd > 0) & np.isfinite(sd))):
        raise ValueError(
            f"{argument}: expected finite numbers above zero, but mode "
            f"{index[-1] + 1} has {sd[tuple(index)]}"
        )
    return sd


def covariance(value: ArrayLike | None, n_modes: int) -> Floats | None:
    """Return a symmetric positive definite ``(n_modes, n_modes)``, or None for None."""
    if value is None:
        return None
    matrix = checks.real_array("covariance", value, 2)
    if matrix.shape != (n_modes, n_modes):
        raise ValueError(
            f"covariance: expected shape {(n_modes, n_modes)}, got {matrix.shape}"
        )
    deviations("covariance (diagonal)", np.diag(matrix), (n_modes,))
    if np.abs(matrix).max() > MOST:
        raise ValueError(f"covariance: expected numbers up to {MOST:g} Hz^2")
    sd = np.sqrt(np.diag(matrix))
    with np.errstate(over="ignore"):  # infinite is an error below
        correlation = matrix / np.outer(sd, sd)
    if not np.isfinite(correlation).all():
        raise ValueError("covariance: expected correlations up to 1, got infinite ones")
    if np.abs(correlation - correlation.T).max() > 1e-8:
        raise ValueError("covariance: expected a symmetric matrix")
    matrix = 0.5 * (matrix + matrix.T)  # the rounding of whoever printed it
    lowest = np.linalg.eigvalsh(correlation)[0]
    if lowest < 1e-10:
        raise ValueError(
            "covariance: expected a positive definite matrix, but the lowest "
            f"eigenvalue of the correlation is {lowest:.3g}; give standard deviations"
        )
    return matrix


def labels(value: Sequence[str] | None, n_sensors: int) -> tuple[str, ...]:
    """Return a label for each sensor: s1, s2, ... by default."""
    if value is None:
        return tuple(f"s{i + 1}" for i in range(n_sensors))
    names = checks.parameter_names("sensors", value)
    if len(names) != n_sensors:
        raise ValueError(
            f"sensors: expected a label for each of {n_sensors} sensors, got "
            f"{len(names)}"
        )
    return names


def dofs(value: ArrayLike | None, n_sensors: int) -> NDArray[np.intp] | None:
    """Return the model's DOF at each sensor: distinct whole numbers from 0."""
    if value is None:
        return None
    try:
        rows = np.array(value)
    except (TypeError, ValueError) as error:  # ragged, or no array at all
        raise TypeError(f"dofs: expected whole numbers ({error})") from None
    if rows.dtype.kind not in "iu":
        raise TypeError(f"dofs: expected whole numbers, got dtype {rows.dtype}")
    if rows.shape != (n_sensors,):
        raise ValueError(
            f"dofs: expected one for each of {n_sensors} sensors, got shape "
            f"{rows.shape}"
        )
    if rows.min() < 0 or len(set(rows.tolist())) < n_sensors:
        raise ValueError(
            "dofs: expected distinct DOFs counted from 0, got "
            f"{rows.tolist()}; average sensors at one DOF first"
        )
    return rows.astype(np.intp)
