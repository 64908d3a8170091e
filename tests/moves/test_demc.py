"""What each move proposes, in distribution: a wrong scale keeps the target, unseen."""

from itertools import permutations

import emcee
import numpy as np
import pytest
from emcee.model import Model
from numpy.random import RandomState
from numpy.testing import assert_allclose
from scipy import stats

from emcee_femu import DEMCMove, IndependenceMove, MetropolisMove

N = 20_000


def asked(move, start):
    """Return what a move proposes from walkers ``(n, d)``; nothing is accepted."""
    proposed = []

    def refuse(theta):
        proposed.append(theta)
        return np.full(len(theta), -np.inf), None

    state = emcee.State(start.copy(), log_prob=np.zeros(len(start)))
    move.propose(Model(None, refuse, map, RandomState(0)), state)
    return np.concatenate(proposed)


def guided(move, guides):
    """Return N proposals from zero with these guides, by emcee's contract."""
    start = np.zeros((N, guides.shape[1]))
    proposed, factors = move.get_proposal(start, [guides], RandomState(0))
    assert factors is None
    return proposed


def match(proposed, candidates, probabilities):
    """Find each proposal among the candidates; return the p-value of their counts."""
    distance = np.abs(proposed[:, None] - candidates).sum(axis=2)
    if not (distance.min(axis=1) < 1e-9).all():
        return 0.0
    counts = np.bincount(distance.argmin(axis=1), minlength=len(candidates))
    return stats.chisquare(counts, np.asarray(probabilities) * len(proposed)).pvalue


@pytest.mark.parametrize("ndim", [1, 3])
def test_demc_proposes_the_difference_of_two_guides_times_gamma(ndim):
    guides = np.random.default_rng(2).normal(size=(4, ndim))
    differences = np.array([a - b for a, b in permutations(guides, 2)])
    proposed = guided(DEMCMove(0.0), guides)
    right = 2.38 / np.sqrt(2 * ndim) * differences
    assert match(proposed, right, np.full(12, 1 / 12)) > 1e-4
    half = guided(DEMCMove(0.0, gamma0=0.5), guides)
    assert match(half, 0.5 * differences, np.full(12, 1 / 12)) > 1e-4


@pytest.mark.parametrize("n", [2, 3, 700])
def test_demc_draws_all_pairs_of_few_and_of_many_guides_alike(n):
    numbers = np.arange(n)
    guides = np.column_stack([numbers, numbers**2]).astype(float)
    step, rise = guided(DEMCMove(0.0, gamma0=1.0), guides).T
    assert (step != 0).all()  # a = b + step, a^2 = b^2 + rise
    first, second = (rise / step + step) / 2, (rise / step - step) / 2
    for chosen in (first, second):
        assert_allclose(chosen, chosen.round(), atol=1e-6)
        counts = np.bincount(chosen.round().astype(int), minlength=n)
        assert stats.chisquare(counts).pvalue > 1e-4
    apart = (first - second).round() % n  # of each distance as many
    counts = np.bincount(apart.astype(int), minlength=n)[1:]
    assert n == 2 or stats.chisquare(counts).pvalue > 1e-4


@pytest.mark.parametrize("sigma", [None, [3e-10, 2.0], 0.5])
def test_noise_is_gaussian_with_the_given_or_the_walkers_scale(sigma):
    guides = np.random.default_rng(2).normal(size=(8, 2)) * [1e-8, 1e6]
    noise = guided(DEMCMove(sigma, gamma0=0.0), guides)
    sds = 0.01 * guides.std(axis=0) if sigma is None else np.broadcast_to(sigma, 2)
    for column, sd in zip(noise.T, sds, strict=True):
        assert stats.kstest(column, stats.norm(0, sd).cdf).pvalue > 1e-4


@pytest.mark.parametrize("ndim", [1, 3])
def test_mode_jump_gives_gamma_one_with_its_probability(ndim):
    guides = np.random.default_rng(2).normal(size=(2, ndim))
    gamma = 2.38 / np.sqrt(2 * ndim)
    steps = np.outer([1.0, -1.0, gamma, -gamma], guides[0] - guides[1])
    proposed = guided(DEMCMove(sigma=0.0, mode_jump=0.3), guides)
    assert match(proposed, steps, [0.15, 0.15, 0.35, 0.35]) > 1e-4


COVARIANCE = np.array([[4.0, 1.0], [1.0, 9.0]]) * np.outer([1e-9, 1e2], [1e-9, 1e2])
DRAWS = np.random.default_rng(0).normal(size=(400, 3)) * [1e-8, 1.0, 1e8]
SPREAD = np.cov(DRAWS.T)
STEPS = [  # a move, and the covariance of its steps
    (MetropolisMove(sd=[3.0, 0.5]), np.diag([9.0, 0.25])),
    (MetropolisMove(sd=3.0), 9 * np.eye(1)),
    (MetropolisMove(cov=[3.0, 0.5]), np.diag([3.0, 0.5])),
    (MetropolisMove(cov=COVARIANCE), COVARIANCE),
    (MetropolisMove.tuned(DRAWS), 2.38**2 / 3 * SPREAD),
    (MetropolisMove.tuned(DRAWS[:, 1:2]), 2.38**2 * SPREAD[1:2, 1:2]),
]


@pytest.mark.parametrize(("move", "covariance"), STEPS)
def test_metropolis_steps_have_the_given_covariance(move, covariance):
    steps = asked(move, np.zeros((N, len(covariance))))
    assert len(np.unique(steps[:, 0])) == N  # each walker its own step
    sd = np.sqrt(np.diag(covariance))
    error = (np.atleast_2d(np.cov(steps.T)) - covariance) / np.outer(sd, sd)
    assert np.abs(error).max() < 5 * np.sqrt(2 / N)


class Rise(IndependenceMove):
    """A proposal whose density falls by 0.6 with every step."""

    def log_density(self, theta):
        return np.where(theta[:, 0] == 0, 0.0, -0.6)


@pytest.mark.parametrize("ndim", [1, 3])
def test_acceptance_is_the_metropolis_hastings_ratio(ndim):
    move = Rise([1.0], np.zeros((1, ndim)), [np.eye(ndim)])
    state = emcee.State(np.zeros((N, ndim)), log_prob=np.full(N, -5.0))
    model = Model(None, lambda q: (np.full(len(q), -6.0), None), map, RandomState(0))
    _, accepted = move.propose(model, state)
    p = np.exp(-1.0 + 0.6)
    assert stats.binomtest(int(accepted.sum()), N, p).pvalue > 1e-4
