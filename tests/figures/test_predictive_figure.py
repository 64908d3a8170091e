"""The figure of predictions: what is drawn where, and that it can be read."""

import numpy as np
import xarray
from numpy.testing import assert_allclose
from support.chains import dataset, wrap
from support.figures import assert_no_texts_overlap, assert_nothing_is_clipped

import emcee_femu as ef

MEASURED = np.array([10.0, 20.0, 40.0])


def made(measured, unit, coords, initial, extra=(), name="frequency", noise=0.0):
    """Return an ArviZ object with predictions 0.2 % too high that scatter by 1 %."""
    rng = np.random.default_rng(0)
    size, dims = (4, 200, *measured.shape), tuple(coords)
    predicted = measured * (1.002 + 0.01 * rng.standard_normal(size))
    sampled, drawn = {"sample_dims": ["chain", "draw"]}, ("chain", "draw", *dims)
    response = {name: predicted, **dict(extra)}
    response = {k: (drawn, v) for k, v in response.items()}
    a = {"a": (("chain", "draw"), rng.random(size[:2]))}
    observed = {name: (dims, measured, {"units": unit})}
    groups = {
        "posterior": xarray.Dataset(a, attrs=sampled),
        "response": xarray.Dataset(response, coords, sampled),
        "observed_data": xarray.Dataset(observed, coords),
        "constant_data": xarray.Dataset({f"initial_{name}": (dims, initial)}, coords),
    }
    if noise:
        new = {name: (drawn, predicted + noise * rng.standard_normal(size))}
        groups["new_measurement"] = xarray.Dataset(new, coords, sampled)
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


def intervals(idata, name="frequency", group="response", scale=1.0, measured=0.0):
    """Return the 95 % intervals of draws less what was measured, by its scale."""
    values = dataset(idata, group)[name].values
    values = (values.reshape(800, -1) - np.ravel(measured)) / scale
    return np.quantile(values, [0.025, 0.975], axis=0).T


def drawn_intervals(axes):
    return [np.array(lines.get_segments())[:, :, 1] for lines in axes.collections]


def diamonds(axes):
    (found,) = (line for line in axes.lines if line.get_marker() == "D")
    return found.get_ydata()


def test_intervals_and_initial_values_are_deviations_in_percent():
    idata, measured = modal(initial=np.array([1.05, 0.97, 1.0]))
    (axes,) = ef.figures.plot_predictive(idata).axes
    expected = intervals(idata, scale=measured / 100, measured=measured)
    assert_allclose(drawn_intervals(axes)[0], expected, rtol=1e-9)
    assert_allclose(diamonds(axes), [5, -3, 0], rtol=0, atol=1e-9)
    # Far ones are arrows with numbers, outside of what is drawn.
    idata, _ = modal(initial=np.array([1.6, 1.01, 0.3]))
    axes = ef.figures.plot_predictive(idata).axes[0]
    assert_allclose(diamonds(axes), [1.0], rtol=1e-9)
    shown, (low, high) = drawn_intervals(axes)[0], axes.get_ylim()
    assert {text.get_text()[-5:] for text in axes.texts} == {"+60 %", "-70 %"}
    assert -70 < low < shown.min() and shown.max() < high < 60


def test_another_quantity_is_drawn_in_its_unit_at_its_coordinates():
    measured = np.array([[1.5, 3.0, 2.0], [-0.5, 0.8, -1.0]])
    coords = {"case": ["snow", "wind"], "point": ["left", "middle", "right"]}
    idata = made(measured, "mm", coords, np.ones((2, 3)), (), "deflection", noise=0.1)
    (axes,) = ef.figures.plot_predictive(idata).axes
    drawn = drawn_intervals(axes)
    for group in ("response", "new_measurement"):
        expected = intervals(idata, "deflection", group, measured=measured)
        close = [np.allclose(lines, expected, rtol=1e-9) for lines in drawn]
        assert sum(close) == 1
    assert axes.get_xticklabels()[1].get_text().startswith("snow, middle\n3 mm")


def test_below_stand_mac_and_the_paired_mode():
    idata, _ = modal(with_mac=True)
    _, bottom = ef.figures.plot_predictive(idata).axes
    assert_allclose(drawn_intervals(bottom)[0], intervals(idata, "mac"), rtol=1e-12)
    ticks = [label.get_text() for label in bottom.get_xticklabels()]
    for tick, mode in zip(ticks, ("model's 2", "model's 3", "96.2 %"), strict=True):
        assert mode in tick


def test_each_experiment_has_its_panel_with_its_own_band():
    sd = {"empty": 0.1, "loaded": 0.4}
    model = ef.FunctionModel(lambda p: [20 * p["a"], 60 * p["a"]], n_modes=2)
    tests = {
        name: (model, ef.FrequencyTerm([10.0, 30.0], sd=value))
        for name, value in sd.items()
    }
    prior = ef.GaussianPrior(["a"], [0.5], [0.1], [(0, 1)])
    joint = ef.LogPosterior.joint(tests, prior)
    run = ef.run(joint, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)
    figure = ef.figures.plot_predictive(run)
    for axes, (name, value) in zip(figure.axes, sd.items(), strict=True):
        assert axes.get_title().startswith(name)
        heights = [bar.get_height() for bar in axes.patches]
        assert_allclose(heights, 400 * value / np.array([10.0, 30.0]), rtol=1e-9)
    assert_nothing_is_clipped(figure)
    assert_no_texts_overlap(figure)
