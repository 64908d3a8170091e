"""What each move proposes, in distribution: a wrong scale keeps the target, unseen."""

from itertools import combinations, permutations

import emcee
import numpy as np
import pytest
from emcee.model import Model
from numpy.random import RandomState
from numpy.testing import assert_allclose
from scipy import stats
from support.checks import LIMIT

from emcee_femu.moves import (
    CrossoverMove,
    DEMCMove,
    IndependenceMove,
    MetropolisMove,
    SnookerMove,
    acceptance,
    crossover,
    demc,
)

N = 20_000


def propose(move, ndim, guides=None, start=0.0):
    """Return N proposals from one place."""
    coords = np.full((N, ndim), start)
    if guides is None:
        return next(move.batches(coords, RandomState(0)))[1]
    proposed, factors = move.get_proposal(coords, [guides], RandomState(0))
    assert factors is None
    return proposed


def choose(proposed, candidates, probabilities):
    """Find each proposal among the candidates; return their numbers, and a p-value."""
    distance = np.abs(proposed[:, None] - candidates).sum(axis=2)
    found = distance.argmin(axis=1)
    if not (distance.min(axis=1) < 1e-9).all():
        return found, 0.0
    counts = np.bincount(found, minlength=len(candidates))
    return found, stats.chisquare(counts, probabilities * len(proposed)).pvalue


def pair_p_value(ndim):
    """Return the p of DE-MC's differences of pairs, each as likely as any other."""
    guides = np.random.default_rng(2).normal(size=(4, ndim))
    steps = np.array([a - b for a, b in permutations(guides, 2)])
    candidates = 2.38 / np.sqrt(2 * ndim) * steps
    return choose(propose(DEMCMove(0.0), ndim, guides), candidates, 1 / 12)[1]


@pytest.mark.parametrize("most_tabled", [demc.MOST_TABLED, 0])
@pytest.mark.parametrize("ndim", [1, 2, 5])
def test_demc_proposes_the_difference_of_two_distinct_guides_times_gamma(
    ndim, most_tabled, monkeypatch
):
    monkeypatch.setattr(demc, "MOST_TABLED", most_tabled)
    assert pair_p_value(ndim) > 1e-4


class WrongRoot:
    """math with a square root of d where DE-MC asks for that of 2 d."""

    @staticmethod
    def sqrt(doubled):
        return np.sqrt(doubled / 2)


@pytest.mark.parametrize("ndim", [1, 5])
def test_a_gamma_without_the_two_is_seen(ndim, monkeypatch):
    monkeypatch.setattr(demc, "math", WrongRoot)
    assert pair_p_value(ndim) < 1e-9


@pytest.mark.parametrize("sigma", [None, [3e-10, 2.0], 0.5])
@pytest.mark.parametrize("ndim", [1, 2])
@pytest.mark.parametrize("kind", [DEMCMove, CrossoverMove])
def test_noise_is_gaussian_with_the_given_or_the_walkers_scale(
    kind, ndim, sigma, monkeypatch
):
    monkeypatch.setattr(crossover, "scale_jump", lambda *_: np.zeros(N))
    guides = (np.random.default_rng(2).normal(size=(8, 2)) * [1e-8, 1e6])[:, :ndim]
    sigma = sigma[:ndim] if isinstance(sigma, list) else sigma
    settings = {"gamma0": 0.0} if kind is DEMCMove else {"crossover": [1.0]}
    noise = propose(kind(sigma=sigma, **settings), ndim, guides)
    sds = 0.01 * guides.std(axis=0) if sigma is None else np.broadcast_to(sigma, ndim)
    for column, sd in zip(noise.T, sds, strict=True):
        assert stats.kstest(column, stats.norm(0, sd).cdf).pvalue > 1e-4


@pytest.mark.parametrize("ndim", [1, 3])
def test_mode_jump_gives_gamma_one_with_its_probability(ndim):
    guides = np.random.default_rng(2).normal(size=(2, ndim))
    difference, gamma = guides[0] - guides[1], 2.38 / np.sqrt(2 * ndim)
    candidates = np.outer([1.0, -1.0, gamma, -gamma], difference)
    proposed = propose(DEMCMove(sigma=0.0, mode_jump=0.3), ndim, guides)
    law = np.array([0.15, 0.15, 0.35, 0.35])
    assert choose(proposed, candidates, law)[1] > 1e-4


