"""Mode shapes against scipy.stats, quadrature and the normalisation on the sphere."""

import numpy as np
import pytest
from scipy import integrate, special, stats

import emcee_femu as ef
from emcee_femu import Measurements, ModalSolution, PairedModel, ShapeTerm
from emcee_femu.models.pairing import mac

RNG = np.random.default_rng(0)
MEASURED = RNG.normal(size=(7, 3))
SHAPES = MEASURED + 0.05 * RNG.normal(size=(20, 7, 3))
MODES = ModalSolution(np.tile([1.0, 2.0, 3.0], (20, 1)), SHAPES)


def test_the_mac_form_is_its_formula():
    delta = np.array([0.03, 0.05, 0.1])
    values = np.diagonal(mac(MEASURED, SHAPES), axis1=1, axis2=2)
    expected = -(1 - values) / (2 * delta**2) - 6 / 2 * np.log(2 * np.pi * delta**2)
    term = ShapeTerm(MEASURED, delta=delta)
    np.testing.assert_allclose(term({}, MODES), expected.sum(axis=1), rtol=1e-12)


@pytest.mark.parametrize("sd", [[0.1, 0.2, 0.4], [[0.1]] * 3 + [[0.3]] * 4])
def test_deviations_by_mode_or_by_sensor_and_modes_that_were_not_measured(sd):
    more = ModalSolution(
        np.ones((20, 4)), np.dstack([SHAPES, RNG.normal(size=(20, 7))])
    )
    weights = np.broadcast_to(sd, (7, 3)) ** -2.0
    gamma = (weights * MEASURED * SHAPES).sum(1) / (weights * SHAPES**2).sum(1)
    fit = stats.norm.logpdf(MEASURED, gamma[:, None] * SHAPES, weights**-0.5)
    for modes in (MODES, more):
        found = ShapeTerm(MEASURED, sd=sd)({}, modes)
        np.testing.assert_allclose(found, fit.sum(axis=(1, 2)), rtol=1e-12)
    delta = ShapeTerm(MEASURED, delta=0.1)
    np.testing.assert_array_equal(delta({}, more), delta({}, MODES))


def test_an_inferred_delta_is_the_number_of_that_value():
    term = ShapeTerm(MEASURED, discrepancy="delta")
    assert term.names == ("delta",)
    values = np.linspace(0.01, 0.2, 20)
    inferred = term({"delta": values}, MODES)
    for row, value in enumerate(values):
        fixed = ShapeTerm(MEASURED, delta=value)({}, MODES)[row]
        np.testing.assert_allclose(inferred[row], fixed, rtol=1e-13)


@pytest.mark.parametrize("n_sensors", [2, 3, 4])
def test_the_density_of_measured_directions_integrates_to_one(n_sensors):
    # Over the half sphere of directions, at colatitude t from the model's shape:
    # the ring there has the area of the (n-2)-sphere times sin(t)^(n-2).
    half = (n_sensors - 1) / 2
    ring = 2 * np.pi**half / special.gamma(half)
    model = ModalSolution(np.ones((1, 1)), np.eye(n_sensors)[None, :, :1])

    def density(t):
        direction = np.zeros((n_sensors, 1))
        direction[:2, 0] = np.cos(t), np.sin(t)
        value = np.exp(ShapeTerm(direction, delta=0.02)({}, model)[0])
        return value * ring * np.sin(t) ** (n_sensors - 2)

    total = integrate.quad(density, 0, np.pi / 2, points=[0.02, 0.06, 0.15])[0]
    assert abs(total - 1) < 2e-3  # curvature of the sphere: of the order delta^2


def test_the_noise_of_unit_shapes_has_the_deviation_delta():
    # Shapes of unit length plus noise: delta found by maximum likelihood is the noise.
    rng, delta, n_sensors = np.random.default_rng(1), 0.03, 10
    truth = np.linalg.qr(rng.normal(size=(n_sensors, n_sensors)))[0]
    noisy = np.hstack([truth + delta * rng.normal(size=truth.shape) for _ in range(40)])
    model = ModalSolution(np.ones((1, 400)), np.hstack([truth] * 40)[None])
    trial = np.linspace(0.8, 1.2, 81) * delta
    total = [ShapeTerm(noisy, delta=d)({}, model)[0] for d in trial]
    found = trial[int(np.argmax(total))]
    assert abs(found / delta - 1) < 4 / np.sqrt(2 * 400 * (n_sensors - 1)) + 0.005


