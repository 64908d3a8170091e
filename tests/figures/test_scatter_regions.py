"""Ellipse or regions: which is drawn where, what they hold, and where axes end."""

import numpy as np
import pytest
import xarray
from matplotlib.contour import ContourSet
from matplotlib.patches import Ellipse
from support.chains import wrap
from support.figures import assert_nothing_is_clipped, legend

import emcee_femu as ef

ELLIPSE, REGIONS = "95 % ellipse", "smallest regions\nof 95 % and 50 %"
CHAINS, STEPS = 8, 500
rng = np.random.default_rng(4)
NORMAL = rng.normal(size=(CHAINS, STEPS, 2))
SIDE = rng.choice([-1.0, 1.0], (CHAINS, STEPS, 1))


LAWS = {
    "correlated": (NORMAL @ [[1.0, 0.99], [0.0, 0.02]], True),
    "two clouds": (0.1 * NORMAL + SIDE, False),
    "banana": (NORMAL * [1.0, 0.3] + [0, 1] * NORMAL[..., :1] ** 2, False),
    "heavy tails": (rng.standard_t(2, (CHAINS, STEPS, 2)), False),
    "the ellipse reaches below zero": (
        np.exp(NORMAL * [0.6, 0.0]) + NORMAL * [0.0, 1.0],
        False,
    ),
    "flat": (rng.random((CHAINS, STEPS, 2)), False),
}


def idata(draws, bounds=None):
    names = [f"p{i}" for i in range(draws.shape[-1])]
    values = {name: (("chain", "draw"), draws[..., i]) for i, name in enumerate(names)}
    groups = {"posterior": xarray.Dataset(values, attrs={"sampled": names})}
    if bounds is not None:
        low, high = np.transpose(bounds)
        constants = {"lower": ("parameter", low), "upper": ("parameter", high)}
        groups["constant_data"] = xarray.Dataset(constants, {"parameter": names})
    return wrap(groups)


def drawn(figure):
    """Return the panel of the first two parameters, its ellipses and its contours."""
    d = round(len(figure.axes) ** 0.5)
    axes = figure.axes[d]
    ellipses = [patch for patch in axes.patches if isinstance(patch, Ellipse)]
    return axes, ellipses, [c for c in axes.collections if isinstance(c, ContourSet)]


def inside(contours, level, points):
    """Return which points an odd number of the outlines of a level go round."""
    polygons = contours.get_paths()[level].to_polygons()
    shapes = [type(contours.get_paths()[level])(polygon) for polygon in polygons]
    return sum(shape.contains_points(points).astype(int) for shape in shapes) % 2 == 1


@pytest.mark.parametrize("label", LAWS)
def test_an_ellipse_where_samples_are_gaussian_and_regions_elsewhere(label):
    draws, gaussian = LAWS[label]
    figure = ef.figures.plot_scatter(idata(draws))
    _, ellipses, contours = drawn(figure)
    assert (len(ellipses), len(contours)) == ((1, 0) if gaussian else (0, 2))
    assert legend(figure) == ["samples", ELLIPSE if gaussian else REGIONS]


@pytest.mark.parametrize(("steps", "memory"), [(7, 0.0), (STEPS, 0.995)])
def test_few_or_slow_gaussian_samples_have_ellipses_in_every_panel(steps, memory):
    """Outlines of 56 draws, or of as many as 4,000 slow ones are worth, are ragged."""
    x = np.random.default_rng(5).normal(size=(CHAINS, steps, 5))
    for step in range(1, steps):
        x[:, step] = memory * x[:, step - 1] + np.sqrt(1 - memory**2) * x[:, step]
    figure = ef.figures.plot_scatter(idata(x))
    patches = [patch for axes in figure.axes for patch in axes.patches]
    assert sum(isinstance(patch, Ellipse) for patch in patches) == 10


@pytest.mark.parametrize("label", ["correlated", "two clouds", "banana"])
def test_the_regions_hold_95_and_50_percent_of_all_samples(label):
    draws = LAWS[label][0]
    _, ellipses, (_, lines) = drawn(
        ef.figures.plot_scatter(idata(draws), ellipse=False)
    )
    assert not ellipses
    points = draws.reshape(-1, 2)
    for level, share in enumerate((0.95, 0.5)):
        assert inside(lines, level, points).mean() == pytest.approx(share, abs=0.01)


