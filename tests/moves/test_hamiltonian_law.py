"""The Hamiltonian move keeps its target: exact starts, and mutants that must fail."""

from functools import cache
from unittest import mock

import emcee
import numpy as np
import pytest
from emcee.model import Model
from support.checks import LIMIT, exact_start
from support.smooth_laws import CutGaussian, SmoothGaussian, SmoothTriangle

from emcee_femu.moves import HamiltonianMove, hamiltonian, leapfrog
from emcee_femu.moves.leapfrog import Points, energies, energies_of, leap

TARGETS = {
    "gaussian": SmoothGaussian,
    "triangle": SmoothTriangle,
    "cut gaussian": CutGaussian,
}
UNIT, FAR = (1.0, 1.0, 1.0), (1e-8, 1.0, 1e8)
CASES = [  # metric, steps, step size, walkers, dimension, scale
    ("covariance", 3, 1.1, 1, 3, UNIT),
    ("covariance", 3, 1.1, 4, 3, FAR),
    ("variances", 4, 0.7, 2, 3, FAR),
    ("variances", 1, 0.7, 3, 5, UNIT),
    (None, 2, 1.2, 1, 1, UNIT),
    ("covariance", 3, 1.5, 2, 1, FAR),
]


# One target for each case, and all of them in the slow tests.
EACH = [
    pytest.param(case, target, marks=[pytest.mark.slow] * ((i + j) % 3 > 0))
    for i, case in enumerate(CASES)
    for j, target in enumerate(TARGETS)
]


@cache
def make_law(target, scale, ndim):
    return TARGETS[target](scale, ndim)


@cache
def make_metric(kind, law):
    draws = law.sample(np.random.default_rng(1), (4_000,))
    covariance = np.atleast_2d(np.cov(draws, rowvar=False))
    return {"covariance": covariance, "variances": np.diag(covariance)}.get(kind)


def make_move(case, law, make=HamiltonianMove):
    kind, steps, size, _, _, _ = case
    return make(make_metric(kind, law), steps, size)


def z_of(move, law, walkers=10_000, steps=6):
    """Return the largest |z| after a few steps from the target, walker by walker.

    The walkers are independent: one large ensemble does the work of many small ones.
    """
    start = law.sample(np.random.default_rng(3), (walkers,))
    state = emcee.State(start, log_prob=law(start))
    model = Model(law, None, map, np.random.RandomState(4))
    for _ in range(steps):
        state, _ = move.propose(model, state)
    values = law.statistics(state.coords)
    mean, error = values.mean(axis=0), values.std(axis=0) / np.sqrt(walkers)
    moved = error > 0
    if (np.abs(mean[~moved]) > 1e-9).any():
        return np.inf
    return float(np.abs(mean[moved] / error[moved]).max())


@pytest.mark.parametrize(("case", "target"), EACH)
def test_the_move_keeps_the_target(case, target):
    law = make_law(target, case[-1], case[-2])
    assert z_of(make_move(case, law), law) < LIMIT


@pytest.mark.parametrize(("case", "target"), EACH[:3] + EACH[-6:-3])
def test_a_few_walkers_keep_the_target(case, target):
    law = make_law(target, case[-1], case[-2])
    move = make_move(case, law)
    assert exact_start(move, law, case[3], ensembles=200, steps=4) < LIMIT


@pytest.mark.parametrize("target", TARGETS)
def test_moves_in_reciprocals_keep_the_target(target):
    law = make_law(target, FAR, 3)
    about = law.scale * [2.5, -3.0, 0.0]  # the last one moves as it is
    move = HamiltonianMove(make_metric("covariance", law), 3, 0.8, about)
    assert z_of(move, law) < LIMIT
    assert exact_start(move, law, 2, ensembles=50, steps=3) < LIMIT


@pytest.mark.parametrize("reciprocal", [False, True])
@pytest.mark.parametrize("ndim", [1, 4])
def test_the_energy_error_falls_with_the_square_of_the_step(ndim, reciprocal):
    # A wrong factor on one side would still be reversible: only slow.
    law = make_law("gaussian", FAR, ndim)
    rng = np.random.default_rng(2)
    factor = law.scale[:, None] * np.linalg.cholesky(np.linalg.inv(law.precision))
    factor = factor @ np.diag(np.linspace(0.5, 1.0, ndim))
    coords, momenta = law.sample(rng, (50,)), rng.standard_normal((50, ndim))
    about = law.mean * (np.arange(ndim) != 1) if reciprocal else None
    coords = np.maximum(coords, 2.0 * law.scale)  # where reciprocals are smooth

    def error(steps):
        rows, gradient = law.gradient(coords)
        here = Points(np.arange(50), coords, momenta, rows, gradient)
        before = energies_of(here, about)
        for _ in range(steps):
            here = leap(law.gradient, here, np.full(50, 1.4 / steps), factor, about)
        after = energies_of(here, about)
        return np.sqrt(np.mean((after - before) ** 2))

    assert error(8) < 0.05
    assert 3.8 < error(8) / error(16) < 4.2


