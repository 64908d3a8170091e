import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.contracts import assert_shapes
from support.universal_file import LABELS, NODES, F, X, Y, Z, a_mode

from emcee_femu import Measurements

LEFT_OUT = r"zero in all modes.*\['4:z', '12:z', '7:z'\]"
HEADER_2414 = """\
    -1
  2414
         1
a mode
{location:10d}
NONE
NONE
NONE
NONE
NONE
         1{analysis:10d}         3{motion:10d}{data:10d}         6
         0         0         1         0         0         1         0         0
         0         0
  0.00000E+00{hertz:13.5E}  0.00000E+00  1.00000E+00{viscous:13.5E}{hysteretic:13.5E}
{real:13.5E}{imaginary:13.5E}  0.00000E+00  0.00000E+00  0.00000E+00  0.00000E+00
"""
ROWS = np.stack([X, Y], axis=1).reshape(6, 3)


@pytest.fixture
def pyuff():
    return pytest.importorskip("pyuff", reason='pip install "emcee_femu[uff]"')


@pytest.fixture
def write(pyuff, tmp_path):
    def write(*sets):
        path = tmp_path / "test.uff"
        pyuff.UFF(str(path)).write_sets(list(sets), "overwrite")
        return path

    return write


def test_normal_modes_among_other_data_sets(pyuff, write):
    millimetres = pyuff.prepare_164(
        units_code=5, length=1e3, force=1.0, temp=1.0, temp_offset=273.15
    )
    forced = a_mode(pyuff, 1, analysis_type=5, freq_step_n=1)
    modes = [a_mode(pyuff, i) for i in (1, 2, 3)]
    path = write(millimetres, modes[0], forced, *modes[1:])
    with pytest.warns(UserWarning, match=LEFT_OUT):
        m = Measurements.from_uff(path, dofs=range(6))
    assert m.sensors == LABELS and m.dofs.tolist() == [*range(6)]
    assert_allclose(m.frequencies, F, rtol=1e-5)  # the file has 6 digits
    assert_allclose(m.shapes, ROWS, rtol=1e-5)
    assert_array_equal(m.phase_collinearity, 1)
    assert m.sd is None and m.damping is None


@pytest.mark.parametrize("kind", [2, 3, 7])
def test_complex_modes(kind, pyuff, write):
    damping = np.array([0.02, 0.01, 0.3])  # 0.3: |lambda| is not its imaginary part
    eig = 2 * np.pi * np.array(F) * (-damping + 1j * np.sqrt(1 - damping**2))
    turn = np.exp(1j * np.array([0.4, 2.0, -1.0]))

    def mode(i):
        own = {"freq": F[i - 1]} if kind == 2 else {"freq": None, "eig": eig[i - 1]}
        return a_mode(pyuff, i, turn[i - 1], analysis_type=kind, **own)

    path = write(*(mode(i) for i in (1, 2, 3)))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        m = Measurements.from_uff(path)
    said = [str(warning.message) for warning in caught]
    assert re.search(LEFT_OUT, said[0])
    if kind == 2:  # the file states none
        assert m.damping is None and len(said) == 1
    else:
        assert_allclose(m.damping, damping, rtol=1e-4)
        assert "30 %" in said[1]
    assert_allclose(m.frequencies, F, rtol=2e-5)
    assert_allclose(m.phase_collinearity, 1, rtol=1e-9)
    assert_shapes(m.shapes, ROWS, atol=1e-5)


