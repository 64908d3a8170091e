import numpy as np
import pytest
import xarray
from matplotlib.patches import Ellipse
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.chains import dataset, wrap
from support.figures import assert_nothing_is_clipped, legend

import emcee_femu as ef

PROBLEM = ef.paper.h_structure()
CORRELATED = np.array([[1.0, 0.7, -0.97], [0.0, 1.0, 0.2], [0.0, 0.0, 0.3]])
MIXED = {"stiff": 1e3, "alpha": 2e-8, "x": 3.0, "big": 4e6, "long_name": 1e-3}


MOST_POINTS = 4_000  # drawn in a panel


@pytest.fixture(scope="module")
def run():
    return ef.run(PROBLEM.posterior, ef.DEMCMove(), 24, 100, seed=1, ensembles=1)


def samples(idata):
    """Return names and draws ``(n, d)``."""
    group = dataset(idata, "posterior")
    names = list(group.attrs.get("sampled", group.data_vars))
    return names, np.column_stack([group[name].values.ravel() for name in names])


def made(values, bounds=None, **attributes):
    """Return an ArviZ object of samples ``(chain, draw)``."""
    posterior = {name: (("chain", "draw"), value) for name, value in values.items()}
    attributes["sample_dims"] = ["chain", "draw"]
    groups = {"posterior": xarray.Dataset(posterior, attrs=attributes)}
    if bounds:
        low, high = np.transpose(list(bounds.values()))
        constants = {"lower": ("parameter", low), "upper": ("parameter", high)}
        coords = {"parameter": list(bounds)}
        groups["constant_data"] = xarray.Dataset(constants, coords)
    return wrap(groups)


def gaussian(d, n=60):
    rng = np.random.default_rng(d)
    mix = np.eye(d)
    mix[: min(d, 3), : min(d, 3)] = CORRELATED[: min(d, 3), : min(d, 3)]
    draws = 5 + rng.normal(size=(4, n, d)) @ mix
    return made({k: MIXED[k] * draws[:, :, i] for i, k in enumerate(list(MIXED)[:d])})


def ellipses(figure, d):
    panels = np.array(figure.axes).reshape(d, d)
    found = {}
    for (row, column), panel in np.ndenumerate(panels):
        patches = [patch for patch in panel.patches if isinstance(patch, Ellipse)]
        if patches:
            (found[row, column],) = patches
    return found


def powers(draws):
    return 10.0 ** np.floor(np.log10(np.abs(draws).max(axis=0)))


def share_inside(points, ellipse):
    angle = np.radians(ellipse.angle)
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    semi_axes = np.array([ellipse.width, ellipse.height]) / 2
    along = (points - ellipse.center) @ axes.T / semi_axes
    return ((along * along).sum(axis=1) <= 1).mean()


@pytest.mark.parametrize("d", [1, 2, 4])
def test_every_pair_has_the_covariance_ellipse_of_all_samples(d):
    idata = gaussian(d, n=1500)  # more samples than points are drawn
    figure = ef.figures.plot_scatter(idata)
    draws = samples(idata)[1]
    assert len(draws) > MOST_POINTS
    draws = draws / np.where([k in (1, 3, 4) for k in range(d)], powers(draws), 1)
    found = ellipses(figure, d)
    assert set(found) == {(row, left) for row in range(d) for left in range(row)}
    for (row, left), patch in found.items():
        pair = draws[:, [left, row]]
        assert_allclose(patch.center, pair.mean(axis=0), rtol=1e-12)
        covariance = np.cov(pair.T)
        radius = stats.chi2.ppf(0.95, 2)
        sizes = [patch.height, patch.width]
        expected = 2 * np.sqrt(radius * np.linalg.eigvalsh(covariance))
        assert_allclose(sizes, expected, rtol=1e-6)
        # Mahalanobis distances, without angle and axes
        offsets = pair - pair.mean(axis=0)
        squares = np.einsum("ni,ij,nj->n", offsets, np.linalg.inv(covariance), offsets)
        inside = (squares <= radius).mean()
        assert abs(share_inside(pair, patch) - inside) < 1e-3
        assert abs(inside - 0.95) < 0.05  # a Gaussian
        assert not patch.get_fill()
        assert patch.get_edgecolor()[0] > 0.7 > 0.3 > patch.get_edgecolor()[1]  # red
        points = set(map(tuple, figure.axes[row * d + left].lines[0].get_xydata()))
        assert len(points) == MOST_POINTS and points <= set(map(tuple, pair))
    if d > 1:
        assert legend(figure) == ["samples", "95 % ellipse"]


