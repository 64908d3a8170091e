import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from support.universal_file import LABELS, NODES, F, X, Y, Z, a_mode

from emcee_femu import Measurements

LEFT_OUT = r"zero in all modes.*\['4:z', '12:z', '7:z'\]"
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
    np.testing.assert_allclose(m.frequencies, F, rtol=1e-5)  # the file has 6 digits
    np.testing.assert_allclose(m.shapes, ROWS, rtol=1e-5)
    np.testing.assert_array_equal(m.phase_collinearity, 1)
    assert m.sd is None and m.damping is None


def test_damping_of_normal_modes_is_read_where_it_is_stated(pyuff, write):
    given = {2: 0.012, 3: 0.034}
    modes = [a_mode(pyuff, i, modal_damp_vis=given.get(i, 0.0)) for i in (1, 2, 3)]
    with pytest.warns(UserWarning, match=LEFT_OUT):
        m = Measurements.from_uff(write(*modes))
    np.testing.assert_allclose(m.damping, [np.nan, 0.012, 0.034], rtol=1e-5)


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
        np.testing.assert_allclose(m.damping, damping, rtol=1e-4)
        assert "30 %" in said[1]
    np.testing.assert_allclose(m.frequencies, F, rtol=2e-5)
    np.testing.assert_allclose(m.phase_collinearity, 1, rtol=1e-9)
    signs = np.sign((m.shapes * ROWS).sum(axis=0))
    np.testing.assert_allclose(m.shapes * signs, ROWS, rtol=0, atol=1e-5)


def test_universal_files_are_refused_by_data_set(pyuff, write, tmp_path):
    forced = a_mode(pyuff, 1, analysis_type=5, freq_step_n=1)
    with pytest.raises(ValueError, match="1 data sets 55 and no mode among them"):
        Measurements.from_uff(write(forced))
    m = Measurements.from_uff(write(forced, a_mode(pyuff, 2)), sensors=["4:x"])
    assert m.n_modes == 1  # an operating deflection shape is no mode
    fewer = a_mode(pyuff, 2, node_nums=NODES[:2], r1=X[:2, 1], r2=Y[:2, 1], r3=Z[:2, 1])
    with pytest.raises(ValueError, match="data set 2: its nodes .* data set 1"):
        Measurements.from_uff(write(a_mode(pyuff, 1), fewer))
    with pytest.raises(ValueError, match=r"sensors: .*no \['5:x'\], only \['4:x'"):
        Measurements.from_uff(write(a_mode(pyuff, 1)), sensors=["4:x", "5:x"])
    with pytest.raises(ValueError, match=r"a node appears twice: \[4, 4, 7\]"):
        Measurements.from_uff(write(a_mode(pyuff, 1, node_nums=[4, 4, 7])))


def test_a_damaged_universal_file_is_refused(pyuff, write):
    path = write(a_mode(pyuff, 1, r1=np.full(3, 0.25)))
    text = path.read_text()
    path.write_text(text.replace("2.50000e-01", "2.5000oe-01", 1))
    with pytest.raises(ValueError, match="test.uff: pyuff cannot read it"):
        Measurements.from_uff(path)
    scalars = text.replace("         2         3\n", "         2         1\n")
    assert scalars != text
    path.write_text(scalars)
    with pytest.raises(ValueError, match="expected 3 or 6 values per node, got 1"):
        Measurements.from_uff(path)
    path.write_text("no universal file\n")
    with pytest.raises(ValueError, match="0 data sets 55"):
        Measurements.from_uff(path)


# pyOMA2; its real results are tested by the example


def a_result(**changes):
    turn = np.exp(1j * np.array([0.01, -0.02, 0.0]))
    values = {"Fn": np.array(F), "Phi": X * turn, "Xi": np.array([0.01, 0.02, 0.01])}
    values |= {"Fn_std": np.array([3e-3, 5e-3, 0.01]), "Phi_std": np.full((3, 3), 0.02)}
    return SimpleNamespace(**(values | changes))


def test_a_result_of_pyoma2():
    m = Measurements.from_pyoma2(a_result(), sensors=[*"abc"], dofs=[2, 1, 0])
    np.testing.assert_array_equal(m.frequencies, F)
    np.testing.assert_array_equal(m.sd, [0.003, 0.005, 0.01])
    np.testing.assert_allclose(m.shapes, X, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(m.damping, [0.01, 0.02, 0.01])
    assert m.damping_sd is None
    assert m.shape_sd is None and m.sensors == (*"abc",)
    assert m.dofs.tolist() == [2, 1, 0]
    m = Measurements.from_pyoma2(a_result(), shape_sd=True)
    np.testing.assert_array_equal(m.shape_sd, 0.02)
    doubtful = a_result(Xi=[0.01, -0.02, np.nan], Xi_std=np.full(3, 1e-3))
    m = Measurements.from_pyoma2(doubtful)
    np.testing.assert_array_equal(m.damping, [0.01, np.nan, np.nan])
    np.testing.assert_array_equal(m.damping_sd, 1e-3)


def test_the_modes_of_pyoma2_are_put_in_ascending_order():
    plain = a_result(Phi_std=np.abs(X) + 0.1)
    order = [2, 0, 1]
    fields = {key: value[..., order] for key, value in vars(plain).items()}
    m, n = (
        Measurements.from_pyoma2(result, shape_sd=True)
        for result in (plain, SimpleNamespace(**fields))
    )
    for field in ("frequencies", "sd", "shapes", "shape_sd", "damping"):
        np.testing.assert_array_equal(getattr(m, field), getattr(n, field))


def test_a_result_of_pyoma2_that_is_not_complete_is_refused():
    with pytest.raises(ValueError, match="no modes yet; call mpe"):
        Measurements.from_pyoma2(a_result(Fn=None))
    with pytest.raises(ValueError, match="no Phi_std; run .* calc_unc=True"):
        Measurements.from_pyoma2(a_result(Phi_std=None), shape_sd=True)
    with pytest.raises(ValueError, match=r"shapes: expected \(n_sensors, 2\)"):
        Measurements.from_pyoma2(a_result(Fn=np.array([3.1, 9.8])))
    with pytest.raises(TypeError, match=r"such as algorithm.result, got SimpleNames"):
        Measurements.from_pyoma2(SimpleNamespace(result=a_result()))
