"""Figures of parameters: what ellipses and regions hold, axes, units, densities."""

import numpy as np
import pytest
from matplotlib.contour import ContourSet
from matplotlib.patches import Ellipse, StepPatch
from numpy.testing import assert_allclose
from scipy import stats
from support.chains import by_hand, dataset
from support.figures import assert_readable

import emcee_femu as ef

MOST_POINTS = 4_000  # drawn in a panel
RNG = np.random.default_rng(4)
NORMAL = RNG.normal(size=(8, 500, 2))
SIDE = RNG.choice([-1.0, 1.0], (8, 500, 1))
POSITIVE = np.exp(NORMAL * [0.6, 0.0]) + NORMAL * [0.0, 1.0]
LAWS = {  # draws, and whether they are Gaussian
    "correlated": (NORMAL @ [[1.0, 0.99], [0.0, 0.02]], True),
    "two clouds": (0.1 * NORMAL + SIDE, False),
    "banana": (NORMAL * [1.0, 0.3] + [0, 1] * NORMAL[..., :1] ** 2, False),
    "heavy tails": (RNG.standard_t(2, (8, 500, 2)), False),
    "reaches below zero": (POSITIVE, False),
    "flat": (RNG.random((8, 500, 2)), False),
}


def made(draws, bounds=None):
    """Return an ArviZ object of draws ``(chain, draw, d)``, of p0, p1, ..."""
    ends = zip(("lower", "upper"), np.transpose(bounds or []), strict=False)
    values = {f"p{i}": values for i, values in enumerate(np.moveaxis(draws, -1, 0))}
    return by_hand(values, dict(ends) or None)


def panels(figure):
    d = round(len(figure.axes) ** 0.5)
    return np.array(figure.axes).reshape(d, d)


def drawn(figure, panel=(1, 0)):
    """Return a panel, its ellipses and its contours."""
    axes = panels(figure)[panel]
    ellipses = [patch for patch in axes.patches if isinstance(patch, Ellipse)]
    return axes, ellipses, [c for c in axes.collections if isinstance(c, ContourSet)]


def inside(contours, level, points):
    """Return which points an odd number of the outlines of a level go round."""
    polygons = contours.get_paths()[level].to_polygons()
    shapes = [type(contours.get_paths()[level])(polygon) for polygon in polygons]
    return sum(shape.contains_points(points).astype(int) for shape in shapes) % 2 == 1


@pytest.mark.parametrize(("count", "ellipse"), [(2, True), (4, False), (6, True)])
def test_the_legend_of_pairs_ends_where_the_panels_do(count, ellipse):
    draws = np.random.default_rng(5).normal(size=(4, 200, count))
    figure = ef.figures.plot_scatter(made(draws), ellipse=ellipse)
    figure.canvas.draw()
    box, (first, *_, last) = figure.legends[0].get_window_extent(), figure.axes
    assert_allclose([box.x1, box.y1], [last.bbox.x1, first.bbox.y1], atol=1.0)
    assert not box.overlaps(first.bbox) and not box.overlaps(last.bbox)


def test_every_pair_has_the_covariance_ellipse_of_all_samples():
    mix = np.array([[1.0, 0.7, -0.97], [0.0, 1.0, 0.2], [0.0, 0.0, 0.3]])
    scale = np.array([1.0, 2e-8, 3.0])
    draws = scale * (5 + np.random.default_rng(3).normal(size=(4, 1500, 3)) @ mix)
    idata, units = made(draws), {"p1": "m^4", "p2": "N/m"}
    figure = ef.figures.plot_scatter(idata, units=units, truths={"p1": 9e-8})
    flat = draws.reshape(-1, 3) / [1.0, 1e-7, 1.0]
    labels = [axes.get_xlabel() for axes in panels(figure)[-1]]
    assert labels == ["p0", "p1 [$10^{-7}$ m$^{4}$]", "p2 [N/m]"]
    (mark,) = panels(figure)[1, 1].lines  # on the scaled axis
    assert_allclose(np.ravel(mark.get_xdata()), 0.9)
    for row, left in ((1, 0), (2, 0), (2, 1)):
        axes, (patch,), _ = drawn(figure, (row, left))
        pair = flat[:, [left, row]]
        assert_allclose(patch.center, pair.mean(axis=0), rtol=1e-12)
        values, vectors = np.linalg.eigh(np.cov(pair.T))
        expected = 2 * np.sqrt(stats.chi2.ppf(0.95, 2) * values)
        assert_allclose(sorted([patch.height, patch.width]), expected, rtol=1e-6)
        angle = np.radians(patch.angle) + (patch.height > patch.width) * np.pi / 2
        assert abs(vectors[:, 1] @ [np.cos(angle), np.sin(angle)]) > 1 - 1e-6
        points = set(map(tuple, axes.lines[0].get_xydata()))
        assert len(points) == MOST_POINTS and points <= set(map(tuple, pair))
    assert_readable(figure)


@pytest.mark.parametrize("length", [1, 18])
def test_a_long_name_is_written_smaller_and_a_short_one_no_larger(length):
    names = ["k" * length, "m" * length]
    figure = ef.figures.plot_scatter(by_hand({n: NORMAL[..., 0] for n in names}))
    figure.draw_without_rendering()
    axes = panels(figure)[1, 0]
    for label, beside in ((axes.xaxis.label, "width"), (axes.yaxis.label, "height")):
        long = getattr(label.get_window_extent(), beside)
        assert long <= getattr(axes.bbox, beside) and label.get_size() <= 10


