"""Mode shapes on the structure, and the MAC: what is drawn where."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.patches import Rectangle
from numpy.testing import assert_allclose
from support.chains import dataset
from support.figures import assert_no_texts_overlap, assert_nothing_is_clipped, legend

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


def run_of(model, measured, **pairing):
    paired = ef.PairedModel(model, measured, **pairing)
    terms = [ef.FrequencyTerm(measured, relative_sd=0.01)]
    posterior = ef.LogPosterior(paired, terms, PRIOR)
    return ef.run(posterior, ef.DEMCMove(), 8, 40, ensembles=1, seed=1)


@pytest.fixture(scope="module")
def run():
    return run_of(MODEL, TEST, candidates=2)


def at_mean(run):
    """Return frequencies and shapes at the posterior mean, from closed forms."""
    draws = dataset(ef.to_inference_data(run), "posterior")
    k1, k2 = (float(draws[name].mean()) for name in ("k1", "k2"))
    squares, shapes = np.linalg.eigh([[k1 + k2, -k2], [-k2, k2]])
    return np.sqrt(squares) / (2 * np.pi), shapes


def short(value, digits=2):
    return f"{value:.{digits}f}".removeprefix("0")


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
        moved = lines(axes, "updated model")
        # The largest displacement is 15 % of the structure; the foot stands still.
        assert_allclose(moved[:, :, 1], [[0, 3], [3, 6]], atol=1e-12)
        assert_allclose(moved[0, 0], [0, 0], atol=1e-12)
        measured = points(axes, "measured")[:, 0]
        sensors = points(axes, "updated model at the sensors")[:, 0]
        assert_allclose(sensors, moved[:, 1, 0], rtol=1e-9)
        largest = max(np.abs(measured).max(), np.abs(sensors).max())
        assert largest == pytest.approx(0.15 * 6)
        assert_allclose(sensors[1] / sensors[0], shapes[1, i] / shapes[0, i], rtol=1e-8)
        # Measured shapes have the model's scale and sign, by least squares.
        assert_allclose(measured[1] / measured[0], MEASURED[1, i] / MEASURED[0, i])
        assert (measured - sensors) @ measured == pytest.approx(0, abs=1e-9)
        mac = (MEASURED[:, i] @ shapes[:, i]) ** 2 / (MEASURED[:, i] ** 2).sum()
        assert axes.get_title() == (
            f"mode {i + 1}: {HERTZ[i]:.4g} Hz measured,\n"
            f"{hertz[i]:.4g} Hz updated, MAC {short(mac, 3)}"
        )
    names = ["at rest", "updated model", "updated model at the sensors", "measured"]
    assert legend(figure) == names
    assert_nothing_is_clipped(figure, "x", "y")
    assert_no_texts_overlap(figure)


def test_modes_are_chosen_and_others_refused(run):
    (axes,) = ef.figures.plot_shapes(run, geometry=TOWER, modes=2).axes
    assert axes.get_title().startswith("mode 2: ")
    for modes, message in (([3], "from 1 to 2"), ([], "from 1 to 2"), ([0], "least 1")):
        with pytest.raises(ValueError, match=f"modes: .*{message}"):
            ef.figures.plot_shapes(run, geometry=TOWER, modes=modes)


def test_without_a_geometry_or_its_sensors_it_says_what_to_give(run):
    with pytest.raises(ValueError, match=r"geometry: .*Geometry\(nodes, lines, sens"):
        ef.figures.plot_shapes(run)
    bare = ef.Geometry({0: (0, 0), 1: (0, 1)}, [(0, 1)], {0: (1, "ux")})
    with pytest.raises(ValueError, match=r"geometry: it does not know the DOFs \[1\]"):
        ef.figures.plot_shapes(run, geometry=bare)
    with pytest.raises(TypeError, match="geometry: expected a Geometry"):
        ef.figures.plot_shapes(run, geometry={0: (0, 0)})
    with pytest.raises(TypeError, match="posterior: expected a LogPosterior"):
        ef.figures.plot_shapes(ef.to_inference_data(run), geometry=TOWER)


def cantilever(shapes):
    bar = ef.Section(E="k1", GJ=700.0, rho=1.0, A=1.0, Iy=1.0, Iz="k2")
    nodes = [(x, 0, 0) for x in range(5)]
    beams = [(i, i + 1, "bar") for i in range(4)]
    return ef.FrameModel(
        nodes, beams, {"bar": bar}, {0: "all"}, n_modes=4, shapes=shapes
    )


BEAM = ef.Geometry({i: (i, 0, 0) for i in range(5)}, [(i, i + 1) for i in range(4)])


@pytest.fixture(scope="module")
def solved():
    """The third mode of a cantilever bends along y; sensors at two of five nodes."""
    return cantilever(True)({"k1": np.array([12.0]), "k2": np.array([8.0])})


def beam_run(solved, shapes):
    full = cantilever(True)
    sensors = ["2:uy", "3:uy"]
    rows = [full.shape_dofs.index(sensor) for sensor in sensors]
    bending = np.abs(solved.shapes[0, rows]).sum(axis=0).argmax()
    measured = ef.Measurements(
        solved.frequencies[0, [bending]],
        shapes=solved.shapes[0][np.ix_(rows, [bending])],
        dofs=sensors,
    )
    return run_of(cantilever(shapes), measured, candidates=4)


def test_lines_move_only_where_the_model_knows_its_nodes(solved):
    everywhere = beam_run(solved, True)
    (axes,) = ef.figures.plot_shapes(everywhere, geometry=BEAM).axes
    moved = lines(axes, "updated model")
    assert len(moved) == 4
    assert_allclose(moved[0, 0], [0, 0], atol=1e-12)  # it is clamped
    assert_allclose(moved[1:, 0], moved[:-1, 1])
    assert np.abs(moved[-1, 1, 1]) == pytest.approx(0.15 * 4)  # the tip moves most
    sensors = beam_run(solved, ["3:uy", "2:uy"])
    (axes,) = ef.figures.plot_shapes(sensors, geometry=BEAM).axes
    (only,) = lines(axes, "updated model")
    assert only[:, 0].tolist() == [2, 3]
    assert_allclose(only, points(axes, "updated model at the sensors"))


@pytest.mark.parametrize(
    ("shapes", "supports", "count"), [(True, [], 4), ([0, 1, 3], ["0"], 2)]
)
def test_a_floor_without_a_sensor_is_not_drawn_at_rest(shapes, supports, count):
    """Four storeys, sensors at the first, the second and the roof."""
    storey = np.eye(4) - np.eye(4, k=-1)
    k = {"k1": storey[:2].T @ storey[:2], "k2": storey[2:].T @ storey[2:]}
    model = ef.MatrixModel(np.zeros((4, 4)), np.eye(4), k, n_modes=1, shapes=shapes)
    shape = np.array([[0.35], [0.65], [1.0]])
    run = run_of(
        model, ef.Measurements([0.18], shapes=shape, dofs=[0, 1, 3]), candidates=1
    )
    storeys = [(str(i), str(i + 1)) for i in range(4)]
    sensors = {i: (str(i + 1), "ux") for i in range(4)}
    nodes = {str(i): (0, 3 * i) for i in range(5)}
    geometry = ef.Geometry(nodes, storeys, sensors, supports)
    (axes,) = ef.figures.plot_shapes(run, geometry=geometry).axes
    moved = lines(axes, "updated model")
    assert len(moved) == count
    assert moved[0, 0].tolist() == [0, 0]
    assert (np.diff(moved[:, :, 0]) > 0).all()  # the first mode has no kink to rest


def test_sensors_across_each_other_add_up_and_a_skew_one_is_not_counted_twice():
    """Three sensors at one node, one at 45 degrees: the node moves as it does."""
    nodes, half = {0: (0, 0), 1: (0, 1)}, 0.5**0.5
    directions = {"a": (1, "ux"), "b": (1, "uy"), "c": (1, [half, half, 0.0])}
    move = np.array([0.6, 0.2])
    shape = np.array([[move[0]], [move[1]], [half * move.sum()]])
    model = ef.FunctionModel(
        lambda p: ef.ModalSolution(np.array([p["k1"]]), shape), n_modes=1
    )
    measured = ef.Measurements([12.0], shapes=shape, sensors=["a", "b", "c"])
    run = run_of(model, measured, candidates=1)
    geometry = ef.Geometry(nodes, [(0, 1)], directions)
    (axes,) = ef.figures.plot_shapes(run, geometry=geometry).axes
    (end,) = points(axes, "updated model at the sensors")
    along = (end - [0, 1]) / np.linalg.norm(end - [0, 1])
    assert_allclose(along, move / np.linalg.norm(move), rtol=1e-9)


def test_a_model_without_measured_shapes_is_drawn_alone_in_space():
    nodes = {0: (0, 0, 0), 1: (4, 0, 0), 2: (4, 3, 0), 3: (0, 3, 2)}
    sensors = {i: (3, d) for i, d in enumerate(("ux", "uz"))}
    geometry = ef.Geometry(nodes, [(0, 1), (1, 2), (2, 3)], sensors)
    term = ef.FrequencyTerm(HERTZ, relative_sd=0.01)
    posterior = ef.LogPosterior(MODEL, term, PRIOR)
    run = ef.run(posterior, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)
    figure = ef.figures.plot_shapes(run, geometry=geometry)
    assert legend(figure) == ["at rest", "updated model"]
    rest = lines(figure.axes[0], "at rest")
    # A parallel projection: x to the right, y to the right and up, z straight up.
    x, y = rest[0, 1] - rest[0, 0], rest[1, 1] - rest[1, 0]
    up = lines(figure.axes[0], "updated model")[2, 1] - rest[2, 1]
    assert x[0] > 0 > x[1] and y[0] > 0 and y[1] > 0 and up.any()
    assert figure.axes[1].get_title().endswith("Hz updated")
    assert {text.get_text() for text in figure.axes[0].texts} == {"x", "y", "z"}


def test_a_model_without_shapes_says_how_to_get_them():
    model = ef.MassSpringModel([1.0, 1.0], SPRINGS)
    posterior = ef.LogPosterior(model, ef.FrequencyTerm(HERTZ, relative_sd=0.01), PRIOR)
    run = ef.run(posterior, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)
    with pytest.raises(ValueError, match=r"shapes=True"):
        ef.figures.plot_shapes(run, geometry=TOWER)
    with pytest.raises(ValueError, match=r"shapes=True"):
        ef.figures.plot_mac(run)


def mac_of(measured, shapes):
    return np.array(
        [[(m @ s) ** 2 / ((m @ m) * (s @ s)) for s in shapes.T] for m in measured.T]
    )


def test_the_matrix_has_the_mac_before_and_after_and_intervals_of_pairs(run):
    figure = ef.figures.plot_mac(run)
    before, after, _ = figure.axes
    k1, k2 = PRIOR.mean
    hertz, shapes = np.linalg.eigh([[k1 + k2, -k2], [-k2, k2]])
    modes = {before: (np.sqrt(hertz) / (2 * np.pi), shapes), after: at_mean(run)}
    mac = dataset(ef.to_inference_data(run), "response")["mac"].values.reshape(-1, 2)
    low, high = np.quantile(mac, [0.025, 0.975], axis=0)
    for axes, (hertz, shapes) in modes.items():
        expected = mac_of(MEASURED, shapes)
        assert_allclose(axes.images[0].get_array(), expected, rtol=1e-9)
        texts = {text.get_position(): text.get_text() for text in axes.texts}
        for (i, j), value in np.ndenumerate(expected):
            pair = i == j and axes is after
            ends = f"\n{short(low[i], 3)}–{short(high[i], 3)}" if pair else ""
            assert texts[j, i] == f"{short(value)}{ends}"
        ticks = [label.get_text() for label in axes.get_xticklabels()]
        assert ticks == [f"{k}\n{f:.4g} Hz" for k, f in enumerate(hertz, 1)]
        frames = [p for p in axes.patches if isinstance(p, Rectangle)]
        centres = [np.mean([p.get_corners()], axis=1)[0] for p in frames]
        assert_allclose(centres, [[0, 0], [1, 1]], atol=1e-12)
    assert low[0] < high[0] < 1
    assert_nothing_is_clipped(figure, "MAC (1: same shape)")
    assert_no_texts_overlap(figure)


def test_a_pair_out_of_order_is_framed_where_it_is():
    turned = ef.Measurements(HERTZ, shapes=SHAPES[:, ::-1], dofs=[0, 1])
    after = ef.figures.plot_mac(run_of(MODEL, turned, candidates=2)).axes[1]
    centres = [np.mean(p.get_corners(), axis=0) for p in after.patches]
    assert_allclose(centres, [[1, 0], [0, 1]], atol=1e-12)


def test_a_prior_mean_that_cannot_be_solved_is_left_out():
    def solve(p):
        if p["k1"] == 12.0:
            raise ValueError("the model fails at the prior mean")
        return ef.ModalSolution(HERTZ * p["k1"] / 10, SHAPES)

    function = ef.FunctionModel(solve, n_modes=2)
    paired = ef.PairedModel(
        function, ef.Measurements(HERTZ, shapes=MEASURED), candidates=2
    )
    posterior = ef.LogPosterior(paired, ef.FrequencyTerm(HERTZ, sd=0.03), PRIOR)
    draws = posterior.start(8, 1)
    run = ef.run(
        posterior, ef.DEMCMove(), 8, 20, ensembles=1, seed=1, starts=draws[None]
    )
    titles = [axes.get_title() for axes in ef.figures.plot_mac(run).axes]
    assert titles == ["after: at the posterior mean", ""]


def test_experiments_are_named():
    paired = ef.PairedModel(MODEL, TEST, candidates=2)
    term = ef.FrequencyTerm(TEST, relative_sd=0.01)
    tests = {
        "empty": (paired, term),
        "plain": (MODEL, ef.FrequencyTerm(HERTZ, sd=0.03)),
    }
    joint = ef.LogPosterior.joint(tests, PRIOR)
    run = ef.run(joint, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)
    assert len(ef.figures.plot_mac(run, experiment="empty").axes) == 3
    with pytest.raises(ValueError, match=r"experiment: expected one of \['empty', 'pl"):
        ef.figures.plot_mac(run)
    with pytest.raises(ValueError, match="pairs no modes; wrap the model"):
        ef.figures.plot_mac(run, experiment="plain")


def test_what_close_modes_span_is_drawn_at_the_sensors_only():
    """Two modes of one frequency: the model's own shapes are turned by 45 degrees."""
    half = 0.5**0.5
    model = ef.FunctionModel(
        lambda p: ef.ModalSolution(
            np.array([p["k1"], p["k1"]]),
            np.array([[half, half], [half, -half], [2, 3]]),
        ),
        variables=ef.modal_variables(2, ["1:ux", "1:uy", "2:ux"]),
    )
    measured = ef.Measurements([12.0], shapes=[[1.0], [0.0]], dofs=["1:ux", "1:uy"])
    run = run_of(model, measured, candidates=2)
    geometry = ef.Geometry({0: (0, 0), 1: (1, 0), 2: (2, 0)}, [(0, 1), (1, 2)])
    (axes,) = ef.figures.plot_shapes(run, geometry=geometry).axes
    predicted = points(axes, "updated model at the sensors")
    assert_allclose(predicted, points(axes, "measured"), atol=1e-9)
    assert not [c for c in axes.collections if c.get_label() == "updated model"]
    assert "MAC 1.000" in axes.get_title()


def test_intervals_are_inside_their_frames(solved):
    figure = ef.figures.plot_mac(beam_run(solved, True))
    figure.canvas.draw()
    after = figure.axes[1]
    (frame,) = (patch.get_window_extent() for patch in after.patches)
    (box,) = (t.get_window_extent() for t in after.texts if "–" in t.get_text())
    assert frame.x0 < box.x0 and box.x1 < frame.x1
