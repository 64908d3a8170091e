import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.contracts import assert_shapes

from emcee_femu import Measurements

RNG = np.random.default_rng(20)
F = [3.1, 9.8, 20.4]
SHAPES = np.array([[0.3, -0.8, 1.0], [0.7, -0.2, -0.9], [1.0, 1.0, 0.4], [1.1, 0.5, 0]])
COVARIANCE = np.array([[4e-4, 1e-4, 0.0], [1e-4, 9e-4, 2e-4], [0.0, 2e-4, 1e-3]])


def test_modes_of_low_collinearity_are_named_in_a_warning():
    shapes = np.array([[1.0, 1.0, 1.0], [2.0, 0.2j, 1j], [-1.0, 0.5, -1.0]])
    expected = np.array([1, (1.21 / 1.29) ** 2, 1 / 9])
    with pytest.warns(UserWarning, match=r"for mode 2 \(MPC 0.88\), 3 \(MPC 0.11\);"):
        m = Measurements(F, shapes=shapes)
    assert_allclose(m.phase_collinearity, expected, rtol=1e-12)
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
    assert_shapes(backwards.shapes, plain.shapes, atol=1e-12)
    places = ["floor:-1", "b", "c", "d"]  # a storey is no direction
    assert Measurements(F, SHAPES, dofs=places).dofs.tolist() == places


@pytest.mark.parametrize("known", ["sd", "damping", "damping_sd"])
def test_what_is_known_of_some_modes_only_can_be_given(known):
    given = {"damping": [0.01, 0.01]} if known == "damping_sd" else {}
    for unknown in (None, np.nan):
        m = Measurements([3.0, 9.0], **(given | {known: [0.02, unknown]}))
        assert_array_equal(getattr(m, known), [0.02, np.nan])
    none = Measurements([3.0, 9.0], **(given | {known: [None, None]}))
    assert getattr(none, known) is None
    with pytest.raises(ValueError, match=f"{known}: .* mode 2 has -1"):
        Measurements([3.0, 9.0], **(given | {known: [0.02, -1.0]}))


@pytest.mark.filterwarnings("ignore:shapes. phase collinearity")
@pytest.mark.parametrize("scatter", [0.02, 0.3, 1.0])
def test_the_real_part_is_the_largest_and_collinearity_the_flatness(scatter):
    shapes, *noise = RNG.standard_normal((3, 5, 3))
    shapes = shapes + scatter * (noise[0] + 1j * noise[1])
    shapes = shapes * np.exp(2j * np.pi * RNG.random(3)) * [1e-17, 2.5, 1e17]
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
        (F, {"shapes": SHAPES * [1, 0, 1]}, "mode 2 is zero, .* at all sensors"),
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
    assert_array_equal(m.covariance, m.covariance.T)
    assert_allclose(m.covariance, COVARIANCE, rtol=1e-9)
    with pytest.warns(UserWarning, match="damping: .* 110 %"):
        Measurements([3.0, 9.0], damping=[0.8, 1.1])


def test_the_table_shows_the_standard_deviations_of_a_covariance():
    m = Measurements(F, covariance=COVARIANCE, shapes=SHAPES)
    frame = m.to_frame()
    assert [*frame.columns] == ["mode", "f [Hz]", "sd [Hz]", "MPC"]
    assert_array_equal(frame["sd [Hz]"], np.sqrt(np.diag(COVARIANCE)))
    assert "0.032" in str(m) and "<td>0.032</td>" in m._repr_html_()


UNIT = SHAPES / np.linalg.norm(SHAPES, axis=0)


def campaign(n):
    return RNG.multivariate_normal(F, COVARIANCE, n)


