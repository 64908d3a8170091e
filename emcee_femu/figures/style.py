"""What figures share: colours, the samples shown, and how a notebook shows a figure."""

import io
import re
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, TypeAlias

import matplotlib
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase

from .. import checks
from ..contracts import Floats
from ..digits import LEAST_PLAIN, MOST_PLAIN, choose_units
from ..results.arviz_objects import (
    InferenceData,
    dataset,
    note_of,
    prior_constants,
    samples,
    unit_of,
)

Size: TypeAlias = tuple[float, float]
Style: TypeAlias = dict[str, Any]  # keyword arguments of matplotlib

# Red for the result, blue for what it is compared with.
RED, BLUE, GREY = "#c8102e", "#1f5fa8", "0.45"
NAME_HEIGHT = 0.4  # inches of an experiment's name above its part of a figure
BELOW: Style = {"loc": "outside lower center", "ncols": 2, "frameon": False}  # legends


def changing_draws(
    idata: InferenceData, var_names: Sequence[str] | None
) -> tuple[list[str], Floats]:
    """Return names and draws ``(n, d)``, refusing a parameter that never changes."""
    names, chains = samples(idata, var_names)
    draws = chains.reshape(-1, len(names))
    for name, column in zip(names, draws.T, strict=True):
        if np.ptp(column) == 0:
            raise ValueError(f"idata: every sample of {name!r} is {column[0]:g}")
    return names, draws


def scale_axes(
    idata: InferenceData,
    names: Sequence[str],
    draws: Sequence[Floats],
    units: Mapping[str, str] | None,
    truths: Mapping[str, float] | None,
) -> tuple[list[str], Floats, Floats, Floats]:
    """Return how the axes of d parameters are drawn.

    Args:
        idata: Samples with what is known of the parameters.
        names: Of the parameters.
        draws: What is drawn of them, several ``(n, d)``.
        units: Units by name, in place of those that idata has.
        truths: Values to mark by name.

    Returns:
        Labels: names, with unit and the power of ten taken out of the axis. The factor
        ``(d,)`` by which what is drawn is divided: of the SI prefix, or that power. So
        divided, where the axes end ``(d, 2)``, and values to mark ``(d,)``; NaN where
        there is none.
    """
    there = [str(name) for name in dataset(idata, "posterior").data_vars]
    values = checks.numbers_by_name("truths", {} if truths is None else truths, there)
    by_name = dict(zip(there, values, strict=True))  # without elements of vectors
    marks = np.array([by_name.get(name, np.nan) for name in names])
    units = checks.units_by_name("units", units, there)
    sizes = np.abs(draws[0]).max(axis=0)
    there = [units.get(name, unit_of(idata, name)) for name in names]
    chosen = choose_units(there, sizes.tolist())
    factors = np.array([factor for _, factor in chosen])
    left = sizes / factors
    ordinary = (left >= LEAST_PLAIN) & (left < MOST_PLAIN)
    exponents = np.where(ordinary, 0, np.floor(np.log10(left))).astype(int)
    labels = [
        label_axis(name, unit, exponent)
        for name, (unit, _), exponent in zip(names, chosen, exponents, strict=True)
    ]
    prior = prior_constants(idata, names)
    bounds = prior[["lower", "upper"]].to_array().values.T
    limits = np.array([axis_limits(part, bounds) for part in draws])
    low = np.fmin(limits[..., 0].min(axis=0), marks)
    high = np.fmax(limits[..., 1].max(axis=0), marks)
    scale = factors * 10.0**exponents
    shown = np.column_stack([low, high]) / scale[:, None]
    return labels, scale, shown, marks / scale


