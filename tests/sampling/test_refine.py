"""A proposal refined by importance weights: exact evidences, shares and weights."""

import numpy as np
import pytest
from scipy import stats

from emcee_femu.moves.mixture_em import Mixture, draw, log_density
from emcee_femu.sampling.groups import COVER, label, separate, weigh
from emcee_femu.sampling.importance import kish_share
from emcee_femu.sampling.refine import COVERS, Draws, cover, refine, uncover

LIMIT = 4.5  # |z|
EVIDENCE, MEAN, SD = 3.5, np.array([1.0, -0.5]), np.array([0.6, 0.3])


def one(mean, matrix, df=8.0):
    return Mixture(np.ones(1), np.array([mean], float), np.array([matrix], float), df)


def log_target(x):
    """A Gaussian, cut at x1 = 1, its mean."""
    log_p = np.log(2 * EVIDENCE) + stats.norm(MEAN, SD).logpdf(x).sum(axis=1)
    return np.where(x[:, 0] > 1, log_p, -np.inf)


def rows(x):
    """With a uniform prior on a box, outside of which the target is nothing."""
    return np.column_stack([log_target(x), np.full(len(x), -np.log(10**2))])


def test_draws_of_several_laws_give_the_exact_evidence_and_moments():
    """Weighted by the mixture of all laws they are unbiased, one law being poor."""
    laws = [one([0.0, 0.0], np.eye(2)), one([1.2, -0.5], 0.1 * np.eye(2))]
    found = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        x = rng.uniform(-5, 5, (200, 2))
        draws = Draws.of_prior(x, rows(x))
        for law, n in zip(laws, (100, 300), strict=True):
            x = draw(rng, law, n)
            draws.add(x, rows(x), law)
        weights = np.exp(draws.log_weights)
        found.append(
            [weights.sum(), *(weights @ draws.x), weights @ draws.x[:, 1] ** 2]
        )
        assert draws.shares.sum() == pytest.approx(1.0)
    mean = MEAN + [SD[0] * np.sqrt(2 / np.pi), 0.0]
    exact = EVIDENCE * np.array([1.0, *mean, MEAN[1] ** 2 + SD[1] ** 2])
    error = np.std(found, axis=0) / len(found) ** 0.5
    assert (np.abs(np.mean(found, axis=0) - exact) < LIMIT * error).all()
    assert (error < 0.01 * EVIDENCE).all()


def test_the_effective_share_of_a_law_that_was_not_drawn_from():
    grid = np.linspace(-40, 40, 200_001)[:, None]
    other = one([0.3], [[2.0]], 5.0)
    p = stats.norm.pdf(grid[:, 0])
    exact = 1 / np.trapezoid(p**2 / np.exp(log_density(grid, other)), grid[:, 0])
    wide = one([0.0], [[4.0]], 5.0)
    x = draw(np.random.default_rng(1), wide, 40_000)
    draws = Draws(np.empty((0, 1)), np.empty(0), np.empty(0), 0)
    log_p = 7.0 + stats.norm.logpdf(x[:, 0])  # its evidence does not matter
    draws.add(x, np.column_stack([log_p, log_p]), wide)
    assert draws.effective_share(other) == pytest.approx(exact, rel=0.02)
    # Where the law lacks most of what carries mass; the farthest draws carry none.
    carry = x[draws.shares > 1e-5]
    thin = one([0.0], [[0.3]], 50.0)
    excess = stats.norm.logpdf(carry[:, 0]) - log_density(carry, thin)
    assert draws.lack(thin) == pytest.approx(excess.max(), abs=0.02)
    assert draws.lack(one([-3.0], [[0.1]])) > 5 > 1 > draws.lack(wide)