@pytest.mark.parametrize("kind", ["real", "complex"])
def test_sign_phase_and_scale_of_a_test_do_not_matter(kind):
    noisy = SHAPES + 0.05 * RNG.standard_normal((6, 4, 3))
    factors = 10.0 ** RNG.uniform(-3, 3, (6, 1, 3)) * RNG.choice([-1, 1], (6, 1, 3))
    if kind == "complex":
        noisy = noisy + 0.03j * RNG.standard_normal((6, 4, 3))
        factors = factors * np.exp(2j * np.pi * RNG.random((6, 1, 3)))
    f = campaign(6)
    plain = Measurements.from_repeats(f, noisy)
    turned = Measurements.from_repeats(f, noisy * factors)
    assert_shapes(turned.shapes, plain.shapes, atol=1e-12)
    assert_allclose(turned.shape_sd, plain.shape_sd, rtol=1e-10)
    assert_allclose(turned.phase_collinearity, plain.phase_collinearity, rtol=1e-10)
    assert (turned.phase_collinearity < 1).all() == (kind == "complex")


def test_mean_and_scatter_are_those_of_the_tests_that_found_a_mode():
    f, shapes = campaign(6), SHAPES + 0.05 * RNG.standard_normal((6, 4, 3))
    f[[1, 4], 1] = np.nan
    shapes[1, :, 1], shapes[4, :, 1] = np.nan, 0.0
    found = Measurements.from_repeats(f, shapes, correlated=False)
    kept = [0, 2, 3, 5]
    fewer = Measurements.from_repeats(f[kept], shapes[kept], correlated=False)
    assert_allclose(found.frequencies[1], fewer.frequencies[1], rtol=1e-14)
    assert_allclose(found.sd[1], fewer.sd[1], rtol=1e-12)
    assert_allclose(found.shape_sd[:, 1], fewer.shape_sd[:, 1], rtol=1e-9)
    assert_shapes(found.shapes[:, [1]], fewer.shapes[:, [1]], rtol=1e-9)
    assert_allclose(found.sd[0], f[:, 0].std(ddof=1), rtol=1e-12)


def test_mean_and_sample_covariance_are_those_of_the_definition():
    f = campaign(7)
    m = Measurements.from_repeats(f)
    assert_allclose(m.frequencies, f.sum(axis=0) / 7, rtol=1e-12)
    deviations = f - m.frequencies
    expected = np.einsum("ti,tj->ij", deviations, deviations) / 6
    assert_allclose(m.covariance, expected, rtol=1e-12)
    assert m.sd is None


def test_the_real_part_is_taken_at_the_phase_of_the_mean():
    # The first sensor lags by 0.6 rad, so that no sensor's phase is that of the shape,
    # and the noise is almost all across it: the wrong phase would let it in.
    shape = UNIT[:, 0] * np.exp(1j * np.array([0.6, 0.0, -0.1, 0.0]))
    noise = (0.001 + 0.02j) * RNG.standard_normal((200, 4))
    noise[0] = 0.2j  # the phase is not that of any one test
    turn = np.exp(2j * np.pi * RNG.random((200, 1)))
    shapes = ((shape + noise) * turn)[:, :, None]
    m = Measurements.from_repeats(campaign(200)[:, :1], shapes)

    unit = shapes[:, :, 0] / np.linalg.norm(shapes[:, :, 0], axis=1)[:, None]
    reference = np.linalg.eigh(unit.T @ unit.conj())[1][:, -1]
    aligned = unit * np.exp(-1j * np.angle(unit @ reference.conj()))[:, None]
    mean = aligned.mean(axis=0)
    phases = np.exp(1j * np.linspace(0, np.pi, 20_001))
    best = phases[((mean[:, None] * phases).real ** 2).sum(axis=0).argmax()]
    sd = (aligned * best).real.std(axis=0, ddof=1)
    assert_allclose(m.shape_sd[:, 0], sd, rtol=1e-3)
    assert_allclose(np.abs(m.shapes[:, 0]), np.abs((mean * best).real), 1e-3)


GOOD, REPEATS = campaign(5), SHAPES + 0.01 * RNG.standard_normal((5, 4, 3))
SWAPPED = np.where(np.arange(5)[:, None, None] == 3, REPEATS[:, :, [0, 2, 1]], REPEATS)


