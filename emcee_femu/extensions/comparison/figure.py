"""Figures of comparisons: moves, and model classes."""

import textwrap
from typing import TypeAlias

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import SymmetricalLogLocator

from ... import checks
from ...figures.predictive import draw_errors, running_tae
from ...figures.style import BLUE, GREY, RED, Style, finish, subplots
from .classes import CLASS_LEAD, ModelComparison
from .compare import Comparison

Colour: TypeAlias = tuple[float, float, float, float]
LABEL_WIDTH, CLASS_WIDTH = 32, 28  # characters per line
LIGHTEST = (
    0.85  # of viridis, which the colour-blind can tell apart, still seen on white
)
LEAST_WRITTEN = 0.001  # least probability written as a number
# A log evidence behind the first beyond which a linear axis would hide how near ones
# differ: the axis is then logarithmic, but for its last unit.
FAR_BEHIND = 25.0


def plot_comparison(comparison: Comparison) -> Figure:
    """Draw each move's ESS per 1000 evaluations, and the error of its mean.

    Left: the best move on top, with error bars of one standard error over the
    ensembles; hatched bars have not converged. Right, if frequencies were measured: the
    total average error of the running mean of the kept steps, in the colours of the
    bars.

    Args:
        comparison: The result of :func:`compare_moves`.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If it is something else.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> moves = {"DE-MC": ef.DEMCMove(), "jumps": ef.DEMCMove(mode_jump=0.1)}
        >>> comparison = ef.compare_moves(posterior, moves, 20, 20, ensembles=2, seed=1)
        >>> len(ef.figures.plot_comparison(comparison).axes)
        2
    """
    checks.instance("comparison", comparison, Comparison)
    labels = [*comparison.diagnoses]
    shades = colormaps["viridis"](np.linspace(0, LIGHTEST, len(labels)))
    colors = dict(zip(labels, map(tuple, shades), strict=True))
    try:
        curves = {
            label: running_tae(idata, comparison.posterior)
            for label, idata in comparison.idata.items()
        }
    except ValueError:  # no frequencies were measured
        curves = {}
    lines = 2 + max(map(len, labels)) // LABEL_WIDTH  # of the longest, with its verdict
    height = 2.2 + max(len(labels) * max(0.5, 0.2 * lines), 2.2)
    widths = [1.3, 1.0] if curves else [1.0]
    size = 11.0 if curves else 7.0, height
    figure, panels = subplots(len(widths), len(widths), size, width_ratios=widths)
    _draw_bars(panels[0], comparison, colors)
    if curves:
        axes = panels[1]
        failed = [label for label, d in comparison.diagnoses.items() if not d.converged]
        drawn = []
        for label, (steps, tae) in curves.items():
            style: Style = {"label": label, "color": colors[label], "lw": 1.6}
            style["ls"] = "--" if label in failed else "-"
            drawn.append((steps - steps[0] + 1, tae, style))
        draw_errors(axes, drawn)
        axes.set_xlabel("generation after burn-in")
        dashed = "; dashed: not converged" if failed else ""
        axes.set_title(f"colours as on the left{dashed}", fontsize=10)
    headline = comparison.conclusion.splitlines()[0]
    figure.suptitle(textwrap.fill(headline, 100 if curves else 60), fontsize=12)
    return finish(figure)


