"""Deviations of predictions from the measurements: of each value, and of the mean."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from typing import TypeAlias

import numpy as np
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..contracts import Floats
from ..posterior.log_posterior import LogPosterior
from ..results.arviz_objects import InferenceData, dataset, samples
from ..results.measured import (
    Measured,
    measured_frequencies,
    measured_variables,
    with_frequencies,
)
from ..results.tables import summarize
from ..results.to_arviz import read_samples, require_model
from .style import BELOW, BLUE, RED, Style, finish, subplots

MOST_TICK_LABELS = 24  # below a panel
FAR_PRIOR = 4.0  # prior deviations, in updated ones, that are drawn as arrows
Curve: TypeAlias = tuple[Floats, Floats]  # generations, and errors there
TAE_POINTS = 200  # generations at which the model is solved


def plot_predictive(
    idata: object, posterior: LogPosterior | None = None, experiment: str | None = None
) -> Figure:
    """Draw how far predictions lie from what was measured, and the MAC.

    There is one panel per measured variable, with deviations in percent for frequencies
    and in the variable's own unit otherwise. The model at the prior mean is a diamond,
    or an arrow with a number if it is far off. The updated model is shown by its mean
    and 95 % interval over the samples. A thin line is the 95 % interval of a new
    measurement, with its error and any inferred discrepancy. With a posterior, bands
    show the measured frequencies +- 2 standard deviations, if its
    :class:`FrequencyTerm` has them. If modes are paired, a panel below shows mean and
    95 % interval of the MAC, and the model mode that is paired most often. It takes no
    solves.

    Args:
        idata: What :func:`to_inference_data` returns, or :func:`run`.
        posterior: The sampled posterior, or None for no measurement errors; known of a
            run.
        experiment: Name of one experiment of a joint posterior; None for all of them.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If posterior is not a LogPosterior.
        ValueError: If no measured variable is one of the response, or of that
            experiment, or posterior has other parameters.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> figure = ef.figures.plot_predictive(run)
        >>> len(figure.axes)  # no modes were paired
        1
    """
    idata, posterior = read_samples(idata, posterior)
    parts = every = measured_variables(idata)
    if experiment is not None:
        parts = [p for p in every if p.experiment == experiment]
    if not parts:
        there = [part.name for part in every]
        raise ValueError(
            f"experiment: nothing was measured in {experiment!r}, only {there}"
        )
    heights = [h for p in parts for h in ([2.8] if p.mac is None else [2.8, 1.2])]
    width = float(np.clip(1.6 + 0.8 * max(len(p.labels) for p in parts), 7, 16))
    size = width, 1.2 + sum(heights)
    figure, panels = subplots(len(heights), 1, size, height_ratios=heights)
    remaining = iter(panels)
    handles: Style = {}
    for part in parts:
        axes = next(remaining)
        _draw_deviations(axes, part, part.sd(posterior))
        drawn, texts = axes.get_legend_handles_labels()
        handles |= dict(zip(texts, drawn, strict=True))
        if part.mac is not None:
            axes.set_xticks([])
            axes = next(remaining)
            _draw_mac(axes, part.mac)
        labels, below = _label(part)
        step = ceil(len(labels) / MOST_TICK_LABELS)
        axes.set_xticks(range(0, len(labels), step), labels[::step])
        axes.set_xlabel(below)
    figure.legend(handles.values(), handles.keys(), **BELOW)
    return finish(figure, idata)


def _label(part: Measured) -> tuple[list[str], str]:
    """Return what stands below the places, and what that is."""
    labels = [
        f"{label}\n{value:.5g} {part.unit}".strip()
        for label, value in zip(part.labels, part.values, strict=True)
    ]
    below = f"{part.dims.replace('_', ' ')}; below it, the measured {part.quantity}"
    below = below.removeprefix("; below it, the ")
    if part.model_mode is None:
        return labels, below
    for i, modes in enumerate(part.model_mode.astype(int).T):
        counts = np.bincount(modes)
        share = 100 * counts.max() / len(modes)
        labels[i] += f"\nmodel's {counts.argmax()}"
        if share < 100:
            labels[i] += f"\nin {min(share, 99.9):.3g} %"
    return labels, f"{below}, and the model's mode paired with it"


def _draw_deviations(axes: Axes, part: Measured, sd: Floats) -> None:
    """Draw the variable before and after updating, and its measurement error."""
    measured, unit = part.values, part.unit
    scale = np.ones_like(measured)
    if unit == "Hz":
        scale, unit = 100 / measured, "%"
    place = np.arange(len(measured))
    _, low, high = scale * (summarize(part.predicted) - measured)
    mean = scale * (part.updated - measured)
    before = scale * (part.initial - measured)
    band = np.abs(2 * scale * sd)
    stated = np.isfinite(band)
    shown = [np.zeros(1), low, high, -band[stated], band[stated]]
    axes.axhline(0, color="black", lw=0.8)
    if stated.any():
        style: Style = {"width": 0.7, "color": "0.85", "label": "measured ± 2 sd"}
        axes.bar(place[stated], 2 * band[stated], bottom=-band[stated], **style)
    if part.replicated is not None:
        ends = scale * (summarize(part.replicated)[1:] - measured)
        shown.extend(ends)
        label = "95 % of new measurements"
        axes.vlines(place, *ends, color=BLUE, lw=1.2, label=label)
    label = "updated model: mean (circle), 95 % interval"
    _draw_intervals(axes, mean, low, high, label)
    _draw_initial(axes, before, np.concatenate(shown), unit)
    old, new = (f"{np.abs(x).mean():.2g} {unit}".rstrip() for x in (before, mean))
    solved = np.isfinite(before).all()  # the model may fail at the prior mean
    title = f"{old} at the prior mean, {new} updated" if solved else f"{new} updated"
    name = replace(part, experiment="").name
    name = f"{part.experiment}: {name}".removeprefix(": ")
    axes.set_title(f"{name}, mean error {title}", fontsize=10)
    label = f"deviation from the\nmeasured {part.quantity}"
    axes.set_ylabel(f"{label} ({unit})" if unit else label)
    # A power of ten above the axis would stand in the title.
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:.6g}")
    axes.grid(True, axis="y", alpha=0.25)


def _draw_mac(axes: Axes, mac: Floats) -> None:
    """Draw mean and 95 % interval of the MAC ``(n, m)``."""
    mean, low, high = summarize(mac)
    _draw_intervals(axes, mean, low, high)
    axes.axhline(1, color="black", lw=0.8)
    span = 1 - min(low.min(), 0.9)
    axes.set_ylim(1 - 1.1 * span, 1 + 0.1 * span)
    axes.set_ylabel("MAC\n(1: same shape)")
    axes.grid(True, axis="y", alpha=0.25)


def _draw_initial(axes: Axes, before: Floats, shown: Floats, unit: str) -> None:
    """Draw the model at the prior mean, and set limits that hold what is ``shown``."""
    near = np.abs(before) <= FAR_PRIOR * np.abs(shown).max()
    inside = np.append(shown, before[near])
    margin = 0.08 * float(np.ptp(inside)) or 1.0  # all alike only in an exact fit
    room = 3 * margin  # for arrows
    low = inside.min() - margin - room * (before[~near] < 0).any()
    high = inside.max() + margin + room * (before[~near] > 0).any()
    near |= (low < before) & (before < high)
    far = np.isfinite(before) & ~near
    place = np.arange(len(before))
    style: Style = {"color": RED, "mfc": "none", "ms": 7, "ls": ""}
    if near.any():
        label = "before updating: prior mean"
        axes.plot(place[near] - 0.22, before[near], marker="D", label=label, **style)
    if far.any():  # in the legend, for annotations are in none
        label = "before updating: beyond the axis"
        axes.plot([], [], marker=r"$\uparrow$", label=label, **style)
    style = {"color": RED, "ha": "center", "fontsize": 9}
    style["arrowprops"] = {"arrowstyle": "-|>", "color": RED}
    for x, value in zip(place[far], before[far], strict=True):
        text = f"before:\n{value:+.3g} {unit}".rstrip()
        end, away, va = (high, -room, "bottom") if value > 0 else (low, room, "top")
        axes.annotate(text, (x, end), (x, end + away), va=va, **style)
    axes.set_ylim(low, high)


def _draw_intervals(
    axes: Axes, mean: Floats, low: Floats, high: Floats, label: str = ""
) -> None:
    place = np.arange(len(mean))
    axes.vlines(place, low, high, color=BLUE, lw=5, label=label)
    axes.plot(place, mean, "o", color="white", mec=BLUE, ms=5)
    axes.set_xlim(-0.6, len(mean) - 0.4)


def plot_tae(
    idata: object, posterior: LogPosterior | None = None, experiment: str | None = None
) -> Figure:
    """Draw the total average error at the running mean (Figs 4.3, 5.4).

    It is the mean error of the frequencies at the mean of the parameters, as in the
    paper, and not of the updated ones of :func:`frequency_table`. It shows how many
    generations the mean needs to settle, and takes up to 200 solves.

    Args:
        idata: The result of :func:`run`, without its burn-in, or what
            ``to_inference_data(run, discard=0)`` returns, with it.
        posterior: The sampled posterior, if idata is an ArviZ object or a certificate.
        experiment: Name of one experiment of a joint posterior; None for a curve of
            each.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If posterior is not a LogPosterior, or is missing.
        ValueError: If no term has measured frequencies, or posterior has other
            parameters.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> figure = ef.figures.plot_tae(run)
        >>> figure.axes[0].get_ylabel()
        'total average error of the mean so far (%)'
    """
    # A result's own posterior is not taken: its model may be slow, as of a certificate.
    idata, known = read_samples(idata, posterior)
    posterior = require_model(known)
    tests: list[str | None] = [experiment]
    if experiment is None:
        every = with_frequencies(measured_variables(idata))
        tests = [part.experiment or None for part in every] or tests
    curves = running_errors(idata, posterior, tests)
    figure, (axes,) = subplots(1, 1, (6.4, 4.0))
    draw_errors(axes, [(*curve, {"label": name}) for name, curve in curves.items()])
    axes.set_xlabel("generation")
    last = [f"{curve[1][-1]:.3g} %" for curve in curves.values()]
    axes.set_title(f"after the last generation: {', '.join(last)}", fontsize=10)
    if len(curves) > 1:
        axes.legend(fontsize=9)
    return finish(figure, idata)


def running_tae(
    idata: InferenceData, posterior: LogPosterior, experiment: str | None = None
) -> Curve:
    """Return generations and the total average error of the mean so far, in percent.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior.
        experiment: Name of one experiment of a joint posterior.

    Raises:
        ValueError: If no term of the posterior has measured frequencies.
    """
    return running_errors(idata, posterior, [experiment])[experiment]


def running_errors(
    idata: InferenceData, posterior: LogPosterior, experiments: Sequence[str | None]
) -> dict[str | None, Curve]:
    r"""Return the curve of :func:`running_tae` of each experiment, by the same solves.

    .. math:: TAE(i) = \frac{100}{N_m} \sum_j \frac{|f_j^m - f_j(\bar\theta_i)|}{f_j^m},
        \qquad \bar\theta_i = \frac{1}{i} \sum_{s \le i} \theta_s

    with the mean over all walkers and ensembles up to generation i, at 200
    generations spaced geometrically.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior.
        experiments: Their names; None for a single one.

    Raises:
        ValueError: If no term of the posterior has measured frequencies.

    Source: the text below Table 4.2 of Sherri, Boulkaibet, Marwala and Friswell.
    """
    every = {name: measured_frequencies(idata, name) for name in experiments}
    by_generation = samples(idata)[1].mean(axis=0)  # (draws, d)
    n = len(by_generation)
    means = np.cumsum(by_generation, axis=0) / np.arange(1, n + 1)[:, None]
    where = np.unique(np.geomspace(1, n, TAE_POINTS).round().astype(int))
    rows = posterior(means[where - 1])
    group = dataset(idata, "posterior")
    steps = 1.0 + group.get("step", group["draw"]).values[where - 1]
    curves: dict[str | None, Curve] = {}
    for name, part in every.items():
        found = rows[:, posterior.columns[part.variable]][:, : len(part.values)]
        curves[name] = steps, 100 * np.abs(found / part.values - 1).mean(axis=1)
    return curves


def draw_errors(axes: Axes, curves: Sequence[tuple[Floats, Floats, Style]]) -> None:
    """Draw errors in percent in their styles; logarithmic where a decade is passed."""
    for generations, error, style in curves:
        axes.plot(generations, error, **style)
    axes.set(xscale="log", ylabel="total average error of the mean so far (%)")
    axes.xaxis.set_major_formatter("{x:g}")
    values = np.concatenate([error for _, error, _ in curves])
    if values.max() > 10 * values.min():
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_minor_formatter(ticker.NullFormatter())
        axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(True, which="both", alpha=0.25)
