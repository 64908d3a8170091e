"""Mixtures of Student-t distributions: density, draws, and fits, also to weights."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import emcee_femu as ef

S1 = np.array([[2.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 0.5]])
WEIGHTS, DF = np.array([0.3, 0.7]), 6.0
MEANS = np.array([[0.0, 1.0, 2.0], [3.0, -1.0, 0.0]])
MATRICES = np.array([S1, np.diag([1e-4, 1.0, 9.0])])
GAUSSIAN = 1e12  # degrees of freedom


def mixture(weights, means, matrices, df=8.0):
    return ef.IndependenceMove(weights, means, matrices, df).mixture


def components(d, df=DF):
    """Return the components' distributions by SciPy."""
    parts = zip(MEANS[:, :d], MATRICES[:, :d, :d], strict=True)
    return [
        stats.multivariate_t(mean, matrix, df=df, seed=i)
        for i, (mean, matrix) in enumerate(parts)
    ]


@pytest.mark.parametrize("d", [1, 3])
def test_the_density_is_that_of_scipy(d):
    scale = np.array([1e-8, 1.0, 1e11])[:d]  # units shift it by their logarithm
    x = 3 * np.random.default_rng(1).normal(size=(50, d))
    means, matrices = MEANS[:, :d], MATRICES[:, :d, :d]
    parts = np.column_stack([component.pdf(x) for component in components(d)]) * WEIGHTS
    plain = mixture(WEIGHTS, means, matrices, DF)
    scaled = mixture(WEIGHTS, means * scale, matrices * np.outer(scale, scale), DF)
    for distribution, units in ((plain, np.ones(d)), (scaled, scale)):
        shift = np.log(units).sum()
        log_parts = distribution.log_parts(x * units) + shift
        assert_allclose(log_parts, np.log(parts), rtol=1e-9)
        total = distribution.log_density(x * units) + shift
        assert_allclose(total, np.log(parts.sum(axis=1)), rtol=1e-9)
    squares = [
        np.einsum("ni,ij,nj->n", x - m, np.linalg.inv(S), x - m)
        for m, S in zip(means, matrices, strict=True)
    ]
    assert_allclose(plain.squared_distances(x), np.transpose(squares), rtol=1e-9)


def test_a_mixture_of_logarithms_has_density_and_draws_of_the_parameters():
    """By SciPy's density of the logarithms, over the volume; seen as it is again."""
    logs, rng = np.array([True, False, True]), np.random.default_rng(1)
    law = ef.IndependenceMove(WEIGHTS, MEANS, MATRICES, DF, logs).mixture
    x = law.draw(rng, 4_000)
    assert (x[:, logs] > 0).all() and (x[:, 1] < 0).any()
    seen = np.where(logs, np.log(np.abs(x)), x)
    parts = np.column_stack([part.pdf(seen) for part in components(3)]) * WEIGHTS
    volume = x[:, logs].prod(axis=1)
    assert_allclose(law.log_density(x), np.log(parts.sum(axis=1) / volume), rtol=1e-9)
    other = mixture(WEIGHTS, MEANS, MATRICES, DF).draw(rng, 4_000)
    for direction in (*np.eye(3), np.ones(3)):
        assert stats.ks_2samp(seen @ direction, other @ direction).pvalue > 1e-4
    narrow = replace(law, matrices=1e-6 * law.matrices)
    plain = narrow.seen_in(None)
    assert plain.logs is None and (plain.means[:, logs] > 0).all()
    near = narrow.draw(rng, 200)
    assert_allclose(plain.log_density(near), narrow.log_density(near), atol=0.2)
    assert_allclose(plain.seen_in(logs).matrices, narrow.matrices, rtol=1e-9)
    assert_allclose(plain.seen_in(logs).means, narrow.means, rtol=1e-9)


def test_a_fit_of_logarithms_is_that_to_the_logarithms_of_the_draws():
    draws, logs = np.random.default_rng(3).lognormal(size=(400, 2)), np.full(2, True)
    begin = mixture([1.0], np.zeros((1, 2)), np.eye(2)[None])
    shares = np.full(400, 1 / 400)
    fitted, gained = replace(begin, logs=logs).improve(draws, shares)
    same, other = begin.improve(np.log(draws), shares)
    assert_allclose(fitted.matrices, same.matrices, rtol=1e-12)
    assert gained == other and fitted.logs is logs


