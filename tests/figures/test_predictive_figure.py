"""The figure of predictions: what is drawn where, and that it can be read."""

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.colors import to_hex
from numpy.testing import assert_allclose
from test_figures import assert_nothing_is_clipped, visible_texts
from test_predictive import MEASURED, made, posterior

import emcee_femu as ef
from emcee_femu.figures.colours import BLUE, RED
from emcee_femu.figures.predictive import plot_predictive
from emcee_femu.results.inference_data import dataset
from emcee_femu.results.predictive import predictive_table

UPDATED = "updated model: mean (circle), 95 % interval"
BEFORE, BAND = "model before updating", "measured ± 2 sd"
NEW = "95 % of new measurements, with discrepancy"


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    plt.close("all")


def predictions(m=3, initial=1.05, with_mac=False, seed=0):
    rng = np.random.default_rng(seed)
    measured = np.resize(MEASURED, m) * np.arange(1, m + 1)
    frequency = measured * (1.002 + 0.01 * rng.standard_normal((4, 200, m)))
    mac = model_mode = None
    if with_mac:
        mac = 1 - 0.2 * rng.random((4, 200, m))
        model_mode = np.tile(np.arange(2, m + 2), (4, 200, 1))
        model_mode[0, :30, -1] = 1
    parameters = {"a": rng.random(800), "sigma": np.full(800, 0.02)}
    idata = made(frequency, mac, model_mode, measured, **parameters)
    group = dataset(idata, "constant_data")
    group["initial_frequency"].values[:] = measured * initial
    return idata, measured, frequency.reshape(-1, m)


def vertical(axes, label):
    (lines,) = (c for c in axes.collections if c.get_label() == label)
    return np.array(lines.get_segments())


