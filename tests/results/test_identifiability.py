"""What the data say: closed forms of linear-Gaussian problems, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.known_posteriors import (
    CURVATURE,
    GRADIENT,
    NAMES,
    PRIOR_SD,
    exact_draws,
    gaussian_posterior,
    linear_frequencies,
    made,
)

import emcee_femu as ef

COVARIANCE = gaussian_posterior(GRADIENT[:2], 0.1)


@pytest.fixture
def found():
    z = exact_draws(COVARIANCE, mean=[0.2, -0.1, 1.0])
    return ef.identifiability(made(z, linear_frequencies(z, curvature=0 * CURVATURE)))


def test_sd_ratio_and_correlation_are_those_of_the_gaussian_posterior(found):
    sd = np.sqrt(np.diag(COVARIANCE))
    assert found.names == NAMES
    assert_allclose(found.sd_ratio, sd, rtol=1e-10)
    assert_allclose(found.correlation, COVARIANCE / np.outer(sd, sd), atol=1e-10)


def test_sensitivities_of_a_linear_model_are_its_matrix(found):
    assert_allclose(found.sensitivities, GRADIENT, rtol=0, atol=1e-9)
    assert_allclose(found.r_squared, [1, 1, np.nan, 1], rtol=1e-9)
    assert (found.sensitivities[2] == 0).all()  # a mode that nothing changes


def test_sensitivities_of_a_curved_model_are_its_gradient_at_the_posterior_mean():
    mean = np.array([0.5, -1.0, 2.0])
    z = exact_draws(COVARIANCE, mean)
    found = ef.identifiability(made(z, linear_frequencies(z)))
    expected = GRADIENT + 2 * CURVATURE[:, None] * mean
    assert_allclose(found.sensitivities, expected, rtol=0, atol=1e-9)


def test_a_parameter_that_does_not_enter_is_named():
    design = np.array([[0.3, 0.0, 0.1], [-0.2, 0.0, 0.3]])
    z = exact_draws(gaussian_posterior(design, 0.05), mean=[0.0, -0.4, 0.0])
    idata = made(z, linear_frequencies(z, design, 0.0), prior_mean=[0.1, 0.0, 0.0])
    found = ef.identifiability(idata)
    assert_allclose(found.sd_ratio[1], 1.0, rtol=1e-10)
    assert_allclose(found.shift, [-0.1 / 3, -0.4, 0], atol=1e-12)
    assert_allclose(found.sensitivities[:, 1], 0.0, atol=1e-9)
    assert found.findings == (
        "The data leave area as uncertain as before (sd ratio 1.00), and move it by "
        "-0.4 prior standard deviations.",
    )


@pytest.mark.parametrize(("ratio", "named"), [(0.89, False), (0.91, True)])
def test_the_threshold_is_nine_tenths_of_the_prior_sd(ratio, named):
    z = exact_draws(np.diag([0.2, ratio, 0.3]) ** 2)
    (sentence,) = ef.identifiability(made(z, linear_frequencies(z))).findings
    expected = "The data leave area" if named else "The data inform every parameter"
    assert sentence.startswith(expected) and f"(sd ratio {ratio:.2f})" in sentence


@pytest.mark.parametrize("sign", [1, -1])
def test_of_a_collinear_pair_the_known_combination_is_named(sign):
    # The data see z_1 + sign * 0.5 z_3 alone, to 1 % of its prior sd.
    design = np.array([[1.0, 0.0, sign * 0.5], [0.0, 1.0, 0.0]])
    noise = 0.01 * np.sqrt(1.25)
    covariance = gaussian_posterior(design, noise)
    z = exact_draws(covariance)
    found = ef.identifiability(made(z, linear_frequencies(z, design, 0.0)))
    assert_allclose(found.sensitivities, design, rtol=0, atol=1e-6)
    (sentence,) = found.findings
    # In parameter units: theta_1 / 3 + sign * 0.5 theta_3 / 0.5
    start = f"Only stiff {'+' if sign > 0 else '-'} 3 x is known well, not stiff and x"
    assert sentence.startswith(start)
    exact = 0.01 / np.sqrt(1 + 0.01**2)
    assert f"sd ratio {exact:.2g}, against 0.45 and 0.89 " in sentence
    assert (
        f"(correlation {-sign * covariance_correlation(covariance):+.3f})" in sentence
    )
    row = dict(zip(found.table.columns, found.table.rows[2], strict=True))
    assert row["with"] == "stiff"
    assert_allclose(row["correlation"], found.correlation[0, 2], rtol=1e-12)


def covariance_correlation(covariance):
    return abs(covariance[0, 2]) / np.sqrt(covariance[0, 0] * covariance[2, 2])


@pytest.mark.parametrize(("r", "named"), [(0.94, False), (-0.96, True)])
def test_the_threshold_of_a_pair_is_a_correlation_of_0_95(r, named):
    covariance = 0.04 * np.array([[1, r, 0], [r, 1, 0], [0, 0, 1]])
    z = exact_draws(covariance)
    sentence = ef.identifiability(made(z, linear_frequencies(z))).findings[0]
    assert sentence.startswith("Only stiff" if named else "The data inform every")


@pytest.mark.parametrize(("side", "share"), [(0, 0.0625), (1, 0.0625), (0, 0.04)])
def test_a_posterior_at_a_bound_is_named(side, share):
    z = exact_draws(np.diag([0.2, 0.3, 0.2]) ** 2)
    z[..., 0] = np.abs(z[..., 0]) * (1 - 2 * side)  # half of a Gaussian at a bound
    ordered = np.sort(np.abs(z[..., 0]).ravel())
    n = round(share * len(ordered))
    # A range of which 1 % reaches up to the n-th sample and not to the next one.
    reach = 100 * (ordered[[n - 1, n]].mean() - ordered[0])
    near, far = np.array([ordered[0], ordered[0] + reach]) * (1 - 2 * side)
    ends = np.sort([near, far]) * PRIOR_SD[0]
    lower, upper = [ends[0], -np.inf, -np.inf], [ends[1], np.inf, np.inf]
    found = ef.identifiability(made(z, linear_frequencies(z), lower=lower, upper=upper))
    assert_allclose(found.at_bound[0, side], share)
    assert found.at_bound[1:].max() == 0
    assert_allclose(found.table.column("at a bound %")[0], 100 * share)
    name = f"{('lower', 'upper')[side]} bound {ends[side]:.5g}: 6 % of the samples"
    pressed = found.findings[0].startswith(f"stiff is pressed against its {name}")
    assert pressed == (share > 0.05)


def test_a_mode_that_is_no_quadratic_of_the_parameters_is_named():
    z = exact_draws(np.diag([0.5, 0.5, 0.5]) ** 2)
    frequencies = linear_frequencies(z)
    frequencies[..., 1] = 10 * np.exp(np.abs(z[..., 0]))  # modes that cross at zero
    found = ef.identifiability(made(z, frequencies))
    assert found.r_squared[1] < 0.95
    assert_allclose(np.delete(found.r_squared, 1), [1, np.nan, 1], rtol=1e-9)
    assert found.findings[-1].startswith("The sensitivities of mode 2 are rough")
    assert not any("are rough" in text for text in found.findings[:-1])


def test_a_rigid_body_mode_has_no_sensitivities_but_the_others_have():
    z = exact_draws(COVARIANCE)
    frequencies = linear_frequencies(z, curvature=0 * CURVATURE)
    frequencies[0, 3, 0] = 0.0
    found = ef.identifiability(made(z, frequencies))
    assert np.isnan(found.sensitivities[0]).all()
    assert_allclose(found.sensitivities[1:], GRADIENT[1:], rtol=0, atol=1e-9)


ERROR = {"is_error": [False, False, True]}  # of the parameters the third, "x"


def with_error(shift=0.0, **constants):
    """Return samples of two stiffnesses and an error of half its prior's width."""
    z = exact_draws(np.diag([0.3, 0.3, 0.5]) ** 2, mean=[0, 0, shift])
    frequencies = linear_frequencies(z, GRADIENT * [1, 1, 0], 0.0)
    return ef.identifiability(made(z, frequencies, **ERROR, **constants))


