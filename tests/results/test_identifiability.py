"""What the data say: closed forms of linear-Gaussian problems, and what is refused."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.chains import by_hand

import emcee_femu as ef

PRIOR_SD = np.array([3.0, 2e-8, 0.5])
NAMES = ("stiff", "area", "x")  # not in alphabetical order
# Change of ln(lambda) of four modes with one prior sd; nothing changes the third.
GRADIENT = np.array(
    [[0.3, 0.0, 0.1], [-0.2, 0.05, 0.0], [0.0, 0.0, 0.0], [0.1, 0.2, 0]]
)
CURVATURE = np.array([0.0, 0.1, 0.0, 0.0])


def exact_draws(covariance, mean=None, n=400, seed=0):
    """Return draws with exactly this mean and covariance, ``(4, n / 4, d)``."""
    d = len(covariance)
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((n, d))
    white -= white.mean(axis=0)
    white = np.linalg.qr(white)[0] * np.sqrt(n - 1)
    draws = white @ np.linalg.cholesky(covariance).T
    return (draws + (np.zeros(d) if mean is None else mean)).reshape(4, -1, d)


def linear_frequencies(z, gradient=GRADIENT, curvature=CURVATURE):
    """Return ``(chain, draw, mode)`` with ln(lambda) a known function of z."""
    log_eigenvalue = z @ gradient.T + curvature * (z**2).sum(axis=-1, keepdims=True)
    return 10 * np.exp(0.5 * log_eigenvalue)


def made(z, frequencies, prior_sd=PRIOR_SD, names=NAMES, **constants):
    """Return what to_inference_data would; z is theta in prior sds."""
    d = len(names)
    constants = {
        "prior_mean": np.zeros(d),
        "prior_sd": prior_sd,
        "is_error": np.zeros(d, dtype=bool),
        "lower": np.full(d, -np.inf),
        "upper": np.full(d, np.inf),
        **constants,
    }
    draws = dict(zip(names, np.moveaxis(z * prior_sd, -1, 0), strict=True))
    return by_hand(draws, constants, response={"frequency": frequencies})


def gaussian_posterior(design, noise):
    """Return the covariance of z ~ N(0, I) given design @ z with errors of sd noise."""
    design = np.atleast_2d(design)
    precision = np.eye(design.shape[1]) + design.T @ design / noise**2
    return np.linalg.inv(precision)


COVARIANCE = gaussian_posterior(GRADIENT[:2], 0.1)
INFORMED = "The data inform every parameter"


def identify(covariance, mean=None, **constants):
    """Return what is said of draws of a Gaussian, and the draws."""
    z = exact_draws(np.asarray(covariance), mean)
    return ef.identifiability(made(z, linear_frequencies(z), **constants))


def test_of_a_gaussian_posterior_of_a_linear_model_all_is_exact():
    z = exact_draws(COVARIANCE, mean=[0.2, -0.1, 1.0])
    frequencies = linear_frequencies(z, curvature=0 * CURVATURE)
    found = ef.identifiability(made(z, frequencies, prior_mean=[0.3, 0.0, 0.0]))
    sd = np.sqrt(np.diag(COVARIANCE))
    assert found.names == NAMES
    assert_allclose(found.sd_ratio, sd, rtol=1e-10)
    assert_allclose(found.shift, [0.1, -0.1, 1.0], atol=1e-12)
    assert_allclose(found.correlation, COVARIANCE / np.outer(sd, sd), atol=1e-10)
    assert_allclose(found.sensitivities, GRADIENT, rtol=0, atol=1e-9)
    assert_allclose(found.r_squared, [1, 1, np.nan, 1], rtol=1e-9)
    assert (found.sensitivities[2] == 0).all()  # a mode that nothing changes
    frequencies[0, 3, 0] = 0.0  # a rigid-body mode has none, but the others have
    found = ef.identifiability(made(z, frequencies))
    assert np.isnan(found.sensitivities[0]).all()
    assert_allclose(found.sensitivities[1:], GRADIENT[1:], rtol=0, atol=1e-9)


def test_sensitivities_of_a_curved_model_are_its_gradient_at_the_posterior_mean():
    mean = np.array([0.5, -1.0, 2.0])
    expected = GRADIENT + 2 * CURVATURE[:, None] * mean
    found = identify(COVARIANCE, mean)
    assert_allclose(found.sensitivities, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("covariance", "named"),
    [
        (np.diag([0.2, 0.89, 0.3]) ** 2, INFORMED),
        (np.diag([0.2, 0.91, 0.3]) ** 2, "The data leave area"),
        (0.04 * np.array([[1, 0.94, 0], [0.94, 1, 0], [0, 0, 1]]), INFORMED),
        (0.04 * np.array([[1, -0.96, 0], [-0.96, 1, 0], [0, 0, 1]]), "Only stiff"),
    ],
)
def test_thresholds_are_nine_tenths_of_the_prior_sd_and_a_correlation_of_0_95(
    covariance, named
):
    assert identify(covariance).findings[0].startswith(named)


@pytest.mark.parametrize("sign", [1, -1])
def test_of_a_collinear_pair_the_known_combination_is_named(sign):
    # The data see z_1 + sign * 0.5 z_3 alone, to 1 % of its prior sd.
    design = np.array([[1.0, 0.0, sign * 0.5], [0.0, 1.0, 0.0]])
    covariance = gaussian_posterior(design, 0.01 * np.sqrt(1.25))
    z = exact_draws(covariance)
    found = ef.identifiability(made(z, linear_frequencies(z, design, 0.0)))
    assert_allclose(found.sensitivities, design, rtol=0, atol=1e-6)
    (sentence,) = found.findings
    # In parameter units: theta_1 / 3 + sign * 0.5 theta_3 / 0.5
    assert f"stiff {'+' if sign > 0 else '-'} 3 x is" in sentence
    assert f"{0.01 / np.sqrt(1 + 0.01**2):.2g}, against 0.45 and 0.89" in sentence
    r = covariance[0, 2] / np.sqrt(covariance[0, 0] * covariance[2, 2])
    assert f"{r:+.3f}" in sentence and found.table.column("with")[2] == "stiff"
    assert_allclose([found.correlation[0, 2], found.table.column("correlation")[2]], r)


def at_bounds(values, low, high, before=None):
    """Return what is said of one parameter of these samples and bounds."""
    others = np.random.default_rng(0).normal(size=(2, len(values)))
    z = np.column_stack([values, *others]).reshape(4, -1, 3)
    constants = {
        "prior_mean": np.zeros(3),
        "prior_sd": np.full(3, np.std(values if before is None else before) + 1),
        "is_error": np.zeros(3, dtype=bool),
        "lower": [low, -np.inf, -np.inf],
        "upper": [high, np.inf, np.inf],
    }
    draws = dict(zip(NAMES, np.moveaxis(z, -1, 0), strict=True))
    by_mode = ("chain", "draw", "mode"), linear_frequencies(np.tanh(z))
    groups = {"response": {"frequency": by_mode}}
    if before is not None:
        groups["prior"] = dict.fromkeys(NAMES, before[None])
    idata = by_hand(draws, constants, dims=(), **groups)
    found = ef.identifiability(idata)
    assert not found.pressed[1:].any() and (found.at_bound[1:] == 0).all()
    named = [text for text in found.findings if "is pressed against" in text]
    assert len(named) == found.pressed.sum()
    return found


def pressed_samples(rng):
    """Return samples that are highest at one of their bounds, and these bounds."""
    low = rng.choice([-3.0, 0.5, 7.0, 1e3])
    high = low + rng.uniform(0.5, 5) * max(abs(low), 1.0)
    reach = rng.uniform(0.005, 0.2) * (high - low)
    law = stats.halfnorm if rng.random() < 0.5 else stats.expon
    away = law.rvs(scale=reach, size=6000, random_state=rng)
    away = away[away < high - low][:4000]
    side = int(rng.integers(2))
    return (high - away if side else low + away), low, high, side


@pytest.mark.parametrize("seed", range(10))
def test_of_truly_pressed_ones_all_are_named(seed):
    values, low, high, side = pressed_samples(np.random.default_rng(seed))
    found = at_bounds(values, low, high)
    assert found.pressed[0].tolist() == [side == 0, side == 1]
    assert found.at_bound[0, side] > 0.75
    end = ("lower", "upper")[side], (low, high)[side]
    words = "stiff is pressed against its {} bound {:.5g}".format(*end)
    assert found.findings[0].startswith(words)


@pytest.mark.parametrize("seed", range(10))
def test_of_wide_lognormals_none_is_pressed(seed):
    """Their upper tails make sds of which 1 % holds most of the samples."""
    rng = np.random.default_rng(seed)
    sd, median = rng.uniform(1, 3), rng.lognormal(0, 2)
    values = median * np.exp(sd * rng.normal(size=4000))
    for low, high in (
        (0.0, np.inf),
        (0.0, 1.1 * values.max()),
        (values.min() / 2, 1e9),
    ):
        assert not at_bounds(values, low, high).pressed.any()


@pytest.mark.parametrize("side", [0, 1])
def test_what_is_high_inside_is_not_pressed(side):
    rng, sign = np.random.default_rng(4), 1 - 2 * side
    inside = stats.truncnorm(-2, 90).rvs(4000, random_state=rng)  # cut at 2 sds
    two = rng.choice([0.2, 8.0], 4000) + 0.03 * rng.normal(size=4000)
    narrow = 13 + rng.normal(size=4000)  # far from a bound whose range is wide
    for values, bound, reach in ((inside, -2, 60), (two, 0.05, 9), (narrow, 0, 2e4)):
        ends = np.sort(sign * np.array([bound, bound + reach]))
        assert not at_bounds(sign * values, *ends).pressed.any()


def test_where_the_prior_is_as_high_at_the_bound_nothing_presses():
    rng = np.random.default_rng(4)
    flat, steep = rng.uniform(1, 2, size=4000), 1 + rng.exponential(0.1, size=4000)
    assert not at_bounds(flat, 1.0, 2.0).pressed.any()
    # Logarithms of a uniform law over a factor of two are twice as dense at its end.
    assert_allclose(at_bounds(flat, 1.0, 2.0).at_bound[0], [0.5, 1.0], atol=0.12)
    assert at_bounds(steep, 1.0, 9.0).pressed[0, 0]
    before = 1 + rng.exponential(0.12, size=4000)
    assert not at_bounds(steep, 1.0, 9.0, before).pressed.any()
    assert at_bounds(steep, 1.0, 9.0, 1 + 5 * (before - 1)).pressed[0, 0]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_bound_of_zero_is_never_named(sign):
    """It is of nature: no positive parameter can go beyond it."""
    values = np.abs(np.random.default_rng(1).normal(size=4000))
    found = at_bounds(sign * values, *np.sort([0.0, sign * 90.0]))
    assert not found.pressed.any() and (found.at_bound[0] < 0.1).all()


def test_r_squared_is_adjusted_and_zero_of_noise():
    """Ten coefficients explain a quarter of what 40 samples of noise scatter."""
    rng, d, count = np.random.default_rng(7), 3, 300
    z = rng.standard_normal((4, 10, d))
    noise = np.exp(rng.standard_normal((4, 10, count)))
    found = ef.identifiability(made(z, noise))
    scatter = found.r_squared.std() / np.sqrt(count)
    assert abs(found.r_squared.mean()) < 4 * scatter < 0.1


def test_a_mode_that_is_no_quadratic_of_the_parameters_is_named():
    z = exact_draws(np.diag([0.5, 0.5, 0.5]) ** 2)
    frequencies = linear_frequencies(z)
    frequencies[..., 1] = 10 * np.exp(np.abs(z[..., 0]))  # modes that cross at zero
    found = ef.identifiability(made(z, frequencies))
    assert found.r_squared[1] < 0.95
    assert_allclose(np.delete(found.r_squared, 1), [1, np.nan, 1], rtol=1e-9)
    assert ["mode 2" in text for text in found.findings][-1]


@pytest.mark.parametrize(("shift", "named"), [(1.9, False), (2.9, True), (-2.9, False)])
def test_errors_have_no_sensitivities_and_are_named_far_above_their_mean(shift, named):
    z = exact_draws(np.diag([0.3, 0.3, 0.5]) ** 2, mean=[0, 0, shift])
    frequencies = linear_frequencies(z, GRADIENT * [1, 1, 0], 0.0)
    idata = made(z, frequencies, is_error=[False, False, True])
    found = ef.identifiability(idata)
    assert_allclose(found.sensitivities[:, :2], GRADIENT[:, :2], atol=1e-9)
    assert np.isnan(found.sensitivities[:, 2]).all()
    assert np.isnan(found.table.column("effect/error")[2])
    assert found.findings[-1].startswith(INFORMED) != named
    assert any(re.search("x is .* 2.9 prior", t) for t in found.findings) == named


@pytest.mark.parametrize("is_error", [True, False])
def test_what_is_pressed_is_said_first_and_errors_may_be_small(is_error):
    z = exact_draws(np.diag([1.0, 0.3, 0.01]) ** 2)
    z[..., 2] = np.abs(z[..., 2]) + 1
    lower, which = [-9e9, -9e9, PRIOR_SD[2]], [False, False, is_error]
    idata = made(z, linear_frequencies(z), lower=lower, is_error=which)
    *pressed, last = ef.identifiability(idata).findings
    assert last.startswith("The data leave stiff")
    assert ["x is pressed" in text for text in pressed] == [True] * (not is_error)


def test_where_little_is_informed_the_known_combinations_are_named():
    """Two frequencies see (3 a + 4 b) / 5 and f of six parameters, no pair alone."""
    names = tuple("abcdef")
    design = np.array([[0.6, 0.8, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1.0]])
    z = exact_draws(gaussian_posterior(design / [[0.5], [0.1]], 1.0), n=4000)
    frequencies = linear_frequencies(z, design, 0.0)
    found = ef.identifiability(made(z, frequencies, np.ones(6), names))
    (text,) = [text for text in found.findings if "combinations" in text]
    first, second = (noise / np.hypot(1, noise) for noise in (0.1, 0.5))
    assert text.startswith("2 of 6 independent combinations")
    assert f"1.00 f (sd ratio {first:.2g})" in text
    assert f"0.80 b + 0.60 a (sd ratio {second:.2g})" in text
    z = exact_draws(np.eye(6), n=4000)
    none = ef.identifiability(made(z, frequencies, np.ones(6), names))
    assert any(text.startswith("No combination") for text in none.findings)


def test_a_single_parameter_has_no_partner_and_few_samples_say_nothing():
    z = exact_draws(np.array([[0.25]]), n=40)
    single = made(z, 10 * np.exp(0.5 * 0.2 * z), PRIOR_SD[:1], NAMES[:1])
    found = ef.identifiability(single)
    assert_allclose(found.sensitivities, [[0.2]], rtol=1e-9)
    assert found.table.column("with") == [""]
    z = exact_draws(np.diag([0.5, 0.5, 0.5]) ** 2)
    few = np.resize(z.reshape(-1, 3)[:29], z.shape)  # 30 are needed
    with pytest.raises(ValueError, match="30 .*29"):
        ef.identifiability(made(few, linear_frequencies(few)))


DESIGN = np.array([[3.0, 1.0, 0.0], [1.0, -2.0, 0.0]])  # Hz per unit of the parameters
SD, MEASURED, RELATIVE = np.array([1.0, 0.5, 2.0]), np.array([21.0, 49.0]), 0.02


def linear_posterior(**bounds):
    laws = {name: stats.norm(0, sd) for name, sd in zip("abc", SD, strict=True)}
    model = ef.FunctionModel(
        lambda p: [20 + 3 * p["a"] + p["b"], 50 + p["a"] - 2 * p["b"]], n_modes=2
    )
    term = ef.FrequencyTerm(MEASURED, relative_sd=RELATIVE)
    return ef.LogPosterior(model, term, ef.IndependentPrior(laws, bounds))


def test_a_linear_gaussian_problem_has_its_exact_answer():
    found = ef.identifiability(ef.find_map(linear_posterior(), 3, seed=1))
    noise = np.diag((RELATIVE * MEASURED) ** -2.0)
    covariance = np.linalg.inv(DESIGN.T @ noise @ DESIGN + np.diag(SD**-2.0))
    mean = covariance @ DESIGN.T @ noise @ (MEASURED - [20, 50])
    sd = np.sqrt(np.diag(covariance))
    # The prior's own are those of its draws, good to 1 %.
    assert_allclose(found.sd_ratio, sd / SD, rtol=0.02)
    assert_allclose(found.shift, mean / SD, atol=0.03)
    assert_allclose(found.correlation, covariance / np.outer(sd, sd), atol=1e-4)
    predicted = [20, 50] + DESIGN @ mean
    expected = 2 * DESIGN * found.prior_sd / predicted[:, None]
    assert_allclose(found.sensitivities, expected, atol=1e-6)
    assert np.isnan(found.r_squared).all() and (found.at_bound == 0).all()
    local, left = found.findings
    assert local.startswith("Local") and left.startswith("The data leave c")
    # The effect in errors is the design by the errors, locally and by samples: of a
    # linear model the log-likelihood is a quadratic, whatever the samples are.
    effect = np.linalg.norm(DESIGN / (RELATIVE * MEASURED)[:, None], axis=0)
    assert_allclose(found.effect, effect * found.prior_sd, rtol=1e-5)
    run = ef.run(linear_posterior(), ef.DEMCMove(), steps=30, ensembles=1, seed=1)
    sampled = ef.identifiability(run)
    assert_allclose(sampled.effect, effect * sampled.prior_sd, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("by_samples", [False, True])
def test_of_a_power_law_all_is_exact_in_logarithms(by_samples):
    """Lambda is proportional to k, over three decades of the prior."""
    model = ef.FunctionModel(lambda p: [10 * np.sqrt(p["k"])], n_modes=1)
    term = ef.FrequencyTerm(
        model({"k": np.array([30.0])}).frequencies[0], relative_sd=RELATIVE
    )
    prior = ef.IndependentPrior({"k": stats.loguniform(1, 1000)})
    posterior = ef.LogPosterior(model, term, prior)
    if by_samples:
        move, start = ef.DEMCMove(), stats.norm(30, 1).rvs((1, 20, 1), random_state=1)
        source = ef.run(posterior, move, 20, 100, ensembles=1, starts=start, seed=1)
    else:
        source = ef.find_map(posterior, 3, seed=1)
    found = ef.identifiability(source)
    sd = np.log(1000) / np.sqrt(12)
    assert_allclose(found.sensitivities, sd, rtol=0.03)
    assert_allclose(found.effect, sd / 2 / RELATIVE, rtol=0.06)
    assert_allclose(found.effect * found.sd_ratio, 1, rtol=0.15)  # of samples: roughly
    assert "k" in found.sensitivity_table.title


def test_a_bound_pressed_upon_is_the_gaussians_not_the_samples():
    posterior = linear_posterior(a=(0.8, 3.0), b=(-4, 4), c=(-9, 9))
    found = ef.identifiability(ef.find_map(posterior, 3, seed=1))
    (sentence,) = [text for text in found.findings if "pressed" in text]
    assert sentence.startswith("a ") and "lower bound 0.8" in sentence
    # The mean of what is inside the bounds is not on one of them.
    assert 0.8 + 0.5 * np.sqrt(found.covariance[0, 0]) < found.mean[0] < 0.9


@pytest.mark.parametrize("sampled", [False, True])
def test_lognormal_priors_are_compared_by_logarithms(sampled):
    """Fault 7: else a c.o.v. that has fallen may be "as uncertain as before"."""
    sd, error = 0.8, 0.4
    term = ef.FrequencyTerm([3.0], beta=(3.0 / error) ** 2)
    laws = {"k": stats.lognorm(sd), "u": (0.5, 1.5)}
    model = ef.FunctionModel(lambda p: [3 + np.log(p["k"])], n_modes=1)
    prior = ef.IndependentPrior(laws, bounds={"k": (np.exp(-2.99), np.inf)})
    posterior = ef.LogPosterior(model, term, prior)
    if sampled:
        run = ef.run(posterior, ef.DEMCMove(), 40, 500, ensembles=1, seed=1)
        found = ef.identifiability(ef.to_inference_data(run, discard=100))
        assert_allclose(found.shift[0], 0, atol=0.06)
        assert (found.mean - found.prior_mean)[0] / found.prior_sd[0] < -0.2
    else:
        found = ef.identifiability(ef.find_map(posterior, 4, seed=1))
    # ln k is normal, and 3 + ln k is measured as 3.0 +- 0.4.
    after = 1 / np.sqrt(sd**-2 + error**-2)
    assert_allclose(found.sd_ratio[0], after / sd, rtol=0.06)
    assert np.isnan(found.logarithms[:, 1]).all()