@pytest.mark.parametrize("random", [np.random.default_rng(2), np.random.RandomState(2)])
@pytest.mark.parametrize("d", [1, 3])
def test_draws_are_those_of_the_mixture(d, random):
    x = mixture(WEIGHTS, MEANS[:, :d], MATRICES[:, :d, :d], DF).draw(random, 20_000)
    shares = zip(WEIGHTS, components(d), strict=True)
    parts = [component.rvs(round(60_000 * w)).reshape(-1, d) for w, component in shares]
    reference = np.concatenate(parts)
    for direction in (*np.eye(d), np.ones(d), (-1.0) ** np.arange(d)):
        test = stats.ks_2samp(x @ direction, reference @ direction)
        assert test.pvalue > 1e-4


def test_one_gaussian_has_the_moments_of_the_weighted_draws():
    rng = np.random.default_rng(3)
    x, shares = rng.normal(size=(200, 3)), rng.random(200) ** 4
    shares /= shares.sum()
    before = 2 * np.eye(3)
    start = mixture([1.0], np.full((1, 3), 5.0), before[None], GAUSSIAN)
    fit, gained = start.improve(x, shares)
    mean = shares @ x
    covariance = (shares * (x - mean).T) @ (x - mean)
    n = 1 / np.sum(shares**2)  # draws that the weights are worth
    assert_allclose(fit.means[0], mean, rtol=1e-6)
    expected = (n * covariance + 4 * before) / (n + 4)  # d + 1 draws said before
    assert_allclose(fit.matrices[0], expected, rtol=1e-6)
    assert gained == pytest.approx(shares @ fit.log_density(x), rel=1e-9)


def test_weighted_draws_of_another_distribution_give_the_target():
    """Uniform draws with the weights of a mixture are fitted by that mixture."""
    rng = np.random.default_rng(4)
    means, matrices = np.array([[-3.0, 0], [2, 1]]), np.array([S1[:2, :2]] * 2)
    target = mixture([0.25, 0.75], means, matrices)
    x = rng.uniform(-12, 12, (40_000, 2))
    shares = np.exp(target.log_density(x))
    shares /= shares.sum()
    start = mixture([0.5, 0.5], means + 0.7, matrices)
    fit, _ = start.improve(x, shares, tolerance=1e-7)
    assert_allclose(fit.weights, target.weights, atol=0.02)
    assert_allclose(fit.means, target.means, atol=0.1)
    assert_allclose(fit.matrices, target.matrices, atol=0.15)


def test_fit_recovers_one_dimension_and_finds_at_most_six_modes():
    distribution = stats.t(8, loc=3.0, scale=2.0)
    move = ef.IndependenceMove.fit(distribution.rvs((60_000, 1), random_state=1))
    fitted = [move.means[0, 0], move.scale_matrices[0, 0, 0]]
    assert_allclose(fitted, [3, 4], rtol=0.03)
    noise = np.random.default_rng(0).normal(size=270)
    nine = (np.repeat(1e3 * np.arange(9.0), 30) + noise)[:, None]
    most = ef.IndependenceMove.fit(nine, "auto")
    assert len(most.weights) == 7  # six of them, and a cover
    draws = distribution.rvs((4_000, 1), random_state=2)
    assert len(ef.IndependenceMove.fit(draws, "auto").weights) == 1
    with pytest.raises(ValueError, match="samples: .*10"):
        ef.IndependenceMove.fit(nine[:9])


def test_auto_finds_the_number_of_modes_and_their_weights():
    # Nearly Gaussian components, for a Gaussian is best met by several of df = 8.
    rng = np.random.default_rng(0)
    draws = rng.standard_normal((2_000, 3))
    draws[:, 0] += np.where(rng.random(2_000) < 0.3, -5, 5)
    move = ef.IndependenceMove.fit(draws, "auto", df=200)
    left, right = np.argsort(move.means[:-1, 0])  # the last one covers the gap
    weights = move.weights[[left, right, 2]]
    assert_allclose(weights, [0.27, 0.63, 0.1], atol=0.03)
    assert_allclose(move.means[[left, right], 0], [-5, 5], atol=0.15)
    assert_allclose(move.scale_matrices[right], np.eye(3), atol=0.2)


def test_a_walker_that_never_moved_gets_a_component_of_its_own():
    draws = np.random.default_rng(0).normal(size=(10_000, 4))
    draws[::20] = [1e3, -2e3, 1e3, 0.0]
    move = ef.IndependenceMove.fit(draws, 2)
    assert_allclose(np.sort(move.weights), [0.045, 0.1, 0.855], atol=1e-3)
    assert np.isfinite(move.log_density(draws)).all()
    assert np.linalg.eigvalsh(move.scale_matrices).min() > 1e-7  # not nothing
