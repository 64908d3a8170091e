"""Snooker and crossover keep their target, and mutants of them do not."""

import emcee
import numpy as np
import pytest
from support.checks import LIMIT, BoundedTriangle, Gaussian, exact_start

from emcee_femu.moves import CrossoverMove, SnookerMove

TARGETS = {"gaussian": Gaussian, "bounded": BoundedTriangle}
SCALE = (1e-8, 1.0, 1e8)
BOLD = {"live_dangerously": True}
QUICK = {"ensembles": 300, "steps": 5}
SIZES = [  # the fewest legal walkers: in two splits, one after another; then many
    *[(SnookerMove(**BOLD), 6), (SnookerMove(nsplits=4, **BOLD), 4)],
    *[(CrossoverMove(**BOLD), 12), (CrossoverMove(nsplits=7, **BOLD), 7)],
    *[(SnookerMove(), 32), (CrossoverMove(), 32)],
]
SETTINGS = [
    SnookerMove((0.1, 3.0), **BOLD),
    SnookerMove((1.7, 1.7), nsplits=3, randomize_split=False, **BOLD),
    CrossoverMove(1, **BOLD),
    CrossoverMove(2, 0.1 * np.ones(1), 0.0, **BOLD),
    CrossoverMove(3, [1.0], 0.1, nsplits=6, **BOLD),
    CrossoverMove(3, [0.5, 0.9], nsplits=4, randomize_split=False, **BOLD),
]
either = pytest.mark.parametrize("target", TARGETS)


@either
@pytest.mark.parametrize("ndim", [3, 5])
@pytest.mark.parametrize(("move", "nwalkers"), SIZES)
def test_the_moves_keep_the_target_for_any_number_of_walkers(
    target, ndim, move, nwalkers
):
    assert exact_start(move, TARGETS[target](ndim=ndim), nwalkers, **QUICK) < LIMIT


@either
@pytest.mark.parametrize("move", SETTINGS)
def test_the_moves_keep_the_target_with_every_setting(target, move):
    assert exact_start(move, TARGETS[target](), 12, **QUICK) < LIMIT


@either
@pytest.mark.parametrize("move", [SnookerMove(), CrossoverMove()])
def test_the_moves_keep_targets_whose_axes_differ_by_1e16(target, move):
    assert exact_start(move, TARGETS[target](SCALE, 5), 12, **QUICK) < LIMIT


@pytest.mark.slow
@either
@pytest.mark.parametrize("ndim", [3, 5])
@pytest.mark.parametrize(("move", "nwalkers"), SIZES[:4:2])
def test_the_moves_keep_the_target_at_high_power(target, ndim, move, nwalkers):
    law = TARGETS[target](ndim=ndim)
    assert exact_start(move, law, nwalkers, ensembles=8_000, steps=15) < LIMIT


@pytest.mark.parametrize("move", [SnookerMove(), CrossoverMove()])
def test_scaled_axes_give_the_same_chain_as_unit_axes(move):
    def chain(scale):
        target = Gaussian(scale)
        start = target.sample(np.random.default_rng(1), (12,))
        sampler = emcee.EnsembleSampler(12, 3, target, moves=move, vectorize=True)
        stream = np.random.RandomState(1).get_state()
        sampler.run_mcmc(emcee.State(start, random_state=stream), 200)
        return sampler.get_chain() / target.scale

    scale = 2.0 ** np.array([-27.0, 0.0, 27.0])  # exact in floating point
    np.testing.assert_allclose(chain(scale), chain((1, 1, 1)), rtol=1e-9)


class Textbook(SnookerMove):
    """The snooker update walker by walker, with two exponents to break it by."""

    def __init__(self, length=1.0, jacobian=1.0, **settings):
        super().__init__(**settings)
        self.length, self.jacobian = length, jacobian

    def get_proposal(self, s, c, random):
        guides, sd = np.concatenate(c), np.concatenate(c).std(axis=0)
        proposed, factors = np.empty_like(s), np.empty(len(s))
        for i, theta in enumerate(s / sd):
            z, z1, z2 = guides[random.choice(len(guides), 3, replace=False)] / sd
            norm = np.linalg.norm(theta - z)
            u = (theta - z) / norm**self.length
            new = theta + random.uniform(*self.gamma) * u * (u @ z1 - u @ z2)
            proposed[i] = new * sd
            factors[i] = np.log(np.linalg.norm(new - z) / norm)
        return proposed, self.jacobian * (s.shape[1] - 1) * factors


class GuidedByItself(CrossoverMove):
    """May take the walker that it moves for one of a pair."""

    def get_proposal(self, s, c, random):
        propose = super().get_proposal
        proposed = [propose(one[None], [np.vstack([*c, one])], random) for one in s]
        return np.vstack([q for q, _ in proposed]), None


MUTANTS = {
    "snooker without Jacobian": (Textbook(jacobian=0.0), 5, 10),
    "snooker, exponent halved": (Textbook(jacobian=0.5), 5, 10),
    "snooker, direction of emcee 3.1.6": (Textbook(length=0.5), 5, 10),
    "snooker of emcee 3.1.6": (Textbook(length=0.5, jacobian=0.5), 5, 10),
    "crossover guided by itself": (GuidedByItself(1, **BOLD), 3, 4),
}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_the_check_catches_a_broken_move(mutant):
    move, ndim, nwalkers = MUTANTS[mutant]
    z = exact_start(move, Gaussian(ndim=ndim), nwalkers, ensembles=400, steps=10)
    assert z > LIMIT


def test_the_textbook_form_of_the_snooker_update_passes_the_check():
    assert exact_start(Textbook(**BOLD), Gaussian(), 6, **QUICK) < LIMIT
