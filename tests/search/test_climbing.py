"""Climbs end at the maximum of their density, with its Gaussian, however thin."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.free_posterior import FreeModel, box, free_posterior

import emcee_femu as ef
from emcee_femu.evaluation.evaluator import Evaluation, Solver
from emcee_femu.search import quadratic
from emcee_femu.search.climbing import Climb, Maximum, climb, distinct
from emcee_femu.search.coordinates import Coordinates
from emcee_femu.search.curvature import Space
from emcee_femu.search.quadratic import log_integral, make_positive, moments_inside

# Lognormal times lognormal: the logarithms of s and t are Gaussian, and x by itself.
PRIOR = ef.IndependentPrior(
    {
        "s": stats.lognorm(2.0, scale=1e6),
        "t": stats.lognorm(0.5, scale=3.0),
        "x": stats.norm(-1.0, 2.0),
    }
)
MEASURED, SD = np.array([12.0, 1.5, 0.5]), np.array([0.4, 0.3, 1.0])
PRIOR_MEAN, PRIOR_SD = np.array([np.log(1e6), np.log(3.0), -1.0]), [2.0, 0.5, 2.0]
EVIDENCE = stats.norm.logpdf(MEASURED, PRIOR_MEAN, np.hypot(PRIOR_SD, SD)).sum()


def log_density(theta):
    at = np.column_stack([np.log(theta[:, :2]), theta[:, 2]])
    return stats.norm.logpdf(at, MEASURED, SD).sum(axis=1)


class Logs:
    """A model of logarithms, with derivatives."""

    names, variables = PRIOR.names, {"y": ef.Variable({"i": range(3)})}

    def __call__(self, p):
        return {"y": np.column_stack([np.log(p["s"]), np.log(p["t"]), p["x"]])}

    def jacobian(self, p):
        slopes = np.ones_like(p["x"]) / [p["s"], p["t"], np.ones_like(p["x"])]
        by = {n: slopes[i][:, None] * np.eye(3)[i] for i, n in enumerate("stx")}
        return self(p), {"y": by}


class Term(ef.likelihoods.term.Term):
    """A term whose information is known."""

    name, reads = "y", Logs.variables

    def deviations(self, parameters, response):
        r = response["y"] - MEASURED
        return r, np.broadcast_to(SD, r.shape)


CASES = {
    "rows": free_posterior(log_density, PRIOR, FreeModel()),
    "information": ef.LogPosterior(lambda p: Logs()(p), Term(), PRIOR),
    "jacobian": ef.LogPosterior(Logs(), Term(), PRIOR),
}


def test_of_a_gaussian_a_step_gains_what_it_predicts():
    evaluator = Evaluation(Solver(CASES["jacobian"], False))
    space = Space(evaluator, None, Coordinates.positive(PRIOR), None)
    (local,) = space.look(np.array([[13.5, 1.2, -1.0]]) / space.scale)
    ascent = Climb(local)
    ascent.choose(space.box)
    (there,) = space.look(ascent.target[None])
    assert ascent.predicted == pytest.approx(there.value - local.value, rel=0.05)


@pytest.mark.parametrize("case", CASES)
def test_a_climb_in_logarithms_ends_at_the_maximum_of_their_density(case):
    posterior = CASES[case]
    precision = SD**-2.0 + np.power(PRIOR_SD, -2.0)
    top = (MEASURED / SD**2 + PRIOR_MEAN / np.power(PRIOR_SD, 2)) / precision
    positive = Coordinates.positive(PRIOR)
    evaluator = Evaluation(Solver(posterior, False))
    starts = positive.sample(np.random.default_rng(1), 3)
    for end in climb(evaluator, starts, coordinates=positive):
        assert end.converged
        # 1e-3 of log-density may be left to gain.
        assert_allclose((end.theta - top) * precision**0.5, 0, atol=0.05)
        assert_allclose(np.diag(end.covariance) * precision, 1.0, rtol=0.1)
        assert end.log_evidence == pytest.approx(EVIDENCE, abs=0.05)
        row = positive.rows(evaluator, end.theta[None])[0]
        assert_allclose(end.row, row, rtol=1e-9)


def test_a_radius_that_was_too_short_grows_by_twice_a_step():
    evaluator = Evaluation(Solver(CASES["jacobian"], False))
    space = Space(evaluator, None, Coordinates.positive(PRIOR), None)
    (local,) = space.look(np.array([[16.0, 0.2, -1.0]]) / space.scale)
    ascent = Climb(local, radius=0.01)
    steps = 0
    while not ascent.ended:
        ascent.choose(space.box)
        if ascent.target is not None:
            ascent.take(*space.look(ascent.target[None], [ascent.local]))
            steps += 1
    assert ascent.converged
    assert steps < 15  # 300 of the first length


class Jump(Logs):
    """A response that jumps where s exceeds 1, as where modes change places."""

    def __call__(self, p):
        y = np.column_stack([p[name] for name in "stx"])
        return {"y": y + 50.0 * (y[:, :1] > 1.0)}

    def jacobian(self, p):
        ones = np.ones_like(p["x"])[:, None]
        return self(p), {"y": {n: ones * np.eye(3)[i] for i, n in enumerate("stx")}}


def test_a_climb_to_a_jump_of_the_response_ends_there_in_few_solves():
    prior = ef.IndependentPrior(dict.fromkeys("stx", stats.norm(0.0, 20.0)))
    evaluator = Evaluation(Solver(ef.LogPosterior(Jump(), Term(), prior), False))
    (end,) = climb(evaluator, np.array([[-7.0, 5.0, 3.0]]))
    assert end.converged
    assert 1.0 - 1e-3 < end.theta[0] <= 1.0
    assert evaluator.solves < 40


def test_a_narrow_maximum_on_the_side_of_a_wide_one_is_another():
    """It is half a standard deviation of the wide one away, and as high."""

    def density(x):
        wide, narrow = -0.5 * (x[:, 0] / 10) ** 2, -0.5 * ((x[:, 0] - 5) / 0.3) ** 2
        return np.logaddexp(wide, np.log(0.12) + narrow)

    evaluator = Evaluation(Solver(free_posterior(density, box(-50, 50, 1)), False))
    ends = climb(evaluator, np.array([[-3.0], [5.1], [-2.0]]))
    assert sorted(map(sorted, distinct(ends))) == [[0, 2], [1]]


def test_a_climb_leaves_a_saddle_on_its_higher_side():
    """Between two equal maxima the slope is small, and in their middle zero."""

    def density(x):
        high, low = (-0.5 * (x[:, 0] - top) ** 2 for top in (3.0, -3.0))
        return np.logaddexp(high, low) - 0.5 * x[:, 1] ** 2

    evaluator = Evaluation(Solver(free_posterior(density, box(-10, 10, 2)), False))
    near = np.array([-1e-6, -1e-7, 0.0, 1e-7, 1e-6])
    ends = climb(evaluator, np.column_stack([near, np.ones(5)]))
    tops = np.array([end.theta for end in ends])
    assert_allclose(np.abs(tops), [[3.0, 0.0]] * 5, atol=1e-4)
    assert np.array_equal(np.sign(tops[:, 0])[near != 0], np.sign(near[near != 0]))


@pytest.mark.parametrize("seed", range(4))
def test_the_mass_of_a_very_thin_gaussian_is_that_of_its_draws(seed):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    values = np.array([1e14, 1e6, 1.0, 1.0])
    curvature = make_positive((axes * values) @ axes.T)
    draws = rng.standard_normal((20_000, 4)) / np.sqrt(values) @ axes.T
    inside = (np.abs(draws) < 1.0).all(axis=1).mean()
    expected = np.log(inside) + 0.5 * (4 * np.log(2 * np.pi) - np.log(values).sum())
    found = log_integral(np.zeros(4), curvature, np.full(4, -1.0), np.full(4, 1.0))
    assert_allclose(found, expected, atol=0.17)


@pytest.mark.parametrize("gives_up", [False, True])
def test_a_step_inside_a_box_is_the_best_there(gives_up, monkeypatch):
    """The law of a maximum, also where LAPACK's SVD does not end."""
    solve = quadratic.lsq_linear

    def solved(*args, **options):
        if gives_up and options.get("lsq_solver") != "lsmr":  # the others take an SVD
            raise np.linalg.LinAlgError("SVD did not converge")
        return solve(*args, **options)

    monkeypatch.setattr(quadratic, "lsq_linear", solved)
    rng = np.random.default_rng(1)
    for _ in range(20):
        root = rng.normal(size=(5, 5))
        curvature, uphill = root @ root.T + np.eye(5), 5 * rng.normal(size=5)
        low, high = -rng.random(5), rng.random(5)
        step, gain = quadratic.step_within(uphill, curvature, low, high)
        slope = uphill - curvature @ step
        # No slope but at bounds, and there outwards.
        assert_allclose(np.clip(step + slope, low, high), step, atol=1e-4)
        assert gain == pytest.approx(uphill @ step - step @ curvature @ step / 2)


