"""Snooker and crossover propose by their laws, and say what does not fit."""

import pickle
from itertools import combinations, permutations

import emcee
import numpy as np
import pytest
from emcee.model import Model
from scipy import stats
from support.checks import LIMIT

from emcee_femu.moves import CrossoverMove, SnookerMove, crossover

BOLD = {"live_dangerously": True}


def choices(proposed, candidates, probabilities):
    """Find each proposal among the candidates; return their numbers, and a p-value."""
    distance = np.abs(proposed[:, None] - candidates).sum(axis=2)
    assert (distance.min(axis=1) < 1e-9).all()
    found = distance.argmin(axis=1)
    counts = np.bincount(found, minlength=len(candidates))
    return found, stats.chisquare(counts, probabilities * len(proposed)).pvalue


def test_snooker_proposals_lie_on_the_line_of_each_guide_with_each_pair():
    rng, scale = np.random.default_rng(3), np.array([1.0, 4.0, 0.3])
    guides, theta = rng.normal(size=(5, 3)) * scale, rng.normal(size=3) * scale
    move, current = SnookerMove((1.0, 1.0)), np.tile(theta, (12_000, 1))
    proposed, factors = move.get_proposal(current, [guides], np.random.RandomState(0))
    sd, candidates, expected = guides.std(axis=0), [], []
    for z, z1, z2 in permutations(guides, 3):
        line = (theta - z) / sd
        u = line / np.linalg.norm(line)
        candidates.append(theta + sd * u * (u @ ((z1 - z2) / sd)))
        new = np.linalg.norm((candidates[-1] - z) / sd)
        expected.append(2 * np.log(new / np.linalg.norm(line)))
    found, p = choices(proposed, np.array(candidates), np.full(60, 1 / 60))
    assert p > 1e-4
    np.testing.assert_allclose(factors, np.array(expected)[found], atol=1e-9)


def test_snooker_gamma_is_uniform_on_its_interval():
    guides = np.array([[0.0], [1.0], [3.0]])  # on a line each projection is itself
    current = np.full((10_000, 1), 7.0)
    proposed, factors = SnookerMove((1.2, 1.3)).get_proposal(
        current, [guides], np.random.RandomState(0)
    )
    assert (factors == 0).all()  # d = 1
    jumps = np.abs(proposed[:, 0] - 7.0)
    gamma = jumps / np.array([1.0, 2.0, 3.0])[np.digitize(jumps, [2.0, 3.0])]
    assert stats.kstest(gamma, stats.uniform(1.2, 0.1).cdf).pvalue > 1e-4


@pytest.mark.parametrize("level", [0.0, -np.inf])
def test_a_walker_on_its_guide_stays_without_a_warning(level):
    start = np.tile([1.0, 2.0, 3.0], (6, 1))
    state = emcee.State(start.copy(), log_prob=np.full(6, level))
    model = Model(
        None, lambda q: (np.full(len(q), level), None), map, np.random.RandomState(0)
    )
    state, accepted = SnookerMove().propose(model, state)
    assert not accepted.any() and np.array_equal(state.coords, start)


@pytest.mark.parametrize("move", [SnookerMove(), CrossoverMove(1)])
def test_proposals_are_finite_where_walkers_at_rest_share_a_value(move):
    guides = np.random.default_rng(0).normal(size=(5, 3)) * [1.0, 0.0, 1e-160]
    current = np.array([[0.1, 0.0, 0.0], [0.1, 2.0, 1.0], [1e200, 0.0, 0.0], guides[0]])
    for seed in range(50):
        random = np.random.RandomState(seed)
        proposed, factors = move.get_proposal(current, [guides], random)
        assert np.isfinite(proposed).all()
        assert factors is None or np.isfinite(factors).all()


@pytest.mark.parametrize("pairs", [1, 2, 3])
def test_crossover_adds_each_sum_of_distinct_pairs_with_its_gamma(pairs):
    guides = np.random.default_rng(4).normal(size=(7, 3))
    move, current = CrossoverMove(pairs, [1.0], 0.0), np.ones((20_000, 3))
    proposed, factors = move.get_proposal(current, [guides], np.random.RandomState(0))
    assert factors is None
    candidates, probabilities = [], []
    for delta in range(1, pairs + 1):
        sums = [
            guides[list(plus)].sum(axis=0) - guides[list(minus)].sum(axis=0)
            for plus in combinations(range(7), delta)
            for minus in combinations(sorted({*range(7)} - {*plus}), delta)
        ]
        candidates += [1.0 + 2.38 / np.sqrt(2 * delta * 3) * one for one in sums]
        probabilities += [1 / pairs / len(sums)] * len(sums)
    p = choices(proposed, np.array(candidates), np.array(probabilities))[1]
    assert p > 1e-4


