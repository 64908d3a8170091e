"""The figure of predictions: what is drawn where, and that it can be read."""

import numpy as np
import pytest
import xarray
from matplotlib.colors import to_hex
from numpy.testing import assert_allclose
from support.chains import dataset, wrap
from support.figures import assert_no_texts_overlap, assert_nothing_is_clipped, legend

import emcee_femu as ef

MEASURED = np.array([10.0, 20.0, 40.0])
UPDATED = "updated model: mean (circle), 95 % interval"
BEFORE, BAND = "before updating: prior mean", "measured ± 2 sd"
NEW = "95 % of new measurements"
RED, BLUE = "#c8102e", "#1f5fa8"
PRIOR = ef.IndependentPrior({"a": (0, 1)})


def made(measured, unit, coords, initial, extra=(), name="frequency", noise=0.0):
    """Return an ArviZ object with predictions 0.2 % too high that scatter by 1 %."""
    rng = np.random.default_rng(0)
    measured = np.asarray(measured, dtype=float)
    size = (4, 200, *measured.shape)
    predicted = measured * (1.002 + 0.01 * rng.standard_normal(size))
    dims, samples = tuple(coords), {"sample_dims": ["chain", "draw"]}
    response = {name: (("chain", "draw", *dims), predicted)}
    response |= {k: (("chain", "draw", *dims), v) for k, v in dict(extra).items()}
    groups = {
        "posterior": xarray.Dataset(
            {"a": (("chain", "draw"), rng.random(size[:2]))}, attrs=samples
        ),
        "response": xarray.Dataset(response, coords, samples),
        "observed_data": xarray.Dataset(
            {name: (dims, measured, {"units": unit})}, coords
        ),
        "constant_data": xarray.Dataset({f"initial_{name}": (dims, initial)}, coords),
    }
    if noise:
        new = predicted + noise * rng.standard_normal(size)
        values = {name: (("chain", "draw", *dims), new)}
        groups["new_measurement"] = xarray.Dataset(values, coords, samples)
    return wrap(groups)


def modal(m=3, initial=1.05, with_mac=False, noise=0.0):
    measured = np.resize(MEASURED, m) * np.arange(1, m + 1)
    extra = {}
    if with_mac:
        model_mode = np.tile(np.arange(2.0, m + 2), (4, 200, 1))
        model_mode[0, :30, -1] = 1
        mac = 1 - 0.2 * np.random.default_rng(1).random((4, 200, m))
        extra = {"mac": mac, "model_mode": model_mode}
    coords = {"mode": np.arange(1, m + 1)}
    idata = made(measured, "Hz", coords, measured * initial, extra, noise=noise)
    return idata, measured


def draws(idata, name="frequency", group="response"):
    values = dataset(idata, group)[name].values
    return values.reshape(values.shape[0] * values.shape[1], -1)


def posterior(measured, **error):
    model = ef.FunctionModel(lambda p: measured, n_modes=len(measured))
    return ef.LogPosterior(model, ef.FrequencyTerm(measured, **error), PRIOR)


def ends(axes, label):
    (lines,) = (c for c in axes.collections if c.get_label() == label)
    return np.array(lines.get_segments())[:, :, 1]


def line(axes, **wanted):
    (found,) = (
        item
        for item in axes.lines
        if all(getattr(item, f"get_{k}")() == v for k, v in wanted.items())
    )
    return found


def test_intervals_means_and_initial_values_are_deviations_in_percent():
    idata, measured = modal(initial=np.array([1.05, 0.97, 1.0]))
    figure = ef.figures.plot_predictive(idata)
    (axes,) = figure.axes
    percent = 100 * (draws(idata) / measured - 1)
    expected = np.quantile(percent, [0.025, 0.975], axis=0).T
    assert_allclose(ends(axes, UPDATED), expected, rtol=1e-9)
    mean = percent.mean(axis=0)
    assert_allclose(line(axes, color="white").get_ydata(), mean, rtol=1e-9)
    diamonds = line(axes, marker="D")
    assert_allclose(diamonds.get_ydata(), [5, -3, 0], rtol=0, atol=1e-9)
    assert diamonds.get_color() == RED
    assert to_hex(axes.collections[0].get_edgecolor()[0]) == BLUE
    assert not axes.patches and legend(figure) == [UPDATED, BEFORE]
    after = f"{np.abs(mean).mean():.2g}"
    headline = f"frequency: mean error 2.7 % at the prior mean, {after} % updated"
    assert axes.get_title() == headline


