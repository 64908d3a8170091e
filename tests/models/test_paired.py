"""Modes are paired one-to-one by MAC, also where frequencies cross or coincide."""

from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.gradients import Crossing

import emcee_femu as ef
from emcee_femu import Measurements, ModalSolution, PairedModel, ShapeTerm
from emcee_femu.models.paired import couple_modes


def random_shapes(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


def mac(a, b):
    """Return the modal assurance criterion of every shape of a with every one of b."""
    return (a.T @ b) ** 2 / np.outer((a**2).sum(axis=0), (b**2).sum(axis=0))


def fixed(frequencies, shapes):
    """Return a model that returns given modes, whatever the parameters."""
    solution = ModalSolution(np.atleast_2d(frequencies), shapes)
    return lambda parameters: solution


def test_close_modes_share_their_space_at_the_sensors_that_a_mode_has():
    """As if the sensors that one of the measured modes lacks were no sensors."""
    shapes = random_shapes(5, 1, 8, 4)
    c, s = np.cos(0.6), np.sin(0.6)
    measured = shapes[0][:, :2] @ [[c, -s], [s, c]]
    measured[3, 1] = np.nan
    model = fixed([2.0, 2.001, 5.0, 6.0], shapes)
    paired = PairedModel(model, Measurements([2.0, 2.001], measured))({})
    assert_allclose(paired.mac, 1.0, rtol=1e-9)
    there = np.arange(8) != 3
    model = fixed([2.0, 2.001, 5.0, 6.0], shapes[:, there])
    fewer = PairedModel(model, Measurements([2.0, 2.001], measured[there]))({})
    assert_allclose(paired.mac[:, 1], fewer.mac[:, 1], rtol=1e-12)
    assert_allclose(paired.shapes[0, there, 1], fewer.shapes[0, :, 1], rtol=1e-9)


def test_the_pairs_are_the_best_of_all_one_to_one_choices():
    shapes, measured = random_shapes(2, 200, 4, 5), random_shapes(0, 4, 3)
    test = Measurements([1.0, 2.0, 3.0], shapes=measured)
    model = fixed(np.tile(np.arange(1.0, 6.0), (200, 1)), shapes)
    pairing = PairedModel(model, test, candidates=5)({})
    choices, greedy = np.array(list(permutations(range(5), 3))), 0
    for row in range(200):
        score = mac(measured, shapes[row])
        best = choices[score[range(3), choices].sum(axis=1).argmax()]
        assert_array_equal(pairing.model_mode[row], best + 1)
        assert_array_equal(pairing.frequencies[row], best + 1)
        assert_array_equal(pairing.shapes[row], shapes[row][:, best])
        assert_allclose(pairing.mac[row], score[range(3), best], rtol=1e-9)
        greedy += (score.argmax(axis=1) != best).any()
    assert greedy  # some needed more than the maximum


def test_a_cluster_of_three_spans_its_subspace_and_no_more():
    shapes = random_shapes(5, 9, 5)
    measured = shapes[:, 1:4] @ random_shapes(6, 3, 2)
    outside = shapes[:, 1:4] @ [1.0, 1.0, 1.0] + 2.0 * random_shapes(7, 9)
    test = Measurements([1, 2, 3], shapes=np.column_stack([measured, outside]))
    model = fixed([1.0, 2.0, 2.01, 2.02, 3.0], shapes[None])
    macs = PairedModel(model, test, candidates=5)({}).mac[0]
    assert_allclose(macs[:2], 1.0, rtol=1e-12)
    fit = shapes[:, 1:4] @ np.linalg.lstsq(shapes[:, 1:4], outside)[0]
    cosine = (fit @ outside) ** 2 / (fit @ fit) / (outside @ outside)
    assert_allclose(macs[2], cosine, rtol=1e-10)
    alone = PairedModel(model, test, candidates=5, min_gap=0.0)({})
    expected = mac(test.shapes, shapes)[range(3), alone.model_mode[0] - 1]
    assert_allclose(alone.mac[0], expected, rtol=1e-10)


def test_a_mode_without_a_pair_costs_a_finite_penalty():
    lonely = np.full((4, 1), 0.5)
    shapes = np.hstack([np.eye(4)[:, :1], lonely])
    test = Measurements([1.0, 2.0], sd=[0.1, 0.1], shapes=shapes)
    paired = PairedModel(fixed([1.0, 2.0, 3.0, 4.0], np.eye(4)[None]), test)({})
    assert paired.unpaired.tolist() == [[False, True]]
    assert_allclose(paired.mac, [[1.0, 0.25]])
    term, neither = ef.FrequencyTerm(test), np.array([[True, True]])
    both = paired._replace(unpaired=neither)
    none, one, two = (
        term({}, each)[0] for each in (ModalSolution(paired.frequencies), paired, both)
    )
    assert_allclose(none - one, one - two)
    assert 1 < none - one < np.inf
    stored = {"frequency": paired.frequency, "unpaired": neither.astype(float)}
    by_mode = term.pointwise({}, stored)["frequency"]
    assert_allclose(by_mode.sum(), two)


def test_where_sharing_fades_the_shape_is_weighted_by_the_weakest_link():
    """Three modes at two equal gaps, half-way: each neighbour counts by a half."""
    measured, weights = np.array([0.9, 0.3, 0.3]), np.array([1.0, 0.5, 0.5])
    model = fixed(np.cumprod([1.0, 1.015, 1.015]), np.eye(3)[None])
    test = Measurements([1.0], measured[:, None])
    paired = PairedModel(model, test, candidates=3)({})
    expected = mac(measured[:, None], (weights * measured)[:, None]).item()
    assert_allclose(paired.mac, [[expected]], rtol=1e-12)
    found = paired.shapes[0, :, 0]
    assert_allclose(found / found[0], weights * measured / 0.9, rtol=1e-12)


@pytest.mark.parametrize("leaving", [0, 2])
def test_neighbours_that_drift_apart_take_nothing_with_them(leaving):
    # Three modes in a row: the last or the first leaves, while the others stay.
    shapes = random_shapes(11, 1, 6, 3)
    measured = shapes[0] @ random_shapes(12, 3, 1)
    test, macs = Measurements([1.0], shapes=measured), []
    for gap in np.linspace(0.009, 0.021, 81):
        ratios = [1.001, 1 + gap] if leaving else [1 + gap, 1.001]
        model = fixed(np.cumprod([1.0, *ratios]), shapes)
        macs.append(PairedModel(model, test, candidates=3)({}).mac[0, 0])
    assert_allclose(macs[0], 1.0, rtol=1e-12)  # in the span of all three
    pair = np.delete(shapes[0], leaving, axis=1)
    fit = pair @ np.linalg.lstsq(pair, measured)[0]
    alone = mac(measured, shapes[0][:, [leaving]]).item()
    expected = max(mac(fit, measured).item(), alone)
    assert_allclose(macs[-1], expected, rtol=1e-10)
    assert np.abs(np.diff(macs)).max() < 0.06


def test_sensors_and_dofs_are_matched_in_any_order():
    K, at = {"k": np.diag([4.0, 3.0, 2.0, 1.0]) + 0.2}, {"k": np.array([9.0])}

    def model(dofs):
        zero = np.zeros((4, 4))
        return ef.MatrixModel(zero, np.eye(4), K, n_modes=4, shapes=dofs)

    frequencies, shapes = (part[0] for part in model(True)(at))
    test = Measurements(frequencies[:2], shapes=shapes[[3, 1]][:, :2], dofs=[3, 1])
    for dofs in (True, [1, 3], [3, 1], [3, 0, 1]):
        paired = PairedModel(model(dofs), test)(at)
        assert_allclose(paired.mac, 1.0, rtol=1e-12)
    with pytest.raises(ValueError, match=r"^dofs: .* sensors at \[3\]"):
        PairedModel(model([0, 1]), test)


def test_rows_of_a_model_that_does_not_name_them():
    shapes, order = random_shapes(13, 4, 3), [3, 1]
    modes = ModalSolution(np.array([[1.0, 2.0, 3.0]]), shapes[None])

    def paired(dofs, rows):
        test = Measurements([1.0, 2.0], shapes=shapes[rows][:, :2], dofs=dofs)
        return PairedModel(lambda _: modes, test, candidates=3)({})

    for dofs, rows in ((order, order), (None, range(4)), ([7, 8, 9, 11], range(4))):
        assert_allclose(paired(dofs, rows).mac, 1.0, rtol=1e-12)
    for dofs, rows, message in (
        ([1, 0, 2, 3], [1, 0, 2, 3], "another order"),
        (None, order, r"the rows of 2 .* give Measurements\(dofs="),
        ([3, 5], order, r"among the 4 .* got .3, 5."),
    ):
        with pytest.raises(ValueError, match=message):
            paired(dofs, rows)


def test_sensors_that_point_backwards_change_nothing():
    """A model may be asked by the same names."""
    bar = ef.Section(E=7e10, GJ=700, rho=2700, A=3e-4, Iy=2e-9, Iz="Iz")
    points = [(x, 0, 0) for x in np.linspace(0, 1, 5)]
    lines, signs = [(i, i + 1, "bar") for i in range(4)], np.array([[1], [-1], [-1]])
    plain, signed = ["2:uy", "3:uy", "4:uz"], ["2:uy", "3:-uy", "4:-uz"]
    options = {"n_modes": 4, "shapes": signed}
    model = ef.FrameModel(points, lines, {"bar": bar}, {0: "all"}, **options)
    parameters = {"Iz": np.array([1e-8, 2e-8])}
    shapes = model({"Iz": np.array([1.5e-8])}).shapes[0, :, :2] + 0.01
    found = []
    for rows, dofs in ((shapes, plain), (signs * shapes, signed)):
        test = Measurements([5.0, 30.0], rows, dofs=dofs)
        paired = PairedModel(model, test, candidates=4)(parameters)
        found.append((paired.mac, ShapeTerm(test, delta=0.1)({}, paired)))
    for one, other in zip(*found, strict=True):
        assert_allclose(one, other, rtol=1e-12)
    assert found[0][0].min() > 0.5


def test_modes_are_followed_by_their_shapes_at_a_reference():
    """As if the shapes there had been measured."""
    test, at = Measurements([10.0, 10.5], sd=[0.3, 0.3]), {"a": 9.0, "b": 11.0}
    paired = PairedModel(Crossing(), test, reference=at, candidates=2)
    given = Measurements([10.0, 10.5], shapes=np.eye(2))
    a = np.array([9.0, 11.0])
    for model in (paired, PairedModel(Crossing(), given, candidates=2)):
        found = model({"a": a, "b": np.array([10.0, 10.0])})
        assert_array_equal(found.frequencies, [[9.0, 10.0], [11.0, 10.0]])
        assert_array_equal(found.model_mode, [[1, 2], [2, 1]])
    swapped = PairedModel(
        Crossing(), [10.0, 10.5], reference={"a": 11.0, "b": 9.0}, candidates=2
    )
    found = swapped({"a": np.array([9.0]), "b": np.array([10.0])})
    assert_array_equal(found.frequencies, [[10.0, 9.0]])
    assert_array_equal(paired.measurements.sd, test.sd)


def test_a_reference_is_of_sensors_that_have_names():
    K = {"k": np.diag([4.0, 3.0, 2.0, 1.0]) + 0.2}
    model = ef.MatrixModel(
        np.zeros((4, 4)), np.eye(4), K, n_modes=4, shapes={"x": 2, "y": 0, "z": 1}
    )
    paired = PairedModel(model, [0.2, 0.3], reference={"k": 1.0})
    assert [*paired.variables["shapes"].coords["dof"]] == ["x", "y", "z"]
    assert_allclose(paired({"k": np.array([3.0])}).mac, 1.0, rtol=1e-9)


def test_what_is_wrong_with_a_reference_is_named():
    K, shaped = {"k": np.eye(2)}, Measurements([1.0], shapes=[[1.0], [2.0]])
    model = ef.MatrixModel(np.diag([1.0, 2.0]), np.eye(2), K, n_modes=2, shapes=True)
    without = ef.MatrixModel(np.diag([1.0, 2.0]), np.eye(2), K, n_modes=2)
    for given, test, reference, match in (
        (model, shaped, {"k": 1.0}, "^reference"),
        (model, [1.0], {}, "^reference.*'k'"),
        (model, [1.0], {"k": "1"}, "^reference"),
        (model, [1.0], [1.0], "^reference"),
        (without, [1.0], {"k": 1.0}, "^reference"),
        (model, [1.0, 2.0, 3.0], {"k": 1.0}, "^measurements: 3"),
        (model, [1.0, -2.0], {"k": 1.0}, "^measurements"),
        (model, Measurements([1.0]), None, "^measurements.*reference="),
    ):
        with pytest.raises((TypeError, ValueError), match=match):
            PairedModel(given, test, reference=reference)


def bent_frame(unit):
    """Return a bent cantilever in space whose unit of length is 1 m / ``unit``."""
    bar = ef.Section(
        E=(7e10 / unit**2, "E"),
        GJ=(700 * unit**2, "twist"),
        rho=2700 / unit**4,
        A=3e-4 * unit**2,
        Iy=(2e-9 * unit**4, "weak"),
        Iz=(1e-8 * unit**4, "strong"),
    )
    points = [(0, 0, 0), (0.5, 0, 0), (1, 0, 0), (1, 0.5, 0), (1.2, 1.0, 0.1)]
    bars = [(i, i + 1, "bar") for i in range(4)]
    supports, nodes = {0: "all"}, unit * np.array(points)
    return ef.FrameModel(nodes, bars, {"bar": bar}, supports, n_modes=8, shapes=True)


def test_modes_are_paired_alike_in_metres_and_in_millimetres():
    rng, names = np.random.default_rng(0), bent_frame(1.0).names
    wide = {name: np.exp(0.8 * rng.standard_normal(40)) for name in names}
    reference = dict.fromkeys(names, 1.0)
    both = [
        PairedModel(
            bent_frame(unit), np.arange(1.0, 6.0), reference=reference, candidates=8
        )
        for unit in (1.0, 1000.0)
    ]
    metres, millimetres = (paired(wide) for paired in both)
    assert_allclose(metres.mac, millimetres.mac, rtol=0, atol=1e-6)
    assert_array_equal(metres.model_mode, millimetres.model_mode)
    assert metres.mac.min() < 0.9  # they were not all the same anyway


def test_a_mode_that_only_turns_is_paired_by_its_rotations():
    bar = ef.Section(
        E=7e10, GJ=(700, "twist"), rho=2700, A=3e-4, Iy=2e-9, Iz=1e-8, Ip=4e-7
    )
    nodes = [(x, 0, 0) for x in np.linspace(0, 1, 9)]
    bars = [(i, i + 1, "bar") for i in range(8)]
    model = ef.FrameModel(nodes, bars, {"bar": bar}, {0: "all"}, n_modes=8, shapes=True)
    twist = np.array([1.0, 0.05])
    frequencies = model({"twist": twist}).frequencies
    turns = (np.abs(frequencies[0, :, None] / frequencies[1] - 1) > 1e-6).all(axis=1)
    first = int(np.argmax(turns))  # the lowest mode that the torsional stiffness moves
    assert first and turns[:6].sum() == 1
    paired = PairedModel(model, range(1, 7), reference={"twist": 1.0}, candidates=8)
    found = paired({"twist": twist})
    assert_allclose(found.mac, 1.0, rtol=1e-6)
    ratio = found.frequencies[1] / found.frequencies[0]
    expected = np.where(np.arange(6) == first, np.sqrt(0.05), 1.0)
    assert_allclose(ratio, expected, rtol=1e-3)


def test_what_rounding_leaves_of_a_turning_mode_resembles_no_measured_shape():
    bends = np.array([[1.0, 2.0, 0.5, 0.0]]).T
    turns = np.array([[1e-16, 2e-16, 5e-17, 1.0]]).T
    test = Measurements([1.0], bends, dofs=["1:uy", "2:uy", "3:uy", "3:rx"])
    model = fixed([1.0, 2.0], np.hstack([turns, bends + 0.1])[None])
    assert PairedModel(model, test)({}).model_mode.tolist() == [[2]]


def test_rotations_follow_the_translations_by_which_close_modes_are_paired():
    shapes = random_shapes(5, 1, 8, 4)
    c, s = np.cos(0.6), np.sin(0.6)
    measured = shapes[0][:, :2] @ [[c, -s], [s, c]]
    dofs = ["1:ux", "1:uy", "2:ux", "2:uy", "3:ux", "1:rx", "2:ry", "3:-rz"]
    measured[-1] *= -1  # as that sensor reads
    test = Measurements([2.0, 2.001], measured, dofs=dofs)
    assert np.isnan(test.compared[5:]).all() and np.isfinite(test.compared[:5]).all()
    solved = PairedModel(fixed([2.0, 2.001, 5.0, 6.0], shapes), test)({})
    assert_allclose(solved.mac, 1.0, rtol=1e-9)
    share = test.shapes / np.linalg.norm(test.shapes[:5], axis=0)
    assert_allclose(solved.shapes[0], share, rtol=1e-9)


def test_one_error_for_rotations_and_translations_is_refused():
    test = Measurements([1.0], [[1.0], [0.4], [0.3]], dofs=["1:ux", "2:ux", "2:ry"])
    with pytest.raises(ValueError, match="measured.*unit.*sd="):
        ShapeTerm(test, delta=0.02)
    with pytest.raises(ValueError, match="measured.*unit.*sd="):
        ShapeTerm(test, discrepancy="delta")
    ShapeTerm(test, sd=[[0.02], [0.02], [0.1]])
    turned = Measurements([1.0], [[1.0], [0.4]], dofs=["1:rx", "2:ry"])
    ShapeTerm(turned, delta=0.02)


def test_the_coupling_of_close_modes_fades_without_a_kink():
    """Beside both ends of the passage it changes by the square of the distance."""
    gap, small = 0.02, 1e-3

    def coupling(apart):
        return couple_modes(np.array([[100.0, 100.0 * (1 + apart * gap)]]), gap)[
            0, 0, 1
        ]

    assert coupling(0.4) == 1.0 and coupling(1.1) == 0.0
    assert_allclose(coupling(0.75), 0.5, atol=1e-9)
    assert 0 < 1 - coupling(0.5 + small) < 20 * small**2
    assert 0 < coupling(1.0 - small) < 20 * small**2
