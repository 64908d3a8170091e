"""How a number is shown: two digits of its uncertainty decide, and SI prefixes."""

import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

# Numbers of this size are read without a prefix or a power of ten.
LEAST_PLAIN, MOST_PLAIN = 1e-2, 1e5
MOST_ZEROS = 3  # that rounding may leave before the decimal point
MOST_DECIMALS = 6
UNCERTAIN = "{:.5g}"  # of a number whose uncertainty is not known
SAME_UNIT = re.compile(r"([kMG]?)N/m(?:\^?2|²)$")  # as Pa, with the same prefix
# A prefix and a unit of the first power, of which a prefix may be changed.
PREFIXED = re.compile(r"([nµmkMGT]?)(Pa|N|Hz|m|J|W)(?![\w^²³⁴])")
EXPONENTS = {"n": -9, "µ": -6, "m": -3, "": 0, "k": 3, "M": 6, "G": 9, "T": 12}


def show(values: ArrayLike, sd: ArrayLike) -> list[str]:
    """Return numbers as they are printed, to two digits of their uncertainty.

    A number whose uncertainty is not known is printed to five digits, and NaN as
    nothing. Where rounding would leave more than three zeros before the decimal point,
    the number has a power of ten.

    Args:
        values: Numbers ``(m,)``.
        sd: Their standard deviations, ``(m,)`` or one for all.

    Examples:
        >>> show([54225.1, 0.0123456, 2.374e10], [2624.0, 0.00096, 1.5e9])
        ['54200', '0.01235', '2.37e+10']
    """
    both = np.broadcast_arrays(np.asarray(values, float), np.asarray(sd, float))
    return [_show(*pair) for pair in zip(*(x.tolist() for x in both), strict=True)]


def show_given(values: ArrayLike, sd: ArrayLike) -> list[str]:
    """Return given numbers, such as measured ones, with all their digits.

    Those of more than five digits, as computed numbers have, and those that take a
    power of ten are shown as by :func:`show`.

    Args:
        values: Numbers ``(m,)``.
        sd: Their standard deviations, ``(m,)`` or one for all.

    Examples:
        >>> show_given([69.72, 54225.1, 2.4e10], [5.0, 2624.0, 1e9])
        ['69.72', '54200', '2.40e+10']
    """
    shortest = [UNCERTAIN.format(value) for value in np.asarray(values, float).tolist()]
    exact = np.asarray(values, float) == np.array(shortest, float)
    pairs = zip(exact, shortest, show(values, sd), strict=True)
    return [a if given and "e" not in a else shown for given, a, shown in pairs]


def _show(value: float, sd: float) -> str:
    if not np.isfinite(value):
        return "" if np.isnan(value) else f"{value:g}"
    if not 0 < sd < np.inf:
        return UNCERTAIN.format(value)
    place = int(f"{sd:.1e}".partition("e")[2]) - 1  # of the second digit
    value = round(value, -place) + 0.0  # which takes the sign from a zero
    if -MOST_DECIMALS <= place <= MOST_ZEROS:
        return f"{value:.{max(-place, 0)}f}"
    size = int(f"{value:e}".partition("e")[2])
    return f"{value:.{size - place}e}" if size >= place else "0"


def choose_units(
    units: Iterable[str], sizes: Sequence[float]
) -> list[tuple[str, float]]:
    """Return units whose prefix suits numbers of such sizes, and what to divide by.

    Units stay as they are where numbers are read well in them, and where a unit has no
    prefix that could be changed; N/m^2 is Pa.

    Args:
        units: One for each number, such as "N/m".
        sizes: Of the numbers, ``(m,)``.

    Examples:
        >>> choose_units(["N/m^2", "kN/m", "m^4"], [2.4e10, 5e4, 3e-5])
        [('GPa', 1000000000.0), ('kN/m', 1.0), ('m^4', 1.0)]
    """
    return [_choose_unit(*pair) for pair in zip(units, sizes, strict=True)]


def _choose_unit(unit: str, size: float) -> tuple[str, float]:
    found = PREFIXED.match(SAME_UNIT.sub(r"\1Pa", unit))
    if LEAST_PLAIN <= size < MOST_PLAIN or not found or not 0 < size < np.inf:
        return unit, 1.0
    now = EXPONENTS[found[1]]
    power = 3 * int(np.floor((np.log10(size) + now) / 3))
    power = min(max(power, min(EXPONENTS.values())), max(EXPONENTS.values()))
    prefix = next(name for name, value in EXPONENTS.items() if value == power)
    return f"{prefix}{found[2]}{found.string[found.end() :]}", 10.0 ** (power - now)