@pytest.mark.parametrize(
    ("frequencies", "shapes", "correlated", "message"),
    [
        (GOOD[:3], None, True, "3 tests .* covariance of 3.*correlated=F"),
        (GOOD * [1, 0, 1] + [0, 9.8, 0], None, True, "mode 2 is 9.8 Hz in all tests"),
        (GOOD, REPEATS[:4], True, r"shapes: expected \(5 tests"),
        (GOOD, SWAPPED, True, r"mode 2 of test 4 has a MAC of 0.\d+"),
        ([[3.1, 9.8], [3.2, np.nan], [3.1, 9.7]], None, True, "test 2 .*correlated=F"),
        ([[3.1, 9.8], [3.2, np.nan]], None, False, "mode 2 was found by 1 of 2"),
        ([[3.1, 9.8], [3.2], [3.1, 9.7]], None, False, r"\[2, 1, 2\].* nan"),
        ([[3.1, 9.8], [3.2, np.inf]], None, False, "frequencies: .*finite"),
    ],
)
def test_what_the_tests_lack_is_named(frequencies, shapes, correlated, message):
    with pytest.raises(ValueError, match=message):
        Measurements.from_repeats(frequencies, shapes, correlated=correlated)


MIXED = ["1:ux", "2:ux", "3:uy", "2:rx", "3:rz"]
IN_MILLIMETRES = np.array([1e3, 1e3, 1e3, 1.0, 1.0])[:, None]


def test_the_collinearity_of_phases_does_not_depend_on_the_unit_of_length():
    rng = np.random.default_rng(3)
    shapes = rng.normal(size=(5, 2)) + 0.1j * rng.normal(size=(5, 2))
    both = [
        Measurements([1.0, 2.0], factor * shapes, dofs=MIXED)
        for factor in (1.0, IN_MILLIMETRES)
    ]
    metres, millimetres = both
    assert_allclose(metres.phase_collinearity, millimetres.phase_collinearity)
    assert_allclose(IN_MILLIMETRES * metres.shapes, millimetres.shapes)


def test_the_scatter_of_repeats_does_not_depend_on_the_unit_of_length():
    rng = np.random.default_rng(3)
    tests = rng.normal(size=(5, 2)) + 0.05 * rng.normal(size=(6, 5, 2))
    tests[:, 3:] = 20.0 * rng.normal(size=(6, 2, 2))  # rotations that tell nothing
    hertz = [1.0, 2.0] + 0.01 * rng.normal(size=(6, 2))
    metres, millimetres = (
        Measurements.from_repeats(hertz, factor * tests, dofs=MIXED)
        for factor in (1.0, IN_MILLIMETRES)
    )
    for scatter in ("shapes", "shape_sd"):
        first, second = getattr(metres, scatter), getattr(millimetres, scatter)
        assert_allclose(IN_MILLIMETRES * first, 1e3 * second, rtol=1e-9)


def test_sensors_at_labelled_dofs_have_the_names_of_these():
    shapes = np.array([[1.0], [0.5]])
    measured = Measurements([3.0], shapes=shapes, dofs=["2:ux", "3:-uy"])
    assert measured.sensors == ("2:ux", "3:uy")
    named = Measurements(
        [3.0], shapes=shapes, dofs=["2:ux", "3:uy"], sensors=["a", "b"]
    )
    assert named.sensors == ("a", "b")
    assert Measurements([3.0], shapes=shapes, dofs=[4, 2]).sensors == ("s1", "s2")


def test_a_mac_compares_translations_at_all_sensors_there_are():
    """By a mode that only turns, rotations are compared; without shapes, nothing."""
    assert Measurements(F).compared.shape == (len(Measurements(F).sensors), len(F))
    assert_array_equal(Measurements(F, shapes=SHAPES).compared, SHAPES)
    turning = np.array([[1.0, 0.0], [0.5, 0.0], [0.2, 1.0]])
    test = Measurements([3, 9], shapes=turning, dofs=["1:x", "2:y", "2:rz"])
    expected = [[1.0, np.nan], [0.5, np.nan], [np.nan, 1.0]]
    assert_array_equal(test.compared, expected)