def test_axes_carry_names_units_and_powers_of_ten_and_nothing_is_clipped(run):
    idata, units = ef.to_inference_data(run), PROBLEM.units
    names, draws = samples(idata)
    figure = ef.figures.plot_scatter(idata, units=units, truths=PROBLEM.nominal)
    panels = np.array(figure.axes).reshape(6, 6)
    exponents = np.log10(powers(draws)).round().astype(int)
    assert set(exponents[:3]) <= {-8, -7} and set(exponents[3:]) <= {-4, -3}
    labels = [
        f"{name} [$10^{{{exponent}}}$ {units[name].replace('^', '$^{')}}}$]"
        for name, exponent in zip(names, exponents, strict=True)
    ]
    assert [panel.get_xlabel() for panel in panels[-1]] == labels
    assert [panel.get_ylabel() for panel in panels[1:, 0]] == labels[1:]
    assert_nothing_is_clipped(figure, "samples")
    assert_nothing_is_clipped(ef.figures.plot_correlation(idata), "1.00", *names)
    assert_array_equal(samples(idata)[1], draws)
    plain = ef.figures.plot_scatter(gaussian(3), units={"stiff": "N/m"})
    labels = [axes.get_xlabel() for axes in plain.axes[-3:]]
    assert labels == ["stiff [N/m]", "alpha [$10^{-7}$]", "x"]


def test_the_error_of_the_running_mean_ends_at_that_of_the_table(run):
    end = ef.frequency_table(run).column("error % ")[-1]
    figure = ef.figures.plot_tae(run)
    assert_nothing_is_clipped(figure, "generation", f"ends at {end:.3g} %")


def test_truths_are_marked_on_the_scaled_axes():
    figure = ef.figures.plot_scatter(gaussian(3), truths={"alpha": 1.1e-7, "x": 14.0})
    panels = np.array(figure.axes).reshape(3, 3)
    marks = [
        [list(np.ravel(line.get_xdata())) for line in panels[k, k].lines]
        for k in range(3)
    ]
    assert marks[0] == []
    assert_allclose(marks[1], [[1.1, 1.1]], rtol=1e-12)
    assert_allclose(marks[2], [[14.0, 14.0]], rtol=1e-12)
    assert legend(figure)[-1] == "reference"


@pytest.mark.parametrize("d", [1, 2, 5])
def test_correlation_map_shows_the_correlations(d):
    idata = gaussian(d)
    axes = ef.figures.plot_correlation(idata).axes[0]
    names, draws = samples(idata)
    expected = np.corrcoef(draws.T).reshape(d, d)
    assert_allclose(axes.images[0].get_array(), expected, rtol=0, atol=1e-12)
    assert axes.images[0].get_clim() == (-1, 1)
    found = {text.get_position(): text.get_text() for text in axes.texts}
    cells = np.ndindex(d, d)
    assert found == {(j, i): f"{expected[i, j]:.2f}" for i, j in cells}
    for axis in (axes.xaxis, axes.yaxis):
        assert [label.get_text() for label in axis.get_ticklabels()] == names


@pytest.fixture
def positive():
    """Draws of a standard deviation near zero, as of HalfNormal, and a derived one."""
    rng = np.random.default_rng(3)
    error = np.abs(rng.normal(size=(4, 200))).clip(max=2.5)
    values = {"x": rng.normal(size=(4, 200)), "error": error, "twice": 2 * error}
    bounds = {"x": (-np.inf, np.inf), "error": (0.0, 2.5)}
    return made(values, bounds, sampled=["x", "error"])


def test_axes_and_histograms_end_at_the_priors_bounds(positive):
    figure = ef.figures.plot_scatter(positive, truths={"x": 9.0}, ellipse=True)
    panels = np.array(figure.axes).reshape(2, 2)
    assert panels[1, 0].get_ylim() == panels[1, 1].get_xlim() == (0.0, 2.5)
    edges = np.concatenate([p.get_xy()[:, 0] for p in panels[1, 1].patches])
    assert edges.min() == 0 and edges.max() == 2.5
    assert panels[0, 0].get_xlim()[0] < -2 and panels[0, 0].get_xlim()[1] == 9
    (ellipse,) = (p for p in panels[1, 0].patches if isinstance(p, Ellipse))
    lowest = ellipse.get_window_extent().y0
    assert lowest < panels[1, 0].get_window_extent().y0  # it is cut there,
    assert ellipse.get_clip_box() is not None  # and not drawn beyond


def test_derived_quantities_are_drawn_when_asked_for(positive):
    units = {"error": "%"}
    assert len(ef.figures.plot_scatter(positive, units=units).axes) == 4
    assert len(ef.figures.plot_correlation(positive).axes[0].texts) == 4
    chosen = {"var_names": ["twice", "error"]}
    panels = ef.figures.plot_scatter(
        positive, units=units, truths={"x": 1.0}, **chosen
    ).axes
    assert [axes.get_xlabel() for axes in panels[2:]] == ["twice", "error [%]"]
    texts = ef.figures.plot_correlation(positive, **chosen).axes[0].texts
    assert [text.get_text() for text in texts] == 4 * ["1.00"]
