"""Figures of compared moves and model classes, of FRFs and predictions: numbers."""

import dataclasses

import numpy as np
import pytest
from matplotlib.colors import to_hex
from numpy.testing import assert_allclose, assert_array_equal
from support.chains import by_hand, dataset
from support.figures import assert_readable

import emcee_femu as ef
from emcee_femu.results.evidence import Evidence

PRIOR = ef.GaussianPrior(["a", "b"], [1.0, 2.0], 0.3)
MODEL = ef.FunctionModel(lambda p: [p["a"], p["a"] + p["b"]], n_modes=2)
POSTERIOR = ef.LogPosterior(
    MODEL, ef.FrequencyTerm([1.0, 3.0], relative_sd=0.05), PRIOR
)


def names(axes):
    return [text.get_text().partition("\n")[0] for text in axes.get_yticklabels()]


def test_bars_are_sorted_and_curves_are_of_the_kept_steps_in_their_colours():
    moves = {"M-H": ef.MetropolisMove(sd=0.002), "DE-MC": ef.DEMCMove()}
    found = ef.compare_moves(POSTERIOR, moves, 8, 40, ensembles=2, seed=1)
    left, right = ef.figures.plot_comparison(found).axes
    efficiency = {label: value for label, (value, _) in found.efficiency.items()}
    assert names(left) == sorted(efficiency, key=efficiency.get)
    widths = [bar.get_width() for bar in left.patches]
    assert_allclose(widths, sorted(efficiency.values()), rtol=1e-12)
    edges = [to_hex(bar.get_edgecolor()) for bar in left.patches]
    colours = dict(zip(names(left), edges, strict=True))
    for line, (label, idata) in zip(right.lines, found.idata.items(), strict=True):
        whole = ef.figures.plot_tae(idata, found.posterior).axes[0].lines[0]
        generations, tae = whole.get_data()
        burn_in = idata["posterior"].attrs["discard"]
        assert generations[0] == 1 + burn_in
        assert_array_equal(line.get_xdata(), generations - burn_in)
        assert_array_equal(line.get_ydata(), tae)
        assert to_hex(line.get_color()) == colours[label]


def test_points_bars_and_probabilities_of_model_classes():
    known = ef.log_evidence(ef.anneal(POSTERIOR, 40, seed=1))

    def drawn(**classes):
        keys = "log_evidence", "log_evidence_error"
        found = {
            name: dataclasses.replace(known, **dict(zip(keys, pair, strict=True)))
            for name, pair in classes.items()
        }
        return ef.figures.plot_model_comparison(ef.compare_models(found)).axes

    left, right = drawn(a=(-3.0, 0.3), b=(-1.0, 0.4), c=(-1.2, 0.1))
    points = [c.lines[0].get_xdata()[0] for c in left.containers]
    assert_allclose(points, [0.0, -0.2, -2.0])
    assert names(left) == ["b", "c", "a"]
    segment = left.containers[2].lines[2][0].get_segments()[0]
    assert_allclose(segment[:, 0], [-3.0, -1.0])  # two combined errors
    odds = np.exp([0.0, -0.2, -2.0])
    assert_allclose([bar.get_width() for bar in right.patches], odds / odds.sum())
    left, _ = drawn(a=(-3.0, np.inf), b=(-1.0, 0.4))  # no error can be claimed
    assert not left.containers[1].has_xerr


@pytest.mark.slow
@pytest.mark.parametrize("behind", [0.1, 1.0, 10.0, 56.0, 134.0, 1000.0])
def test_every_class_is_drawn_inside_the_axis_with_its_bar(behind):
    found = {
        "A": Evidence(-12.3, 0.05, "known"),
        "B": Evidence(-12.3 - behind, 0.3, ""),
    }
    found["C"] = Evidence(-13.3, 0.05, "known")
    figure = ef.figures.plot_model_comparison(ef.compare_models(found))
    figure.draw_without_rendering()
    left = figure.axes[0]
    points = [c.lines[0].get_xdata()[0] for c in left.containers]
    assert_allclose(sorted(points), sorted([0.0, -1.0, -behind]), atol=1e-12)
    pixels = left.transData.transform([(x, 0.0) for x in (0.0, -1.0, -behind)])[:, 0]
    share = (pixels - left.bbox.x0) / left.bbox.width
    assert ((share > 0.02) & (share < 0.98)).all()
    assert share[0] - share[1] > 0.05  # near ones are told apart, whatever else
    if behind > 1:
        assert share[1] - share[2] > 0.2
    low, high = left.get_xlim()
    bar = left.containers[-1].lines[2][0].get_segments()[0][:, 0]
    assert low < bar.min() and bar.max() < high
    assert sum(low <= tick <= high for tick in left.get_xticks()) >= 3


def test_measured_amplitudes_of_frfs_are_drawn_by_channel():
    lines, channels = np.linspace(0.5, 6.0, 40), [(0, 1), (1, 1)]
    K = {"k": np.array([[2.0, -1.0], [-1.0, 1.0]])}
    two = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), K, n_modes=2, shapes=True)
    model = ef.frf.FRFModel(two, lines, channels, damping=0.02)
    values = model({"k": [550.0]})["receptance"][0] @ [1, 1j]
    measured = ef.frf.FRFMeasurements(lines, values, channels, kind="receptance")
    term = ef.frf.FRFTerm(measured, sd=1e-3)
    posterior = ef.LogPosterior(model, term, ef.IndependentPrior({"k": (9, 999)}))
    run = ef.run(posterior, ef.DEMCMove(), 8, 20, seed=1, ensembles=1)
    for axes, value in zip(ef.frf.plot_frf(run).axes, values, strict=True):
        assert_allclose(axes.lines[0].get_ydata(), np.abs(value))


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


@pytest.mark.parametrize("prior", [[5.0, -3.0, 0.0], [90.0, 90.0, -90.0], [9, 90, 9]])
def test_the_legend_names_what_is_drawn_of_the_prior_mean(prior):
    """Deviations in percent, of which an axis of some 4 % holds the small ones."""
    idata = made(HERTZ, "Hz", ("mode",), HERTZ * (1 + np.array(prior) / 100))
    figure = ef.figures.plot_predictive(idata)
    (axes,), (legend,) = figure.axes, figure.legends
    diamonds = [line for line in axes.lines if line.get_marker() == "D"]
    handles = [
        h.get_marker() for h in legend.legend_handles if hasattr(h, "get_marker")
    ]
    shown = sum(len(line.get_xdata()) for line in diamonds)
    assert ("D" in handles) is (shown > 0)
    assert (r"$\uparrow$" in handles) is (len(axes.texts) > 0)
    assert shown + len(axes.texts) == 3
    assert_readable(figure)


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
