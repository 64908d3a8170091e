"""Gaussian processes: the conditional law by another route, leaving out in earnest."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg, special

from emcee_femu.extensions.emulation import gaussian_process as gp

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


def with_slopes(x):
    """Return the answers and their slopes, ``(n, 1 + d, q)``."""
    slopes = np.zeros((len(x), 3, 2))
    slopes[:, :, 0] = [5.0, 1.0, 2.0]
    slopes[:, 0, 0] += 30.0 * np.cos(x[:, 0])
    slopes[:, 1, 1] = 8.0 * np.exp(0.4 * x[:, 1])
    return np.concatenate([answers(x)[:, None], slopes], axis=1)


VALUES = answers(POINTS)[:, None]
FITTED = gp.fit_processes(POINTS, VALUES)
FEW, SLOPED = POINTS[:8], with_slopes(POINTS[:8])
PARTLY = SLOPED.copy()
PARTLY[2, 1:] = np.nan  # a point whose slopes are not known
LENGTHS = np.array([2.0, 2.5, 9.0])
TREND = np.hstack([np.ones((len(POINTS), 1)), POINTS])
CASES = {
    "smooth": FITTED,
    "rough": gp.Processes(POINTS, VALUES, FITTED.lengths, True),
    "rough, sloped": gp.Processes(FEW, SLOPED, LENGTHS, True),
    "partly": gp.Processes(FEW, PARTLY, LENGTHS, False),
}
EVERY = pytest.mark.parametrize("case", CASES)
SMALL = 1e-4  # differences in place of slopes


def correlate(a, b, lengths, rough):
    r = np.sqrt((((a[:, None] - b[None]) / lengths) ** 2).sum(axis=2))
    if not rough:
        return np.exp(-0.5 * r**2)
    # Matern's kernel of any smoothness, at 5/2
    z = np.sqrt(5.0) * np.maximum(r, 1e-9)
    return 2.0**-1.5 / special.gamma(2.5) * z**2.5 * special.kv(2.5, z)


def spell_out(points, values, lengths):
    """Return numbers, and the places of which they are weighted sums, slopes too."""
    places, weights, numbers = [], [], []
    for x, (value, *slopes) in zip(points, values, strict=True):
        places.append(x[None])
        weights.append([1.0])
        numbers.append(value)
        for j, slope in enumerate(slopes):
            if not np.isnan(slope).any():
                places.append(x + SMALL * np.array([[1.0], [-1.0]]) * np.eye(3)[j])
                weights.append(np.array([0.5, -0.5]) / SMALL * lengths[j])
                numbers.append(slope * lengths[j])
    return np.vstack(places), linalg.block_diag(*weights), np.array(numbers)


def condition(points, values, at, fitted):
    """Return means and covariance, with a trend of a vague prior."""
    # A prior of variance 1e6 on the trend makes it an ordinary conditional Gaussian.
    places, weights, numbers = spell_out(points, values, fitted.lengths)
    weights = linalg.block_diag(weights, np.eye(len(at)))
    every = np.vstack([places, at])
    trend = weights @ np.hstack([np.ones((len(every), 1)), every])
    kernel = correlate(every, every, fitted.lengths, fitted.rough)
    joint = weights @ kernel @ weights.T + 1e6 * trend @ trend.T
    n = len(numbers)
    among = joint[:n, :n] + gp.NUGGET * np.eye(n)
    gain = np.linalg.solve(among, joint[:n, n:]).T
    return gain @ numbers, joint[n:, n:] - gain @ joint[:n, n:]


@EVERY
def test_prediction_is_the_conditional_gaussian_and_its_slopes_are_its_own(case):
    fitted, step = CASES[case], 1e-4
    expected, covariance = condition(fitted.points, fitted.values, FRESH, fitted)
    assert_allclose(fitted.predict(FRESH), expected, atol=4e-3)
    sd = np.sqrt(covariance.diagonal())
    assert_allclose(fitted.unit_sd(FRESH), sd, rtol=1e-2, atol=1e-4)
    slopes = fitted.slopes(FRESH)
    for j in range(3):
        move = step * np.eye(3)[j]
        ahead, behind = (fitted.predict(FRESH + s * move) for s in (1.0, -1.0))
        change = (ahead - behind) / (2 * step)
        assert_allclose(slopes[:, :, j], change, rtol=1e-6, atol=1e-5)


@EVERY
def test_leaving_one_out_is_what_the_others_predict(case):
    fitted = CASES[case]
    points, values = fitted.points, fitted.values
    residual, sd = fitted.leave_out(values), fitted.left_out_sd
    for i in range(len(points)):
        rest, at = np.arange(len(points)) != i, points[i : i + 1]
        mean, covariance = condition(points[rest], values[rest], at, fitted)
        assert_allclose(residual[i], values[i, 0] - mean[0], atol=8e-3)
        assert_allclose(sd[i], np.sqrt(covariance[0] + gp.NUGGET), rtol=1e-2)


@EVERY
def test_the_covariance_after_further_solves_needs_no_values(case):
    fitted, extra = CASES[case], RNG.standard_normal((3, 3))
    sloped = fitted.values.shape[1] > 1  # then so are the next ones
    more = with_slopes(extra)[:, : fitted.values.shape[1]]
    solved, values = np.vstack([fitted.points, extra]), [fitted.values, more]
    _, covariance = condition(solved, np.concatenate(values), FRESH, fitted)
    after = fitted.unit_covariance(FRESH, extra)
    assert_allclose(after, covariance, rtol=0.01, atol=1e-3 if sloped else 1e-4)
    before = fitted.unit_covariance(FRESH, extra[:0]).diagonal()
    assert_allclose(before, fitted.unit_sd(FRESH) ** 2, atol=1e-6)


def test_the_kernel_is_rough_where_there_are_kinks():
    x = RNG.standard_normal((40, 3))
    assert gp.fit_processes(x, kinks(x)[:, None]).rough
    assert not gp.fit_processes(x, answers(x)[:, None]).rough


@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize(
    ("points", "values"),
    [(POINTS, VALUES), (FEW, PARTLY)],
    ids=["values", "partly"],
)
def test_the_lengths_maximise_the_restricted_likelihood(points, values, rough):
    # Second route: the density of contrasts that no linear trend moves.
    places, weights, numbers = spell_out(points, values, np.ones(3))
    trend = weights @ np.hstack([np.ones((len(places), 1)), places])
    contrasts = np.linalg.svd(trend)[0][:, 4:].T

    def cost(logs):
        lengths = np.exp(logs)
        scale = np.linalg.norm(spell_out(points, values, lengths)[1], axis=1)
        scale /= np.linalg.norm(weights, axis=1)
        R = weights @ correlate(places, places, lengths, rough) @ weights.T
        C = contrasts @ (R + np.diag(gp.NUGGET / scale**2)) @ contrasts.T
        total = 0.0
        for y in (contrasts @ numbers).T:
            variance = y @ np.linalg.solve(C, y) / len(y)
            total += 0.5 * np.linalg.slogdet(2 * np.pi * np.e * variance * C)[1]
        return total

    def ours(logs):
        return gp._restricted(points, values, np.exp(logs), rough, np.ones(2))[0]

    # Where lengths are long, differences in place of slopes lose digits.
    some = np.log([1.2, 1.0, 1.5])
    moved = some + np.array([0.2, -0.1, 0.3])
    expected = cost(moved) - cost(some)
    assert_allclose(ours(moved) - ours(some), expected, rtol=1e-4)
    if not rough:  # for which a smooth problem need not be best
        best = np.log(gp.fit_processes(points, values).lengths)
        widest = np.log(gp.LONGEST_LENGTH * points.std(axis=0))
        for step in 0.1 * np.vstack([np.eye(3), -np.eye(3)]):
            assert ours(np.minimum(best + step, widest)) >= ours(best) - 1e-3


def test_few_points_have_a_constant_trend_and_straight_outputs_change_nothing():
    few = gp.fit_processes(POINTS[:4], VALUES[:4])
    assert_allclose(few.predict(POINTS[:4]), VALUES[:4, 0], atol=0.1)
    assert np.isfinite(few.unit_sd(FRESH)).all()
    straight = [POINTS @ [1.0, 2.0, -3.0], np.full(len(POINTS), 3.0)]
    fitted = gp.fit_processes(
        POINTS, np.column_stack([VALUES[:, 0], *straight])[:, None]
    )
    mean = fitted.predict(FRESH)
    assert_allclose(mean[:, 2], FRESH @ [1.0, 2.0, -3.0], atol=1e-6)
    assert_allclose(mean[:, 3], 3.0, atol=1e-6)
    assert (fitted.amplitudes[2:] < 1e-6).all()
    assert_allclose(mean[:, :2], FITTED.predict(FRESH), atol=0.01)


def test_amplitudes_are_those_of_students_t_or_of_what_is_left_out():
    """Of 40 draws of the process: the variance of a t, unless errors are larger."""
    number, p = TREND.shape
    kernel = correlate(POINTS, POINTS, LENGTHS, False) + gp.NUGGET * np.eye(number)
    factor = np.linalg.cholesky(kernel)
    values = 10.0 * factor @ np.random.default_rng(1).standard_normal((number, 40))
    trend, white = np.linalg.solve(factor, TREND), np.linalg.solve(factor, values)
    residual = white - trend @ np.linalg.lstsq(trend, white)[0]
    of_t = (residual**2).sum(axis=0) / (number - p - 2)
    fitted = gp.Processes(POINTS, values[:, None], LENGTHS, False)
    z = fitted.leave_out(fitted.values) / fitted.left_out_sd[:, None]
    left_out = (z**2).mean(axis=0)
    assert 0.1 < (left_out > of_t).mean() < 0.9  # both occur
    assert_allclose(fitted.amplitudes**2, np.maximum(of_t, left_out), rtol=1e-3)
