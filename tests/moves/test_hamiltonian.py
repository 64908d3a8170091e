"""The Hamiltonian move: its target, its solves, runs of it, and its tuning."""

from types import SimpleNamespace

import emcee
import numpy as np
import pytest
from emcee.model import Model
from support.checks import LIMIT, BoundedTriangle, Gaussian, exact_start
from support.gradients import PRIOR, TERM, Derived, Failing, Solver
from support.runs import never

import emcee_femu as ef
from emcee_femu.moves.hamiltonian import Points, _travel


class Differentiable:
    """What a move asks of a posterior; a law beside it is the density."""

    def gradient(self, theta):
        """Return log densities and gradients, NaN where the density is zero."""
        log_prob = self(theta)
        gradient = np.full(theta.shape, np.nan)
        inside = log_prob > -np.inf
        gradient[inside] = self.slope(theta[inside])
        return log_prob[..., None], gradient


class SmoothGaussian(Differentiable, Gaussian):
    """The correlated Gaussian."""

    def slope(self, theta):
        x = (theta - self.mean) / self.scale
        return -(x @ self.precision) / self.scale


class SmoothTriangle(Differentiable, BoundedTriangle):
    """The density that rises to an edge of its box."""

    def slope(self, theta):
        return 1 / theta


TARGETS = {"gaussian": SmoothGaussian, "triangle": SmoothTriangle}
UNIT, FAR = (1.0, 1.0, 1.0), (1e-8, 1.0, 1e8)
CASES = [  # metric, steps, step size, dimension, scale
    ("covariance", 3, 1.1, 3, FAR),
    ("variances", 1, 0.7, 5, UNIT),
    (None, 2, 1.2, 1, UNIT),
]


def make_metric(kind, target):
    draws = target.sample(np.random.default_rng(1), (4_000,))
    covariance = np.atleast_2d(np.cov(draws, rowvar=False))
    return {"covariance": covariance, "variances": np.diag(covariance)}.get(kind)


def make_move(case, target):
    kind, steps, size, _, _ = case
    return ef.moves.HamiltonianMove(make_metric(kind, target), steps, size)


def travel(move, target, walkers=6_000, steps=5):
    """Return the share of accepted steps of walkers from the target."""
    start = target.sample(np.random.default_rng(3), (walkers,))
    state, accepted = emcee.State(start, log_prob=target(start)), []
    model = Model(target, None, map, np.random.RandomState(4))
    for _ in range(steps):
        state, moved = move.propose(model, state)
        accepted.append(moved.mean())
    # Several points round otherwise than few.
    np.testing.assert_allclose(state.log_prob, target(state.coords), 1e-9, 1e-9)
    return np.mean(accepted)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("case", CASES)
def test_the_move_keeps_the_target(case, target):
    target = TARGETS[target](case[-1], case[-2])
    # The walkers are independent: few large ensembles do the work of many small ones.
    assert exact_start(make_move(case, target), target, 150, 40, 5) < LIMIT


class WrongGradient(SmoothGaussian):
    """Its gradient is that of another target: a bad guide, no wrong one."""

    def slope(self, theta):
        return 0.5 * super().slope(theta) + 0.4 * np.sin(theta / self.scale)


def test_a_wrong_gradient_costs_acceptance_and_nothing_else():
    target = WrongGradient()
    move = make_move(("covariance", 3, 1.1, 3, UNIT), target)
    assert exact_start(move, target, 150, 40, 5) < LIMIT
    right = travel(move, SmoothGaussian())
    assert 0.1 < travel(move, target) < 0.9 * right


@pytest.mark.parametrize("ndim", [1, 4])
def test_rejections_fall_with_the_square_of_the_step(ndim):
    # A wrong factor on one side would still be reversible: only slow.
    target = SmoothGaussian(FAR, ndim)
    metric = np.atleast_2d(make_metric("covariance", target))

    def rejected(steps):
        move = ef.moves.HamiltonianMove(0.6 * metric, steps, 1.4 / steps)
        return 1 - travel(move, target, 20_000)

    assert rejected(2) < 0.2
    assert 3.6 < rejected(2) / rejected(4) < 4.6