def test_errors_have_no_sensitivities():
    found = with_error()
    assert_allclose(found.sensitivities[:, :2], GRADIENT[:, :2], atol=1e-9)
    assert np.isnan(found.sensitivities[:, 2]).all()
    assert found.sensitivity_table.column("parameter") == [*NAMES[:2], "R^2"]
    assert np.isnan(found.table.column("effect/error")[2])
    assert found.findings[0].startswith("The data inform every parameter")
    assert len(found.findings) == 1


@pytest.mark.parametrize(("shift", "named"), [(1.9, False), (2.9, True), (-2.9, False)])
def test_an_error_far_above_its_prior_mean_is_named(shift, named):
    found = with_error(shift)
    surprising = [
        text for text in found.findings if "prior standard deviations" in text
    ]
    assert len(surprising) == named
    if named:
        assert surprising[0].startswith("x is inferred 2.9 prior standard deviations")


@pytest.mark.parametrize("is_error", [True, False])
def test_what_is_pressed_is_said_first_and_errors_may_be_small(is_error):
    z = exact_draws(np.diag([1.0, 0.3, 0.01]) ** 2)
    z[..., 2] = np.abs(z[..., 2])
    lower, which = [-9e9, -9e9, 0.0], [False, False, is_error]
    idata = made(z, linear_frequencies(z), lower=lower, is_error=which)
    *pressed, last = ef.identifiability(idata).findings
    assert last.startswith("The data leave stiff as uncertain as before")
    assert len(pressed) == (not is_error)
    if pressed:
        assert pressed[0].startswith("x is pressed against its lower bound 0: ")


