"""Gaussian processes: the conditional law by another route, leaving out in earnest."""

import numpy as np
import pytest
from scipy import special, stats

from emcee_femu.surrogates import gaussian_process as gp

RNG = np.random.default_rng(7)
POINTS = RNG.standard_normal((14, 3))
FRESH = RNG.standard_normal((5, 3))


def answers(x):
    return np.stack(
        [30.0 * np.sin(x[:, 0]) + x @ [5.0, 1.0, 2.0], 20.0 * np.exp(0.4 * x[:, 1])],
        axis=1,
    )


def kinks(x):
    return answers(x) + 25.0 * np.abs(x[:, 0] - 0.2 * x[:, 2])[:, None]


VALUES = answers(POINTS)
FITTED = gp.fit_processes(POINTS, VALUES)
ROUGH = gp.Processes.condition(POINTS, VALUES, FITTED.lengths, True)
TREND = np.hstack([np.ones((len(POINTS), 1)), POINTS])
BOTH = pytest.mark.parametrize("fitted", [FITTED, ROUGH])


def correlate(a, b, lengths, rough):
    r = np.sqrt((((a[:, None] - b[None]) / lengths) ** 2).sum(axis=2))
    if not rough:
        return np.exp(-0.5 * r**2)
    # Matern's kernel of any smoothness, at 5/2
    z = np.sqrt(5.0) * np.maximum(r, 1e-9)
    return 2.0**-1.5 / special.gamma(2.5) * z**2.5 * special.kv(2.5, z)


def condition(points, values, at, fitted):
    """Return means and factors of the variance, with a trend of a vague prior."""
    # A prior of variance 1e6 on the trend makes it an ordinary conditional Gaussian.
    every = np.vstack([points, at])
    trend = np.hstack([np.ones((len(every), 1)), every])
    joint = (
        correlate(every, every, fitted.lengths, fitted.rough) + 1e6 * trend @ trend.T
    )
    n = len(points)
    among = joint[:n, :n] + gp.NUGGET * np.eye(n)
    gain = np.linalg.solve(among, joint[:n, n:]).T
    return gain @ values, (joint[n:, n:] - gain @ joint[:n, n:]).diagonal()


@BOTH
def test_prediction_is_the_conditional_gaussian(fitted):
    expected, factor = condition(POINTS, VALUES, FRESH, fitted)
    np.testing.assert_allclose(fitted.predict(FRESH), expected, atol=1e-3)
    np.testing.assert_allclose(fitted.unit_sd(FRESH), np.sqrt(factor), rtol=1e-2)


@BOTH
def test_leaving_one_out_is_what_the_others_predict(fitted):
    residual, sd = fitted.leave_out(VALUES), fitted.left_out_sd
    for i in range(len(POINTS)):
        rest, at = np.arange(len(POINTS)) != i, POINTS[i : i + 1]
        mean, factor = condition(POINTS[rest], VALUES[rest], at, fitted)
        np.testing.assert_allclose(residual[i], VALUES[i] - mean[0], atol=2e-3)
        np.testing.assert_allclose(sd[i], np.sqrt(factor + gp.NUGGET), rtol=1e-2)


@BOTH
def test_the_sd_after_further_solves_needs_no_values(fitted):
    extra = RNG.standard_normal((3, 3))
    solved = np.vstack([POINTS, extra])
    _, factor = condition(solved, answers(solved), FRESH, fitted)
    after = fitted.unit_sd(FRESH, extra)
    np.testing.assert_allclose(after, np.sqrt(factor), rtol=0.01, atol=1e-3)
    np.testing.assert_allclose(fitted.unit_sd(FRESH, extra[:0]), fitted.unit_sd(FRESH))


@BOTH
def test_slopes_are_those_of_the_mean(fitted):
    slopes, step = fitted.slopes(FRESH), 1e-4
    for j in range(3):
        move = step * np.eye(3)[j]
        ahead, behind = (fitted.predict(FRESH + s * move) for s in (1.0, -1.0))
        np.testing.assert_allclose(
            slopes[:, :, j], (ahead - behind) / (2 * step), rtol=1e-6, atol=1e-5
        )


