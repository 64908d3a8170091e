"""Mode shapes on the structure: what is drawn where."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.text import Annotation
from numpy.testing import assert_allclose
from support.figures import assert_readable
from support.tower import HERTZ, MEASURED, MODEL, PRIOR, SPRINGS, at_mean

import emcee_femu as ef

TOWER = ef.Geometry(
    {"foot": (0, 0), "middle": (0, 3), "top": (0, 6)},
    [("foot", "middle"), ("middle", "top")],
    {0: ("middle", "ux"), 1: ("top", "ux")},
)
TEST = ef.Measurements(HERTZ, shapes=MEASURED, dofs=[0, 1])
MOVED, AT_SENSORS = "updated model", "updated model at the sensors"


def sampled(posterior):
    return ef.run(posterior, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)


def run_of(model, measured, candidates=2):
    term = ef.FrequencyTerm(measured, relative_sd=0.01)
    if candidates:
        model = ef.PairedModel(model, measured, candidates=candidates)
    return sampled(ef.LogPosterior(model, term, PRIOR))


@pytest.fixture(scope="module")
def run():
    return run_of(MODEL, TEST)


def lines(axes, label):
    (drawn,) = (
        c
        for c in axes.collections
        if isinstance(c, LineCollection) and c.get_label() == label
    )
    return np.array(drawn.get_segments())


def points(axes, label):
    (drawn,) = (line for line in axes.lines if line.get_label() == label)
    return drawn.get_xydata()


def test_the_structure_moves_as_the_updated_model_does_in_its_plane(run):
    figure = ef.figures.plot_shapes(run, geometry=TOWER)
    shapes = at_mean(run)
    for i, axes in enumerate(figure.axes):
        rest = [[[0, 0], [0, 3]], [[0, 3], [0, 6]]]
        assert_allclose(lines(axes, "at rest"), rest, atol=1e-12)
        moved = lines(axes, MOVED)
        # The largest displacement is 15 % of the structure; the foot stands still.
        assert_allclose(moved[:, :, 1], [[0, 3], [3, 6]], atol=1e-12)
        assert_allclose(moved[0, 0], [0, 0], atol=1e-12)
        measured = points(axes, "measured")[:, 0]
        sensors = points(axes, AT_SENSORS)[:, 0]
        assert_allclose(sensors, moved[:, 1, 0], rtol=1e-9)
        largest = max(np.abs(measured).max(), np.abs(sensors).max())
        assert largest == pytest.approx(0.15 * 6)
        assert_allclose(sensors[1] / sensors[0], shapes[1, i] / shapes[0, i], rtol=1e-8)
        # Measured shapes have the model's scale and sign, by least squares.
        assert_allclose(measured[1] / measured[0], MEASURED[1, i] / MEASURED[0, i])
        assert (measured - sensors) @ measured == pytest.approx(0, abs=1e-9)
    assert_readable(figure)
    assert len(ef.figures.plot_shapes(run, geometry=TOWER, modes=2).axes) == 1


@pytest.mark.parametrize("modes", [1, [1, 2]])
def test_no_empty_band_is_left_above_the_legend(run, modes):
    """Of a tall structure and a long one, in one panel or two."""
    nodes = {"foot": (0, 0), "middle": (3, 0), "top": (6, 0)}
    sensors = {0: ("middle", "uy"), 1: ("top", "uy")}
    lying = ef.Geometry(nodes, TOWER.lines, sensors)
    for geometry in (TOWER, lying):
        figure = ef.figures.plot_shapes(run, geometry=geometry, modes=modes)
        figure.canvas.draw()
        top = figure.legends[0].get_window_extent().y1
        low = min(axes.get_window_extent().y0 for axes in figure.axes)
        assert 0 <= (low - top) / figure.dpi < 0.2  # inches


def test_what_cannot_be_drawn_says_what_to_give(run):
    bare = ef.Geometry({0: (0, 0), 1: (0, 1)}, [(0, 1)], {0: (1, "ux")})
    for wrong, message in (
        ({"modes": [3]}, "modes: .*from 1 to 2"),
        ({"modes": []}, "modes"),
        ({"geometry": None}, "geometry"),
        ({"geometry": bare}, r"geometry: .*\[1\]"),
    ):
        with pytest.raises(ValueError, match=message):
            ef.figures.plot_shapes(run, **{"geometry": TOWER} | wrong)
    plain = run_of(ef.MassSpringModel([1.0, 1.0], SPRINGS), HERTZ, 0)
    for plot, options in (
        (ef.figures.plot_shapes, {"geometry": TOWER}),
        (ef.figures.plot_mac, {}),
    ):
        with pytest.raises(ValueError, match="shapes=True"):
            plot(plain, **options)
    term = ef.FrequencyTerm(TEST, relative_sd=0.01)
    paired = ef.PairedModel(MODEL, TEST, candidates=2)
    tests = {"empty": (paired, term), "plain": (MODEL, term)}
    both = sampled(ef.LogPosterior.joint(tests, PRIOR))
    assert len(ef.figures.plot_mac(both, experiment="empty").axes) == 3
    with pytest.raises(ValueError, match="pairs no"):
        ef.figures.plot_mac(both, experiment="plain")


def test_without_a_name_every_experiment_that_can_be_drawn_is():
    """Two that pair modes, and one between them that does not."""
    term = ef.FrequencyTerm(TEST, relative_sd=0.01)
    paired = ef.PairedModel(MODEL, TEST, candidates=2)
    plain = ef.FunctionModel(lambda p: [0.085 * p["k1"] ** 0.5], n_modes=1)
    first = ef.FrequencyTerm([0.27], relative_sd=0.01)
    tests = {"empty": (paired, term), "plain": (plain, first), "full": (paired, term)}
    run = sampled(ef.LogPosterior.joint(tests, PRIOR))
    table = ef.pairing_table(run)
    rows = [f"{name}, {mode}" for name in ("empty", "full") for mode in (1, 2, "any")]
    assert table.column("mode") == rows
    for plot, options, of_one in (
        (ef.figures.plot_mac, {}, 3),
        (ef.figures.plot_shapes, {"geometry": TOWER}, 2),
    ):
        one = plot(run, experiment="full", **options)
        figure = plot(run, **options)
        assert len(one.axes) == of_one and len(figure.axes) == 2 * of_one
        above = [part.get_suptitle() for part in figure.subfigs]
        assert above == ["empty", "full"] and one.get_suptitle() == "full"
        drawn = [axes.get_title() for axes in figure.axes]
        assert drawn == 2 * [axes.get_title() for axes in one.axes]


@pytest.mark.parametrize(
    ("shapes", "supports", "count"), [(True, [], 4), ([0, 1, 3], ["0"], 2)]
)
def test_a_floor_without_a_sensor_is_not_drawn_at_rest(shapes, supports, count):
    """Four storeys, sensors at the first, the second and the roof."""
    storey = np.eye(4) - np.eye(4, k=-1)
    k = {"k1": storey[:2].T @ storey[:2], "k2": storey[2:].T @ storey[2:]}
    model = ef.MatrixModel(np.zeros((4, 4)), np.eye(4), k, n_modes=1, shapes=shapes)
    test = ef.Measurements([0.18], shapes=[[0.35], [0.65], [1.0]], dofs=[0, 1, 3])
    storeys = [(str(i), str(i + 1)) for i in range(4)]
    sensors = {i: (str(i + 1), "ux") for i in range(4)}
    nodes = {str(i): (0, 3 * i) for i in range(5)}
    geometry = ef.Geometry(nodes, storeys, sensors, supports)
    (axes,) = ef.figures.plot_shapes(run_of(model, test, 1), geometry=geometry).axes
    moved = lines(axes, MOVED)
    assert len(moved) == count and moved[0, 0].tolist() == [0, 0]
    assert (np.diff(moved[:, :, 0]) > 0).all()  # the first mode has no kink to rest


def test_sensors_across_each_other_add_up_and_a_skew_one_is_not_counted_twice():
    """Three sensors at one node, one at 45 degrees: the node moves as it does."""
    half, move = 0.5**0.5, np.array([0.6, 0.2])
    directions = {"a": (1, "ux"), "b": (1, "uy"), "c": (1, [half, half, 0.0])}
    shape = np.array([[move[0]], [move[1]], [half * move.sum()]])
    model = ef.FunctionModel(
        lambda p: ef.ModalSolution(np.array([p["k1"]]), shape), n_modes=1
    )
    test = ef.Measurements([12.0], shapes=shape, sensors=["a", "b", "c"])
    geometry = ef.Geometry({0: (0, 0), 1: (0, 1)}, [(0, 1)], directions)
    (axes,) = ef.figures.plot_shapes(run_of(model, test, 1), geometry=geometry).axes
    (end,) = points(axes, AT_SENSORS)
    along = (end - [0, 1]) / np.linalg.norm(end - [0, 1])
    assert_allclose(along, move / np.linalg.norm(move), rtol=1e-9)


def drawn_of_close(shapes, gap=0.0, measured=(1.0, 0.0)):
    """Draw two modes whose frequencies differ by a part, with two sensors at a node."""
    model = ef.FunctionModel(
        lambda p: ef.ModalSolution(np.array([p["k1"], p["k1"] * (1 + gap)]), shapes),
        variables=ef.modal_variables(2, ["1:ux", "1:uy", "2:ux"]),
    )
    measured = np.array([measured]).T
    test = ef.Measurements([12.0], shapes=measured, dofs=["1:ux", "1:uy"])
    nodes = {0: (0, 0), 1: (0, 1), 2: (0, 2)}
    geometry = ef.Geometry(nodes, [(0, 1), (1, 2)], supports=[0])
    return ef.figures.plot_shapes(run_of(model, test), geometry=geometry).axes[0]


def test_of_close_modes_the_combination_nearest_to_the_measured_shape_is_drawn():
    """Two modes of one frequency: the model's own shapes are turned by 45 degrees."""
    half = 0.5**0.5
    shapes = np.array([[half, half], [half, -half], [2, 3]]) * [1, 2]  # no unit length
    axes = drawn_of_close(shapes)
    assert_allclose(points(axes, AT_SENSORS), points(axes, "measured"), atol=1e-9)
    foot, middle, top = lines(axes, MOVED)[[0, 0, 1], [0, 1, 1]]
    assert_allclose([foot, middle], [[0, 0], points(axes, AT_SENSORS)[0]], atol=1e-12)
    assert top[0] / middle[0] == pytest.approx(half * (2 + 3))  # each of them as much