@pytest.mark.parametrize("steepest", [1.0, 1e3, 1e9])
def test_the_gaussian_at_bounds_falls_as_the_density_does(steepest):
    """Where it falls steeply from a bound, as an exponential of that slope."""
    rng = np.random.default_rng(5)
    factor = rng.normal(size=(4, 4))
    curvature = factor @ factor.T + 0.1 * np.eye(4)
    slopes = np.array([-steepest, -3.0 * steepest, 0.0, 0.0])
    covariance = np.linalg.inv(curvature + np.diag(slopes**2))
    at_bound = slopes < 0
    zero = np.zeros(4)
    top = Maximum(zero, zero, covariance, slopes, 0.0, at_bound, True, "")
    low, high = np.where(at_bound, 0.0, -np.inf), np.full(4, np.inf)
    sd = np.sqrt(np.diag(moments_inside(*top.gaussian, low, high)[1]))
    if steepest > 1.0:
        np.testing.assert_allclose(sd[:2] * -slopes[:2], 1.0, rtol=0.1)
        return
    mean, exact = zero + np.linalg.solve(curvature, slopes), np.linalg.inv(curvature)
    cut = np.sqrt(np.diag(moments_inside(mean, exact, low, high)[1]))
    np.testing.assert_allclose(sd, cut, rtol=1e-3)
