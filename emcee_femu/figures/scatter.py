"""All pairs of parameters with their 95 % ellipses."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Floats
from .colours import BLUE, GREY, RED
from .draws import changing_draws
from .ellipses import covariance_ellipse

MOST_POINTS = 4_000  # drawn in a scatter panel; the ellipses use every sample


def plot_scatter(
    idata: Any,
    *,
    units: Mapping[str, str] | None = None,
    truths: Mapping[str, float] | None = None,
    probability: float = 0.95,
) -> Any:
    """Draw all pairs of parameters with covariance ellipses in red (Figs 4.2, 5.2).

    An ellipse holds ``probability`` of a Gaussian with the samples' covariance
    (:func:`figures.ellipses.covariance_ellipse`).

    Args:
        idata: What :func:`to_inference_data` returns.
        units: Units by parameter name, for the axes.
        truths: Values to mark by parameter name, such as the nominal ones.
        probability: The share inside an ellipse.

    Raises:
        TypeError: If units or truths is no such mapping.
        ValueError: If units or truths name an unknown parameter, probability is not
            between 0 and 1, or a parameter has the same value in all samples.
    """
    import corner
    from matplotlib.lines import Line2D
    from matplotlib.patches import Ellipse

    names, draws = changing_draws(idata)
    probability = checks.real_number("probability", probability)
    if not 0 < probability < 1:
        raise ValueError(f"probability: expected between 0 and 1, got {probability:g}")
    marks = {
        name: checks.real_number(f"truths[{name!r}]", value)
        for name, value in _known("truths", truths, names).items()
    }
    exponents = [_exponent(column) for column in draws.T]
    scale = 10.0 ** np.array(exponents)
    draws = draws / scale
    scaled_marks = [
        marks[name] / factor if name in marks else None
        for name, factor in zip(names, scale, strict=True)
    ]
    shown = np.random.default_rng(0).permutation(len(draws))[:MOST_POINTS]
    figure = corner.corner(
        draws[shown],
        labels=_labels(names, units, exponents),
        range=_ranges(draws, scaled_marks, probability),
        bins=30,
        plot_contours=False,
        plot_density=False,
        truths=scaled_marks,
        truth_color=BLUE,
        data_kwargs={"alpha": 0.25, "ms": 2.0, "color": GREY},
        hist_kwargs={"color": GREY},
        max_n_ticks=4,
        label_kwargs={"fontsize": 11},
        labelpad=0.08,
    )
    d = len(names)
    panels = np.array(figure.axes).reshape(d, d)
    for row in range(1, d):
        for left in range(row):
            pair = draws[:, (left, row)]
            shape = covariance_ellipse(pair, probability)
            width, height = 2 * shape.semi_axes
            panels[row, left].add_patch(
                Ellipse(
                    tuple(shape.centre),
                    width,
                    height,
                    angle=shape.angle,
                    fill=False,
                    color=RED,
                    linewidth=1.8,
                    zorder=5,
                )
            )
    handles = [
        Line2D([], [], color=GREY, marker=".", ls="", label="samples"),
        Line2D([], [], color=RED, lw=1.8, label=f"{100 * probability:g} % ellipse"),
    ]
    if marks:
        handles.append(Line2D([], [], color=BLUE, marker="s", label="reference"))
    figure.legend(handles=handles, loc="upper right", fontsize=13, frameon=False)
    return figure


def _ranges(
    draws: Floats, marks: list[float | None], probability: float
) -> list[tuple[float, float]]:
    """Return axis limits that show every sample, ellipse and mark."""
    radius = math.sqrt(-2 * math.log1p(-probability))
    ranges = []
    for column, mark in zip(draws.T, marks, strict=True):
        reach = 1.05 * radius * column.std()
        shown = [column.min(), column.max()]
        shown += [column.mean() - reach, column.mean() + reach]
        shown += [] if mark is None else [mark]
        ranges.append((float(min(shown)), float(max(shown))))
    return ranges


def _exponent(column: Floats) -> int:
    """Return the power of ten to take out of an axis, 0 for ordinary numbers."""
    size = float(np.abs(column).max())
    return 0 if 1e-2 <= size < 1e5 else int(np.floor(np.log10(size)))


def _known(
    argument: str, values: Mapping[str, Any] | None, names: list[str]
) -> dict[str, Any]:
    return {} if values is None else checks.by_name(argument, values, names)


def _labels(
    names: list[str], units: Mapping[str, str] | None, exponents: list[int]
) -> list[str]:
    by_name = _known("units", units, names)
    for name, unit in by_name.items():
        if not isinstance(unit, str):
            raise TypeError(f"units[{name!r}]: expected text, got {unit!r}")
    labels = []
    for name, exponent in zip(names, exponents, strict=True):
        power = f"$10^{{{exponent}}}$ " if exponent else ""
        unit = f"{power}{by_name.get(name, '')}".strip()
        labels.append(f"{name} [{unit}]" if unit else name)
    return labels