def test_the_sensor_form_is_a_normal_density_about_the_scaled_shape():
    sd = 0.02 + 0.1 * RNG.random((7, 3))
    term = ShapeTerm(MEASURED, sd=sd)
    found = term({}, MODES)
    for row in range(3):
        total = 0.0
        for mode in range(3):
            phi, measured, s = SHAPES[row, :, mode], MEASURED[:, mode], sd[:, mode]
            gamma = np.linalg.lstsq((phi / s)[:, None], measured / s)[0][0]
            total += stats.norm(gamma * phi, s).logpdf(measured).sum()
        np.testing.assert_allclose(found[row], total, rtol=1e-11)


@pytest.mark.parametrize("options", [{"delta": 0.05}, {"sd": 0.05}])
def test_scale_and_sign_of_the_models_shapes_do_not_matter(options):
    term = ShapeTerm(MEASURED, **options)
    scaled = ModalSolution(MODES.frequencies, SHAPES * [-3.0, 1e-6, 1e6])
    np.testing.assert_allclose(term({}, scaled), term({}, MODES), rtol=1e-9)


def test_close_to_one_a_mac_keeps_its_digits():
    nudge = np.zeros((7, 1))
    nudge[2] = 1e-9
    first = MEASURED[:, :1]
    model = ModalSolution(np.ones((1, 1)), (first + nudge)[None])
    gap = 1e-18 * (1 - first[2] ** 2 / (first**2).sum()) / (first**2).sum()
    delta = 1e-9
    term = ShapeTerm(first, delta=delta)({}, model)[0]
    constant = -3 * np.log(2 * np.pi * delta**2)
    np.testing.assert_allclose(term - constant, -gap[0] / (2 * delta**2), rtol=1e-5)


def test_a_shape_with_no_motion_at_the_sensors_has_mac_zero():
    still = ModalSolution(np.ones((1, 1)), np.zeros((1, 7, 1)))
    value = ShapeTerm(MEASURED[:, :1], delta=0.1)({}, still)[0]
    np.testing.assert_allclose(value, -1 / 0.02 - 3 * np.log(2 * np.pi * 0.01))


def test_the_posterior_of_two_parameters_agrees_with_quadrature():
    # A shape (1, a) measured with an inferred delta, whose prior is half-normal.
    measured = np.array([[1.0], [0.5], [0.35]])  # no value of a fits exactly

    def model(p):
        a = p["a"]
        shapes = np.column_stack([np.ones_like(a), a, a**2])[..., None]
        return ModalSolution(np.ones((len(a), 1)), shapes)

    prior = ef.IndependentPrior(
        {"a": stats.uniform(0.2, 0.6), "delta": stats.halfnorm(scale=0.1)}
    )
    term = ShapeTerm(measured, discrepancy="delta")
    posterior = ef.LogPosterior(model, term, prior)
    a, delta = np.linspace(0.2, 0.8, 303)[1:-1], np.linspace(5e-4, 0.5, 400)
    grid = np.array(np.meshgrid(a, delta, indexing="ij")).reshape(2, -1).T
    weight = np.exp(posterior(grid)[:, 0].reshape(301, 400))
    # The same from the formula, by hand.
    shape = np.array([np.ones(301), a, a**2])
    value = mac(measured, shape)[0]
    by_hand = np.exp(-(1 - value[:, None]) / (2 * delta**2)) * delta**-2.0
    by_hand = by_hand * np.exp(-(delta**2) / (2 * 0.1**2))
    weight, by_hand = weight / weight.sum(), by_hand / by_hand.sum()
    np.testing.assert_allclose(weight, by_hand, atol=1e-12)
    mean = (weight.sum(axis=0) * delta).sum()
    (sampler,) = ef.run(posterior, nwalkers=32, nsteps=1_200, seed=4)
    draws = sampler.get_chain(discard=300)[..., 1]
    error = draws.mean(axis=1).std() * np.sqrt(50 / len(draws))  # tau below 50
    assert abs(draws.mean() - mean) < 4 * error + 1e-4