def test_refinement_goes_on_while_draws_that_carry_mass_are_lacked(monkeypatch):
    sizes = []

    def propose(law, size):
        sizes.append(size)
        x = draw(rng, law, size)
        return x, np.column_stack([log_density(x, law) - 3.0, log_density(x, law)])

    for lack in (np.inf, -np.inf):
        rng = np.random.default_rng(2)
        monkeypatch.setattr("emcee_femu.sampling.refine.LACK", lack)
        draws = Draws(np.empty((0, 2)), np.empty(0), np.empty(0), 0)
        refine(draws, one([0.0, 0.0], np.eye(2)), 100, 10_000, propose)
    assert sizes[:2] == [100, 100] and len(sizes) > 4
    sizes.clear()
    refine(draws, one([0.0, 0.0], np.eye(2)), 100, 300, propose)
    assert sum(sizes) == 300  # the budget


@pytest.mark.parametrize("height", [1e5, -1e5])
def test_a_poor_start_becomes_a_good_proposal(height):
    """Whatever the constant of the log-likelihood."""
    target = Mixture(
        np.array([0.3, 0.7]),
        np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 1.0]]),
        np.array([[[1.0, 0.9, 0], [0.9, 1, 0], [0, 0, 0.1]], np.diag([0.2, 2.0, 1.0])]),
        1e6,
    )

    def propose(law, n):
        x = draw(rng, law, n)
        return x, np.column_stack([log_density(x, target) + height, np.zeros(n)])

    def share(law):
        x, found = propose(law, 4_000)
        return kish_share(found[:, 0] - log_density(x, law))

    rng = np.random.default_rng(2)
    start = one([1.5, 1.5, 1.5], 4 * np.eye(3))
    x, found = propose(start, 500)
    draws = Draws(x[:0], found[:0, 0], found[:0, 0], 0)
    law = refine(draws, start, 500, 10_000, propose)
    assert share(start) < 0.2 and share(law) > 0.8
    assert len(law.weights) > len(COVERS) + 1


def test_what_covers_a_law_is_taken_off_again():
    law = Mixture(np.full(2, 0.5), np.eye(2), np.array([np.eye(2)] * 2), 5.0)
    wide = cover(law)
    assert wide.weights.sum() == pytest.approx(1.0)
    again = uncover(wide)
    assert all(np.allclose(a, b) for a, b in zip(again, law, strict=True))


CENTRES = np.array([[0.0, 0.0], [2.0, 0.0], [20.0, 0.0]])
WEIGHTS = np.array([0.2, 0.3, 0.5])


def test_groups_are_what_does_not_overlap():
    law = cover(Mixture(WEIGHTS, CENTRES, np.array([np.eye(2)] * 3), 8.0))
    group_of = separate(law)
    assert group_of.tolist() == [0, 0, 1, COVER, COVER]
    labels = label(
        np.array([[1.0, 1], [-2, 0], [18, 2], [13, 0], [7, 0]]), law, group_of
    )
    assert labels.tolist() == [0, 0, 1, 1, 0]


def test_the_weights_of_groups_are_exact_and_so_are_their_errors():
    target = Mixture(WEIGHTS, CENTRES, np.array([np.eye(2)] * 3), 1e6)
    law = cover(target._replace(weights=np.array([0.4, 0.4, 0.2]), df=5.0))
    group_of, rng = separate(law), np.random.default_rng(3)
    found = []
    for _ in range(200):
        x = draw(rng, law, 1_000)
        labels = label(x, law, group_of)
        found.append(weigh(labels, log_density(x, target) - log_density(x, law), 2))
    shares, errors = np.moveaxis(found, 1, 0)
    spread = shares.std(axis=0)
    assert (np.abs(shares.mean(axis=0) - 0.5) < LIMIT * spread / 200**0.5).all()
    np.testing.assert_allclose(errors.mean(axis=0), spread, rtol=0.2)


def test_the_weights_of_groups_that_no_draw_met_are_not_known():
    assert weigh(np.zeros(5, int), np.full(5, -np.inf), 2) == ([None] * 2, [None] * 2)