@pytest.mark.parametrize("label", LAWS)
def test_an_ellipse_where_samples_are_gaussian_and_regions_elsewhere(label):
    draws, gaussian = LAWS[label]
    _, ellipses, contours = drawn(ef.figures.plot_scatter(made(draws)))
    assert (len(ellipses), len(contours)) == ((1, 0) if gaussian else (0, 2))
    asked = ef.figures.plot_scatter(made(draws), ellipse=not gaussian)
    assert len(drawn(asked)[1]) == (not gaussian)
    if not gaussian and label not in ("two clouds", "banana"):
        return
    lines = (drawn(asked)[2] if gaussian else contours)[-1]
    for level, share in enumerate((0.95, 0.5)):
        held = inside(lines, level, draws.reshape(-1, 2)).mean()
        assert held == pytest.approx(share, abs=0.01)
    if label == "two clouds":  # and no region between them
        places = [[0.0, 0.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]
        assert inside(lines, 0, places).tolist() == [False, True, True, False]


def test_the_region_of_a_thin_bent_band_is_no_wider_than_the_band():
    """It was several times as wide, with islands along the arms."""
    rng = np.random.default_rng(4)
    a = rng.normal(0.0, 2.0, (4, 1000))
    band = np.stack([a, a**2 + 0.2 * rng.normal(size=a.shape)], axis=-1)
    lines = drawn(ef.figures.plot_scatter(made(band)))[2][-1]
    x = np.linspace(-2.0, 2.0, 41)
    for away in (-1.5, 0.0, 1.5):
        places = np.column_stack([x, x**2 + away])
        assert inside(lines, 0, places).all() == (away == 0)
        assert inside(lines, 0, places).any() == (away == 0)


def test_a_density_that_leans_on_a_bound_does_not_fade_there():
    bounds = [(0.0, np.inf), (-np.inf, np.inf)]
    leaning = made(np.abs(NORMAL) * [1, 0] + NORMAL * [0, 1], bounds)
    axes, _, (_, lines) = drawn(ef.figures.plot_scatter(leaning, ellipse=False))
    assert axes.get_xlim()[0] == 0.0
    # Half of a half Gaussian lies within a radius of 1.18, at the bound as elsewhere.
    along = np.column_stack([np.full(200, 0.02), np.linspace(0, 3, 200)])
    reach = along[inside(lines, 1, along), 1].max()
    assert reach == pytest.approx(1.18, abs=0.15)


def test_correlation_map_shows_the_correlations():
    draws = NORMAL @ [[1.0, 0.7], [0.0, 1.0]]
    figure = ef.figures.plot_correlation(made(draws))
    expected = np.corrcoef(draws.reshape(-1, 2).T)
    shown = figure.axes[0].images[0].get_array()
    assert_allclose(shown, expected, rtol=0, atol=1e-12)
    assert_readable(figure)


MARGINALS = {"k": stats.norm(10.0, 2.0), "sigma": stats.halfnorm(scale=1e-3)}
MARGINALS |= {"m": stats.lognorm(0.5, scale=3e6)}


def histograms(axes):
    return [p.get_data() for p in axes.patches if isinstance(p, StepPatch) and p.fill]


def middle(bars):
    places = bars.edges[:-1] + np.diff(bars.edges) / 2
    return np.average(places, weights=bars.values)


def test_prior_densities_stand_beside_histograms_of_the_samples():
    """Of three parameters, of which only k is learned."""
    model = ef.FunctionModel(lambda p: [p["k"]], n_modes=1)
    term = ef.FrequencyTerm([10.5], sd=0.1)
    posterior = ef.LogPosterior(model, term, ef.IndependentPrior(MARGINALS))
    run = ef.run(posterior, ef.DEMCMove(), 24, 200, ensembles=1, seed=1)
    figure = ef.figures.plot_prior_posterior(run, units={"sigma": "m", "m": "kg"})
    idata, scales = ef.to_inference_data(run), [1.0, 1e-3, 1e7]
    for axes, name, scale in zip(figure.axes, MARGINALS, scales, strict=True):
        x, y = axes.lines[0].get_data()
        density = MARGINALS[name].pdf(x * scale)
        assert_allclose(y, density / density.max(), rtol=1e-9)
        (bars,) = histograms(axes)
        values = dataset(idata, "posterior")[name].values.ravel() / scale
        counts = np.histogram(values, bars.edges)[0]
        assert_allclose(bars.values, counts / counts.max())
        assert counts.sum() >= 0.99 * len(values) and (counts > 0).sum() >= 20
    assert_readable(figure)
    # Without the posterior the prior is a histogram of its draws.
    idata["posterior"]["ratio"] = idata["posterior"]["m"] / idata["posterior"]["k"]
    names = ["k", "ratio"]  # the second has no prior
    first, second = ef.figures.plot_prior_posterior(idata, var_names=names).axes
    before, after = histograms(first)
    assert len(histograms(second)) == 1
    assert middle(before) == pytest.approx(10.0, abs=0.3)
    assert middle(after) == pytest.approx(10.5, abs=0.05)
