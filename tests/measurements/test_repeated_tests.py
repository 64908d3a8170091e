import numpy as np
import pytest

from emcee_femu import Measurements

RNG = np.random.default_rng(21)
F = np.array([3.1, 9.8, 20.4])
COVARIANCE = np.array([[4e-4, 1e-4, 0.0], [1e-4, 9e-4, 2e-4], [0.0, 2e-4, 1e-3]])
SHAPES = np.array([[0.3, -0.8, 1.0], [0.7, -0.2, -0.9], [1.0, 1.0, 0.4], [1.1, 0.5, 0]])
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
    signs = np.sign((plain.shapes * turned.shapes).sum(axis=0))
    np.testing.assert_allclose(turned.shapes * signs, plain.shapes, rtol=0, atol=1e-12)
    np.testing.assert_allclose(turned.shape_sd, plain.shape_sd, rtol=1e-10)
    np.testing.assert_allclose(
        turned.phase_collinearity, plain.phase_collinearity, rtol=1e-10
    )
    assert (turned.phase_collinearity < 1).all() == (kind == "complex")


def test_mean_and_scatter_are_those_of_the_tests_that_found_a_mode():
    f, shapes = campaign(6), SHAPES + 0.05 * RNG.standard_normal((6, 4, 3))
    f[[1, 4], 1] = np.nan
    shapes[1, :, 1], shapes[4, :, 1] = np.nan, 0.0
    found = Measurements.from_repeats(f, shapes, correlated=False)
    kept = [0, 2, 3, 5]
    fewer = Measurements.from_repeats(f[kept], shapes[kept], correlated=False)
    np.testing.assert_allclose(found.frequencies[1], fewer.frequencies[1], rtol=1e-14)
    np.testing.assert_allclose(found.sd[1], fewer.sd[1], rtol=1e-12)
    np.testing.assert_allclose(found.shape_sd[:, 1], fewer.shape_sd[:, 1], rtol=1e-9)
    side = np.sign(found.shapes[0, 1] * fewer.shapes[0, 1])
    np.testing.assert_allclose(side * found.shapes[:, 1], fewer.shapes[:, 1], rtol=1e-9)
    np.testing.assert_allclose(found.sd[0], f[:, 0].std(ddof=1), rtol=1e-12)


def test_mean_and_sample_covariance_are_those_of_the_definition():
    f = campaign(7)
    m = Measurements.from_repeats(f)
    np.testing.assert_allclose(m.frequencies, f.sum(axis=0) / 7, rtol=1e-12)
    deviations = f - m.frequencies
    expected = np.einsum("ti,tj->ij", deviations, deviations) / 6
    np.testing.assert_allclose(m.covariance, expected, rtol=1e-12)
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
    np.testing.assert_allclose(m.shape_sd[:, 0], sd, rtol=1e-3)
    np.testing.assert_allclose(np.abs(m.shapes[:, 0]), np.abs((mean * best).real), 1e-3)


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