def test_damping_is_read_where_it_is_stated_and_is_half_the_hysteretic_one(
    pyuff, write
):
    viscous = a_mode(pyuff, 1, modal_damp_vis=0.02, modal_damp_his=0.05)
    hysteretic = a_mode(pyuff, 2, modal_damp_his=0.05)
    path = write(viscous, hysteretic, a_mode(pyuff, 3))
    found = Measurements.from_uff(path, sensors=["4:x", "7:y"])
    assert_allclose(found.damping, [0.02, 0.025, np.nan])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"node_nums": [4, 4, 7]}, r"data set 1: .*once, got \[4.0, 4.0, 7.0\]"),
        ({"analysis_type": 5, "freq_step_n": 1}, r"modes.*types \['55'\]"),
        (("2.50000e-01", "2.5000oe-01"), "test.uff, data set 1: .*got 'oe'"),
        (("         2         3\n", "         2         1\n"), "values each, got 1"),
        (("", ""), "ends inside data set 2"),
        ("no universal file\n", r"test.uff: expected modes.*types \[\]"),
        ({}, r"sensors: .*no \['5:x'\], only \['4:x'"),
    ],
)
def test_universal_files_are_refused_by_data_set(pyuff, write, change, message):
    own = change if isinstance(change, dict) else {}
    path = write(a_mode(pyuff, 1, **({"r1": np.full(3, 0.25)} | own)))
    text = path.read_text()
    if isinstance(change, str):
        path.write_text(change)
    elif isinstance(change, tuple):
        cut = text[: len(text) // 2] if change[0] == "" else ""
        path.write_text((text.replace(*change, 1) if change[0] else text) + cut)
    with pytest.raises(ValueError, match=message):
        Measurements.from_uff(path, sensors=["4:x", "5:x"])


@pytest.mark.filterwarnings("ignore:.*taken as not measured")
def test_one_bad_mode_does_not_spoil_the_others(pyuff, write):
    """A rigid-body mode, a damaged one: only what is asked for is read."""
    rigid = a_mode(pyuff, 1, freq=0.0)
    path = write(rigid, *(a_mode(pyuff, i, r1=X[:, i - 1] + 0.25) for i in (3, 2)))
    with pytest.raises(ValueError, match=r"data set 1: mode 1 .*modes=\[2, 3\]"):
        Measurements.from_uff(path)
    found = Measurements.from_uff(path, modes=[2, 3])
    assert_allclose(found.frequencies, F[1:], rtol=1e-5)
    assert_allclose(found.shapes[::2], X[:, 1:] + 0.25, rtol=1e-5)
    path.write_text(path.read_text().replace("e-01", "e-0l", 1))
    assert_allclose(Measurements.from_uff(path, modes=[3]).frequencies, 9.8)
    for wrong in ([], [2, 2], [4]):
        with pytest.raises(ValueError, match="modes: expected numbers from 1 to 3"):
            Measurements.from_uff(path, modes=wrong)


def test_a_node_that_a_mode_lacks_is_missing_in_it(pyuff, write):
    fewer = a_mode(pyuff, 2, node_nums=NODES[:2], r1=X[:2, 1], r2=Y[:2, 1], r3=Z[:2, 1])
    with pytest.warns(UserWarning, match=r"absent in some modes.*\['7:x', '7:y'\]"):
        found = Measurements.from_uff(write(a_mode(pyuff, 1), fewer))
    assert np.argwhere(np.isnan(found.shapes)).tolist() == [[4, 1], [5, 1]]


@pytest.mark.parametrize("analysis", [2, 3])
@pytest.mark.parametrize("narrow", [False, True])
def test_modes_of_six_directions_in_data_sets_2414(analysis, narrow, tmp_path):
    """Complex ones go over two lines; columns may be narrow, exponents Fortran's."""
    values = np.random.default_rng(3).normal(size=(2, 6))
    header = dict(
        location=1, motion=8, analysis=analysis, data=6 if analysis > 2 else 4
    )
    header |= dict(hertz=5.0, viscous=0.0, hysteretic=0.04)
    header |= dict(real=-1.0, imaginary=np.sqrt(99.0))  # |lambda| = 10, damping .1
    text = HEADER_2414.format(**header)
    for node, row in zip((12, 7), values, strict=True):
        numbers = np.stack([row, 0.5 * row], axis=1).ravel() if analysis > 2 else row
        cells = [f"{x:12.4E}" if narrow else f"{x:13.5E}" for x in numbers]
        rows = ["".join(cells[i : i + 6]) for i in range(0, len(cells), 6)]
        text += f"{node:10d}\n" + "\n".join(rows).replace("E", "D") + "\n"
    other = HEADER_2414.format(**(header | dict(motion=2))) + "         1\n"  # a stress
    path = tmp_path / "modes.unv"
    path.write_text(text + "    -1\n" + other + "    -1\n")
    found = Measurements.from_uff(path)
    assert found.sensors[:2] == ("12:x", "12:y") and found.sensors[-1] == "7:rz"
    assert_allclose(found.frequencies, 5.0 if analysis == 2 else 5 / np.pi, 1e-5)
    assert_allclose(found.damping, 0.02 if analysis == 2 else 0.1, 1e-5)
    shape = found.shapes[:, 0] / found.shapes[0, 0]
    assert_allclose(shape, values.ravel() / values[0, 0], rtol=2e-3)


def a_result(**changes):
    turn = np.exp(1j * np.array([0.01, -0.02, 0.0]))
    values = {"Fn": np.array(F), "Phi": X * turn, "Xi": np.array([0.01, 0.02, 0.01])}
    values |= {"Fn_std": np.array([3e-3, 5e-3, 0.01]), "Phi_std": np.full((3, 3), 0.02)}
    return SimpleNamespace(**(values | changes))


def test_a_result_of_pyoma2():
    m = Measurements.from_pyoma2(a_result(), sensors=[*"abc"], dofs=[2, 1, 0])
    assert_array_equal(m.frequencies, F)
    assert_array_equal(m.sd, [0.003, 0.005, 0.01])
    assert_allclose(m.shapes, X, rtol=0, atol=1e-12)
    assert_array_equal(m.damping, [0.01, 0.02, 0.01])
    assert m.damping_sd is None
    assert m.shape_sd is None and m.sensors == (*"abc",)
    assert m.dofs.tolist() == [2, 1, 0]
    m = Measurements.from_pyoma2(a_result(), shape_sd=True)
    assert_array_equal(m.shape_sd, 0.02)
    doubtful = a_result(Xi=[0.01, -0.02, np.nan], Xi_std=np.full(3, 1e-3))
    m = Measurements.from_pyoma2(doubtful)
    assert_array_equal(m.damping, [0.01, np.nan, np.nan])
    assert_array_equal(m.damping_sd, 1e-3)


def test_an_uncertainty_of_zero_from_pyoma2_has_a_cure():
    result = a_result(Fn_std=np.array([3e-3, 0.0, 0.01]))
    with pytest.raises(ValueError, match=r"Fn_std.*\[2\].*modes=\[1, 3\].*relative_sd"):
        Measurements.from_pyoma2(result)
    assert_array_equal(Measurements.from_pyoma2(result, modes=[1, 3]).sd, [3e-3, 0.01])
    result.Fn_std = result.Phi_std = None
    assert Measurements.from_pyoma2(result).sd is None


def test_modes_of_pyoma2_are_put_in_ascending_order_and_chosen():
    plain, order = a_result(Phi_std=np.abs(X) + 0.1), [2, 0, 1]
    fields = {key: value[..., order] for key, value in vars(plain).items()}
    fields["Fn"] = np.where(fields["Fn"] == F[1], np.nan, fields["Fn"])  # not found
    mixed = SimpleNamespace(**fields)
    with pytest.raises(ValueError, match=r"result.Fn: mode 3 .*modes=\[1, 2\]"):
        Measurements.from_pyoma2(mixed)
    m = Measurements.from_pyoma2(plain, shape_sd=True)
    n = Measurements.from_pyoma2(mixed, shape_sd=True, modes=[1, 2])
    for field in ("frequencies", "sd", "shapes", "shape_sd", "damping"):
        assert_array_equal(getattr(m, field)[..., [0, 2]], getattr(n, field))


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (a_result(Fn=None), "call mpe"),
        (a_result(Phi_std=None), "no Phi_std; .* calc_unc=True"),
        (a_result(Fn=np.array([3.1, 9.8])), r"shapes: expected \(n_sensors, 2\)"),
        (SimpleNamespace(result=a_result()), "algorithm.result, got SimpleNames"),
    ],
)
def test_a_result_of_pyoma2_that_is_not_complete_is_refused(result, message):
    with pytest.raises((TypeError, ValueError), match=message):
        Measurements.from_pyoma2(result, shape_sd=True)
