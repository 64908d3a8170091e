import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from emcee_femu.figures.ellipses import covariance_ellipse

SQUARE = np.array([[1.0, 1], [1, -1], [-1, 1], [-1, -1]])  # covariance 4/3


def share_inside(points, ellipse):
    angle = np.radians(ellipse.angle)
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    along = (points - ellipse.centre) @ axes.T / ellipse.semi_axes
    return ((along * along).sum(axis=1) <= 1).mean()


def covariance(sd_x, sd_y, correlation):
    mixed = sd_x * sd_y * correlation
    return np.array([[sd_x**2, mixed], [mixed, sd_y**2]])


SHAPES = {
    "round": covariance(1.0, 1.0, 0.0),
    "wide": covariance(30.0, 1.0, 0.5),
    "narrow": covariance(2.0, 2.0, 0.99),
    "narrow down": covariance(1.0, 5.0, -0.99),
    "tiny and large": covariance(1e-8, 1e3, 0.9),
    "tiny": covariance(1e-8, 3e-8, -0.6),
}


@pytest.mark.parametrize("probability", [0.1, 0.5, 0.95, 0.99])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_ellipse_holds_its_share_of_a_gaussian(shape, probability):
    rng, n = np.random.default_rng(1), 40_000
    sd = np.sqrt(np.diag(SHAPES[shape]))
    correlated = np.linalg.cholesky(SHAPES[shape] / np.outer(sd, sd))
    first, second = rng.normal(size=(2, n, 2)) @ correlated.T * sd + [3.0, -7.0] * sd
    ellipse = covariance_ellipse(first, probability)
    inside = share_inside(second, ellipse)  # points that did not shape the ellipse
    # Two sampling errors: of the share, and of the ellipse's area.
    variance = probability * (1 - probability) / n
    area = (1 - probability) * np.log(1 - probability)
    assert abs(inside - probability) < 4 * np.sqrt(variance + area**2 / n)
    if sd[1] < 100 * sd[0]:  # Mahalanobis distances, without angle and axes
        offsets = first - first.mean(axis=0)
        inverse = np.linalg.inv(np.cov(first.T))
        squares = np.einsum("ni,ij,nj->n", offsets, inverse, offsets)
        limit = stats.chi2.ppf(probability, 2)
        assert share_inside(first, ellipse) == (squares <= limit).mean()


@pytest.mark.parametrize("probability", [1e-12, 0.1, 0.5, 0.95, 0.999, 1 - 1e-12])
def test_the_radius_is_chi_squared_with_two_degrees_of_freedom(probability):
    semi_axes = covariance_ellipse(SQUARE * [3, 1], probability).semi_axes
    radius = np.sqrt(stats.chi2.ppf(probability, 2))
    assert_allclose(semi_axes, radius * np.array([3, 1]) * np.sqrt(4 / 3), rtol=1e-9)


def test_the_default_is_95_percent():
    semi_axes = covariance_ellipse(SQUARE).semi_axes
    assert_allclose(semi_axes, np.sqrt(-2 * np.log(0.05) * 4 / 3), rtol=1e-14)


@pytest.mark.parametrize("turn", [10.0, 77.0, 90.0, 160.0, 300.0])
def test_turned_and_shifted_points_turn_and_shift_the_ellipse(turn):
    points = SQUARE * [3.0, 0.5] + [[0.1, 0.0], [0.0, 0.0], [0.0, 0.2], [0.0, 0.0]]
    cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    rotation = np.array([[cosine, -sine], [sine, cosine]])
    before = covariance_ellipse(points)
    after = covariance_ellipse(points @ rotation.T + [2.0, 5.0])
    assert_allclose(after.semi_axes, before.semi_axes, rtol=1e-12)
    assert_allclose(after.centre, rotation @ before.centre + [2.0, 5.0], rtol=1e-12)
    difference = (after.angle - before.angle - turn + 90) % 180 - 90
    assert abs(difference) < 1e-9


def test_points_on_a_line_have_a_minor_axis_of_zero():
    ellipse = covariance_ellipse(np.outer(np.arange(5.0), [1.0, 1.0]) / 3)
    assert_allclose(ellipse.angle % 180, 45, atol=1e-9)
    assert 0 <= ellipse.semi_axes[1] < 1e-7 * ellipse.semi_axes[0]
