"""All pairs of parameters with their 95 % ellipses, and their correlation."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .. import checks
from ..interfaces import Floats
from ..results.arviz_objects import dataset, prior_constants
from ..results.to_arviz import read_samples
from .style import BLUE, GREY, RED, Style, changing_draws, finish

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RADIUS = math.sqrt(-2 * math.log(0.05))  # of an ellipse, in standard deviations
MOST_POINTS = 4_000  # drawn in a scatter panel; the ellipses use every sample


def plot_scatter(
    idata: object,
    *,
    var_names: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None,
    truths: Mapping[str, float] | None = None,
) -> "Figure":
    """Draw all pairs of parameters with covariance ellipses in red (Figs 4.2, 5.2).

    An ellipse holds 95 % of a Gaussian with the samples' covariance. Axes end at the
    prior's bounds.

    Args:
        idata: What :func:`to_inference_data` returns or takes, such as a run.
        var_names: Variables of its ``posterior`` group; default: the sampled ones.
        units: Units by parameter name, for the axes.
        truths: Values to mark by parameter name, such as the nominal ones.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If units or truths is not such a mapping.
        ValueError: If units or truths name an unknown parameter, or a parameter has the
            same value in all samples.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> units = {"k1": "N/m"}
        >>> figure = ef.figures.plot_scatter(run, var_names=["k1", "k2"], units=units)
        >>> figure.axes[2].get_xlabel()
        'k1 [N/m]'
    """
    import corner
    from matplotlib.lines import Line2D
    from matplotlib.patches import Ellipse

    idata, _ = read_samples(idata)
    names, draws = changing_draws(idata, var_names)
    there = [str(name) for name in dataset(idata, "posterior").data_vars]
    values = checks.numbers_by_name("truths", {} if truths is None else truths, there)
    by_name = dict(zip(there, values, strict=True))  # without elements of vectors
    marks = np.array([by_name.get(name, np.nan) for name in names])
    units = checks.by_name("units", {} if units is None else units, there)
    for name, unit in units.items():
        if not isinstance(unit, str):
            raise TypeError(f"units[{name!r}]: expected text, got {unit!r}")
    exponents = [_exponent(column) for column in draws.T]
    labels = [
        _label(name, units.get(name, ""), exponent)
        for name, exponent in zip(names, exponents, strict=True)
    ]
    prior = prior_constants(idata, names)
    bounds = np.column_stack([prior["lower"].values, prior["upper"].values])
    limits = _limits(draws, marks, bounds)
    scale = 10.0 ** np.array(exponents)
    figure: Figure = corner.corner(
        draws[np.random.default_rng(0).permutation(len(draws))[:MOST_POINTS]] / scale,
        labels=labels,
        range=limits / scale[:, None],
        bins=30,
        plot_contours=False,
        plot_density=False,
        truths=[None if np.isnan(mark) else mark for mark in marks / scale],
        truth_color=BLUE,
        data_kwargs={"alpha": 0.25, "ms": 2.0, "color": GREY},
        hist_kwargs={"color": GREY},
        max_n_ticks=4,
        label_kwargs={"fontsize": 11},
        labelpad=0.08,
    )
    d = len(names)
    panels = np.array(figure.axes).reshape(d, d)
    for row, left in zip(*np.tril_indices(d, -1), strict=True):
        points = (draws / scale)[:, (left, row)]
        (width, height), angle = covariance_ellipse(points)
        style: Style = {"fill": False, "color": RED, "lw": 1.8, "zorder": 5}
        ellipse = Ellipse(points.mean(axis=0), width, height, angle=angle, **style)
        panels[row, left].add_patch(ellipse)
    handles = [
        Line2D([], [], color=GREY, marker=".", ls="", label="samples"),
        Line2D([], [], color=RED, lw=1.8, label="95 % ellipse"),
        Line2D([], [], color=BLUE, marker="s", label="reference"),
    ][: 3 if np.isfinite(marks).any() else 2]
    finish(figure, idata)
    place = {"bbox_to_anchor": (1.0, 0.96 if figure.get_suptitle() else 1.0)}
    figure.legend(
        handles=handles, loc="upper right", fontsize=13, frameon=False, **place
    )
    return figure


def covariance_ellipse(points: Floats) -> tuple[Floats, float]:
    r"""Return the ellipse that holds 95 % of a Gaussian like the points ``(n, 2)``.

    .. math:: (x - \bar x)^T C^{-1} (x - \bar x) = \chi^2_2(0.95) = -2 \ln 0.05

    with mean and covariance of the points; 95 % of the joint distribution lie inside
    2.448 standard deviations, not the 1.96 of one variable.

    Returns:
        Its major and minor axis ``(2,)``, and the angle from the first coordinate to
        the major one, counter-clockwise in degrees.

    Examples:
        >>> square = np.array([[1.0, 1], [1, -1], [-1, 1], [-1, -1]])
        >>> covariance_ellipse(square)[0].round(3).tolist()
        [5.653, 5.653]
    """
    variances, axes = np.linalg.eigh(np.cov(points, rowvar=False))
    # Ascending eigenvalues; points on a line may leave one just below zero.
    variances = np.maximum(variances[::-1], 0.0)
    x, y = axes[:, 1]
    return 2 * RADIUS * np.sqrt(variances), float(np.degrees(np.arctan2(y, x)))


def _limits(draws: Floats, marks: Floats, bounds: Floats) -> Floats:
    """Return axis limits ``(d, 2)``: samples and ellipses in the bounds, and marks."""
    reach = 1.05 * RADIUS * draws.std(axis=0)
    mean = draws.mean(axis=0)
    low = np.minimum(draws.min(axis=0), mean - reach)
    high = np.maximum(draws.max(axis=0), mean + reach)
    # fmin and fmax leave out NaN.
    low, high = np.fmax(low, bounds[:, 0]), np.fmin(high, bounds[:, 1])
    return np.column_stack([np.fmin(low, marks), np.fmax(high, marks)])


def _exponent(column: Floats) -> int:
    """Return the power of ten to take out of an axis, 0 for ordinary numbers."""
    size = float(np.abs(column).max())
    return 0 if 1e-2 <= size < 1e5 else int(np.floor(np.log10(size)))


def _label(name: str, unit: str, exponent: int) -> str:
    """Return a parameter with its unit and the power of ten taken out of its axis."""
    power = f"$10^{{{exponent}}}$ " if exponent else ""
    within = f"{power}{unit}".strip()
    return f"{name} [{within}]" if within else name


def plot_correlation(
    idata: object, *, var_names: Sequence[str] | None = None
) -> "Figure":
    """Draw the correlation of the parameters as a map with numbers (Figs 4.4, 5.3).

    Args:
        idata: What :func:`to_inference_data` returns or takes, such as a run.
        var_names: Variables of its ``posterior`` group; default: the sampled ones.

    Returns:
        The matplotlib Figure.

    Raises:
        ValueError: If a parameter has the same value in all samples.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> len(ef.figures.plot_correlation(run).axes)  # the map and its colour bar
        2
    """
    from matplotlib import pyplot as plt

    idata, _ = read_samples(idata)
    names, draws = changing_draws(idata, var_names)
    d = len(names)
    values = np.corrcoef(draws, rowvar=False).reshape(d, d)
    size = 1.8 + 0.7 * d
    figure, axes = plt.subplots(figsize=(size + 0.8, size), layout="constrained")
    image = axes.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1)
    for (i, j), value in np.ndenumerate(values):
        color = "white" if abs(value) > 0.6 else "black"
        axes.text(j, i, f"{value:.2f}", ha="center", va="center", color=color)
    axes.set_xticks(range(d), names)
    axes.set_yticks(range(d), names)
    figure.colorbar(image, ax=axes, label="correlation", shrink=0.85)
    figure = finish(figure, idata)
    figure.draw_without_rendering()  # the layout of square axes settles in two passes
    return figure
