"""The figure of many tests: each alone, each in the light of all, and the next one."""

from typing import Any

import numpy as np

from ..interfaces import Floats
from ..population.pooled import PooledTests
from .colours import BLUE, GREY, RED
from .shown import show_once

LEVELS = (0.025, 0.5, 0.975)
MOST_LABELS = 25  # of tests beside a panel
POINTS = 60  # of a line along a covariate
SHIFT = 0.17  # between the intervals of one test
BESIDE = 0.006  # of the covariate's range, between intervals of one test


def plot_population(pooled: PooledTests, against: str | None = None) -> Any:
    """Draw the parameters of every test, their population and the next test.

    One panel per parameter. Grey is a test by itself (median and 95 % interval of its
    own posterior), blue the same test in the light of all; red is the population: the
    95 % intervals of its mean (dark) and of the next test (light). Hollow: by a normal
    law, for its draws do not reach where the population puts it; a cross marks a test
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
        ...     samplers = ef.run(posterior, nwalkers=16, nsteps=60, seed=1)
        ...     tests[name] = ef.to_inference_data(samplers, posterior, discard=30)
        >>> pooled = ef.pool_tests(tests, ef.NormalPopulation(["k"]), seed=1, nsteps=50,
        ...                        ensembles=1, draws=100)
        >>> figure = ef.plot_population(pooled)
        >>> [text.get_text() for text in figure.axes[0].get_yticklabels()]
        ['May', 'June', "population's mean", 'next test']
    """
    if not isinstance(pooled, PooledTests):
        raise TypeError(
            f"pooled: expected what pool_tests returns, got {type(pooled).__name__}"
        )
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
    where = {"loc": "outside lower center", "ncols": 2, "frameon": False}
    figure.legend(handles, labels, **where)
    return show_once(figure)


def _draw_rows(axes: Any, pooled: PooledTests, i: int) -> None:
    """Draw one row per test, and below them the population and the next test."""
    name, count = pooled.population.names[i], len(pooled.tests)
    rows: Floats = np.arange(float(count))
    alone, together = _intervals(pooled, i)
    many = count > MOST_LABELS
    size = 2.5 if many else 4.0
    for place, found, colour, what in (
        (rows - SHIFT, alone, GREY, "test by itself"),
        (rows + SHIFT, together, BLUE, "test in the light of all"),
    ):
        hollow = _hollow(pooled) if colour is BLUE else np.zeros(count, dtype=bool)
        axes.hlines(place, found[0], found[2], color=colour, lw=1.0 if many else 1.6)
        for which, face in ((~hollow, colour), (hollow, "white")):
            style = {"ms": size, "color": colour, "mfc": face, "zorder": 3}
            axes.plot(found[1][which], place[which], "o", **style)
        axes.plot([], [], "o-", color=colour, ms=size, label=f"{what}, 95 %")
    _mark_unreached(axes, pooled, together[1], rows + SHIFT)
    mean = np.quantile(pooled.hyperdraws[f"mean {name}"], LEVELS)
    coming = np.quantile(pooled.next_test()[name], LEVELS)
    band = {"color": RED, "lw": 0}
    axes.axvspan(coming[0], coming[2], alpha=0.12, **band)
    axes.axvspan(mean[0], mean[2], alpha=0.35, **band)
    where = "".join(
        f", {covariate} = {np.mean([*values.values()]):.4g}"
        for covariate, values in pooled.population.covariates.items()
    )
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


def _draw_along(axes: Any, pooled: PooledTests, i: int, against: str) -> None:
    """Draw the tests along a covariate, with the population's mean as a line."""
    name = pooled.population.names[i]
    values = pooled.population.covariates[against]
    x = np.array([values[test] for test in pooled.tests])
    reach = np.ptp(x)
    alone, together = _intervals(pooled, i)
    line = np.linspace(x.min() - 0.05 * reach, x.max() + 0.05 * reach, POINTS)
    slopes = pooled.hyperdraws[f"{name} per {against}"]
    centred = line - np.mean([*values.values()])
    mean = pooled.hyperdraws[f"mean {name}"] + centred[:, None] * slopes
    # One standard test for all points, so that the band has no noise of its own.
    coming = mean + pooled.next_test()[name] - pooled.hyperdraws[f"mean {name}"]
    if np.isfinite(pooled.model.bounds_of[i]).any():
        coming = np.clip(coming, *pooled.model.bounds_of[i])
    outer, inner = (np.quantile(v, LEVELS, axis=1) for v in (coming, mean))
    band = {"color": RED, "lw": 0}
    axes.fill_between(line, outer[0], outer[2], alpha=0.12, label="next test", **band)
    label = "population's mean"
    axes.fill_between(line, inner[0], inner[2], alpha=0.35, label=label, **band)
    axes.plot(line, inner[1], color=RED, lw=1.6)
    shift = BESIDE * reach
    hollow = _hollow(pooled)
    none = np.zeros(len(x), dtype=bool)
    for place, found, colour, empty, what in (
        (x - shift, alone, GREY, none, "test by itself"),
        (x + shift, together, BLUE, hollow, "test in the light of all"),
    ):
        axes.vlines(place, found[0], found[2], color=colour, lw=1.2)
        for which, face in ((~empty, colour), (empty, "white")):
            style = {"ms": 3.5, "color": colour, "mfc": face, "zorder": 3}
            axes.plot(place[which], found[1][which], "o", **style)
        axes.plot([], [], "o-", color=colour, ms=4, label=f"{what}, 95 %")
    _mark_unreached(axes, pooled, x + shift, together[1])
    axes.set_xlabel(against)
    axes.set_ylabel(name)


def _intervals(pooled: PooledTests, i: int) -> tuple[Floats, Floats]:
    """Return the quantiles of each test, alone and in the light of all, ``(3, T)``."""
    alone = [np.quantile(own.theta[:, i], LEVELS) for own in pooled.model.draws]
    return np.transpose(alone), np.quantile(pooled.theta[:, :, i], LEVELS, axis=0)


def _hollow(pooled: PooledTests) -> Any:
    return np.isin(pooled.tests, pooled.by_law)


def _mark_unreached(axes: Any, pooled: PooledTests, x: Floats, y: Floats) -> None:
    which = np.isin(pooled.tests, pooled.unreached)
    if which.any():
        label = "to be sampled again"
        style = {"ms": 9, "color": BLUE, "mew": 2, "zorder": 4, "label": label}
        axes.plot(x[which], y[which], "x", **style)
