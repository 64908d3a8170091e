"""The figure of a comparison: who is ahead, and how the error falls."""

import textwrap
from typing import Any

from ..comparison.compare import Comparison
from ..interfaces import Floats
from ..results.diagnostics import CONVERGED
from ..results.frequencies import running_tae
from ..results.measured import measured_frequencies
from .colours import GREY
from .shown import show_once
from .total_average_error import scale_error_axes

LABEL_WIDTH = 32  # characters per line


def plot_comparison(comparison: Comparison) -> Any:
    """Draw the ESS per 1000 evaluations of each move, and the error of its mean.

    Left: the best on top, error bars of one standard error over the ensembles; the
    bars of moves that have not converged are hatched. Right, where frequencies were
    measured: the total average error of the running mean of the kept steps, in the
    colours of the bars.

    Args:
        comparison: What :func:`compare_moves` returns.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If it is something else.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> moves = {"DE-MC": ef.DEMCMove(), "crossover": ef.CrossoverMove()}
        >>> comparison = ef.compare_moves(posterior, moves, 20, 20, ensembles=2, seed=1)
        >>> len(ef.plot_comparison(comparison).axes)
        2
    """
    if not isinstance(comparison, Comparison):
        raise TypeError(
            "comparison: expected what compare_moves returns, got "
            f"{type(comparison).__name__}"
        )
    from matplotlib import pyplot as plt

    labels = comparison.table.column("move")
    palette = plt.get_cmap("tab10" if len(labels) <= 10 else "tab20").colors
    colors = {label: palette[i % len(palette)] for i, label in enumerate(labels)}
    curves = _error_curves(comparison)
    lines = 2 + max(map(len, labels)) // LABEL_WIDTH  # of the longest, with its verdict
    height = 2.2 + max(len(labels) * max(0.5, 0.2 * lines), 2.2)
    figure, panels = plt.subplots(
        1,
        1 + bool(curves),
        figsize=(11.0 if curves else 7.0, height),
        layout="constrained",
        squeeze=False,
        width_ratios=[1.3, 1.0] if curves else [1.0],
    )
    _draw_bars(panels[0, 0], comparison, colors)
    if curves:
        _draw_curves(panels[0, 1], comparison, curves, colors)
    headline = comparison.conclusion.splitlines()[0]
    figure.suptitle(textwrap.fill(headline, 100 if curves else 60), fontsize=12)
    return show_once(figure)


def _draw_bars(axes: Any, comparison: Comparison, colors: dict[str, Any]) -> None:
    from matplotlib.patches import Patch

    column = comparison.table.column
    fields = ("ESS per 1000", "+-", "move", "verdict")
    rows = sorted(zip(*map(column, fields), strict=True), key=lambda row: row[0])
    values, errors, labels, verdicts = zip(*rows, strict=True)
    fit = [verdict == CONVERGED for verdict in verdicts]
    bars = axes.barh(
        range(len(rows)),
        values,
        xerr=errors,
        height=0.65,
        color=[colors[x] if v == CONVERGED else "none" for _, _, x, v in rows],
        edgecolor=[colors[label] for label in labels],
        hatch=["" if good else "////" for good in fit],
        error_kw={"capsize": 3, "lw": 1.2},
    )
    axes.bar_label(bars, fmt="{:.3g}", padding=6, fontsize=9)
    longest = max(value + error for value, error, *_ in rows)
    axes.set_xlim(0, 1.25 * longest)  # room for the numbers
    axes.set_yticks(range(len(rows)), map(_name, labels, verdicts))
    axes.set_xlabel("ESS per 1000 log-posterior evaluations (more is better)")
    axes.spines[["top", "right"]].set_visible(False)
    keys = [Patch(color=GREY, label="converged")]
    if not all(fit):
        text = "not converged, so the number cannot be trusted"
        keys.append(Patch(fc="none", ec=GREY, hatch="////", label=text))
    where = {"loc": "outside lower left", "ncols": len(keys), "frameon": False}
    axes.figure.legend(handles=keys, **where)


def _name(label: str, verdict: str) -> str:
    """Return the label in short lines, with the verdict on moves that failed."""
    lines = textwrap.wrap(label, LABEL_WIDTH, break_on_hyphens=False)
    return "\n".join([*lines, *([] if verdict == CONVERGED else [f"({verdict})"])])


def _error_curves(comparison: Comparison) -> dict[str, tuple[Floats, Floats]]:
    """Return kept steps and TAE by label, nothing without measured frequencies."""
    curves = {}
    for label, idata in comparison.idata.items():
        try:
            measured_frequencies(idata)
        except ValueError:
            return {}
        generations, tae = running_tae(idata, comparison.posterior)
        curves[label] = (generations - generations[0] + 1, tae)
    return curves


def _draw_curves(
    axes: Any,
    comparison: Comparison,
    curves: dict[str, tuple[Floats, Floats]],
    colors: dict[str, Any],
) -> None:
    column = comparison.table.column
    verdicts = dict(zip(column("move"), column("verdict"), strict=True))
    for label, (generations, tae) in curves.items():
        style = "-" if verdicts[label] == CONVERGED else "--"
        axes.plot(generations, tae, style, color=colors[label], lw=1.6, label=label)
    scale_error_axes(axes, [tae for _, tae in curves.values()])
    dashed = set(verdicts.values()) != {CONVERGED}
    axes.set_xlabel("generation after burn-in")
    axes.set_title(f"same colours{'; dashed: not converged' if dashed else ''}")
