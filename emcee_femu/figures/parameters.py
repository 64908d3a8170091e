"""Parameters before and after updating, and all pairs of them."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from .. import checks
from ..contracts import Floats, read_declared
from ..posterior.log_posterior import LogPosterior
from ..results.arviz_objects import prior_draws, samples
from ..results.to_arviz import read_samples
from ..verdict.statistics import mean_sizes
from .style import (
    BELOW,
    BLUE,
    GREY,
    RED,
    Style,
    changing_draws,
    finish,
    scale_axes,
    subplots,
)

MOST_POINTS = 4_000  # drawn in a scatter panel; ellipses and regions use every sample
PAGE_WIDTH = 7.0  # inches: that of a page
# Inches beside the panels, and above with title.
LEFT_INCHES, RIGHT_INCHES, TITLE_INCHES = 0.8, 0.15, 0.4
LABEL, SMALLEST = 10.0, 6.0  # points
WIDE_NAME = 7  # characters below a cell of the correlation map
# Least effective sample size assumed for regions.
FEWEST_INDEPENDENT = 50.0


RADIUS = math.sqrt(-2 * math.log(0.05))  # of an ellipse, in standard deviations
REGION_SHARES = 0.95, 0.5  # of the draws in the regions
CELLS = 160  # along an axis
LINE, NARROW = 1e-8, 0.02  # 1 - r^2 of points on a line, and close to one
SMOOTH = 1.25  # times Scott's rule, for even outlines
NARROWER = 1, 2, 4, 8  # the widths that are tried are so many times narrower
UNSEEN = 1e-6  # least density, in draws per cell, that is predicted anywhere
TENTH = 0.251  # standard deviations of a Gaussian that hold its middle tenth
# Area that region and ellipse share, over that of both, from which draws count as
# Gaussian; the second for one independent draw, since few draws make ragged regions.
SAME_WIDTH, GRID_NOISE = 0.8, 1.5
# Panels beside each other; inches of each.
HISTOGRAM_COLUMNS, HISTOGRAM_PANEL = 3, (2.33, 1.7)
HISTOGRAM_BINS, AXIS_POINTS = 25, 400  # of the central 99 % of samples, and of an axis


def plot_scatter(
    idata: object,
    *,
    var_names: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None,
    truths: Mapping[str, float] | None = None,
    ellipse: bool | None = None,
) -> Figure:
    """Draw all pairs of parameters, with regions that hold 95 % of the mass in red.

    If a pair is close to Gaussian, the region is the covariance ellipse that holds 95 %
    of a Gaussian, as in Figs 4.2 and 5.2. Otherwise the smallest regions that hold 95 %
    and 50 % of the samples are drawn. A pair counts as Gaussian if the 95 % region and
    the ellipse share four fifths of the area of both (somewhat less if there are few
    effective samples, whose regions are ragged), and if the ellipse stays inside the
    axes. Axes show the central 99 % of the samples and a tenth more on either side, and
    all truths. They end at the prior's bounds, and at zero if all samples are positive.

    Args:
        idata: The result of :func:`run` or :func:`to_inference_data`, or anything that
            the latter accepts.
        var_names: Variables of its ``posterior`` group; the sampled ones by default.
        units: Units by parameter name, instead of the posterior's own.
        truths: Values to mark by parameter name, such as the nominal ones.
        ellipse: True for ellipses everywhere, False for regions everywhere; None to
            decide as above.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If units or truths is not such a mapping, or ellipse is not None,
            True or False.
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
    import corner  # and with it ArviZ, which takes seconds

    if ellipse is not None:
        checks.flag("ellipse", ellipse)
    idata, _ = read_samples(idata)
    names, draws = changing_draws(idata, var_names)
    labels, scale, limits, marks = scale_axes(idata, names, [draws], units, truths)
    draws = draws / scale
    d = len(names)
    side = max(min(PAGE_WIDTH, 2.0 + 1.2 * d), d)
    panel = (side - LEFT_INCHES - RIGHT_INCHES) / d
    style: Style = {"plot_contours": False, "plot_density": False, "max_n_ticks": 4}
    figure: Figure = corner.corner(
        draws[np.random.default_rng(0).permutation(len(draws))[:MOST_POINTS]],
        labels=labels,
        range=limits,
        bins=30,
        truths=[None if np.isnan(mark) else mark for mark in marks],
        truth_color=BLUE,
        data_kwargs={"alpha": 0.25, "ms": min(2.0, 1.2 * panel), "color": GREY},
        hist_kwargs={"color": GREY},
        **style,
    )
    figure.set_size_inches(side, side)
    finish(figure, idata)
    above = TITLE_INCHES if figure.get_suptitle() else RIGHT_INCHES
    edge = LEFT_INCHES / side
    figure.subplots_adjust(edge, edge, 1 - RIGHT_INCHES / side, 1 - above / side)
    panels = np.array(figure.axes).reshape(d, d)
    chains = samples(idata, var_names)[1]
    sizes = np.fmax(np.nan_to_num(mean_sizes(chains)), FEWEST_INDEPENDENT)  # effective
    drawn = set()
    for row, left in zip(*np.tril_indices(d, -1), strict=True):
        pair = [left, row]
        size = min(sizes[pair].min(), len(draws))
        points, shown = draws[:, pair], limits[pair]
        drawn.add(_draw_mass(panels[row, left], points, shown, size, ellipse))
    _fit_labels(figure, panels, panel)
    handles = [
        Line2D([], [], color=GREY, marker=".", ls="", label="samples"),
        Line2D([], [], color=RED, lw=1.6, label="95 % ellipse"),
        Patch(fc=(RED, 0.3), ec=RED, label="smallest regions\nof 95 % and 50 %"),
        Line2D([], [], color=BLUE, marker="s", label="reference"),
    ]
    is_shown = [d > 1, True in drawn, False in drawn, np.isfinite(marks).any()]
    handles = [h for h, shown in zip(handles, is_shown, strict=True) if shown]
    style = {"loc": "upper right", "frameon": False, "fontsize": min(11, 6.5 + d)}
    style["bbox_to_anchor"] = (1 - RIGHT_INCHES / side, 1 - above / side)
    style["borderaxespad"] = 0.0  # it ends where the panels do
    figure.legend(handles=handles, **style)
    return figure


