"""A sensor that is no DOF gives, by every door, what the DOFs themselves give."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import emcee_femu as ef
from emcee_femu.measurements.directions import (
    read_combination,
    unit_of,
    write_combination,
)

COS, SIN = 0.8, 0.6
SKEW = {"2:ux": COS, "2:uy": SIN}
GAUGE = {"3:rz": 2.0, "2:rz": -2.0}  # the curvature of a bar of half a metre
AT = {"k": np.array([1.0, 1.3]), "tip": np.array([1.0, 1.0])}
SKEW_TEXT = "0.8*2:ux + 0.6*2:uy"


def frame(**options):
    """Return a bent frame, in which nodes move along x and y."""
    nodes = [(0, 0), (0.3, 0.4), (0.6, 0.8), (1.0, 1.1), (1.5, 1.1)]
    own = {"rho": 7800, "A": 1e-4, "I": 1e-9}
    sections = {name: ef.Section(E=(2e11, name), **own) for name in ("k", "tip")}
    bars = [(i, i + 1, "k" if i < 2 else "tip") for i in range(4)]
    supports = {0: "fixed"}
    given = {"plane": "xy", "n_modes": 6, "shapes": True} | options
    return ef.FrameModel(nodes, bars, sections, supports, **given)


FRAME = frame()
SHAPES = FRAME(AT).shapes[0]
ROW = {dof: i for i, dof in enumerate(FRAME.dofs)}
BY_DOF = SHAPES[[ROW["1:ux"], ROW["3:uy"], ROW["4:uy"]], :3]
ALONG = COS * SHAPES[ROW["2:ux"], :3] + SIN * SHAPES[ROW["2:uy"], :3]
HERTZ = FRAME(AT).frequencies[0, :3]


def measured(last, row=ALONG):
    dofs = ["1:ux", "3:uy", "4:uy", last]
    return ef.Measurements(HERTZ, np.vstack([BY_DOF, row]), dofs=dofs)


@pytest.mark.parametrize("text", ["2:ux", "2:-ux", "A-1:ux", "4", "", "a b", "a *"])
def test_a_single_dof_is_no_combination(text):
    assert read_combination(text) is None


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (SKEW_TEXT, SKEW),
        ("0.8*2:ux+.6*2:uy", SKEW),
        ("0.8*2:ux - 0.6*2:-uy", SKEW),
        ("3:ux - 2:ux", {"3:ux": 1.0, "2:ux": -1.0}),
        ("-1e-3*3:rz + 1E-3 * 2:rz", {"3:rz": -1e-3, "2:rz": 1e-3}),
        ("0.8*4 + 0.6*5", {4: 0.8, 5: 0.6}),
    ],
)
def test_a_combination_is_read_and_written(text, parts):
    assert read_combination(text) == parts
    assert read_combination(write_combination(parts)) == parts


def test_a_skew_sensor_pairs_by_what_it_measures_in_every_spelling(tmp_path):
    """The MAC is 1: only the right combination of the model's rows gives it."""
    rows = np.vstack([BY_DOF, ALONG]).tolist()
    lines = [
        "quantity;sensor;dof;a;b;c",
        "frequency [Hz];;;" + ";".join(map(str, HERTZ)),
    ]
    for dof, row in zip(
        ["1:ux", "3:uy", "4:uy", "0,8*2:ux + 0,6*2:uy"], rows, strict=True
    ):
        lines.append(f"shape;{dof[:1]};{dof};" + ";".join(map(str, row)))
    path = tmp_path / "test.csv"
    path.write_text("\n".join([*lines, ""]).replace(".", ","), encoding="utf-8")
    read = ef.Measurements.from_csv(path)
    read.to_csv(tmp_path / "again.csv")
    again = ef.Measurements.from_csv(tmp_path / "again.csv")
    for test in (measured(SKEW), measured(SKEW_TEXT), read, again):
        assert test.dofs.tolist()[-1] == SKEW_TEXT
        assert_allclose(ef.PairedModel(FRAME, test)(AT).mac[0], 1, atol=1e-6)
    wrong = measured({"2:ux": COS, "2:uy": -SIN})
    assert ef.PairedModel(FRAME, wrong)(AT).mac.min() < 0.99
    turned = measured({"2:-ux": COS, "2:-uy": SIN}, -ALONG)
    assert_allclose(ef.PairedModel(FRAME, turned)(AT).mac[0], 1, atol=1e-6)


