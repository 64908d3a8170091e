"""All pairs of parameters with their 95 % ellipses."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Floats
from ..results.arviz_objects import dataset
from .colours import BLUE, GREY, RED
from .draws import changing_draws, say_certified
from .ellipses import covariance_ellipse
from .shown import show_once

MOST_POINTS = 4_000  # drawn in a scatter panel; the ellipses use every sample


def plot_scatter(
    idata: Any,
    *,
    var_names: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None,
    truths: Mapping[str, float] | None = None,
    probability: float = 0.95,
) -> Any:
    """Draw all pairs of parameters with covariance ellipses in red (Figs 4.2, 5.2).

    An ellipse holds ``probability`` of a Gaussian with the samples' covariance. Axes
    end at the prior's bounds.

    Args:
        idata: What :func:`to_inference_data` returns.
        var_names: Variables of its ``posterior`` group; default: the sampled ones.
        units: Units by parameter name, for the axes.
        truths: Values to mark by parameter name, such as the nominal ones.
        probability: The share inside an ellipse.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If units or truths is not such a mapping.
        ValueError: If units or truths name an unknown parameter, probability is not
            between 0 and 1, or a parameter has the same value in all samples.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> samplers = ef.run(posterior, nwalkers=20, nsteps=100, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=50)
        >>> figure = ef.plot_scatter(idata, var_names=["k1", "k2"], units={"k1": "N/m"})
        >>> figure.axes[2].get_xlabel()
        'k1 [N/m]'
    """
    import corner

    names, draws = changing_draws(idata, var_names)
    probability = checks.real_number("probability", probability)
    if not 0 < probability < 1:
        raise ValueError(f"probability: expected between 0 and 1, got {probability:g}")
    known = [str(name) for name in dataset(idata, "posterior").data_vars]
    marks = _marks(truths, names, known)
    exponents = np.array([_exponent(column) for column in draws.T])
    labels = _labels(units, names, known, exponents)
    limits = _limits(draws, marks, _bounds(idata, names), probability)
    scale = 10.0**exponents
    shown = np.random.default_rng(0).permutation(len(draws))[:MOST_POINTS]
    figure = corner.corner(
        draws[shown] / scale,
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
    _draw_ellipses(figure, draws / scale, probability)
    say_certified(figure, idata)
    _add_legend(figure, probability, bool(np.isfinite(marks).any()))
    return show_once(figure)


def _draw_ellipses(figure: Any, draws: Floats, probability: float) -> None:
    from matplotlib.patches import Ellipse

    d = draws.shape[1]
    panels = np.array(figure.axes).reshape(d, d)
    style: dict[str, Any] = {"fill": False, "color": RED, "linewidth": 1.8, "zorder": 5}
    for row, left in zip(*np.tril_indices(d, -1), strict=True):
        shape = covariance_ellipse(draws[:, (left, row)], probability)
        width, height = 2 * shape.semi_axes
        centre = tuple(shape.centre)
        patch = Ellipse(centre, width, height, angle=shape.angle, **style)
        panels[row, left].add_patch(patch)


def _add_legend(figure: Any, probability: float, with_marks: bool) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=GREY, marker=".", ls="", label="samples"),
        Line2D([], [], color=RED, lw=1.8, label=f"{100 * probability:g} % ellipse"),
        Line2D([], [], color=BLUE, marker="s", label="reference"),
    ]
    where: dict[str, Any] = {"loc": "upper right", "fontsize": 13, "frameon": False}
    where["bbox_to_anchor"] = (1.0, 0.96 if figure.get_suptitle() else 1.0)
    figure.legend(handles=handles[: 2 + with_marks], **where)


def _marks(
    truths: Mapping[str, float] | None, names: list[str], known: list[str]
) -> Floats:
    """Return the values to mark, NaN where there is none, ``(d,)``."""
    given = {} if truths is None else checks.by_name("truths", truths, known)
    values = {k: checks.real_number(f"truths[{k!r}]", v) for k, v in given.items()}
    return np.array([values.get(name, np.nan) for name in names])


def _bounds(idata: Any, names: list[str]) -> Floats:
    """Return the prior's bounds, NaN where there is no prior, ``(d, 2)``."""
    try:
        constants = dataset(idata, "constant_data")[["lower", "upper"]]
    except ValueError:  # chains from elsewhere
        return np.full((len(names), 2), np.nan)
    by_name = constants.reindex(parameter=names)
    return np.column_stack([by_name["lower"].values, by_name["upper"].values])


def _limits(draws: Floats, marks: Floats, bounds: Floats, probability: float) -> Floats:
    """Return axis limits ``(d, 2)``: samples and ellipses in the bounds, and marks."""
    reach = 1.05 * math.sqrt(-2 * math.log1p(-probability)) * draws.std(axis=0)
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


def _labels(
    units: Mapping[str, str] | None,
    names: list[str],
    known: list[str],
    exponents: Any,
) -> list[str]:
    by_name = {} if units is None else checks.by_name("units", units, known)
    for name, unit in by_name.items():
        if not isinstance(unit, str):
            raise TypeError(f"units[{name!r}]: expected text, got {unit!r}")
    labels = []
    for name, exponent in zip(names, exponents, strict=True):
        power = f"$10^{{{exponent}}}$ " if exponent else ""
        unit = f"{power}{by_name.get(name, '')}".strip()
        labels.append(f"{name} [{unit}]" if unit else name)
    return labels