@pytest.mark.parametrize("side", [0, 1])
def test_a_narrow_posterior_in_a_wide_range_is_not_pressed_against_its_bound(side):
    """As 60 +- 4.6 of a range from 0 to 1e5: 1 % of it reaches to 1000."""
    z = exact_draws(np.diag([0.3, 0.3, 0.01]) ** 2)
    ends = np.array([-0.13, 200.0] if side == 0 else [-200.0, 0.13]) * PRIOR_SD[2]
    bounds = {"lower": [-9e9, -9e9, ends[0]], "upper": [9e9, 9e9, ends[1]]}
    found = ef.identifiability(made(z, linear_frequencies(z), **bounds))
    assert_allclose(found.at_bound[2, side], 1.0)
    assert_allclose(found.from_bound[2, side], 13, rtol=1e-6)
    (text,) = found.findings
    assert text.startswith("The data inform every parameter")


def test_where_little_is_informed_the_known_combinations_are_named():
    """Two frequencies see (3 a + 4 b) / 5 and f of six parameters, no pair alone."""
    names = tuple("abcdef")
    design = np.array([[0.6, 0.8, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1.0]])
    z = exact_draws(gaussian_posterior(design / [[0.5], [0.1]], 1.0), n=4000)
    frequencies = linear_frequencies(z, design, 0.0)
    found = ef.identifiability(made(z, frequencies, np.ones(6), names))
    (text,) = [text for text in found.findings if "combinations" in text]
    first, second = (noise / np.hypot(1, noise) for noise in (0.1, 0.5))
    assert text.startswith("2 of 6 independent combinations are known well (sd ratio")
    assert text.endswith(
        f"in prior standard deviations: 1.00 f (sd ratio {first:.2g}); 0.80 b + 0.60 a "
        f"(sd ratio {second:.2g})."
    )
    none = exact_draws(np.eye(6), n=4000)
    found = ef.identifiability(made(none, frequencies, np.ones(6), names))
    assert "No combination of the parameters is known well either." in found.findings


def test_a_single_parameter_has_no_partner():
    z = exact_draws(np.array([[0.25]]), n=40)
    idata = made(z, 10 * np.exp(0.5 * 0.2 * z), PRIOR_SD[:1], NAMES[:1])
    found = ef.identifiability(idata)
    assert_allclose(found.sensitivities, [[0.2]], rtol=1e-9)
    assert found.table.column("with") == [""]
    assert np.isnan(found.table.column("correlation")[0])


def test_too_few_different_samples_are_refused():
    z = exact_draws(np.diag([0.5, 0.5, 0.5]) ** 2)
    few = np.resize(z.reshape(-1, 3)[:29], z.shape)  # 30 are needed
    with pytest.raises(ValueError, match="at least 30 different samples .* got 29"):
        ef.identifiability(made(few, linear_frequencies(few)))