def test_the_kernel_is_rough_where_there_are_kinks():
    assert not FITTED.rough
    x = RNG.standard_normal((40, 3))
    assert gp.fit_processes(x, kinks(x)).rough
    assert not gp.fit_processes(x, answers(x)).rough


@pytest.mark.parametrize("rough", [False, True])
def test_the_lengths_maximise_the_restricted_likelihood(rough):
    # Second route: the density of contrasts that no linear trend moves.
    contrasts = np.linalg.svd(TREND)[0][:, 4:].T

    def cost(logs):
        R = correlate(POINTS, POINTS, np.exp(logs), rough)
        C = contrasts @ (R + gp.NUGGET * np.eye(len(POINTS))) @ contrasts.T
        total = 0.0
        for y in (contrasts @ VALUES).T:
            variance = y @ np.linalg.solve(C, y) / len(y)
            total -= stats.multivariate_normal(cov=variance * C).logpdf(y)
        return total

    def restricted(logs):
        return gp._restricted(POINTS, VALUES, TREND, np.exp(logs), rough, np.ones(2))

    best = np.log(FITTED.lengths)
    moved = best + np.array([0.2, -0.1, 0.3])
    (ours, _), (there, slopes) = restricted(best), restricted(moved)
    np.testing.assert_allclose(there - ours, cost(moved) - cost(best), rtol=1e-4)
    for j, step in enumerate(1e-5 * np.eye(3)):
        ahead, behind = restricted(moved + step)[0], restricted(moved - step)[0]
        np.testing.assert_allclose(slopes[j], (ahead - behind) / 2e-5, rtol=1e-3)
    widest = np.log(gp.WIDEST * POINTS.std(axis=0))
    for step in 0.05 * np.vstack([np.eye(3), -np.eye(3)]) * (not rough):
        assert restricted(np.minimum(best + step, widest))[0] >= ours - 1e-4


def test_errors_are_about_as_large_as_predicted():
    ratios = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        x, fresh = rng.standard_normal((25, 3)), rng.standard_normal((50, 3))
        fitted = gp.fit_processes(x, answers(x))
        sd = fitted.unit_sd(fresh)[:, None] * fitted.amplitudes
        wrong = (fitted.predict(fresh) - answers(fresh)) / sd
        ratios.append(np.sqrt((wrong**2).mean()))
    assert 0.2 < np.median(ratios) < 2.0


def test_few_points_have_a_constant_trend():
    fitted = gp.fit_processes(POINTS[:4], VALUES[:4])
    np.testing.assert_allclose(fitted.predict(POINTS[:4]), VALUES[:4], atol=0.1)
    assert np.isfinite(fitted.unit_sd(FRESH)).all()


def test_a_straight_output_changes_nothing_for_the_others():
    straight = [POINTS @ [1.0, 2.0, -3.0], np.full(len(POINTS), 3.0)]
    fitted = gp.fit_processes(POINTS, np.column_stack([VALUES, *straight]))
    mean = fitted.predict(FRESH)
    np.testing.assert_allclose(mean[:, 2], FRESH @ [1.0, 2.0, -3.0], atol=1e-6)
    np.testing.assert_allclose(mean[:, 3], 3.0, atol=1e-6)
    assert (fitted.amplitudes[2:] < 1e-6).all()
    np.testing.assert_allclose(mean[:, :2], FITTED.predict(FRESH), atol=0.01)


def test_amplitudes_allow_for_errors_that_leaving_one_out_shows():
    for lengths in (FITTED.lengths, 4 * FITTED.lengths):  # the second far too smooth
        fitted = gp.Processes.condition(POINTS, kinks(POINTS), lengths, False)
        sd = fitted.amplitudes * fitted.left_out_sd[:, None]
        z = fitted.leave_out(kinks(POINTS)) / sd
        assert (np.sqrt((z**2).mean(axis=0)) < 1.001).all()
