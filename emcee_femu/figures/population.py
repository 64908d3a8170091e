"""The figure of many tests: each alone, each in the light of all, and the next one."""

from typing import TYPE_CHECKING

import numpy as np

from .. import checks
from ..interfaces import Floats
from ..population.pool_tests import PooledTests
from .style import BELOW, BLUE, GREY, RED, Style, finish

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEVELS = (0.025, 0.5, 0.975)
MOST_LABELS = 25  # of tests beside a panel
POINTS = 60  # of a line along a covariate
SHIFT = 0.17  # between the intervals of one test
BESIDE = 0.006  # of the covariate's range, between intervals of one test


def plot_population(pooled: PooledTests, against: str | None = None) -> "Figure":
    """Draw the parameters of every test, their population and the next test.

    One panel per parameter. Grey is a test by itself (median and 95 % interval of its
    own posterior), blue the same test in the light of all; red is the population: the
    95 % intervals of its mean (dark) and of the next test (light). A cross marks a test
    that has to be sampled again.

    Args:
        pooled: What :func:`pool_tests` returns.
        against: A covariate; tests are then drawn along it, with the population's mean
            as a line. None for one row per test.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If pooled is something else.
        ValueError: If the population has no such covariate.

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
        >>> prior = ef.GaussianPrior(["k"], [9.0], [1.0], [(5.0, 13.0)])
        >>> tests = {}
        >>> for name, f in {"May": 2.95, "June": 3.05}.items():
        ...     term = ef.FrequencyTerm([f], sd=0.01)
        ...     posterior = ef.LogPosterior(model, term, prior)
        ...     samplers = ef.run(posterior, ef.DEMCMove(), 16, 60, ensembles=1, seed=1)
        ...     tests[name] = ef.to_inference_data(samplers, posterior, discard=30)
        >>> population = ef.population.NormalPopulation(["k"])
        >>> pooled = ef.pool_tests(tests, population, seed=1, steps=50, ensembles=1,
        ...                        draws=100)
        >>> figure = ef.figures.plot_population(pooled)
        >>> [text.get_text() for text in figure.axes[0].get_yticklabels()]
        ['May', 'June', "population's mean", 'next test']
    """
    checks.instance("pooled", pooled, PooledTests)
    known = pooled.population.covariates
    if against is not None and against not in [*known]:
        raise ValueError(
            f"against: expected a covariate among {[*known]}, got {against!r}"
        )
    from matplotlib import pyplot as plt

    d = len(pooled.population.names)
    if against is None:
        rows = len(pooled.tests) + 3
        columns, height = min(d, 4), 1.4 + float(np.clip(0.24 * rows, 2.0, 12.0))
        lines = -(-d // columns)
        size = (2.6 + 2.4 * columns, height * lines)
    else:
        columns = min(d, 3)
        lines = -(-d // columns)
        size = (1.0 + 4.2 * columns, 0.9 + 3.3 * lines)
    figure, panels = plt.subplots(
        lines,
        columns,
        figsize=size,
        layout="constrained",
        squeeze=False,
        sharey="row" if against is None else False,
    )
    for axes in panels.flat[d:]:
        axes.remove()
    for i, axes in enumerate(panels.flat[:d]):
        if against is None:
            _draw_rows(axes, pooled, i)
        else:
            _draw_along(axes, pooled, i, against)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, **BELOW)
    return finish(figure)


def _draw_rows(axes: "Axes", pooled: PooledTests, i: int) -> None:
    """Draw one row per test, and below them the population and the next test."""
    name, count = pooled.population.names[i], len(pooled.tests)
    rows: Floats = np.arange(float(count))
    _draw_tests(axes, pooled, i, rows, SHIFT, sideways=True)
    mean = np.quantile(pooled.hyperdraws[f"mean {name}"], LEVELS)
    coming = np.quantile(pooled.next_test()[name], LEVELS)
    band: Style = {"color": RED, "lw": 0}
    axes.axvspan(coming[0], coming[2], alpha=0.12, **band)
    axes.axvspan(mean[0], mean[2], alpha=0.35, **band)
    averages = pooled.population.averages.items()
    where = "".join(f", {covariate} = {x:.4g}" for covariate, x in averages)
    for row, found, label, alpha in (
        (count + 0.5, mean, f"population's mean{where}", 0.35),
        (count + 1.5, coming, f"next test{where}", 0.15),
    ):
        axes.plot([found[0], found[2]], [row, row], color=RED, lw=2.4)
        axes.plot(found[1], row, "o", color=RED, ms=5)
        axes.plot([], [], color=RED, lw=7, alpha=alpha, label=label)
    step = -(-count // MOST_LABELS)
    axes.set_yticks(
        [*rows[::step], count + 0.5, count + 1.5],
        [*pooled.tests[::step], "population's mean", "next test"],
    )
    axes.axhline(count - 0.25, color=GREY, lw=0.6)
    axes.set_ylim(count + 2.1, -0.8)
    axes.set_xlabel(name)


def _draw_along(axes: "Axes", pooled: PooledTests, i: int, against: str) -> None:
    """Draw the tests along a covariate, with the population's mean as a line."""
    name = pooled.population.names[i]
    values = pooled.population.covariates[against]
    x = np.array([values[test] for test in pooled.tests])
    reach = float(np.ptp(x))
    line = np.linspace(x.min() - 0.05 * reach, x.max() + 0.05 * reach, POINTS)
    slopes = pooled.hyperdraws[f"{name} per {against}"]
    centred = line - pooled.population.averages[against]
    mean = pooled.hyperdraws[f"mean {name}"] + centred[:, None] * slopes
    # One standard test for all points, so that the band has no noise of its own.
    coming = mean + pooled.next_test()[name] - pooled.hyperdraws[f"mean {name}"]
    if np.isfinite(pooled.model.bounds_of[i]).any():
        coming = np.clip(coming, *pooled.model.bounds_of[i])
    outer, inner = (np.quantile(v, LEVELS, axis=1) for v in (coming, mean))
    band: Style = {"color": RED, "lw": 0}
    axes.fill_between(line, outer[0], outer[2], alpha=0.12, label="next test", **band)
    label = "population's mean"
    axes.fill_between(line, inner[0], inner[2], alpha=0.35, label=label, **band)
    axes.plot(line, inner[1], color=RED, lw=1.6)
    _draw_tests(axes, pooled, i, x, BESIDE * reach, sideways=False)
    axes.set_xlabel(against)
    axes.set_ylabel(name)


def _draw_tests(
    axes: "Axes", pooled: PooledTests, i: int, at: Floats, shift: float, sideways: bool
) -> None:
    """Draw the intervals of the tests at places, beside each other by a shift."""
    alone = [
        np.quantile(own.theta[:, i], LEVELS) for own in pooled.model.tests.values()
    ]
    together = np.quantile(pooled.theta[:, :, i], LEVELS, axis=0)
    count = len(pooled.tests)
    many = count > MOST_LABELS
    size = 2.5 if many else 4.0
    for place, (low, middle, high), colour, what in (
        (at - shift, np.transpose(alone), GREY, "by itself"),
        (at + shift, together, BLUE, "in the light of all"),
    ):
        lines = axes.hlines if sideways else axes.vlines
        lines(place, low, high, color=colour, lw=1.0 if many else 1.6)
        points = np.stack((middle, place) if sideways else (place, middle))
        axes.plot(*points, "o", ms=size, color=colour, zorder=3)
        axes.plot([], [], "o-", color=colour, ms=size, label=f"test {what}, 95 %")
    unreached = np.isin(pooled.tests, pooled.unreached)
    if unreached.any():
        label = "to be sampled again"
        cross: Style = {"ms": 9, "color": BLUE, "mew": 2, "zorder": 4, "label": label}
        axes.plot(*points[:, unreached], "x", **cross)
