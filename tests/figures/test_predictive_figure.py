"""The figure of predictions: what is drawn where, and that it can be read."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.chains import by_hand, dataset
from support.figures import assert_readable

import emcee_femu as ef

RNG = np.random.default_rng(0)
HERTZ = np.array([10.0, 40.0, 120.0])


def made(measured, unit, dims, initial, name="frequency", mac=None):
    """Return an ArviZ object with predictions 0.2 % too high that scatter by 1 %."""
    size = 4, 200, *measured.shape
    response = {name: measured * (1.002 + 0.01 * RNG.standard_normal(size))}
    new = response[name] + 0.1 * RNG.standard_normal(size)
    if mac is not None:
        model_mode = np.broadcast_to(np.arange(2.0, 5.0), size)
        response |= {"mac": mac, "model_mode": model_mode}
    return by_hand(
        {"a": RNG.random(size[:2])},
        {f"initial_{name}": (dims, initial)},
        {name: (dims, measured, {"units": unit})},
        dims,
        response=response,
        new_measurement={name: new},
    )


def intervals(values):
    return np.quantile(values.reshape(800, -1), [0.025, 0.975], axis=0).T


def drawn_intervals(axes):
    return [np.array(lines.get_segments())[:, :, 1] for lines in axes.collections]


@pytest.mark.parametrize(
    ("name", "unit", "measured", "dims", "scale"),
    [
        ("frequency", "Hz", HERTZ, ("mode",), HERTZ / 100),
        ("deflection", "mm", np.array([[1.5, 3.0, -2.0]]), ("case", "point"), 0.1),
    ],
)
def test_all_is_drawn_as_deviation_in_percent_or_in_the_unit(
    name, unit, measured, dims, scale
):
    initial = measured + scale * np.array([5.0, -3.0, 0.0])
    idata = made(measured, unit, dims, initial, name)
    (axes,) = ef.figures.plot_predictive(idata).axes
    scale = scale if unit == "Hz" else 1.0
    for group in ("response", "new_measurement"):
        off = (dataset(idata, group)[name].values - measured) / scale
        close = [np.allclose(x, intervals(off)) for x in drawn_intervals(axes)]
        assert sum(close) == 1
    (diamonds,) = (line for line in axes.lines if line.get_marker() == "D")
    expected = np.ravel((initial - measured) / scale)
    assert_allclose(diamonds.get_ydata(), expected, rtol=0, atol=1e-9)


def test_below_stand_mac_and_the_paired_mode():
    mac = 1 - 0.2 * np.random.default_rng(1).random((4, 200, 3))
    idata = made(HERTZ, "Hz", ("mode",), 1.05 * HERTZ, mac=mac)
    _, bottom = ef.figures.plot_predictive(idata).axes
    assert_allclose(drawn_intervals(bottom)[0], intervals(mac), rtol=1e-12)
    for mode, label in zip("234", bottom.get_xticklabels(), strict=True):
        assert label.get_text().endswith(f" {mode}")


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
    assert_readable(figure)