@pytest.mark.parametrize("gap", [0.0199, 0.0201])
def test_a_shape_has_one_scale_and_sign_on_either_side_of_the_least_gap(gap):
    """Shapes are far from unit length, and of the other sign than the measured one."""
    axes = drawn_of_close(np.array([[-0.06, 0.01], [0.01, 0.06], [-0.12, 0.02]]), gap)
    middle, top = lines(axes, MOVED)[[0, 1], 1]
    assert_allclose(middle, points(axes, AT_SENSORS)[0], atol=1e-12)
    assert top[0] / middle[0] == pytest.approx(2, abs=1e-3)


@pytest.mark.parametrize("error", [0.0, 1e-3])
def test_close_modes_alike_at_the_sensors_are_drawn_there_only(error):
    shapes = np.array([[0.5, 0.5], [0.5, 0.5 + error], [2, 3]])
    axes = drawn_of_close(shapes, measured=(1.0, 1.0))
    assert len(points(axes, AT_SENSORS)) == 1 and len(lines(axes, MOVED)) == 1
    # A mode that rests at the sensors is no part of what they measured.
    axes = drawn_of_close(np.array([[0.5, 1e-3 * error], [0.0, 0.0], [1.0, 3]]))
    assert (len(lines(axes, MOVED)) == 2) is (error == 0)