def test_the_defaults_are_those_of_the_docstrings():
    assert SnookerMove().gamma == (1.2, 2.2)
    assert CrossoverMove().crossover == (1 / 3, 2 / 3, 1.0)
    assert (CrossoverMove().pairs, DEMCMove().mode_jump) == (3, 0.0)


@pytest.mark.parametrize("beta", [None, 0.3])
@pytest.mark.parametrize("ndim", [1, 3])
def test_acceptance_is_the_metropolis_ratio(ndim, beta):
    """Of the tempered densities and the asymmetry, whatever the dimension."""
    rises = {"log-likelihood": -0.8, "log-prior": 0.5, "asymmetry": -0.6}
    state = emcee.State(np.zeros((N, ndim)), np.full(N, -5.0), np.full((N, 2), -2.0))
    row = -5.0 + rises["log-likelihood"] + rises["log-prior"], -2 + rises["log-prior"]

    def solve(q):
        return np.full(len(q), row[0]), np.full((len(q), 2), row[1])

    model = Model(None, solve, map, RandomState(0))
    everyone, factors = np.arange(N), np.full(N, rises["asymmetry"])
    betas = None if beta is None else np.full(N, beta)
    step = everyone, np.ones((N, ndim)), factors, betas
    moved = acceptance.accept_or_reject(model, state, *step)
    power = 1.0 if beta is None else beta
    log_ratio = power * rises["log-likelihood"] + 0.5 - 0.6
    p = min(1.0, np.exp(log_ratio))
    assert stats.binomtest(len(moved), N, p).pvalue > 1e-4


COVARIANCE = np.array([[4.0, 1.0], [1.0, 9.0]]) * np.outer([1e-9, 1e2], [1e-9, 1e2])
DRAWS = np.random.default_rng(0).normal(size=(400, 3)) * [1e-8, 1.0, 1e8]
STEPS = {  # a move, and the covariance of its steps
    "sd": (MetropolisMove(sd=3.0), 9 * np.eye(1)),
    "sds": (MetropolisMove(sd=[3.0, 0.5]), np.diag([9.0, 0.25])),
    "variance": (MetropolisMove(cov=3.0), 3 * np.eye(1)),
    "variances": (MetropolisMove(cov=[3.0, 0.5]), np.diag([3.0, 0.5])),
    "covariance": (MetropolisMove(cov=COVARIANCE), COVARIANCE),
    "covariance, d = 1": (MetropolisMove(cov=[[4.0]]), 4 * np.eye(1)),
    "tuned": (MetropolisMove.tuned(DRAWS), 2.38**2 / 3 * np.cov(DRAWS.T)),
    "tuned, d = 1": (
        MetropolisMove.tuned(DRAWS[:, 1:2]),
        2.38**2 * DRAWS[:, 1:2].var(ddof=1, keepdims=True),
    ),
}


@pytest.mark.parametrize("case", STEPS)
def test_metropolis_steps_have_the_given_covariance(case):
    move, covariance = STEPS[case]
    steps = propose(move, len(covariance), start=0.0)
    assert len(np.unique(steps[:, 0])) == N  # each walker its own step
    sd = np.sqrt(np.diag(covariance))
    error = (np.atleast_2d(np.cov(steps.T)) - covariance) / np.outer(sd, sd)
    assert np.abs(error).max() < 5 * np.sqrt(2 / N)


@pytest.mark.parametrize("cov", [0.3, [0.3, 2.0]])
def test_cov_means_what_it_means_in_emcee(cov):
    theirs = emcee.moves.GaussianMove(cov).get_proposal(np.zeros((N, 2)), RandomState())
    ours = propose(MetropolisMove(cov=cov), 2)
    assert_allclose(ours.var(axis=0), theirs[0].var(axis=0), rtol=10 / np.sqrt(N))