def _draw_bars(axes: Axes, comparison: Comparison, colors: dict[str, Colour]) -> None:
    efficiency = comparison.efficiency
    labels = sorted(efficiency, key=lambda label: efficiency[label][0])
    values, errors = zip(*(efficiency[label] for label in labels), strict=True)
    fit = [comparison.diagnoses[label].converged for label in labels]
    edges = [colors[label] for label in labels]
    style: Style = {"height": 0.65, "error_kw": {"capsize": 3, "lw": 1.2}}
    style["color"] = [c if good else "none" for c, good in zip(edges, fit, strict=True)]
    style["hatch"] = ["" if good else "////" for good in fit]
    bars = axes.barh(range(len(labels)), values, xerr=errors, edgecolor=edges, **style)
    axes.bar_label(bars, fmt="{:.3g}", padding=6, fontsize=9)
    axes.set_xlim(0, 1.25 * np.add(values, errors).max())  # room for the numbers
    names = [
        textwrap.fill(label, LABEL_WIDTH, break_on_hyphens=False)
        + ("" if good else f"\n({comparison.diagnoses[label].chains.short})")
        for label, good in zip(labels, fit, strict=True)
    ]
    axes.set_yticks(range(len(labels)), names)
    axes.set_xlabel("ESS per 1000 log-posterior evaluations (more is better)")
    axes.spines[["top", "right"]].set_visible(False)
    keys = [Patch(color=GREY, label="converged")]
    if not all(fit):
        text = "not converged, so the number cannot be trusted"
        keys.append(Patch(fc="none", ec=GREY, hatch="////", label=text))
    where = {"loc": "outside lower left", "ncols": len(keys), "frameon": False}
    axes.figure.legend(handles=keys, **where)


def plot_model_comparison(comparison: ModelComparison) -> Figure:
    """Draw log Bayes factors of model classes against the best, and probabilities.

    Left: the best class on top, with bars of two combined standard errors; a class
    counts as behind if its bar ends below the best. There is no bar if the error is
    unknown. Hollow markers are undecided. The axis is logarithmic beyond 1 where a
    class is more than 25 behind. Right: the probabilities given the data.

    Args:
        comparison: The result of :func:`compare_models`.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If it is something else.

    Examples:
        >>> import emcee_femu as ef
        >>> from emcee_femu.results.evidence import Evidence
        >>> one, four = Evidence(-12.3, 0.1, "known"), Evidence(-9.1, 0.1, "known")
        >>> comparison = ef.compare_models({"one factor": one, "four factors": four})
        >>> len(ef.figures.plot_model_comparison(comparison).axes)
        2
    """
    checks.instance("comparison", comparison, ModelComparison)
    labels, standings = [*comparison.standings], [*comparison.standings.values()]
    rows = np.arange(len(labels))
    colours = [RED, *(BLUE for _ in labels[1:])]
    size, widths = (9.0, 1.9 + 0.55 * len(rows)), [1.6, 1.0]
    figure, (left, right) = subplots(2, 2, size, sharey=True, width_ratios=widths)
    left.axvline(0.0, color=GREY, lw=0.8)
    for row, standing in enumerate(standings):
        x, bar = -standing.lead, CLASS_LEAD * standing.lead_error
        style: Style = {"fmt": "o", "color": colours[row], "capsize": 4}
        style["mfc"] = colours[row] if standing.decided or not row else "white"
        left.errorbar(x, row, xerr=bar if row and np.isfinite(bar) else None, **style)
        if not np.isfinite(bar):
            where: Style = {"xytext": (8, 4), "textcoords": "offset points"}
            left.annotate("no error can be claimed", (x, row), **where)
    if max(standing.lead for standing in standings) > FAR_BEHIND:
        left.set_xscale("symlog", linthresh=1.0)
        left.xaxis.set_major_locator(SymmetricalLogLocator(base=10.0, linthresh=1.0))
    left.margins(x=0.12, y=0.2)
    left.set_yticks(rows, [textwrap.fill(label, CLASS_WIDTH) for label in labels])
    left.invert_yaxis()
    left.set_xlabel("ln of the evidence over that of the first")
    probabilities = [standing.probability for standing in standings]
    drawn = right.barh(rows, probabilities, height=0.55, color=colours)
    shares = [
        f"{p:.3f}" if p >= LEAST_WRITTEN else f"< {LEAST_WRITTEN}"
        for p in probabilities
    ]
    right.bar_label(drawn, shares, padding=4, fontsize=9)
    right.set(xlim=(0, 1.2), xticks=[0, 0.5, 1], xlabel="probability given the data")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    headline = comparison.conclusion.splitlines()[0]
    figure.suptitle(textwrap.fill(headline, 90), fontsize=11)
    return finish(figure)