def test_measurements_give_shapes_sensors_and_deviations():
    sd = np.full((2, 1), 0.1)
    test = Measurements([5.0], shapes=[[1.0], [2.0]], shape_sd=sd, dofs=[3, 0])
    term = ShapeTerm(test)
    np.testing.assert_array_equal(term.sd, sd)
    assert term.n_modes == 1
    shapes = RNG.normal(size=(4, 5, 2))
    full = ModalSolution(np.ones((4, 2)), shapes)
    at_rows = ModalSolution(np.ones((4, 2)), shapes[:, [3, 0]])
    np.testing.assert_array_equal(term({}, full), term({}, at_rows))
    assert ShapeTerm(test, delta=0.1).sd is None


def test_paired_with_a_turned_cluster_the_shape_term_sees_no_turning():
    basis = np.linalg.qr(RNG.normal(size=(7, 4)))[0]
    test = Measurements([1.0, 2.0, 2.1], shapes=basis[:, :3])
    term = ShapeTerm(test, delta=0.05)
    values = []
    for angle in (0.0, 0.7):
        c, s = np.cos(angle), np.sin(angle)
        shapes = basis.copy()
        shapes[:, 1:3] = basis[:, 1:3] @ [[c, -s], [s, c]]
        solution = ModalSolution(np.array([[1.0, 2.0, 2.01, 4.0]]), shapes[None])
        paired = PairedModel(lambda p, m=solution: m, test, candidates=4)
        values.append(term({}, paired({}))[0])
    np.testing.assert_allclose(values[1], values[0], rtol=1e-10)


def test_rows_are_the_same_to_the_bit_alone_and_in_a_batch():
    for options in ({"delta": 0.05}, {"sd": 0.05}):
        term = ShapeTerm(MEASURED, **options)
        whole = term({}, MODES)
        for row in range(len(whole)):
            one = ModalSolution(MODES.frequencies[[row]], SHAPES[[row]])
            assert term({}, one)[0] == whole[row]


@pytest.mark.parametrize(
    ("measured", "options", "error", "message"),
    [
        (MEASURED, {}, TypeError, "delta, discrepancy, sd: .* 2 % of the shape's"),
        (MEASURED, {"delta": 0.1, "sd": 0.1}, TypeError, "exactly one"),
        (Measurements([1.0]), {"delta": 0.1}, ValueError, "have no shapes"),
        (MEASURED[:1], {"delta": 0.1}, ValueError, "at least two sensors"),
        (np.zeros((4, 1)), {"delta": 0.1}, ValueError, "none of them all zero"),
        (MEASURED[:, 0], {"delta": 0.1}, ValueError, "measured: expected 2 dim"),
        (MEASURED, {"delta": 0.0}, ValueError, "delta: expected numbers above zero"),
        (MEASURED, {"discrepancy": ""}, TypeError, "discrepancy: expected a non-"),
        (MEASURED, {"delta": [0.1, 0.2]}, ValueError, r"delta: .* each of \(3,\)"),
        (MEASURED, {"sd": np.ones((3, 7))}, ValueError, r"sd: .* each of \(7, 3\)"),
        (MEASURED, {"delta": 0.1, "name": ""}, TypeError, "name: expected"),
    ],
)
def test_arguments_are_checked(measured, options, error, message):
    with pytest.raises(error, match=message):
        ShapeTerm(measured, **options)


def test_a_model_without_its_shapes_is_refused():
    term = ShapeTerm(MEASURED, delta=0.1)
    with pytest.raises(TypeError, match="has no 'shapes'"):
        term({}, ModalSolution(np.ones((1, 3))))
    with pytest.raises(ValueError, match="returned shapes"):
        term({}, ModalSolution(np.ones((1, 2)), np.ones((1, 7, 2))))
    with pytest.raises(ValueError, match="dofs: expected the rows of 7 sensors"):
        term({}, ModalSolution(np.ones((1, 3)), np.ones((1, 9, 3))))


def test_a_delta_that_may_be_negative_is_refused_before_the_run():
    prior = ef.IndependentPrior({"delta": stats.norm(0, 1)})
    model = ef.FunctionModel(lambda p: ModalSolution([1.0, 2, 3], MEASURED), n_modes=3)
    with pytest.raises(ValueError, match="'delta' must stay above zero for ShapeTerm"):
        ef.LogPosterior(model, ShapeTerm(MEASURED, discrepancy="delta"), prior)