def test_another_quantity_is_drawn_in_its_unit_at_its_coordinates():
    measured = np.array([[1.5, 3.0, 2.0], [-0.5, 0.8, -1.0]])
    coords = {"case": ["snow", "wind"], "point": ["left", "middle", "right"]}
    idata = made(measured, "mm", coords, np.ones((2, 3)), (), "deflection", noise=0.1)
    figure = ef.figures.plot_predictive(idata, posterior(MEASURED, beta=1.0))
    (axes,) = figure.axes
    for label, group in ((UPDATED, "response"), (NEW, "new_measurement")):
        values = draws(idata, "deflection", group) - measured.ravel()
        expected = np.quantile(values, [0.025, 0.975], axis=0).T
        assert_allclose(ends(axes, label), expected, rtol=1e-9, atol=1e-12)
    assert axes.get_ylabel() == "deviation from the\nmeasured deflection (mm)"
    assert axes.get_xlabel() == "measured case, point, its deflection"
    ticks = [label.get_text() for label in axes.get_xticklabels()]
    assert ticks[1:4] == [
        "snow, middle\n3 mm",
        "snow, right\n2 mm",
        "wind, left\n-0.5 mm",
    ]
    assert axes.get_title().startswith("deflection: mean error 1.2 mm at the prior m")
    assert legend(figure) == [NEW, UPDATED, BEFORE]
    assert_nothing_is_clipped(figure)
    assert_no_texts_overlap(figure)


def test_each_experiment_has_its_panel_with_its_own_band():
    sd = {"empty": 0.1, "loaded": 0.4}
    model = ef.FunctionModel(lambda p: [20 * p["a"], 60 * p["a"]], n_modes=2)
    tests = {
        name: (model, ef.FrequencyTerm([10.0, 30.0], sd=value))
        for name, value in sd.items()
    }
    joint = ef.LogPosterior.joint(
        tests, ef.GaussianPrior(["a"], [0.5], [0.1], [(0, 1)])
    )
    run = ef.run(joint, ef.DEMCMove(), steps=20, ensembles=1, seed=1)
    figure = ef.figures.plot_predictive(run)
    for axes, (name, value) in zip(figure.axes, sd.items(), strict=True):
        assert axes.get_title().startswith(f"{name}.frequency: mean error ")
        assert axes.get_xlabel() == f"measured mode, its {name}.frequency"
        heights = [bar.get_height() for bar in axes.patches]
        assert_allclose(heights, 400 * value / np.array([10.0, 30.0]), rtol=1e-9)
    assert legend(figure).count(BAND) == 1
    assert_nothing_is_clipped(figure)
    assert_no_texts_overlap(figure)


def test_initial_values_far_away_are_arrows_with_numbers():
    idata, _ = modal(initial=np.array([1.6, 1.01, 0.3]))
    axes = ef.figures.plot_predictive(idata).axes[0]
    assert_allclose(line(axes, marker="D").get_ydata(), [1.0], rtol=1e-9)
    arrows = {text.get_text(): text for text in axes.texts}
    assert set(arrows) == {"before:\n+60 %", "before:\n-70 %"}
    low, high = axes.get_ylim()
    assert arrows["before:\n+60 %"].xy == (0, high)
    assert arrows["before:\n-70 %"].xy == (2, low)
    shown = ends(axes, UPDATED)
    # The text begins outside of what is drawn, between it and the edge.
    assert shown.max() < arrows["before:\n+60 %"].xyann[1] < high < 60
    assert shown.min() > arrows["before:\n-70 %"].xyann[1] > low > -70


def test_below_stand_mac_and_the_paired_mode():
    idata, measured = modal(with_mac=True)
    top, bottom = ef.figures.plot_predictive(idata).axes
    mac = draws(idata, "mac")
    (lines,) = bottom.collections
    expected = np.quantile(mac, [0.025, 0.975], axis=0).T
    assert_allclose(np.array(lines.get_segments())[:, :, 1], expected, rtol=1e-12)
    means = line(bottom, color="white").get_ydata()
    assert_allclose(means, mac.mean(axis=0), rtol=1e-12)
    assert bottom.get_ylim()[0] < expected.min() and bottom.get_ylim()[1] > 1
    ticks = [label.get_text() for label in bottom.get_xticklabels()]
    assert ticks == [
        f"1\n{measured[0]:g} Hz\nmodel's 2",
        f"2\n{measured[1]:g} Hz\nmodel's 3",
        f"3\n{measured[2]:g} Hz\nmodel's 4\nin 96.2 %",
    ]
    assert top.get_xlim() == bottom.get_xlim()


@pytest.mark.parametrize(("m", "with_mac"), [(1, False), (3, True), (12, True)])
def test_nothing_is_clipped_and_no_texts_overlap(m, with_mac):
    initial = np.resize([1.5, 1.01, 0.4, 1.02, 0.98], m)
    idata, measured = modal(m, initial, with_mac, noise=0.2)
    figure = ef.figures.plot_predictive(idata, posterior(measured, sd=0.01 * measured))
    expected = ["deviation from the\nmeasured frequency (%)"]
    expected += [UPDATED, BEFORE, BAND, NEW]
    expected += ["MAC\n(1: same shape)"] if with_mac else []
    assert_nothing_is_clipped(figure, *expected)
    assert_no_texts_overlap(figure)


def test_a_prior_mean_that_cannot_be_solved_is_left_out():
    axes = ef.figures.plot_predictive(modal(initial=np.full(3, np.nan))[0]).axes[0]
    assert not axes.texts and not len(line(axes, marker="D").get_xdata())
    assert "prior mean" not in axes.get_title()