# Mutants: each breaks the move in one way, and the exact start must see it.


def without_last_kick(evaluate, start, sizes, factor, about=None):
    end = leap(evaluate, start, sizes, factor)
    kick = 0.5 * sizes[end.walkers, None] * (end.gradient @ factor)
    return end._replace(momenta=end.momenta - kick)


def steps_by_place(evaluate, start, sizes, factor, about=None):
    place = (np.arctan(start.coords[:, 0] - 3.0) + 2.0) / 2.0
    own = sizes.copy()
    own[start.walkers] *= place
    return leap(evaluate, start, own, factor)


def clipped(evaluate, start, sizes, factor, about=None):
    def inside(theta):
        theta[:] = np.clip(theta, 2.5001, 3.9999)
        return evaluate(theta)

    return leap(inside, start, sizes, factor)


def without_kinetic_energy(log_prob, momenta):
    return log_prob


def potential_alone_at_the_end(log_prob, momenta):
    return energies(log_prob, 0.9 * momenta)


MUTANTS = {  # what is replaced, by what, target
    "no last half step": ("leap", without_last_kick, "gaussian"),
    "steps by place": ("leap", steps_by_place, "gaussian"),
    "clipped at bounds": ("leap", clipped, "cut gaussian"),
    "no kinetic energy": ("energies", without_kinetic_energy, "gaussian"),
    "less kinetic energy": ("energies", potential_alone_at_the_end, "gaussian"),
}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_the_check_catches_a_broken_move(mutant):
    name, broken, target = MUTANTS[mutant]
    law = make_law(target, UNIT, 3)
    module = hamiltonian if name == "leap" else leapfrog
    with mock.patch.object(module, name, broken):
        assert z_of(make_move(CASES[0], law), law) > LIMIT


def test_the_check_catches_a_density_that_stays_that_of_the_parameters():
    law = make_law("gaussian", UNIT, 3)
    move = HamiltonianMove(make_metric("covariance", law), 3, 0.8, law.mean)
    with mock.patch.object(leapfrog, "log_volume", lambda theta, about: 0.0):
        assert z_of(move, law) > LIMIT


class Stream:
    """A random stream of whose normal numbers something is made."""

    def __init__(self, random, normal):
        self.uniform, self.standard_exponential = (
            random.uniform,
            random.standard_exponential,
        )
        self.standard_normal = normal


class OfOneSign(HamiltonianMove):
    def propose(self, model, state):
        def normal(size):
            return np.abs(model.random.standard_normal(size))

        stream = Stream(model.random, normal)
        return super().propose(model._replace(random=stream), state)


class NeverDrawnAgain(HamiltonianMove):
    def propose(self, model, state):
        stream = Stream(model.random, np.random.RandomState(5).standard_normal)
        return super().propose(model._replace(random=stream), state)


@pytest.mark.parametrize("broken", [OfOneSign, NeverDrawnAgain])
def test_the_check_catches_momenta_of_another_law(broken):
    law = make_law("gaussian", UNIT, 3)
    assert z_of(make_move(CASES[0], law, broken), law) > LIMIT


def test_a_walker_in_a_valley_too_narrow_for_the_steps_gets_out():
    class Valley(SmoothGaussian):  # a fifth as wide on the left of zero
        def sd(self, theta):
            return np.where(theta[:, :1] < 0, 0.1, 1.0)

        def __call__(self, theta):
            return -0.5 * (((theta - 5.0) / self.sd(theta)) ** 2).sum(axis=1)

        def slope(self, theta):
            return -(theta - 5.0) / self.sd(theta) ** 2

    law = Valley()
    start = np.full((20, 3), -1.0)
    state = emcee.State(start, log_prob=law(start))
    model = Model(law, None, map, np.random.RandomState(4))
    for _ in range(150):
        state, _ = HamiltonianMove(np.ones(3), 4, 0.5).propose(model, state)
    assert (state.coords[:, 0] > 0).all()