def cantilever(elements):
    nodes = [(0, 2.0 * i / elements) for i in range(elements + 1)]
    section = ef.Section("E", rho=7850.0, A=1e-3, I=1e-6)
    bars = [(i, i + 1, "bar") for i in range(elements)]
    every = {"plane": "xz", "shapes": True, "n_modes": 2}
    return ef.FrameModel(nodes, bars, {"bar": section}, {0: "all"}, **every)


def drawn_modes(elements):
    model, prior = (
        cantilever(elements),
        ef.GaussianPrior(["E"], [2e11], 2e9, [(1e11, 3e11)]),
    )
    hertz = model({"E": np.array([2e11])}).frequencies[0]
    term = ef.FrequencyTerm(hertz, relative_sd=0.01)
    figure = ef.figures.plot_shapes(sampled(ef.LogPosterior(model, term, prior)))
    return [np.concatenate(lines(axes, MOVED)) for axes in figure.axes]


def test_beams_are_drawn_as_they_bend():
    """Three elements, drawn with their rotations, are the beam of twelve."""
    for coarse, fine in zip(drawn_modes(3), drawn_modes(12), strict=True):
        drawn = np.interp(fine[:, 1], *coarse[np.argsort(coarse[:, 1])].T[::-1])
        largest = np.abs(fine[:, 0]).max()
        assert largest > 0.1
        sign = np.sign(coarse[-1, 0] * fine[-1, 0])
        assert_allclose(sign * drawn, fine[:, 0], atol=0.03 * largest)


