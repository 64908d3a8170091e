"""The error of the mean so far, generation by generation."""

from collections.abc import Mapping

import numpy as np
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import checks
from ..contracts import Floats
from ..posterior.log_posterior import LogPosterior
from ..results.arviz_objects import InferenceData, dataset, samples
from ..results.measured import measured_frequencies
from ..results.to_arviz import read_samples
from .style import Style, finish, subplots

TAE_POINTS = 200  # generations at which the model is solved


def plot_tae(
    idata: object, posterior: LogPosterior | None = None, experiment: str | None = None
) -> Figure:
    """Draw the total average error of the running mean (Figs 4.3, 5.4).

    Args:
        idata: What :func:`run` or :func:`to_inference_data` returns, best without
            burn-in removed.
        posterior: The sampled posterior; known of a run.
        experiment: Name of one experiment of a joint posterior.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If posterior is not a LogPosterior, or needed.
        ValueError: If no term of it has measured frequencies, or it has other
            parameters.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> figure = ef.figures.plot_tae(run)
        >>> figure.axes[0].get_ylabel()
        'total average error of the mean so far (%)'
    """
    idata, posterior = read_samples(idata, posterior)
    posterior = checks.instance("posterior", posterior, LogPosterior)
    curve = running_tae(idata, posterior, experiment)
    figure, (axes,) = subplots(1, 1, (6.4, 4.0))
    draw_errors(axes, {f"ends at {curve[1][-1]:.3g} %": curve})
    axes.set_xlabel("generation")
    axes.legend(frameon=False)
    return finish(figure, idata)


def running_tae(
    idata: InferenceData, posterior: LogPosterior, experiment: str | None = None
) -> tuple[Floats, Floats]:
    r"""Return generations and the total average error of the mean so far, in percent.

    .. math:: TAE(i) = \frac{100}{N_m} \sum_j \frac{|f_j^m - f_j(\bar\theta_i)|}{f_j^m},
        \qquad \bar\theta_i = \frac{1}{i} \sum_{s \le i} \theta_s

    with the mean over all walkers and ensembles up to generation i, at 200
    generations spaced geometrically.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior.
        experiment: Name of one experiment of a joint posterior.

    Raises:
        ValueError: If no term of the posterior has measured frequencies.

    Source: the text below Table 4.2 of Sherri, Boulkaibet, Marwala and Friswell.
    """
    frequency = measured_frequencies(idata, experiment)
    measured = frequency.values
    by_generation = samples(idata)[1].mean(axis=0)  # (draws, d)
    n = len(by_generation)
    means = np.cumsum(by_generation, axis=0) / np.arange(1, n + 1)[:, None]
    where = np.unique(np.geomspace(1, n, TAE_POINTS).round().astype(int))
    frequencies = posterior(means[where - 1])[:, posterior.columns[frequency.variable]]
    group = dataset(idata, "posterior")
    steps = 1.0 + group.get("step", group["draw"]).values[where - 1]
    return steps, 100 * np.abs(frequencies[:, : len(measured)] / measured - 1).mean(1)


def draw_errors(
    axes: Axes,
    curves: Mapping[str, tuple[Floats, Floats]],
    styles: Mapping[str, Style] | None = None,
) -> None:
    """Draw errors in percent by label; logarithmic where a decade is passed."""
    for label, (generations, error) in curves.items():
        axes.plot(generations, error, label=label, **(styles or {}).get(label, {}))
    axes.set(xscale="log", ylabel="total average error of the mean so far (%)")
    axes.xaxis.set_major_formatter("{x:g}")
    values = np.concatenate([error for _, error in curves.values()])
    if values.max() > 10 * values.min():
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_minor_formatter(ticker.NullFormatter())
        axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(True, which="both", alpha=0.25)