def labels(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_intervals_means_and_initial_values_are_deviations_in_percent():
    initial = np.array([1.05, 0.97, 1.0])
    idata, measured, frequency = predictions(initial=initial)
    (axes,) = plot_predictive(idata).axes
    percent = 100 * (frequency / measured - 1)
    segments = vertical(axes, UPDATED)
    assert_allclose(segments[:, :, 0], np.tile([[0], [1], [2]], 2))
    expected = np.quantile(percent, [0.025, 0.975], axis=0).T
    assert_allclose(segments[:, :, 1], expected, rtol=1e-9)
    (means,) = (line for line in axes.lines if line.get_color() == "white")
    assert_allclose(means.get_ydata(), percent.mean(axis=0), rtol=1e-9)
    (diamonds,) = (line for line in axes.lines if line.get_marker() == "D")
    assert_allclose(diamonds.get_ydata(), [5, -3, 0], rtol=0, atol=1e-9)
    assert diamonds.get_color() == RED
    assert to_hex(axes.collections[0].get_edgecolor()[0]) == BLUE
    assert not axes.patches
    table = predictive_table(idata)
    assert_allclose(
        segments[:, 0, 1], 100 * (np.array(table.column("2.5 %")) / measured - 1)
    )


def test_the_headline_is_the_error_before_and_after():
    idata, measured, frequency = predictions(initial=np.array([1.05, 0.97, 1.01]))
    after = 100 * np.abs(frequency.mean(axis=0) / measured - 1).mean()
    headline = plot_predictive(idata).get_suptitle()
    assert headline.endswith(f": 3 % before updating, {after:.2g} % after")


def test_the_band_is_two_measured_standard_deviations():
    idata, measured, _ = predictions()
    sd = np.array([0.1, 0.4, 0.2])
    target = with_measured(measured, sd=sd)
    figure = plot_predictive(idata, target)
    (axes,) = figure.axes
    bottoms = [bar.get_y() for bar in axes.patches]
    heights = [bar.get_height() for bar in axes.patches]
    assert_allclose(bottoms, -200 * sd / measured, rtol=1e-9)
    assert_allclose(heights, 400 * sd / measured, rtol=1e-9)
    assert sorted(labels(figure)) == sorted([UPDATED, BAND, BEFORE])


def with_measured(measured, **error):
    usual = posterior(("a", "sigma"), beta=1.0)
    model = ef.FunctionModel(lambda p: measured, n_modes=len(measured))
    return ef.LogPosterior(model, ef.FrequencyTerm(measured, **error), usual.prior)


def test_a_discrepancy_adds_the_interval_of_new_measurements():
    idata, measured, _ = predictions()
    target = with_measured(measured, discrepancy="sigma")
    figure = plot_predictive(idata, target)
    (axes,) = figure.axes
    table = predictive_table(idata, target)
    ends = np.transpose([table.column("2.5 %"), table.column("97.5 %")])
    segments = vertical(axes, NEW)
    assert_allclose(segments[:, :, 1], 100 * (ends / measured[:, None] - 1), rtol=1e-9)
    assert not axes.patches  # the measured standard deviations are not known
    assert sorted(labels(figure)) == sorted([UPDATED, NEW, BEFORE])
    plain = plot_predictive(idata, with_measured(measured, sd=0.1))
    assert NEW not in labels(plain)


def test_initial_values_far_away_are_arrows_with_numbers():
    idata, _, frequency = predictions(initial=np.array([1.6, 1.01, 0.3]))
    axes = plot_predictive(idata).axes[0]
    (diamonds,) = (line for line in axes.lines if line.get_marker() == "D")
    assert_allclose(diamonds.get_ydata(), [1.0], rtol=1e-9)
    arrows = {text.get_text(): text for text in axes.texts}
    assert set(arrows) == {"before:\n+60 %", "before:\n-70 %"}
    low, high = axes.get_ylim()
    assert arrows["before:\n+60 %"].xy == (0, high)
    assert arrows["before:\n-70 %"].xy == (2, low)
    segments = vertical(axes, UPDATED)
    # The text begins outside of what is drawn, between it and the edge.
    assert segments.max() < arrows["before:\n+60 %"].xyann[1] < high < 60
    assert segments[..., 1].min() > arrows["before:\n-70 %"].xyann[1] > low > -70


@pytest.mark.parametrize("factor", np.linspace(1.02, 1.3, 15))
def test_an_initial_value_is_inside_the_frame_or_an_arrow_beyond_it(factor):
    idata, _, _ = predictions(initial=np.array([factor, 1.09, 2 - factor]))
    axes = plot_predictive(idata).axes[0]
    low, high = axes.get_ylim()
    (diamonds,) = (line for line in axes.lines if line.get_marker() == "D")
    drawn = diamonds.get_ydata()
    assert ((low < drawn) & (drawn < high)).all()
    pointed = [float(t.get_text().split()[1]) for t in axes.texts]
    assert len(pointed) + len(drawn) == 3
    assert all(value > high or value < low for value in pointed)


def test_below_stand_mac_and_the_paired_mode():
    idata, measured, _ = predictions(with_mac=True)
    figure = plot_predictive(idata)
    top, bottom = figure.axes
    mac = dataset(idata, "response")["mac"].values.reshape(-1, 3)
    (lines,) = bottom.collections
    expected = np.quantile(mac, [0.025, 0.975], axis=0).T
    assert_allclose(np.array(lines.get_segments())[:, :, 1], expected, rtol=1e-12)
    (means,) = (line for line in bottom.lines if line.get_color() == "white")
    assert_allclose(means.get_ydata(), mac.mean(axis=0), rtol=1e-12)
    low, high = bottom.get_ylim()
    assert low < expected.min() and high > 1
    ticks = [label.get_text() for label in bottom.get_xticklabels()]
    assert ticks == [
        f"1\n{measured[0]:g} Hz\nmodel's 2",
        f"2\n{measured[1]:g} Hz\nmodel's 3",
        f"3\n{measured[2]:g} Hz\nmodel's 4\nin 96.2 %",
    ]
    assert top.get_xlim() == bottom.get_xlim()


@pytest.mark.parametrize("with_mac", [False, True])
@pytest.mark.parametrize("m", [1, 3, 12])
def test_nothing_is_clipped_and_no_texts_overlap(m, with_mac):
    initial = np.resize([1.5, 1.01, 0.4, 1.02, 0.98], m)
    idata, measured, _ = predictions(m, initial, with_mac)
    target = with_measured(measured, sd=0.01 * measured, discrepancy="sigma")
    figure = plot_predictive(idata, target)
    expected = [
        "deviation from the\nmeasured frequency (%)",
        UPDATED,
        BEFORE,
        BAND,
        NEW,
    ]
    expected += ["MAC\n(1: same shape)"] if with_mac else []
    assert_nothing_is_clipped(figure, *expected)
    boxes = [text.get_window_extent() for text in visible_texts(figure)]
    for i, box in enumerate(boxes):
        for other in boxes[:i]:
            assert not box.overlaps(other), (m, box, other)


def test_the_paper_is_drawn_with_its_frequencies():
    problem = ef.paper.mass_spring()
    runs = ef.run(problem.posterior, None, 24, 200, seed=1)
    idata = ef.to_inference_data(runs, problem.posterior, discard=100)
    before = dataset(idata, "response").copy(deep=True)
    figure = plot_predictive(idata, problem.posterior)
    assert_nothing_is_clipped(figure, "1\n3.507 Hz", "5\n9.426 Hz")
    assert dataset(idata, "response").identical(before)


def test_an_exact_fit_has_a_frame_of_its_own():
    idata = made(np.ones((1, 4, 3)) * MEASURED)
    dataset(idata, "constant_data")["initial_frequency"].values[:] = MEASURED
    low, high = plot_predictive(idata).axes[0].get_ylim()
    assert low < 0 < high


def test_measured_frequencies_are_needed():
    model = ef.FunctionModel(lambda p: MEASURED, n_modes=3)
    prior = posterior(beta=1.0).prior
    bare = ef.LogPosterior(model, lambda p, modes: 0 * p["a"], prior)
    runs = ef.run(bare, None, 8, 4, seed=1)
    with pytest.raises(ValueError, match="no likelihood term"):
        plot_predictive(ef.to_inference_data(runs, bare))


def test_a_share_below_one_is_never_rounded_to_all():
    mode = np.ones((4, 1000, 1))
    mode[2, 7] = 2
    idata = made(10 * np.ones((4, 1000, 1)), np.ones((4, 1000, 1)), mode, [10.0])
    (label,) = plot_predictive(idata).axes[-1].get_xticklabels()
    assert label.get_text() == "1\n10 Hz\nmodel's 1\nin 99.9 %"