def _draw_mass(
    axes: Axes, points: Floats, limits: Floats, size: float, ellipse: bool | None
) -> bool:
    """Draw the ellipse of points ``(n, 2)`` or their regions, and tell if the first."""
    density = None if ellipse else estimate_density(points, limits, size)
    if density is None or (ellipse is None and density[2]):
        (width, height), angle = covariance_ellipse(points)
        covariance = np.cov(points.T)
        style: Style = {"fill": False, "color": RED, "lw": 1.6, "zorder": 5}
        # A line as wide as usual would hide the samples.
        if np.linalg.det(covariance) < NARROW * np.diag(covariance).prod():
            style["lw"] = 0.6
        patch = Ellipse(points.mean(axis=0), width, height, angle=angle, **style)
        axes.add_patch(patch)
        return True
    grid, levels, _ = density
    levels = np.unique([*levels, 2 * grid[2].max()])
    axes.contourf(*grid, levels, colors=[(RED, 0.15), (RED, 0.35)], zorder=4)
    axes.contour(*grid, levels[:-1], colors=RED, linewidths=0.9, zorder=5)
    return False


def _fit_labels(figure: Figure, panels: NDArray[np.object_], panel: float) -> None:
    """Set labels and ticks so that they fit beside panels of so many inches."""
    bottom = [axes.xaxis for axes in panels[-1]]
    beside = [axes.yaxis for axes in panels[1:, 0]]
    longest = 0.0
    for axis in (*bottom, *beside):
        axis.label.set_size(LABEL)
        box = axis.label.get_window_extent()
        longest = max(longest, box.width, box.height)
        axis.set_tick_params(labelsize=8)
        axis.get_major_formatter().set_useOffset(False)
    size = LABEL * min(1.0, 0.95 * panel * figure.dpi / longest)
    for axis in (*bottom, *beside):
        axis.label.set_size(max(size, SMALLEST))
    below = [axes.xaxis for axes in panels[np.tril_indices(len(panels))]]
    below += [axes.yaxis for axes in panels[np.tril_indices(len(panels), -1)]]
    for axis in below:  # a number at the corner would meet that of the next panel
        low, high = axis.get_view_interval()
        ticks = np.array(axis.get_majorticklocs())
        axis.set_ticks(ticks[np.abs(2 * ticks - low - high) < 0.9 * (high - low)])
    away = -(LEFT_INCHES - 0.25) / panel
    for axis in bottom:
        axis.set_label_coords(0.5, away)
    for axis in beside:
        axis.set_label_coords(away, 0.5)