@pytest.mark.parametrize("ndim", [2, 3])
def test_snooker_proposals_lie_on_the_line_of_each_guide_with_each_pair(ndim):
    rng, scale = np.random.default_rng(3), np.array([1.0, 4.0, 0.3])[:ndim]
    guides, theta = rng.normal(size=(5, ndim)) * scale, rng.normal(size=ndim) * scale
    move, current = SnookerMove((1.0, 1.0)), np.tile(theta, (12_000, 1))
    proposed, factors = move.get_proposal(current, [guides], RandomState(0))
    sd, candidates, expected = guides.std(axis=0), [], []
    for z, z1, z2 in permutations(guides, 3):
        line = (theta - z) / sd
        u = line / np.linalg.norm(line)
        candidates.append(theta + sd * u * (u @ ((z1 - z2) / sd)))
        new = np.linalg.norm((candidates[-1] - z) / sd)
        expected.append((ndim - 1) * np.log(new / np.linalg.norm(line)))
    found, p = choose(proposed, np.array(candidates), np.full(60, 1 / 60))
    assert p > 1e-4
    assert_allclose(factors, np.array(expected)[found], atol=1e-9)


def test_snooker_gamma_is_uniform_on_its_interval():
    guides = np.array([[0.0], [1.0], [3.0]])  # on a line each projection is itself
    current = np.full((10_000, 1), 7.0)
    proposed, factors = SnookerMove((1.2, 1.3)).get_proposal(
        current, [guides], RandomState(0)
    )
    assert (factors == 0).all()  # d = 1
    jumps = np.abs(proposed[:, 0] - 7.0)
    gamma = jumps / np.array([1.0, 2.0, 3.0])[np.digitize(jumps, [2.0, 3.0])]
    assert stats.kstest(gamma, stats.uniform(1.2, 0.1).cdf).pvalue > 1e-4


def test_a_walker_on_its_guide_stays_without_a_warning():
    start = np.tile([1.0, 2.0, 3.0], (6, 1))
    state = emcee.State(start.copy(), log_prob=np.zeros(6))
    model = Model(None, lambda q: (np.zeros(len(q)), None), map, RandomState(0))
    state, accepted = SnookerMove().propose(model, state)
    assert not accepted.any() and np.array_equal(state.coords, start)


@pytest.mark.parametrize("move", [SnookerMove(), CrossoverMove(1)])
def test_proposals_are_finite_where_walkers_at_rest_share_a_value(move):
    guides = np.random.default_rng(0).normal(size=(5, 3)) * [1.0, 0.0, 1e-9]
    current = np.array([[0.1, 0.0, 0.0], [0.1, 2.0, 1.0], guides[0]])
    for seed in range(50):
        proposed, factors = move.get_proposal(current, [guides], RandomState(seed))
        assert np.isfinite(proposed).all()
        assert factors is None or np.isfinite(factors).all()


@pytest.mark.parametrize(
    ("pairs", "ndim"), [(1, 1), (2, 1), (3, 1), (1, 3), (2, 3), (3, 3)]
)
def test_crossover_adds_each_sum_of_distinct_pairs_with_its_gamma(pairs, ndim):
    guides = np.random.default_rng(4).normal(size=(7, ndim))
    candidates, probabilities = [], []
    for delta in range(1, pairs + 1):
        sums = [
            guides[list(plus)].sum(axis=0) - guides[list(minus)].sum(axis=0)
            for plus in combinations(range(7), delta)
            for minus in combinations(sorted({*range(7)} - {*plus}), delta)
        ]
        candidates += [2.38 / np.sqrt(2 * delta * ndim) * one for one in sums]
        probabilities += [1 / pairs / len(sums)] * len(sums)
    proposed = propose(CrossoverMove(pairs, [1.0], 0.0), ndim, guides)
    assert choose(proposed, np.array(candidates), np.array(probabilities))[1] > 1e-4


@pytest.mark.parametrize("values", [(1 / 3, 2 / 3, 1.0), (0.2,), (1e-9,), (1.0,)])
def test_crossover_moves_as_many_parameters_as_its_probabilities_say(values):
    guides = np.random.default_rng(5).normal(size=(8, 5))
    proposed = propose(CrossoverMove(2, values), 5, guides)
    moved = (proposed != 0).sum(axis=1)
    law = np.mean([stats.binom.pmf(range(6), 5, value) for value in values], axis=0)
    law[:2] = 0.0, law[0] + law[1]  # none: then one of them
    counts, possible = np.bincount(moved, minlength=6), law > 1e-7
    assert not counts[~possible].any()
    if possible.sum() > 1:
        expected = law[possible] / law[possible].sum() * N
        assert stats.chisquare(counts[possible], expected).pvalue > 1e-4
    alone = moved == 1
    if alone.any():  # each parameter as often as any other
        assert stats.chisquare((proposed[alone] != 0).sum(axis=0)).pvalue > 1e-4


