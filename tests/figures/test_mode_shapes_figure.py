"""Mode shapes on the structure, and the MAC: what is drawn where."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.patches import Rectangle
from numpy.testing import assert_allclose
from support.chains import dataset
from support.figures import assert_no_texts_overlap, assert_nothing_is_clipped

import emcee_femu as ef

# A tower of two unit masses, whose modes are known: k1 = k2 = 10 N/m.
SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 10.0)}
GOLDEN = (1 + 5**0.5) / 2
SHAPES = np.array([[1.0, 1.0], [GOLDEN, 1 - GOLDEN]])
HERTZ = np.sqrt([10 / GOLDEN**2, 10 * GOLDEN**2]) / (2 * np.pi)
MEASURED = np.array([[1.0, -1.1], [1.7, 0.6]])  # the second turned round
PRIOR = ef.GaussianPrior(["k1", "k2"], [12.0, 8.0], 3.0, [(1, 30), (1, 30)])
TOWER = ef.Geometry(
    {"foot": (0, 0), "middle": (0, 3), "top": (0, 6)},
    [("foot", "middle"), ("middle", "top")],
    {0: ("middle", "ux"), 1: ("top", "ux")},
)
MODEL = ef.MassSpringModel([1.0, 1.0], SPRINGS, shapes=True)
TEST = ef.Measurements(HERTZ, shapes=MEASURED, dofs=[0, 1])
MOVED, AT_SENSORS = "updated model", "updated model at the sensors"


def sample(model, measured, **options):
    term = ef.FrequencyTerm(measured, relative_sd=0.01)
    posterior = ef.LogPosterior(model, term, PRIOR)
    return ef.run(posterior, ef.DEMCMove(), 8, 20, ensembles=1, seed=1, **options)


def run_of(model, measured, candidates=2):
    return sample(ef.PairedModel(model, measured, candidates=candidates), measured)


@pytest.fixture(scope="module")
def run():
    return run_of(MODEL, TEST)


def solved(k1, k2):
    """Return frequencies and shapes, from closed forms."""
    squares, shapes = np.linalg.eigh([[k1 + k2, -k2], [-k2, k2]])
    return np.sqrt(squares) / (2 * np.pi), shapes


def at_mean(run):
    draws = dataset(ef.to_inference_data(run), "posterior")
    return solved(*(float(draws[name].mean()) for name in ("k1", "k2")))


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
    hertz, shapes = at_mean(run)
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
        mac = (MEASURED[:, i] @ shapes[:, i]) ** 2 / (MEASURED[:, i] ** 2).sum()
        for number in (f"{HERTZ[i]:.4g}", f"{hertz[i]:.4g}", f"MAC {mac:.3f}"):
            assert number.replace(" 0.", " .") in axes.get_title()
    assert_nothing_is_clipped(figure)
    assert_no_texts_overlap(figure)
    assert len(ef.figures.plot_shapes(run, geometry=TOWER, modes=2).axes) == 1


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
    plain = sample(ef.MassSpringModel([1.0, 1.0], SPRINGS), HERTZ)
    for plot in (ef.figures.plot_shapes, ef.figures.plot_mac):
        with pytest.raises(ValueError, match="shapes=True"):
            plot(plain, **{"geometry": TOWER} if plot is ef.figures.plot_shapes else {})
    term = ef.FrequencyTerm(TEST, relative_sd=0.01)
    paired = ef.PairedModel(MODEL, TEST, candidates=2)
    tests = {"empty": (paired, term), "plain": (MODEL, term)}
    joint = ef.LogPosterior.joint(tests, PRIOR)
    both = ef.run(joint, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)
    assert len(ef.figures.plot_mac(both, experiment="empty").axes) == 3
    for options, message in (({}, "experiment"), ({"experiment": "plain"}, "pairs no")):
        with pytest.raises(ValueError, match=message):
            ef.figures.plot_mac(both, **options)


@pytest.mark.parametrize("shapes", [True, ["3:uy", "2:uy"]])
def test_lines_move_only_where_the_model_knows_its_nodes(shapes):
    """The bending of a cantilever along y, with sensors at two of five nodes."""
    bar = ef.Section(E="k1", GJ=700.0, rho=1.0, A=1.0, Iy=1.0, Iz="k2")
    beam = [(x, 0, 0) for x in range(5)], [(i, i + 1, "bar") for i in range(4)]
    full, frame = (
        ef.FrameModel(*beam, {"bar": bar}, {0: "all"}, n_modes=4, shapes=which)
        for which in (True, shapes)
    )
    modes, sensors = full({"k1": [12.0], "k2": [8.0]}), ["2:uy", "3:uy"]
    rows = [full.shape_dofs.index(sensor) for sensor in sensors]
    bending = [np.abs(modes.shapes[0, rows]).sum(axis=0).argmax()]
    shape = modes.shapes[0][np.ix_(rows, bending)]
    test = ef.Measurements(modes.frequencies[0, bending], shapes=shape, dofs=sensors)
    run, nodes = run_of(frame, test, 4), {i: (i, 0, 0) for i in range(5)}
    geometry = ef.Geometry(nodes, [(i, i + 1) for i in range(4)])
    (axes,) = ef.figures.plot_shapes(run, geometry=geometry).axes
    moved = lines(axes, MOVED)
    if shapes is not True:
        assert moved[0, :, 0].tolist() == [2, 3] and len(moved) == 1
        assert_allclose(moved[0], points(axes, AT_SENSORS))
        return
    assert len(moved) == 4
    assert_allclose(moved[0, 0], [0, 0], atol=1e-12)  # it is clamped
    assert_allclose(moved[1:, 0], moved[:-1, 1])
    assert np.abs(moved[-1, 1, 1]) == pytest.approx(0.15 * 4)  # the tip moves most


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


def test_the_matrix_has_the_mac_before_and_after_and_intervals_of_pairs(run):
    figure = ef.figures.plot_mac(run)
    mac = dataset(ef.to_inference_data(run), "response")["mac"].values.reshape(-1, 2)
    low, high = np.quantile(mac, [0.025, 0.975], axis=0)
    before_and_after = solved(*PRIOR.mean), at_mean(run)
    for axes, (_, shapes) in zip(figure.axes, before_and_after, strict=False):
        expected = (MEASURED.T @ shapes) ** 2 / (MEASURED**2).sum(axis=0)[:, None]
        assert_allclose(axes.images[0].get_array(), expected, rtol=1e-9)
        texts = {text.get_position(): text.get_text() for text in axes.texts}
        for (i, j), value in np.ndenumerate(expected):
            assert texts[j, i].startswith(f"{value:.2f}".removeprefix("0"))
            ends = f"{low[i]:.3f}–{high[i]:.3f}".replace("0.", ".")
            assert (ends in texts[j, i]) == (i == j and axes is figure.axes[1])
        frames = [p for p in axes.patches if isinstance(p, Rectangle)]
        centres = [np.mean(p.get_corners(), axis=0) for p in frames]
        assert_allclose(centres, [[0, 0], [1, 1]], atol=1e-12)
    assert_nothing_is_clipped(figure)
    assert_no_texts_overlap(figure)
    # A pair out of order is framed where it is, around its interval.
    turned = ef.Measurements(HERTZ, shapes=SHAPES[:, ::-1], dofs=[0, 1])
    figure = ef.figures.plot_mac(run_of(MODEL, turned))
    figure.canvas.draw()
    frames = figure.axes[1].patches
    centres = [np.mean(p.get_corners(), axis=0) for p in frames]
    assert_allclose(centres, [[1, 0], [0, 1]], atol=1e-12)
    boxes = [p.get_window_extent() for p in frames]
    for text in figure.axes[1].texts:
        if "–" in text.get_text():
            box = text.get_window_extent()
            assert any(f.x0 < box.x0 and box.x1 < f.x1 for f in boxes)


def test_what_close_modes_span_is_drawn_at_the_sensors_only():
    """Two modes of one frequency: the model's own shapes are turned by 45 degrees."""
    half = 0.5**0.5
    shapes = np.array([[half, half], [half, -half], [2, 3]])
    model = ef.FunctionModel(
        lambda p: ef.ModalSolution(np.array([p["k1"], p["k1"]]), shapes),
        variables=ef.modal_variables(2, ["1:ux", "1:uy", "2:ux"]),
    )
    test = ef.Measurements([12.0], shapes=[[1.0], [0.0]], dofs=["1:ux", "1:uy"])
    geometry = ef.Geometry({0: (0, 0), 1: (1, 0), 2: (2, 0)}, [(0, 1), (1, 2)])
    (axes,) = ef.figures.plot_shapes(run_of(model, test), geometry=geometry).axes
    assert_allclose(points(axes, AT_SENSORS), points(axes, "measured"), atol=1e-9)
    assert not [c for c in axes.collections if c.get_label() == MOVED]