def plot_correlation(
    idata: object, *, var_names: Sequence[str] | None = None
) -> Figure:
    """Draw the correlation matrix of the parameters with numbers (Figs 4.4, 5.3).

    Args:
        idata: The result of :func:`run` or :func:`to_inference_data`, or anything that
            the latter accepts.
        var_names: Variables of its ``posterior`` group; the sampled ones by default.

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
    idata, _ = read_samples(idata)
    names, draws = changing_draws(idata, var_names)
    d = len(names)
    values = np.corrcoef(draws, rowvar=False).reshape(d, d)
    size = 1.8 + 0.7 * d
    figure, (axes,) = subplots(1, 1, (size + 0.8, size))
    image = axes.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1)
    for (i, j), value in np.ndenumerate(values):
        color = "white" if abs(value) > 0.6 else "black"
        axes.text(j, i, f"{value:.2f}", ha="center", va="center", color=color)
    slope = 40 if max(map(len, names)) > WIDE_NAME else 0  # else they would meet
    ends: Style = {"ha": "right", "rotation_mode": "anchor"} if slope else {}
    axes.set_xticks(range(d), names, rotation=slope, **ends)
    axes.set_yticks(range(d), names)
    figure.colorbar(image, ax=axes, label="correlation", shrink=0.85)
    finish(figure, idata)
    figure.draw_without_rendering()  # the layout of square axes settles in two passes
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


def estimate_density(
    points: Floats, limits: Floats, size: float
) -> tuple[tuple[Floats, Floats, Floats], Floats, bool] | None:
    """Return the density of points ``(n, 2)`` inside the axes' limits ``(2, 2)``.

    A histogram of coordinates without correlation, smoothed by a Gaussian as wide as
    ``size`` independent points allow, in units of the narrowest tenth of them along
    each axis: separate clouds stay separate. It is narrower where half of the points
    then predict the others better. Points are mirrored at the limits, so that
    a density that leans on a bound does not fade there. None for points on a line.
    """
    near = points[((points >= limits[:, 0]) & (points <= limits[:, 1])).all(axis=1)]
    centre, scale = near.mean(axis=0), near.std(axis=0)
    correlation: Floats = np.atleast_2d(np.corrcoef(near, rowvar=False))
    if not 1 - correlation[0, 1] ** 2 > LINE:
        return None
    # x = centre + turn z; without correlation z are the parameters themselves.
    turn = scale[:, None] * np.linalg.cholesky(correlation)
    back = np.linalg.inv(turn)
    z = (near - centre) @ back.T
    tenth = min(max(len(z) // 10, 50), len(z) - 1)  # fewer may be close by chance
    ordered = np.sort(z, axis=0)
    narrow = (ordered[tenth:] - ordered[:-tenth]).min(axis=0) / TENTH
    width = SMOOTH * np.where(narrow < 0.4, narrow, 1.0) * size ** (-1 / 6)
    low, high = z.min(axis=0) - 4 * width, z.max(axis=0) + 4 * width
    cells = (high - low) / CELLS
    edges = np.linspace(low, high, CELLS + 1).T

    def smooth(points: Floats, width: Floats, at: Floats) -> tuple[Floats, Floats]:
        """Return the density of points on the grid, and where it is asked for."""
        mirrored = [points]
        for axis, end in np.ndindex(2, 2):
            mirrored.append(points.copy())
            mirrored[-1][:, axis] = 2 * limits[axis, end] - points[:, axis]
        everywhere = (np.concatenate(mirrored) - centre) @ back.T
        counts = np.histogramdd(everywhere, bins=[*edges])[0]
        values = gaussian_filter(counts, width / cells, mode="constant")
        places = ((at - low) / cells - 0.5).T
        return values, map_coordinates(values, places, order=1)

    # Of a thin bent band no axis tells the width: the second half of the draws does,
    # which come from other walkers than the first.
    half = len(near) // 2
    told = [smooth(near[:half], width / n, z[half:])[1] for n in NARROWER]
    likeliest = np.argmax([np.log(np.fmax(each, UNSEEN)).mean() for each in told])
    at_points = np.zeros(len(points))  # none where the axes do not reach
    values, at_points[: len(near)] = smooth(near, width / NARROWER[likeliest], z)
    levels = np.quantile(at_points, 1 - np.array(REGION_SHARES))
    centres = low + cells * (0.5 + np.arange(CELLS)[:, None])
    x = centre + np.stack(np.meshgrid(*centres.T, indexing="ij"), axis=-1) @ turn.T
    offsets, precision = x - points.mean(axis=0), np.linalg.inv(np.cov(points.T))
    squares = np.einsum("...i,ij,...j", offsets, precision, offsets)
    shown = ((x >= limits[:, 0]) & (x <= limits[:, 1])).all(axis=-1)
    region, ellipse = (values >= levels[0]) & shown, squares <= RADIUS**2
    overlap = (region & ellipse).sum() / (region | ellipse).sum()
    fits = shown[ellipse].all()
    gaussian = bool(fits and overlap > SAME_WIDTH - GRID_NOISE / math.sqrt(size))
    return (x[..., 0], x[..., 1], values), levels, gaussian


def plot_prior_posterior(
    idata: object,
    posterior: LogPosterior | None = None,
    *,
    var_names: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None,
    truths: Mapping[str, float] | None = None,
) -> Figure:
    """Draw the prior and posterior densities of every parameter.

    Each density is divided by its maximum, so heights cannot be compared. If the data
    say nothing about a parameter, both curves have the same form; if they determine it,
    the posterior is a narrow peak. Axes show the central 99 % of both and a tenth more
    on either side. They end at the prior's bounds, and at zero if all samples are
    positive. The density is drawn for priors of this package if the posterior is known,
    as it is to a run; for others, a histogram of 1,000 draws.

    Args:
        idata: The result of :func:`run` or :func:`to_inference_data`, or anything that
            the latter accepts.
        posterior: The sampled posterior, for its prior, if idata is an ArviZ object.
        var_names: Variables of its ``posterior`` group; the sampled ones by default.
        units: Units by parameter name, for the axes.
        truths: Values to mark by parameter name, such as the nominal ones.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If units or truths is not such a mapping, or posterior is not a
            LogPosterior.
        ValueError: If units or truths name an unknown parameter, a parameter has the
            same value in all samples, or posterior has other parameters.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> figure = ef.figures.plot_prior_posterior(run)
        >>> [axes.get_xlabel() for axes in figure.axes]
        ['k1 [N/m]', 'k2 [N/m]', 'k4 [N/m]', 'k6 [N/m]', 'k8 [N/m]']
    """
    idata, posterior = read_samples(idata, posterior)
    names, draws = changing_draws(idata, var_names)
    before = prior_draws(idata, names)
    known = ~np.isnan(before[0])
    shown = [draws, np.where(known, before, draws.mean(axis=0))]
    labels, scale, limits, marks = scale_axes(idata, names, shown, units, truths)
    columns = min(len(names), HISTOGRAM_COLUMNS)
    width, height = HISTOGRAM_PANEL
    size = max(width * columns, 3.4), 0.4 + height * -(-len(names) // columns)
    figure, panels = subplots(len(names), columns, size)
    for i, axes in enumerate(panels):
        grid = np.linspace(limits[i, 0], limits[i, 1], AXIS_POINTS)
        density = _prior_density(posterior, names[i], grid * scale[i])
        if density is not None:
            axes.fill_between(grid, density, color=GREY, alpha=0.3)
            axes.plot(grid, density, color=GREY, lw=1)
        elif known[i]:
            _draw_histogram(axes, before[:, i] / scale[i], limits[i], GREY)
        _draw_histogram(axes, draws[:, i] / scale[i], limits[i], RED)
        axes.axvline(marks[i], color=BLUE, lw=1.4)
        axes.set(xlim=limits[i], ylim=(0, 1.08), yticks=[], xlabel=labels[i])
        axes.xaxis.set_major_locator(MaxNLocator(4, prune="both"))
        axes.ticklabel_format(axis="x", useOffset=False)
        axes.spines[["left", "top", "right"]].set_visible(False)
    keys = [
        Patch(color=GREY, alpha=0.5, label="prior"),
        Patch(color=RED, alpha=0.5, label="posterior"),
        Line2D([], [], color=BLUE, lw=1.4, label="reference"),
    ]
    keys = keys[: 3 if np.isfinite(marks).any() else 2]
    figure.legend(handles=keys, **BELOW | {"ncols": 3})
    figure.supylabel("density, scaled to\na maximum of 1", fontsize=9, ma="center")
    return finish(figure, idata)


def _prior_density(
    posterior: LogPosterior | None, name: str, values: Floats
) -> Floats | None:
    """Return the prior's density at values ``(n,)``, its maximum 1, None if unknown."""
    prior = posterior and posterior.prior
    logpdfs = read_declared(prior, "logpdfs")
    if prior is None or logpdfs is None or name not in prior.names:
        return None  # as for a derived quantity
    theta = np.tile(values[:, None], len(prior.names))
    density = np.exp(logpdfs(theta)[:, prior.names.index(name)])
    return np.asarray(density / density[np.isfinite(density)].max())


def _draw_histogram(axes: Axes, values: Floats, limits: Floats, color: str) -> None:
    """Draw a histogram of as many bins as the values fill well, its maximum 1."""
    low, high = np.quantile(values, [0.005, 0.995])
    width = (high - low) / HISTOGRAM_BINS
    counts, edges = np.histogram(values, np.arange(limits[0], limits[1] + width, width))
    heights = counts / counts.max()
    axes.stairs(heights, edges, fill=True, color=color, alpha=0.35)
    axes.stairs(heights, edges, color=color)