def run(moves, posterior, nwalkers=12, steps=8, **options):
    options = {"seed": 5, "ensembles": 1, **options}
    return ef.run(posterior, moves, nwalkers, steps, **options)


def test_a_step_costs_one_solve_and_none_beyond_the_bounds():
    model = Derived()
    wide = ef.GaussianPrior(["a", "b"], [1.0, 1.0], 0.1)
    move = ef.moves.HamiltonianMove([0.002, 0.002], steps=4, step_size=0.3)
    start = np.random.default_rng(1).normal(1.0, 0.02, (10, 2))
    run(move, ef.LogPosterior(model, TERM, wide), 10, 7, starts=start)
    # The prior mean, the starts, their gradients, and then nothing but steps.
    assert sum(model.solved) == 1 + 10 + 10 + 10 * 7 * 4
    assert model.solved[2:] == [10] * (1 + 7 * 4)

    model = Derived()
    run(move, ef.LogPosterior(model, TERM, PRIOR), 10, 30)
    inside = model.solved[3:]
    assert sum(inside) < 10 * 30 * 4 and 0 < min(inside) < 10


def test_a_failure_names_its_place():
    posterior = ef.LogPosterior(Failing(), TERM, PRIOR)
    move = ef.moves.HamiltonianMove([0.003, 0.003], steps=3, step_size=0.5)
    start = np.full((12, 2), [1.07, 0.95]) + 1e-4 * np.arange(12)[:, None]
    with pytest.raises(ArithmeticError) as caught:
        run(move, posterior, 12, 40, starts=start)
    assert "'a': 1." in "".join(getattr(caught.value, "__notes__", []))


def test_what_has_no_gradients_is_refused_by_name():
    move = ef.moves.HamiltonianMove()
    sampler = emcee.EnsembleSampler(4, 2, never, moves=move)
    with pytest.raises(TypeError, match="log_prob_fn.*gradient"):
        sampler.run_mcmc(emcee.State(np.eye(4)[:, :2], log_prob=np.zeros(4)), 1)
    posterior = ef.LogPosterior(Solver(), TERM, PRIOR)
    for options in ({}, {"on_failure": "reject"}, {"workers": 1}):
        with pytest.raises(TypeError, match="jacobian"):
            run([(move, 1.0)], posterior, 8, **options)


def test_tuning_finds_80_percent_acceptance_and_long_enough_trajectories():
    target = SmoothGaussian((1e-3, 1.0, 1e6), 20)
    samples = target.sample(np.random.default_rng(1), (24,))
    kept = samples.copy()
    spread = np.outer(target.scale, target.scale) * (target.factor @ target.factor.T)
    tuned = ef.moves.HamiltonianMove.tuned
    move = tuned(target, samples, 1.5 * spread, seed=1)
    assert repr(move) == repr(tuned(target, kept, 1.5 * spread, seed=1))
    assert np.array_equal(samples, kept)
    assert 1.0 < move.steps * move.step_size < 3.0
    # With variances alone, the correlation makes long trajectories worth their solves.
    poor = tuned(target, samples, np.diag(spread), seed=1)
    assert poor.steps > 2 * move.steps and poor.steps * poor.step_size > 2.0
    sampler = emcee.EnsembleSampler(50, 20, target, moves=move, vectorize=True)
    sampler.run_mcmc(target.sample(np.random.default_rng(2), (50,)), 60)
    assert 0.58 < sampler.acceptance_fraction.mean() < 0.95


def test_in_tuning_the_steps_of_walkers_lie_on_both_sides_of_their_mean():
    seen = []

    def step(here, sizes):
        seen.append(sizes)
        return here

    n = 60
    here = Points(np.arange(n), *np.zeros((4, n, 2)))
    _travel(SimpleNamespace(step=step), here, 1.0, 0.5, np.random.default_rng(1))
    assert len(seen) == 2 and np.array_equal(*seen)  # one size on all of its way
    assert 0.4 <= seen[0].min() < 0.44 and 0.56 < seen[0].max() <= 0.6