def displacement_z():
    """Return the largest |z| of the squares of displacements, 2.38^2 var_j / d'.

    d' is the number of moved parameters and var_j the variance of the guides.
    """
    guides = np.random.default_rng(6).normal(size=(8, 5)) * [1, 2, 4, 1e-6, 1e6]
    proposed = propose(CrossoverMove(3, [0.3, 0.7], 0.0), 5, guides)
    moved = (proposed != 0).sum(axis=1, keepdims=True)
    if not moved.all():
        return np.inf
    square = moved * proposed**2 / (2.38**2 * guides.var(axis=0, ddof=1))
    zs = []
    for number in range(1, 6):
        for column in square[moved[:, 0] == number].T:
            inside = column[column > 0]
            zs.append((inside.mean() - 1) / (inside.std() / np.sqrt(len(inside))))
    return np.abs(zs).max()


WRONG_GAMMAS = {
    "truncated, as in UQpy": lambda pairs, d: 2.38 / np.sqrt(2 * pairs * d) // 1,
    "without the pairs": lambda pairs, d: 2.38 / np.sqrt(2 * d),
    "of all parameters": lambda pairs, d: 2.38 / np.sqrt(2 * pairs * 5),
}


def test_crossover_displacements_have_the_scale_of_the_moved_parameters():
    assert displacement_z() < LIMIT


@pytest.mark.parametrize("wrong", WRONG_GAMMAS)
def test_the_scale_of_displacements_catches_a_wrong_gamma(wrong, monkeypatch):
    monkeypatch.setattr(crossover, "scale_jump", WRONG_GAMMAS[wrong])
    assert displacement_z() > LIMIT


WEIGHTS, DF = np.array([0.3, 0.7]), 6.0
MEANS = np.array([[0.0, 1.0, 2.0], [3.0, -1.0, 0.0]])
SCALE_MATRICES = np.array([np.diag([1.0, 2.0, 0.5]), 0.5 * np.eye(3) + 0.4])


def make_mixture(ndim=3, scale=1.0):
    """Return the move, and the laws of its components."""
    means, matrices = MEANS[:, :ndim], SCALE_MATRICES[:, :ndim, :ndim]
    scale = np.resize(scale, ndim)
    scaled = means * scale, matrices * np.outer(scale, scale)
    move = IndependenceMove(WEIGHTS, *scaled, DF)
    pairs = enumerate(zip(means, matrices, strict=True))
    return move, [stats.multivariate_t(m, S, df=DF, seed=i) for i, (m, S) in pairs]


@pytest.mark.parametrize("ndim", [1, 3])
def test_the_density_of_independence_is_that_of_the_mixture(ndim):
    move, laws = make_mixture(ndim)
    x = np.random.default_rng(0).normal(size=(50, ndim)) * 5
    exact = np.log(sum(w * law.pdf(x) for w, law in zip(WEIGHTS, laws, strict=True)))
    assert_allclose(move.log_density(x), exact, rtol=1e-12)
    scale = np.array([1e-8, 1.0, 1e11])[:ndim]  # units shift it by their logarithm
    shifted = make_mixture(ndim, scale)[0].log_density(x * scale) + np.log(scale).sum()
    assert_allclose(shifted, exact, rtol=1e-9)


@pytest.mark.parametrize("ndim", [1, 3])
def test_independence_proposes_from_the_mixture(ndim):
    move, laws = make_mixture(ndim)
    drawn = [law.rvs(round(60_000 * w)) for w, law in zip(WEIGHTS, laws, strict=True)]
    reference = np.concatenate(drawn).reshape(-1, ndim)
    for direction in (*np.eye(ndim), np.ones(ndim), (-1.0) ** np.arange(ndim)):
        test = stats.ks_2samp(propose(move, ndim) @ direction, reference @ direction)
        assert test.pvalue > 1e-4
    start = np.zeros((5, ndim))
    ((_, proposed, factors),) = move.batches(start, RandomState(1))
    expected = move.log_density(start) - move.log_density(proposed)
    assert_allclose(factors, expected, rtol=1e-12)