def axis_limits(draws: Floats, bounds: Floats) -> Floats:
    """Return limits ``(d, 2)`` of axes that show where the mass of draws ``(n, d)`` is.

    The central 99 % and a tenth more to either side, which for a Gaussian are 99.8 %;
    as much as a quarter more where the 95 % ellipse reaches so far. Not beyond the
    prior's bounds ``(d, 2)``, NaN where they are not known, nor below zero where no
    draw is.
    """
    low, high = np.quantile(draws, [0.005, 0.995], axis=0)
    least, most = draws.min(axis=0), draws.max(axis=0)
    low, high = np.where(high == low, [least, most], [low, high])
    mean, ellipse, width = draws.mean(axis=0), 2.6 * draws.std(axis=0), high - low
    low = np.clip(mean - ellipse, low - 0.25 * width, low - 0.1 * width)
    high = np.clip(mean + ellipse, high + 0.1 * width, high + 0.25 * width)
    low = np.where(least >= 0, np.maximum(low, 0.0), low)
    # fmin and fmax leave out NaN.
    limits = np.fmax(low, bounds[:, 0]), np.fmin(high, bounds[:, 1])
    return np.column_stack(limits)


def label_axis(name: str, unit: str, exponent: int = 0) -> str:
    """Return a parameter with its unit and the power of ten taken out of its axis."""
    unit = re.sub(r"\^(-?\d+)", r"$^{\1}$", unit)
    power = f"$10^{{{exponent}}}$ " if exponent else ""
    within = f"{power}{unit}".strip()
    return f"{name} [{within}]" if within else name


def subplots(
    count: int, columns: int, size: tuple[float, float], **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure of pyplot and its panels, row by row.

    Args:
        count: How many panels there are.
        columns: How many of them are beside each other.
        size: Of the figure, in inches.
        options: Of ``Figure.subplots``.
    """
    figure = plt.figure(figsize=size, layout="constrained")
    return figure, add_panels(figure, count, columns, **options)


def add_panels(
    figure: FigureBase, count: int, columns: int, **options: Any
) -> list[Axes]:
    """Return panels of a figure, or of a part of one, row by row."""
    panels = figure.subplots(-(-count // columns), columns, squeeze=False, **options)
    for axes in panels.flat[count:]:
        axes.remove()
    return [*panels.flat[:count]]


def stack_parts(sizes: Mapping[str, Size]) -> tuple[Figure, list[FigureBase]]:
    """Return a figure, and parts of it below each other, one for each experiment.

    Args:
        sizes: Inches of each, by the name that stands above it; that of a single one
            stands above the figure.
    """
    widths, heights = np.transpose([*sizes.values()])
    if len(sizes) > 1:
        heights = heights + NAME_HEIGHT
    size = max(widths), sum(heights)
    figure = plt.figure(figsize=size, layout="constrained")
    if len(sizes) == 1:
        return figure, [figure]
    parts = figure.subfigures(len(sizes), 1, squeeze=False, height_ratios=heights)
    for name, part in zip(sizes, parts.flat, strict=True):
        part.suptitle(name, fontsize=10)
    return figure, [*parts.flat]


def finish(
    figure: Figure, idata: InferenceData | None = None, experiment: str = ""
) -> Figure:
    """Return a figure of pyplot, which a notebook will show once.

    Above it stand the experiment, if it has a name, and what :func:`certify` said of
    the samples, if it did.

    At the end of a cell, a notebook shows the value of the last line and then all
    figures of pyplot, so a figure that is drawn and returned would appear twice. Our
    figures leave pyplot when they are shown as a value. Scripts are not affected.
    """
    text = "" if idata is None else note_of(idata)
    parts = experiment, f"{text[:1].upper()}{text[1:]}"
    if title := "\n".join(filter(None, parts)):
        figure.suptitle(title, fontsize=10)
    if "inline" in matplotlib.get_backend():
        # No function of this one: figures can be pickled.
        show = partial(_leave_pyplot, figure)
        figure._ipython_display_ = show  # type: ignore[attr-defined]
    return figure


def _leave_pyplot(figure: Figure) -> None:
    """Close the figure, and let IPython show it as usual."""
    plt.close(figure)
    raise NotImplementedError  # how IPython is told so


def draw_png(figure: Figure) -> bytes:
    """Return a figure as PNG on white, of 160 dots per inch, and close it."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=160, facecolor="white")
    plt.close(figure)
    return file.getvalue()


def show_mac(value: float, digits: int = 2) -> str:
    """Return a MAC as 1.00 or .98."""
    return f"{value:.{digits}f}".removeprefix("0")
