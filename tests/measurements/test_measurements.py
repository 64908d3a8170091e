import numpy as np
import pytest

from emcee_femu import Measurements

RNG = np.random.default_rng(20)
F = [3.1, 9.8, 20.4]
SHAPES = np.array([[0.3, -0.8, 1.0], [0.7, -0.2, -0.9], [1.0, 1.0, 0.4], [1.1, 0.5, 0]])
COVARIANCE = np.array([[4e-4, 1e-4, 0.0], [1e-4, 9e-4, 2e-4], [0.0, 2e-4, 1e-3]])


def complex_shapes(n_sensors=5, n_modes=3, scatter=0.1):
    noise = RNG.standard_normal((2, n_sensors, n_modes))
    shapes = RNG.standard_normal((n_sensors, n_modes))
    turn = np.exp(2j * np.pi * RNG.random(n_modes))
    return (shapes + scatter * (noise[0] + 1j * noise[1])) * turn


def test_modes_of_low_collinearity_are_named_in_a_warning():
    shapes = np.array([[1.0, 1.0, 1.0], [2.0, 0.2j, 1j], [-1.0, 0.5, -1.0]])
    expected = np.array([1, (1.21 / 1.29) ** 2, 1 / 9])
    with pytest.warns(UserWarning, match=r"for mode 2 \(MPC 0.88\), 3 \(MPC 0.11\);"):
        m = Measurements(F, shapes=shapes)
    np.testing.assert_allclose(m.phase_collinearity, expected, rtol=1e-12)
    with pytest.warns(UserWarning, match=r"for mode 3 \(MPC 0.50\);"):
        Measurements(F, shapes=SHAPES, phase_collinearity=[1.0, 0.9, 0.5])


@pytest.mark.parametrize("turn", [1.0, np.exp(0.7j)])
def test_a_sensor_that_points_backwards_is_turned(turn):
    """Whatever the sign of its axis, the motion along it is the same."""
    dofs, signs = ["1:ux", "2:uy", "3:z", "4:rx"], np.array([1, -1, 1, -1])[:, None]
    signed = ["1:+ux", "2:-uy", "3:z", "4:-rx"]
    plain = Measurements(F, SHAPES * turn, dofs=dofs)
    backwards = Measurements(F, signs * SHAPES * turn, dofs=signed)
    assert backwards.dofs.tolist() == dofs
    side = np.sign((plain.shapes * backwards.shapes).sum(axis=0))
    np.testing.assert_allclose(side * backwards.shapes, plain.shapes, atol=1e-12)
    places = ["floor:-1", "b", "c", "d"]  # a storey is no direction
    assert Measurements(F, SHAPES, dofs=places).dofs.tolist() == places


@pytest.mark.parametrize("known", ["sd", "damping", "damping_sd"])
def test_what_is_known_of_some_modes_only_can_be_given(known):
    given = {"damping": [0.01, 0.01]} if known == "damping_sd" else {}
    for unknown in (None, np.nan):
        m = Measurements([3.0, 9.0], **(given | {known: [0.02, unknown]}))
        np.testing.assert_array_equal(getattr(m, known), [0.02, np.nan])
    none = Measurements([3.0, 9.0], **(given | {known: [None, None]}))
    assert getattr(none, known) is None
    with pytest.raises(ValueError, match=f"{known}: .* mode 2 has -1"):
        Measurements([3.0, 9.0], **(given | {known: [0.02, -1.0]}))


@pytest.mark.filterwarnings("ignore:shapes. phase collinearity")
@pytest.mark.parametrize("scatter", [0.02, 0.3, 1.0])
def test_the_real_part_is_the_largest_and_collinearity_the_flatness(scatter):
    shapes = complex_shapes(scatter=scatter) * [1e-17, 2.5, 1e17]  # of any scale
    m = Measurements(F, shapes=shapes)
    for column, real, value in zip(
        shapes.T, m.shapes.T, m.phase_collinearity, strict=True
    ):
        plane = np.array([column.real, column.imag])
        low, high = np.linalg.eigvalsh(plane @ plane.T)  # over all phases
        assert real @ real == pytest.approx(high, rel=1e-10)
        assert value == pytest.approx(((high - low) / (high + low)) ** 2, rel=1e-10)
        own = abs(np.vdot(column, column.conj())) ** 2 / np.vdot(column, column) ** 2
        assert value == pytest.approx(own.real, rel=1e-12)  # the MAC with its conjugate


TWICE = np.column_stack([SHAPES, -1.7 * SHAPES[:, 2] + 0.01])


@pytest.mark.parametrize(
    ("frequencies", "options", "message"),
    [
        ([3.1, 0.0, 9.8], {}, "mode 2 has 0.0"),
        ([3.1, 20.4, 9.8], {}, r"mode 3 \(9.8 Hz\) is below mode 2"),
        (F, {"covariance": np.triu(COVARIANCE)}, "covariance: .*symmetric"),
        (F, {"shapes": SHAPES.T}, r"shapes: .*got \(3, 4\)"),
        (F, {"shapes": SHAPES * [1, 0, 1]}, "mode 2 is zero at all sensors"),
        (F, {"shapes": SHAPES, "dofs": [0, 1, 2, 2]}, "dofs: .*distinct"),
        (F, {"shapes": SHAPES, "dofs": ["1:x", "1:-x", "2", "3"]}, "dofs: .*distinct"),
        (F, {"shapes": 1j * SHAPES, "phase_collinearity": F}, "complex shapes"),
        ([*F, 20.41], {"shapes": TWICE}, "modes 3 and 4 .*20.41 Hz.*MAC"),
    ],
)
def test_what_cannot_be_measured_is_refused_by_mode(frequencies, options, message):
    with pytest.raises(ValueError, match=message):
        Measurements(frequencies, **options)


def test_what_is_only_unusual_is_measured():
    Measurements([*F, 20.6], shapes=TWICE)  # 1 % apart: close modes of a few sensors
    Measurements([*F, 20.4], shapes=np.column_stack([SHAPES, [0.4, 0.9, -1.0, 0.2]]))
    Measurements([3.0, 3.0], [[1.0, -2.0]])  # one sensor cannot tell
    printed = COVARIANCE * (1 + 1e-10 * RNG.standard_normal((3, 3)))
    m = Measurements(F, covariance=printed)
    np.testing.assert_array_equal(m.covariance, m.covariance.T)
    np.testing.assert_allclose(m.covariance, COVARIANCE, rtol=1e-9)
    with pytest.warns(UserWarning, match="damping: .* 110 %"):
        Measurements([3.0, 9.0], damping=[0.8, 1.1])


def test_the_table_shows_the_standard_deviations_of_a_covariance():
    m = Measurements(F, covariance=COVARIANCE, shapes=SHAPES)
    frame = m.to_frame()
    assert [*frame.columns] == ["mode", "f [Hz]", "sd [Hz]", "MPC"]
    np.testing.assert_array_equal(frame["sd [Hz]"], np.sqrt(np.diag(COVARIANCE)))
    assert "0.0316" in str(m) and "<td>0.0316</td>" in m._repr_html_()
