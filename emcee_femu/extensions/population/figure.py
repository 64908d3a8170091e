"""The figure of many tests: each alone, each given all tests, and the next one."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ... import checks
from ...contracts import Floats
from ...figures.style import BELOW, BLUE, GREY, RED, Style, finish, label_axis, subplots
from ...results.arviz_objects import unit_of
from .pool_tests import PooledTests

LEVELS = (0.025, 0.5, 0.975)
MOST_TESTS_LABELLED = 25  # of tests beside a panel
LINE_POINTS = 60  # of a line along a covariate
SHIFT = 0.17  # between the intervals of one test
BESIDE_TEST = 0.006  # of the covariate's range, between intervals of one test


def plot_population(pooled: PooledTests, against: str | None = None) -> Figure:
    """Draw the parameters of every test, their population and the next test.

    There is one panel per parameter. Grey is a test by itself (median and 95 % interval
    of its own posterior), and blue the same test given all tests. Red is the
    population: the 95 % intervals of its mean (dark) and of the next test (light). A
    cross marks a test that must be sampled again.

    Args:
        pooled: The result of :func:`pool_tests`.
        against: A covariate along which to draw the tests, with the population's mean
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
    checks.one_of("against", against, [None, *pooled.population.covariates])
    d, rows = len(pooled.population.names), len(pooled.tests) + 3
    columns = min(d, 4 if against is None else 3)
    lines = -(-d // columns)
    size = (1.0 + 4.2 * columns, 0.9 + 3.3 * lines)
    if against is None:
        height = 1.4 + float(np.clip(0.24 * rows, 2.0, 12.0))
        size = (2.6 + 2.4 * columns, height * lines)
    sharey = "row" if against is None else False
    figure, panels = subplots(d, columns, size, sharey=sharey)
    for i, axes in enumerate(panels):
        if against is None:
            _draw_rows(axes, pooled, i)
        else:
            _draw_along(axes, pooled, i, against)
    figure.legend(handles=panels[0].get_legend_handles_labels()[0], **BELOW)
    return finish(figure)


def _draw_rows(axes: Axes, pooled: PooledTests, i: int) -> None:
    """Draw one row per test, and below them the population and the next test."""
    name, count = pooled.population.names[i], len(pooled.tests)
    rows: Floats = np.arange(float(count))
    _draw_tests(axes, pooled, i, rows, SHIFT, sideways=True)
    averages = pooled.population.averages.items()
    where = "".join(f", {covariate} = {x:.4g}" for covariate, x in averages)
    for row, label, values, light, dark in (
        (0.5, "population's mean", pooled.hyperdraws[f"mean {name}"], 0.35, 0.35),
        (1.5, "next test", pooled.next_test()[name], 0.12, 0.15),
    ):
        low, middle, high = np.quantile(values, LEVELS)
        axes.axvspan(low, high, alpha=light, color=RED, lw=0)
        axes.plot([low, high], 2 * [count + row], color=RED, lw=2.4)
        axes.plot(middle, count + row, "o", color=RED, ms=5)
        axes.plot([], [], color=RED, lw=7, alpha=dark, label=f"{label}{where}")
    step = -(-count // MOST_TESTS_LABELLED)
    axes.set_yticks(
        [*rows[::step], count + 0.5, count + 1.5],
        [*pooled.tests[::step], "population's mean", "next test"],
    )
    axes.axhline(count - 0.25, color=GREY, lw=0.6)
    axes.set_ylim(count + 2.1, -0.8)
    axes.set_xlabel(label_axis(name, unit_of(pooled.idata, f"mean {name}")))


def _draw_along(axes: Axes, pooled: PooledTests, i: int, against: str) -> None:
    """Draw the tests along a covariate, with the population's mean as a line."""
    name = pooled.population.names[i]
    values = pooled.population.covariates[against]
    x = np.array([values[test] for test in pooled.tests])
    reach = float(np.ptp(x))
    line = np.linspace(x.min() - 0.05 * reach, x.max() + 0.05 * reach, LINE_POINTS)
    centre = pooled.hyperdraws[f"mean {name}"]
    centred = line - pooled.population.averages[against]
    mean = centre + centred[:, None] * pooled.hyperdraws[f"{name} per {against}"]
    # One standard test for all points, so that the band has no noise of its own.
    low, high = pooled.model.bounds_of[i]
    coming = np.clip(mean + pooled.next_test()[name] - centre, low, high)
    for label, drawn, alpha in (
        ("next test", coming, 0.12),
        ("population's mean", mean, 0.35),
    ):
        ends = np.quantile(drawn, (LEVELS[0], LEVELS[2]), axis=1)
        axes.fill_between(line, *ends, alpha=alpha, label=label, color=RED, lw=0)
    axes.plot(line, np.median(mean, axis=1), color=RED, lw=1.6)
    _draw_tests(axes, pooled, i, x, BESIDE_TEST * reach, sideways=False)
    axes.set_xlabel(against)
    axes.set_ylabel(label_axis(name, unit_of(pooled.idata, f"mean {name}")))


def _draw_tests(
    axes: Axes, pooled: PooledTests, i: int, at: Floats, shift: float, sideways: bool
) -> None:
    """Draw the intervals of the tests at places, beside each other by a shift."""
    tests = pooled.model.tests.values()
    alone = np.transpose([np.quantile(test.theta[:, i], LEVELS) for test in tests])
    together = np.quantile(pooled.theta[:, :, i], LEVELS, axis=0)
    many = len(tests) > MOST_TESTS_LABELLED
    size = 2.5 if many else 4.0
    for place, (low, middle, high), colour, what in (
        (at - shift, alone, GREY, "by itself"),
        (at + shift, together, BLUE, "given all tests"),
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
