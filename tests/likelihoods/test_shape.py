"""Mode shapes against scipy.stats, formulas and the normalisation on the sphere."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import integrate, special, stats
from support.contracts import assert_term

import emcee_femu as ef

RNG = np.random.default_rng(0)
MEASURED = RNG.normal(size=(7, 3))
SHAPES = MEASURED + 0.05 * RNG.normal(size=(20, 7, 3))
MODES = {"shapes": SHAPES}
MORE = {"shapes": np.dstack([SHAPES, RNG.normal(size=(20, 7))])}  # one not measured
TRIED = np.linspace(0.01, 0.2, 20)
GAPS = MEASURED.copy()  # the first sensor is missing in a mode, two in another
GAPS[0, 0] = GAPS[2, 1] = GAPS[5, 1] = np.nan


def mac(measured, shapes):
    """Return modal assurance criteria ``(..., n_modes)``, mode by mode."""
    products = (measured * shapes).sum(axis=-2) ** 2
    return products / ((measured**2).sum(axis=-2) * (shapes**2).sum(axis=-2))


@pytest.mark.parametrize("delta", [0.05, [0.03, 0.05, 0.1], "inferred"])
def test_the_mac_form_is_its_formula(delta):
    options, parameters, value = {"delta": delta}, {}, delta
    if delta == "inferred":
        options, parameters = {"discrepancy": "delta"}, {"delta": TRIED}
        value = TRIED[:, None]
    squares = np.square(value)
    expected = -(1 - mac(MEASURED, SHAPES)) / (2 * squares)
    expected = (expected - 6 / 2 * np.log(2 * np.pi * squares)).sum(axis=1)
    term = ef.ShapeTerm(MEASURED, **options)
    assert term.names == tuple(parameters)
    for modes in (MODES, MORE):
        assert_allclose(term(parameters, modes), expected, rtol=1e-12)
    assert_term(term, parameters, MODES, expected)


@pytest.mark.parametrize(
    "sd",
    [0.05, [0.1, 0.2, 0.4], [[0.1]] * 3 + [[0.3]] * 4, 0.02 + 0.1 * RNG.random((7, 3))],
    ids=["one", "by mode", "by sensor", "each"],
)
def test_the_sensor_form_is_a_normal_density_about_the_scaled_shape(sd):
    weights = np.broadcast_to(sd, (7, 3)) ** -2.0
    gamma = (weights * MEASURED * SHAPES).sum(1) / (weights * SHAPES**2).sum(1)
    fit = stats.norm.logpdf(MEASURED, gamma[:, None] * SHAPES, weights**-0.5)
    term = ef.ShapeTerm(MEASURED, sd=sd)
    for modes in (MODES, MORE):
        assert_allclose(term({}, modes), fit.sum(axis=(1, 2)), rtol=1e-11)
    assert_term(term, {}, MODES, fit.sum(axis=(1, 2)))


@pytest.mark.parametrize("n_sensors", [2, 3, 4])
def test_the_density_of_measured_directions_integrates_to_one(n_sensors):
    # Over the half sphere of directions, at colatitude t from the model's shape:
    # the ring there has the area of the (n-2)-sphere times sin(t)^(n-2).
    half = (n_sensors - 1) / 2
    ring = 2 * np.pi**half / special.gamma(half)
    model = {"shapes": np.eye(n_sensors)[None, :, :1]}

    def density(t):
        direction = np.zeros((n_sensors, 1))
        direction[:2, 0] = np.cos(t), np.sin(t)
        value = np.exp(ef.ShapeTerm(direction, delta=0.02)({}, model)[0])
        return value * ring * np.sin(t) ** (n_sensors - 2)

    total = integrate.quad(density, 0, np.pi / 2, points=[0.02, 0.06, 0.15])[0]
    assert abs(total - 1) < 2e-3  # curvature of the sphere: of the order delta^2


def test_a_mac_keeps_its_digits_close_to_one_and_is_zero_without_motion():
    nudge = np.zeros((7, 1))
    nudge[2] = 1e-9
    first, delta = MEASURED[:, :1], 1e-9
    gap = 1e-18 * (1 - first[2] ** 2 / (first**2).sum()) / (first**2).sum()
    term = ef.ShapeTerm(first, delta=delta)({}, {"shapes": (first + nudge)[None]})[0]
    constant = -3 * np.log(2 * np.pi * delta**2)
    assert_allclose(term - constant, -gap[0] / (2 * delta**2), rtol=1e-5)
    still = ef.ShapeTerm(first, delta=0.1)({}, {"shapes": np.zeros((1, 7, 1))})[0]
    assert_allclose(still, -1 / 0.02 - 3 * np.log(2 * np.pi * 0.01))


@pytest.mark.parametrize("name", ["delta", "sd"])
def test_a_missing_sensor_drops_out_of_its_mode_alone(name):
    values = {"delta": [0.03, 0.05, 0.1], "sd": 0.02 + RNG.random((7, 3))}[name]
    expected = 0.0
    for mode in range(3):
        at = ~np.isnan(GAPS[:, mode])
        own = values[mode] if name == "delta" else values[at, mode][:, None]
        term = ef.ShapeTerm(GAPS[at, mode][:, None], **{name: own})
        expected = expected + term({}, {"shapes": SHAPES[:, at][:, :, [mode]]})
    term = ef.ShapeTerm(GAPS, **{name: values})
    assert_term(term, {}, MODES, expected)
    assert_allclose(term({}, MODES), expected, rtol=1e-12)
    with pytest.raises(ValueError, match="at least two sensors"):
        ef.ShapeTerm(np.where(np.arange(7)[:, None] < 6, np.nan, GAPS), delta=0.1)


def test_modes_with_missing_sensors_are_paired_and_counted_one_by_one():
    sd = 0.1 + RNG.random(GAPS.shape)
    test = ef.Measurements([1.0, 2.0, 3.0], GAPS, shape_sd=sd)
    names = {"frequency": np.tile([1.0, 2.0, 3.0], (20, 1)), "shapes": SHAPES}
    paired = ef.PairedModel(lambda p: names, test, candidates=3)({})
    known = ef.ShapeTerm(test)
    assert_array_equal(known({}, paired), ef.ShapeTerm(GAPS, sd=sd)({}, paired))
    at = ~np.isnan(GAPS)
    assert_allclose(paired.mac, mac(np.nan_to_num(GAPS), SHAPES * at), rtol=1e-12)
    term, delta = ef.ShapeTerm(GAPS, discrepancy="delta"), {"delta": TRIED}
    each = term.pointwise(delta, {"mac": paired.mac})["mac"]
    assert_allclose(each.sum(axis=1), term(delta, paired), rtol=1e-11)