def test_functions_and_models_with_numbers_take_combinations():
    numbered = {ROW[dof]: factor for dof, factor in SKEW.items()}
    dofs = [ROW["1:ux"], ROW["3:uy"], ROW["4:uy"], numbered]
    test = ef.Measurements(HERTZ, np.vstack([BY_DOF, ALONG]), dofs=dofs)

    def solve(p):
        modes = FRAME({name: np.array([value]) for name, value in p.items()})
        return ef.ModalSolution(modes.frequencies[0], modes.shapes[0])

    by_function = ef.PairedModel(ef.FunctionModel(solve, n_modes=6), test)
    assert_allclose(by_function(AT).mac[0], 1, atol=1e-9)
    K, M = FRAME.matrices({"k": 1.0, "tip": 0.5})
    tip = FRAME.K["tip"]
    matrices = ef.MatrixModel(
        K - FRAME.K["k"] - 0.5 * tip,
        M,
        {"k": FRAME.K["k"], "tip": tip},
        n_modes=6,
        shapes=True,
    )
    assert_allclose(ef.PairedModel(matrices, test)(AT).mac[0], 1, atol=1e-9)
    term = ef.ShapeTerm(test, delta=0.01)
    exact = term({}, by_function(AT))[0]
    off = ef.ShapeTerm(measured(SKEW, -ALONG), delta=0.01)({}, by_function(AT))[0]
    assert exact > off + 10


def test_derivatives_of_paired_combinations_are_those_of_differences():
    paired = ef.PairedModel(FRAME, measured(SKEW))
    slopes = paired.jacobian(AT)[1]["shapes"]["k"]
    step = 1e-6
    ahead, behind = (paired(AT | {"k": AT["k"] + s}).shapes for s in (step, -step))
    assert np.abs(slopes[:, -1]).max() > 1e-3
    assert_allclose(slopes, (ahead - behind) / (2 * step), atol=1e-5)


def test_a_strain_gauge_is_left_out_of_the_mac_beside_translations():
    """In another unit of length, and of any gain, the MAC is the same."""
    strain = 2 * (SHAPES[ROW["3:rz"], :3] - SHAPES[ROW["2:rz"], :3])
    assert unit_of(write_combination(GAUGE)) != unit_of("2:ux")
    for factor in (1.0, 1e3):
        test = measured(GAUGE, factor * strain)
        assert np.isnan(test.compared[-1]).all()
        assert_allclose(ef.PairedModel(FRAME, test)(AT).mac[0], 1, atol=1e-9)
    with pytest.raises(ValueError, match="unit of length; give sd="):
        ef.ShapeTerm(test, delta=0.01)
    named = frame(shapes={"a": "1:ux", "b": "3:uy", "c": "4:uy", "gauge": GAUGE})
    dofs = ["a", "b", "c", "gauge"]
    test = ef.Measurements(HERTZ, np.vstack([BY_DOF, strain]), dofs=dofs)
    with pytest.raises(ValueError, match="'gauge' measures .*unit of length"):
        ef.PairedModel(named, test)


@pytest.mark.parametrize(
    ("label", "like"),
    [
        ("3:ux - 2:ux", "2:ux"),  # a displacement of one against the other
        (SKEW_TEXT, "2:ux"),
        ("1.0*3:ux + 0.2*3:rz", "2:ux"),  # on an arm of 0.2 m
        ("0.8*2:rx + 0.6*2:ry", "2:rz"),
        ("0.5*2:ux + 0.5*3:ux", "2:ux"),  # the mean of two
        ("4.0*3:ux - 4.0*2:ux", write_combination(GAUGE)),  # a strain
    ],
)
def test_the_unit_of_a_combination(label, like):
    assert unit_of(label) == unit_of(like)


def test_a_skew_sensor_is_drawn_along_its_axis():
    node, along = FRAME.geometry.locate(SKEW_TEXT)
    assert node == 2
    assert_allclose(along, [COS, SIN, 0])
    assert FRAME.geometry.locate("3:ux - 2:ux") is None


@pytest.mark.parametrize(
    ("dofs", "error", "message"),
    [
        ([{"2:ux": 0.0, "2:uy": 1.0}, "1:ux"], ValueError, "dofs: .*other than 0"),
        ([{"2:ux": "a"}, "1:ux"], TypeError, "dofs"),
        ([SKEW, SKEW_TEXT], ValueError, "dofs: expected distinct"),
    ],
)
def test_wrong_combinations_are_refused(dofs, error, message):
    with pytest.raises(error, match=message):
        ef.Measurements(HERTZ[:1], [[1.0], [2.0]], dofs=dofs)


def test_a_combination_of_dofs_that_do_not_exist_names_them():
    with pytest.raises(
        ValueError, match="'9:uy'.*did you mean|nodes with free DOFs are"
    ):
        ef.PairedModel(FRAME, measured({"2:ux": COS, "9:uy": SIN}))
    with pytest.raises(ValueError, match="each DOF once"):
        frame(shapes={"a": {"2:ux": 1.0, "2:-ux": 0.5}})
