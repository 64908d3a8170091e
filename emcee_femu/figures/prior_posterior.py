"""What is known of each parameter before and after updating."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ..contracts import Floats
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import GaussianPrior, IndependentPrior
from ..results.arviz_objects import prior_draws
from ..results.to_arviz import read_samples
from .style import BELOW, BLUE, GREY, RED, changing_draws, finish, scale_axes, subplots

# Panels beside each other; inches of each.
HISTOGRAM_COLUMNS, HISTOGRAM_PANEL = 3, (2.33, 1.7)
HISTOGRAM_BINS, AXIS_POINTS = 25, 400  # of the central 99 % of samples, and of an axis


def plot_prior_posterior(
    idata: object,
    posterior: LogPosterior | None = None,
    *,
    var_names: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None,
    truths: Mapping[str, float] | None = None,
) -> Figure:
    """Draw the prior and the posterior density of every parameter.

    Each density is divided by its maximum: that of a parameter which the data leave
    alone has the prior's form, that of one they fix is a narrow peak. Axes show the
    central 99 % of both and a tenth more to either side; they end at the prior's
    bounds, and at zero where all samples are positive. Of priors of this package, which
    a run knows, the density itself is drawn; of others a histogram of 1,000 draws.

    Args:
        idata: What :func:`to_inference_data` returns or takes, such as a run.
        posterior: The sampled posterior, for its prior; known of a run.
        var_names: Variables of its ``posterior`` group; default: the sampled ones.
        units: Units by parameter name, for the axes.
        truths: Values to mark by parameter name, such as the nominal ones.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If units or truths is not such a mapping, or posterior not a
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
    size = (
        max(HISTOGRAM_PANEL[0] * columns, 3.4),
        0.4 + HISTOGRAM_PANEL[1] * -(-len(names) // columns),
    )
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
    return finish(figure, idata)


def _prior_density(
    posterior: LogPosterior | None, name: str, values: Floats
) -> Floats | None:
    """Return the prior's density at values ``(n,)``, its maximum 1, None if unknown."""
    prior = None if posterior is None else posterior.prior
    if not isinstance(prior, GaussianPrior | IndependentPrior):
        return None
    if name not in prior.names:  # a derived quantity
        return None
    theta = np.tile(values[:, None], len(prior.names))
    density = np.exp(prior.logpdfs(theta)[:, prior.names.index(name)])
    return np.asarray(density / density[np.isfinite(density)].max())


def _draw_histogram(axes: Axes, values: Floats, limits: Floats, color: str) -> None:
    """Draw a histogram of as many bins as the values fill well, its maximum 1."""
    low, high = np.quantile(values, [0.005, 0.995])
    width = (high - low) / HISTOGRAM_BINS
    counts, edges = np.histogram(values, np.arange(limits[0], limits[1] + width, width))
    heights = counts / counts.max()
    axes.stairs(heights, edges, fill=True, color=color, alpha=0.35)
    axes.stairs(heights, edges, color=color)