@pytest.mark.parametrize("values", [(1 / 3, 2 / 3, 1.0), (0.2,), (1e-9,), (1.0,)])
def test_crossover_moves_as_many_parameters_as_its_probabilities_say(values):
    guides = np.random.default_rng(5).normal(size=(8, 5))
    move = CrossoverMove(2, values)
    proposed, _ = move.get_proposal(
        np.zeros((20_000, 5)), [guides], np.random.RandomState(0)
    )
    moved = (proposed != 0).sum(axis=1)
    law = np.mean([stats.binom.pmf(range(6), 5, value) for value in values], axis=0)
    law[:2] = 0.0, law[0] + law[1]  # none: then one of them
    counts, possible = np.bincount(moved, minlength=6), law > 1e-7
    assert not counts[~possible].any()
    if possible.sum() > 1:
        expected = law[possible] / law[possible].sum() * 20_000
        assert stats.chisquare(counts[possible], expected).pvalue > 1e-4
    alone = moved == 1
    if alone.any():  # each parameter as often as any other
        assert stats.chisquare((proposed[alone] != 0).sum(axis=0)).pvalue > 1e-4


def displacement_z():
    """Return the largest |z| of the squares of displacements, 2.38^2 var_j / d'.

    d' is the number of moved parameters and var_j the variance of the guides.
    """
    guides = np.random.default_rng(6).normal(size=(8, 5)) * [1, 2, 4, 1e-6, 1e6]
    proposed, _ = CrossoverMove(3, [0.3, 0.7], 0.0).get_proposal(
        np.zeros((40_000, 5)), [guides], np.random.RandomState(0)
    )
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


# The exact-start test cannot see a wrong gamma: the move stays symmetric.
WRONG_GAMMAS = {
    "truncated, as in UQpy": lambda pairs, d: 2.38 / np.sqrt(2 * pairs * d) // 1,
    "without the pairs": lambda pairs, d: 2.38 / np.sqrt(2 * d),
    "of all parameters": lambda pairs, d: 2.38 / np.sqrt(2 * pairs * 5),
}


def test_crossover_displacements_have_the_scale_of_the_moved_parameters():
    assert displacement_z() < LIMIT


@pytest.mark.parametrize("wrong", WRONG_GAMMAS)
def test_the_scale_of_displacements_catches_a_wrong_gamma(wrong, monkeypatch):
    monkeypatch.setattr(crossover, "jump_factor", WRONG_GAMMAS[wrong])
    assert displacement_z() > LIMIT


@pytest.mark.parametrize(
    ("make", "error", "match"),
    [
        (lambda: SnookerMove(1.7), ValueError, "gamma"),
        (lambda: SnookerMove((2.2, 1.2)), ValueError, "gamma.*low <= high"),
        (lambda: SnookerMove((0.0, 1.2)), ValueError, "gamma"),
        (lambda: SnookerMove((1.2, np.inf)), ValueError, "gamma"),
        (lambda: SnookerMove("wide"), TypeError, "gamma"),
        (lambda: SnookerMove(nsplits=1), ValueError, "nsplits"),
        (lambda: CrossoverMove(0), ValueError, "pairs"),
        (lambda: CrossoverMove(4), ValueError, "pairs: expected 1, 2 or 3"),
        (lambda: CrossoverMove(1.0), TypeError, "pairs"),
        (lambda: CrossoverMove(1, []), ValueError, "crossover"),
        (lambda: CrossoverMove(1, [0.0, 0.5]), ValueError, "crossover"),
        (lambda: CrossoverMove(1, [0.5, 1.1]), ValueError, "crossover"),
        (lambda: CrossoverMove(1, 0.5), ValueError, "crossover"),
        (lambda: CrossoverMove(sigma=[-0.1]), ValueError, "sigma"),
        (lambda: CrossoverMove(sigma="0.1"), TypeError, "sigma"),
        (lambda: CrossoverMove(1, sigma=[1, 1]).check(8, 3), ValueError, "sigma"),
        (lambda: SnookerMove().check(5, 2), ValueError, "3 walkers at rest.*least 6 "),
        (lambda: CrossoverMove().check(10, 3), ValueError, "least 12 walkers"),
        (lambda: CrossoverMove(nsplits=3).check(8, 2), ValueError, "least 9 walkers"),
        (lambda: SnookerMove().check(8, 5), RuntimeError, "2 \\* ndim"),
    ],
)
def test_wrong_settings_and_ensembles_are_refused_by_name(make, error, match):
    with pytest.raises(error, match=match):
        make()


@pytest.mark.parametrize(
    "move",
    [
        SnookerMove((1, 2), nsplits=3),
        CrossoverMove(2, [0.1, 1 / 3], [0.1, 0.2], **BOLD),
    ],
)
def test_moves_survive_pickling_and_show_their_settings(move):
    again = pickle.loads(pickle.dumps(move))
    assert repr(again) == repr(move) == repr(eval(repr(move)))
    assert vars(again).keys() == vars(move).keys()