def test_no_region_lies_between_separate_clouds():
    _, _, (_, lines) = drawn(ef.figures.plot_scatter(idata(LAWS["two clouds"][0])))
    places = [[0.0, 0.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]
    assert inside(lines, 0, places).tolist() == [False, True, True, False]


def test_clouds_in_a_row_stay_separate():
    row = 0.1 * NORMAL + rng.integers(5, size=(CHAINS, STEPS, 1)) * [1.0, 0.0]
    _, _, (_, lines) = drawn(ef.figures.plot_scatter(idata(row)))
    places = np.column_stack([np.arange(0, 4.5, 0.5), np.zeros(9)])
    assert inside(lines, 0, places).tolist() == [True, False] * 4 + [True]


def test_on_request_an_ellipse_is_drawn_everywhere():
    figure = ef.figures.plot_scatter(idata(LAWS["banana"][0]), ellipse=True)
    assert len(drawn(figure)[1]) == 1 and legend(figure)[1] == ELLIPSE
    with pytest.raises(TypeError, match="ellipse: expected True or False, got 'no'"):
        ef.figures.plot_scatter(idata(NORMAL), ellipse="no")


def test_a_density_that_leans_on_a_bound_does_not_fade_there():
    bounds = [(0.0, np.inf), (-np.inf, np.inf)]
    leaning = idata(np.abs(NORMAL) * [1, 0] + NORMAL * [0, 1], bounds)
    axes, _, (_, lines) = drawn(ef.figures.plot_scatter(leaning, ellipse=False))
    assert axes.get_xlim()[0] == 0.0
    # Half of a half Gaussian lies within a radius of 1.18, at the bound as elsewhere.
    along = np.column_stack([np.full(200, 0.02), np.linspace(0, 3, 200)])
    reach = along[inside(lines, 1, along), 1].max()
    assert reach == pytest.approx(1.18, abs=0.15)


def test_axes_show_where_the_mass_is():
    tails = rng.standard_t(1.5, (CHAINS, STEPS, 2))
    figure = ef.figures.plot_scatter(idata(tails))
    panels = np.array(figure.axes).reshape(2, 2)
    for i, axes in enumerate(panels[1]):
        low, high = np.quantile(tails[..., i], [0.005, 0.995])
        ends = panels[1, i].get_xlim()
        assert ends[0] >= low - 0.25 * (high - low) > tails[..., i].min()
        assert ends[1] <= high + 0.25 * (high - low)
        assert ends[0] < low < high < ends[1], axes
    gaussian = ef.figures.plot_scatter(idata(NORMAL)).axes[3].get_xlim()
    np.testing.assert_allclose(gaussian, [-3.09, 3.09], atol=0.2)


def test_axes_end_at_bounds_and_not_in_the_room_beside_samples():
    bounds = [(5.0, np.inf), (-np.inf, -5.0)]
    leaning = idata(np.abs(NORMAL) * [1, -1] + [5, -5], bounds)
    axes = drawn(ef.figures.plot_scatter(leaning))[0]
    assert axes.get_xlim()[0] == 5.0 and axes.get_ylim()[1] == -5.0


def test_axes_of_positive_samples_stay_positive_without_known_bounds():
    draws = np.exp(NORMAL)
    figure = ef.figures.plot_scatter(idata(draws))
    assert figure.axes[2].get_xlim()[0] == figure.axes[2].get_ylim()[0] == 0.0


def test_a_title_stands_above_the_panels():
    certified = idata(NORMAL)
    certified.posterior.attrs["certificate"] = "certified by 60 full solves"
    figure = ef.figures.plot_scatter(certified)
    figure.canvas.draw()
    title = figure._suptitle.get_window_extent()
    assert figure.get_suptitle() == "Certified by 60 full solves"
    assert title.y0 > figure.axes[0].get_window_extent().y1
    assert title.y0 > figure.legends[0].get_window_extent().y1


def test_six_parameters_are_readable_at_page_width():
    draws = rng.normal(size=(CHAINS, 60, 6)) * [2e-3, 1, 1e-3, 1e4, 7e9, 0.3]
    draws += [5e-2, 0, 1234, 9e4, 2.1e11, 3]
    names = [f"p{i}" for i in range(6)]
    units = dict.fromkeys(names, "kg m^2")
    figure = ef.figures.plot_scatter(idata(draws), units=units)
    assert figure.get_size_inches().tolist() == [7.0, 7.0]
    assert_nothing_is_clipped(figure, "p4 [$10^{11}$ kg m$^{2}$]")
    outer = [*figure.axes[-6:], *figure.axes[6::6]]
    for axis in [axes.xaxis for axes in outer[:6]] + [a.yaxis for a in outer[6:]]:
        texts = [t for t in axis.get_ticklabels() if t.get_text()]
        low, high = axis.get_view_interval()
        ends = axis.get_majorticklocs()[[0, -1]]
        assert (
            low + 0.04 * (high - low) < ends[0] < ends[1] < high - 0.04 * (high - low)
        )
        assert len(texts) >= 2 and min(t.get_fontsize() for t in texts) >= 8
        assert axis.label.get_fontsize() >= 7
        assert not axis.get_offset_text().get_text()
    labels = [axes.xaxis.label.get_window_extent() for axes in outer[:6]]
    assert all(a.x1 < b.x0 for a, b in zip(labels, labels[1:], strict=False))
