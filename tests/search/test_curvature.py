"""Quadratics about a point: of a quadratic density they are it, and few solves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.free_posterior import FreeModel, box

import emcee_femu as ef
from emcee_femu.evaluation.evaluator import Evaluation, Solver
from emcee_femu.search.coordinates import Coordinates
from emcee_femu.search.curvature import Local, Space, _bend

HESSIAN = np.array([[4.0, 1.5, 0.0], [1.5, 2.0, -0.7], [0.0, -0.7, 1.0]])
TOP = np.array([0.3, -0.2, 0.5])
UNIFORM = box(-6, 6, 3)


def quadratic(theta):
    far = theta - TOP
    return -0.5 * (far @ HESSIAN * far).sum(axis=1)


def space(density, prior=UNIFORM, box=None, guess=None):
    def term(parameters, _):
        return density(np.column_stack([parameters[n] for n in prior.names]))

    posterior = ef.LogPosterior(FreeModel(), term, prior)
    evaluator = Evaluation(Solver(posterior, False))
    return Space(evaluator, guess, Coordinates.plain(prior), box)


def test_of_a_quadratic_gradient_and_curvature_are_exact():
    seen = space(quadratic)
    point = np.array([1.0, 0.5, -1.0]) / seen.scale
    (local,) = seen.look(point[None])
    scales = np.outer(seen.scale, seen.scale)
    assert_allclose(local.curvature, HESSIAN * scales, rtol=1e-3, atol=1e-3)
    gradient = -HESSIAN @ (point * seen.scale - TOP) * seen.scale
    assert_allclose(local.gradient, gradient, rtol=1e-6)
    assert local.fresh and local.usable
    # The point, two on each axis, and one for each pair of axes.
    assert seen.evaluator.solves == 1 + 2 * 3 + 3


def test_a_curvature_that_predicts_is_not_found_anew():
    seen = space(quadratic)
    (first,) = seen.look(np.array([[1.0, 0.5, -1.0]]) / seen.scale)
    before = seen.evaluator.solves
    (second,) = seen.look(TOP[None] / seen.scale, [first])
    assert seen.evaluator.solves - before == seen.price == 7
    assert second.fresh
    assert_allclose(second.curvature, first.curvature)
    assert_allclose(second.gradient, 0.0, atol=1e-4)


def test_one_that_does_not_predict_is():
    def bent(theta):
        return quadratic(theta) - (theta**4).sum(axis=1)

    seen = space(bent)
    (first,) = seen.look(np.array([[2.0, 2.0, -2.0]]) / seen.scale)
    (second,) = seen.look(TOP[None] / seen.scale, [first])
    exact = (HESSIAN + np.diag(12 * TOP**2)) * np.outer(seen.scale, seen.scale)
    assert second.fresh
    assert_allclose(second.curvature, exact, rtol=1e-2, atol=1e-2 * np.abs(exact).max())


def test_a_point_that_is_lower_than_before_is_not_looked_around():
    seen = space(quadratic)
    (top,) = seen.look(TOP[None] / seen.scale)
    before = seen.evaluator.solves
    (low,) = seen.look(np.array([[4.0, 4.0, 4.0]]) / seen.scale, [top])
    assert seen.evaluator.solves - before == 1
    assert not low.usable


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_beside_a_failed_solve_the_slope_of_the_other_side_is_taken(side):
    point = np.array([1.0, 0.5, -1.0])

    def failing(theta):
        lost = side * (theta[:, 0] - point[0]) > 1e-12
        return np.where(lost, -np.inf, quadratic(theta))

    seen = space(failing)
    (local,) = seen.look(point[None] / seen.scale)
    gradient = -HESSIAN @ (point - TOP) * seen.scale
    assert_allclose(local.gradient, gradient, rtol=0.05)


@pytest.mark.parametrize("end", [-6.0, 6.0])
def test_at_a_bound_neighbours_are_inside(end):
    solved = []

    def watched(theta):
        solved.append(theta)
        return quadratic(theta)

    seen = space(watched)
    point = np.array([end, 0.0, 0.0])
    (local,) = seen.look(point[None] / seen.scale)
    assert np.abs(np.concatenate(solved)).max() <= 6.0
    assert_allclose(local.gradient, -HESSIAN @ (point - TOP) * seen.scale, rtol=1e-4)


def test_in_a_thin_slab_neighbours_are_inside():
    solved, slab = [], np.array([[1.0, 1.001], [-6.0, 6.0], [-6.0, 6.0]])

    def watched(theta):
        solved.append(theta)
        return quadratic(theta)

    seen = space(watched, box=slab)
    point = np.array([1.0004, 0.5, -1.0])
    (local,) = seen.look(point[None] / seen.scale)
    x = np.concatenate(solved)[:, 0]
    assert 1.0 <= x.min() and x.max() <= 1.001
    assert_allclose(local.gradient, -HESSIAN @ (point - TOP) * seen.scale, rtol=1e-4)


def test_information_of_the_terms_is_the_curvature_of_all_points():
    prior = ef.IndependentPrior({f"x{i}": stats.norm(0.0, 2.0) for i in range(2)})
    A, sd = np.array([[2.0, 1.0], [0.5, -1.0], [1.0, 3.0]]), 0.3
    dims = {"i": range(3)}

    class Linear:
        names, variables = prior.names, {"y": ef.Variable(dims)}

        def __call__(self, p):
            return {"y": np.column_stack([p["x0"], p["x1"]]) @ A.T}

    class Term(ef.likelihoods.term.Term):
        name, reads = "y", Linear.variables

        def deviations(self, parameters, response):
            r = response["y"] - 1.0
            return r, np.full(r.shape, sd)

    posterior = ef.LogPosterior(Linear(), Term(), prior)
    evaluator = Evaluation(Solver(posterior, False))
    seen = Space(evaluator, None, Coordinates.plain(prior), None)
    exact = (A.T @ A / sd**2 + np.eye(2) / 4.0) * np.outer(seen.scale, seen.scale)
    for local in seen.look(np.array([[0.0, 0.0], [1.0, -2.0]])):
        assert_allclose(local.curvature, exact, rtol=1e-6)


def test_the_correction_explains_how_the_gradient_changed():
    """The secant condition, which SR1 meets for any symmetric matrix."""
    rng = np.random.default_rng(3)
    old = np.diag([3.0, 1.0, 2.0])
    row = np.zeros(3)
    before = Local(np.zeros(3), row, rng.normal(size=3), old)
    step = rng.normal(size=3)
    here = Local(step, row, before.gradient - HESSIAN @ step, old)
    bent = _bend(before, here)
    assert_allclose(bent @ step, HESSIAN @ step)
    assert_allclose(bent, bent.T)
    same = Local(step, row, before.gradient - old @ step, old)
    assert_allclose(_bend(before, same), old, atol=1e-12)