def test_what_bends_between_nodes_stays_inside_its_panel():
    """Mode 2 of a bar held at both ends moves most where one element has no node."""
    nodes, section = [(0, 0), (0, 1), (0, 3)], ef.Section("E", rho=1.0, A=1.0, I=1e-3)
    bars = [(0, 1, "bar"), (1, 2, "bar")]
    every = {"plane": "xz", "shapes": True, "n_modes": 2}
    supports = {0: "fixed", 2: "pinned"}
    model = ef.FrameModel(nodes, bars, {"bar": section}, supports, **every)
    hertz = model({"E": np.array([1e6])}).frequencies[0]
    prior = ef.GaussianPrior(["E"], [1e6], 1e4, [(5e5, 2e6)])
    term = ef.FrequencyTerm(hertz, relative_sd=0.01)
    figure = ef.figures.plot_shapes(sampled(ef.LogPosterior(model, term, prior)))
    for axes in figure.axes:
        drawn = np.concatenate(lines(axes, MOVED))
        for values, (low, high) in zip(
            drawn.T, (axes.get_xlim(), axes.get_ylim()), strict=True
        ):
            assert low < values.min() and values.max() < high


def test_a_panel_shows_the_structure_with_its_sensors(run):
    figure = ef.figures.plot_shapes(run, modes=[2], geometry=TOWER, structure=True)
    first, second = figure.axes
    assert "2 sensors" in first.get_title() and "mode 2" in second.get_title()
    arrows = [text for text in first.texts if isinstance(text, Annotation)]
    tails = [arrow.xyann for arrow in arrows]
    assert_allclose(sorted(tails), [(0, 3), (0, 6)], atol=1e-9)
    names = [text.get_text() for text in first.texts if text not in arrows]
    assert names == [*TEST.sensors]


@pytest.mark.parametrize(
    "sample",
    [
        pytest.param(lambda at: ef.anneal(at, 40, seed=1), id="annealed"),
        pytest.param(
            lambda at: ef.run_emulated(at, 60, seed=1),
            id="emulated",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_result_that_holds_its_posterior_is_drawn_by_its_model(sample):
    model = ef.PairedModel(MODEL, TEST, candidates=2)
    term = ef.FrequencyTerm(TEST, relative_sd=0.01)
    result = sample(ef.LogPosterior(model, term, PRIOR))
    assert ef.figures.plot_mac(result).axes
    assert ef.figures.plot_shapes(result, geometry=TOWER).axes
    with pytest.raises(TypeError, match="posterior: .*ArviZ"):
        ef.figures.plot_mac(ef.to_inference_data(result))
