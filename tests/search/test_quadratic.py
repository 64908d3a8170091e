"""The Gaussian at a maximum: its mass inside bounds, against quadrature."""

import numpy as np
import pytest

from emcee_femu.search import quadratic
from emcee_femu.search.quadratic import draw_inside, log_integral

SIDE = 0.7  # of the box, upwards from the maximum
NODES, WEIGHTS = np.polynomial.legendre.leggauss(60)


def by_quadrature(gradient, curvature):
    """Return the log of the integral, the mean and the sds, by Gauss and Legendre.

    Each coordinate is that of an exponential as steep as the density's.
    """
    steep = np.maximum(-gradient, 1.0)
    cut = -np.expm1(-steep * SIDE)
    t = np.meshgrid(*[(NODES + 1) / 2] * len(gradient), indexing="ij")
    t = np.stack([x.ravel() for x in t], axis=1)
    p = -np.log1p(-t * cut) / steep
    shares = np.prod(
        np.meshgrid(*[WEIGHTS / 2] * len(gradient), indexing="ij"), axis=0
    ).ravel()
    log_f = p @ gradient - 0.5 * np.einsum("ni,ij,nj->n", p, curvature, p)
    log_q = (np.log(steep / cut) - steep * p).sum(axis=1)
    parts = shares * np.exp(log_f - log_q)
    mean = parts @ p / parts.sum()
    return np.log(parts.sum()), mean, np.sqrt(parts @ (p - mean) ** 2 / parts.sum())


CASES = [
    (d, steepest, correlation)
    for d in (1, 2, 3)
    for steepest in (0.0, 3.0, 1e2, 1e4, 1e8)
    for correlation in (-0.45, 0.0, 0.95)
]


def corner(d, steepest, correlation):
    """Return gradient, curvature and a box in whose lowest corner the maximum is.

    The density falls from each lower bound, three times as steeply from the next.
    """
    gradient = -steepest * 3.0 ** np.arange(d)
    curvature = (1 - correlation) * np.eye(d) + correlation
    return gradient, 20.0 * curvature, np.zeros(d), np.full(d, SIDE)


@pytest.mark.parametrize(("d", "steepest", "correlation"), CASES)
def test_what_a_box_holds_is_what_quadrature_says(d, steepest, correlation):
    gradient, curvature, low, high = corner(d, steepest, correlation)
    exact = by_quadrature(gradient, curvature)[0]
    found = log_integral(gradient, curvature, low, high)
    assert found == pytest.approx(exact, abs=0.15)


@pytest.mark.parametrize(("d", "steepest", "correlation"), CASES)
def test_draws_of_a_box_have_its_moments(d, steepest, correlation):
    if steepest == 1e8:
        return  # the mean is too far away to be written beside the box
    gradient, curvature, low, high = corner(d, steepest, correlation)
    _, mean, sd = by_quadrature(gradient, curvature)
    covariance = np.linalg.inv(curvature)
    draws, weights = draw_inside(covariance @ gradient, covariance, low, high)
    assert weights.sum() == pytest.approx(1)
    assert ((draws >= low) & (draws <= high)).all()
    found = weights @ draws
    np.testing.assert_allclose((found - mean) / sd, 0.0, atol=0.15)
    spread = np.sqrt(weights @ (draws - found) ** 2)
    np.testing.assert_allclose(spread / sd, 1.0, atol=0.1)


def test_upper_bounds_are_as_lower_ones():
    gradient, curvature, low, high = corner(3, 1e3, 0.95)
    one = log_integral(gradient, curvature, low, high)
    other = log_integral(-gradient, curvature, -high, -low)
    assert one == pytest.approx(other, abs=0.1)


def test_a_maximum_at_one_bound_and_inside_others():
    """Where its mean in the other coordinates is moved by the steep bound."""
    curvature = np.array([[4.0, 3.0, 0.0], [3.0, 9.0, 1.0], [0.0, 1.0, 25.0]])
    gradient = np.array([-1e3, 0.0, 0.0])
    low, high = np.array([0.0, -20.0, -20.0]), np.full(3, 20.0)
    free = np.linalg.slogdet(curvature[1:, 1:])[1]
    exact = np.log(2 * np.pi) - 0.5 * free - np.log(1e3)
    found = quadratic.log_integral(gradient, curvature, low, high)
    assert found == pytest.approx(exact, abs=0.02)


def test_a_direction_without_curvature_is_damped_to_the_radius():
    """Its eigenvalue is lost beside the damping."""
    gradient, curvature = np.array([0.3, 4.0]), np.diag([1e-30, 1e-17])
    free = np.full(2, -np.inf), np.full(2, np.inf)
    for radius in (1e-3, 1.0, 1e3):
        damping = quadratic.find_damping(gradient, curvature, radius, *free)
        step = gradient / (np.diag(curvature) + damping)
        assert np.isclose(np.linalg.norm(step), radius, rtol=1e-2)


def test_a_step_along_a_bound_is_no_longer_than_the_radius():
    """Without the bound it would be short, and with it long: they are correlated."""
    curvature = np.array([[100.0, 9.9], [9.9, 1.0]])
    shortest, radius = np.array([-0.1, 0.0]), 0.2
    gradient = curvature @ shortest
    low, high = np.array([0.0, -9.0]), np.full(2, 9.0)
    free, _ = quadratic.step_within(gradient, curvature, low, high)
    damping = quadratic.find_damping(gradient, curvature, radius, low, high)
    damped = curvature + damping * np.eye(2)
    step, _ = quadratic.step_within(gradient, damped, low, high)
    assert np.linalg.norm(free) > radius
    assert np.linalg.norm(step) == pytest.approx(radius, rel=1e-2)
