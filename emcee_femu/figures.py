"""The paper's figures, for any chain; each function returns a matplotlib Figure.

This module and comparison_figure alone use matplotlib and corner, which take seconds
to import: they are imported where they are used.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from . import checks
from .diagnostics import running_tae
from .ellipses import covariance_ellipse
from .inference_data import samples
from .interfaces import Floats
from .posterior import LogPosterior

RED, BLUE, GREY = "#c8102e", "#1f5fa8", "0.45"
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
    (:func:`ellipses.covariance_ellipse`).

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

    names, draws = _draws(idata)
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


def plot_tae(idata: Any, posterior: LogPosterior) -> Any:
    """Draw the total average error of the running mean (Figs 4.3, 5.4).

    Args:
        idata: What :func:`to_inference_data` returns, best without burn-in removed,
            or several as ``{label: idata}`` of the same posterior.
        posterior: The sampled posterior.

    Raises:
        TypeError: If posterior is no LogPosterior.
        ValueError: If no term of it has measured frequencies, it has other parameters,
            or there is no idata.
    """
    from matplotlib import pyplot as plt
    from matplotlib import ticker

    given = dict(idata) if isinstance(idata, dict) else {"": idata}
    if not given:
        raise ValueError("idata: expected at least one, got none")
    curves = {label: running_tae(item, posterior) for label, item in given.items()}
    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    lowest, highest = np.inf, 0.0
    for label, (generations, tae) in curves.items():
        end = f"ends at {tae[-1]:.3g} %"
        axes.plot(generations, tae, label=f"{label}, {end}" if label else end)
        lowest, highest = min(lowest, tae.min()), max(highest, tae.max())
    axes.set(
        xscale="log",
        xlabel="generation",
        ylabel="total average error of the mean so far (%)",
    )
    axes.xaxis.set_major_formatter("{x:g}")
    if highest > 10 * lowest:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_minor_formatter(ticker.NullFormatter())
        axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(frameon=False)
    return figure


def plot_correlation(idata: Any) -> Any:
    """Draw the correlation of the parameters as a map with numbers (Figs 4.4, 5.3).

    Args:
        idata: What :func:`to_inference_data` returns.
    """
    from matplotlib import pyplot as plt

    names, draws = _draws(idata)
    d = len(names)
    values = np.corrcoef(draws, rowvar=False).reshape(d, d)
    size = 1.8 + 0.7 * d
    figure, axes = plt.subplots(figsize=(size + 0.8, size), layout="constrained")
    image = axes.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1)
    for i in range(d):
        for j in range(d):
            dark = abs(values[i, j]) > 0.6
            axes.text(
                j,
                i,
                f"{values[i, j]:.2f}",
                ha="center",
                va="center",
                color="white" if dark else "black",
            )
    axes.set_xticks(range(d), names)
    axes.set_yticks(range(d), names)
    figure.colorbar(image, ax=axes, label="correlation", shrink=0.85)
    figure.draw_without_rendering()  # the layout of square axes settles in two passes
    return figure


def plot_proposals() -> Any:
    """Draw how M-H and DE-MC make a proposal, on a 2-D Gaussian (Fig. 3.1)."""
    from matplotlib import pyplot as plt

    covariance = np.array([[1.0, 0.8], [0.8, 1.0]])
    current, a, b = np.array([[-1.3, -0.9], [1.4, 1.0], [0.3, -0.4]])
    others = [(-0.6, -1.1), (-0.3, 0.5), (0.9, 1.5), (-1.6, -1.9), (0.6, 0.5)]
    figure, panels = plt.subplots(
        1, 2, figsize=(9.6, 4.9), sharex=True, sharey=True, layout="constrained"
    )
    grid = np.linspace(-2.6, 2.6, 121)
    x, y = np.meshgrid(grid, grid)
    points = np.stack([x, y], axis=-1)
    square = np.einsum("...i,ij,...j", points, np.linalg.inv(covariance), points)
    for axes in panels:
        axes.contour(x, y, square, [0.5, 2, 4.5], colors=GREY, linewidths=0.8)
        axes.set(aspect="equal", xlabel=r"$\theta_1$", ylabel=r"$\theta_2$")

    proposed = current + np.array([0.55, 0.25])
    panels[0].set_title("Metropolis-Hastings: a step of fixed law")
    panels[0].add_patch(plt.Circle(tuple(current), 1.0, color=BLUE, alpha=0.12))
    _arrow(panels[0], current, proposed, RED)
    _point(panels[0], current, r"$\theta_{t-1}$", below=True)
    _point(panels[0], proposed, r"$\theta^*$", RED)

    gamma, noise = 2.38 / math.sqrt(2 * 2), np.array([0.06, -0.12])
    proposed = current + gamma * (a - b) + noise
    panels[1].set_title(
        r"DE-MC: $\theta^* = \theta_i + \gamma(\theta_a - \theta_b) + \varepsilon$"
    )
    panels[1].plot(*np.transpose(others), "o", color=GREY, ms=5)
    _arrow(panels[1], b, a, BLUE)
    _arrow(panels[1], current, proposed, RED)
    _point(panels[1], a, r"$\theta_a$", BLUE)
    _point(panels[1], b, r"$\theta_b$", BLUE, below=True)
    _point(panels[1], current, r"$\theta_i$", below=True)
    _point(panels[1], proposed, r"$\theta^*$", RED)
    figure.draw_without_rendering()  # the layout of square axes settles in two passes
    return figure


def _arrow(axes: Any, start: Floats, end: Floats, color: str) -> None:
    axes.annotate(
        "", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.8}
    )


def _point(
    axes: Any, at: Floats, label: str, color: str = "black", below: bool = False
) -> None:
    axes.plot(*at, "o", color=color, ms=7)
    axes.annotate(
        label,
        at,
        textcoords="offset points",
        xytext=(6, -20) if below else (6, 8),
        color=color,
        fontsize=14,
    )


def _draws(idata: Any) -> tuple[list[str], Floats]:
    """Return names and draws ``(n, d)``, refusing a parameter that never changes."""
    names, chains = samples(idata)
    draws = chains.reshape(-1, len(names))
    for name, column in zip(names, draws.T, strict=True):
        if np.ptp(column) == 0:
            raise ValueError(f"idata: every sample of {name!r} is {column[0]:g}")
    return names, draws


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
