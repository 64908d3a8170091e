"""An annealed population has the posterior's law, and the evidence its exact value."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.free_posterior import box, free_posterior
from support.pool_problems import forks
from support.tempered_laws import BoundedLaw, GaussianLaw

import emcee_femu as ef
from emcee_femu.moves import IndependenceMove
from emcee_femu.search.anneal import _find_problems, _renew

LIMIT = 5.0
LAW = GaussianLaw()


def in_a_box(log_likelihood, d, half_width):
    """Return the posterior of a likelihood, whose prior is uniform on a cube."""
    return free_posterior(log_likelihood, box(-half_width, half_width, d))


def two_modes(theta):
    """Return the log of a density: .3 at 5 and .7 at -5 along the first axis."""
    rest = (theta[:, 1:] ** 2).sum(axis=1)
    modes = [
        np.log(share) - 0.5 * ((theta[:, 0] - centre) ** 2 + rest)
        for share, centre in ((0.7, -5.0), (0.3, 5.0))
    ]
    return np.logaddexp(*modes) - 0.5 * theta.shape[1] * np.log(2 * np.pi)


@pytest.mark.slow
@pytest.mark.parametrize("target", [LAW, BoundedLaw()], ids=["free", "bounded"])
def test_population_and_evidence_are_exact_over_replicates(target):
    annealed = [ef.anneal(target.posterior, 120, seed=seed) for seed in range(10)]
    averages = np.array(
        [target.statistics(p.theta, 1.0).mean(axis=0) for p in annealed]
    )
    errors = averages.std(axis=0, ddof=1) / np.sqrt(len(annealed))
    assert np.abs(averages.mean(axis=0) / errors).max() < LIMIT
    assert errors.max() < 0.15  # of statistics of unit size: a test that can fail
    off = np.array([p.log_evidence - target.log_evidence for p in annealed])
    claimed = np.array([p.log_evidence_error for p in annealed])
    assert abs(off.mean()) < LIMIT * off.std(ddof=1) / np.sqrt(len(annealed))
    able = np.isfinite(claimed)
    assert able.sum() >= 7 and claimed[able].mean() < 0.25
    assert 0.4 < claimed[able].mean() / np.sqrt((off[able] ** 2).mean()) < 2.5


@pytest.mark.filterwarnings("ignore:model. the same response")
def test_evidences_that_are_known_by_hand():
    """A constant takes one step; two modes; and a quarter of the prior is possible."""
    flat = in_a_box(lambda theta: np.full(len(theta), -3.5), 2, 1.0)
    annealed = ef.anneal(flat, 100, seed=1)
    assert annealed.powers.tolist() == [0.0, 1.0]
    assert annealed.log_evidence == pytest.approx(-3.5, abs=1e-12)
    assert annealed.log_evidence_error == pytest.approx(0.0, abs=1e-6)
    modes = ef.anneal(in_a_box(two_modes, 2, 10.0), 300, seed=1)
    assert modes.log_evidence == pytest.approx(-2 * np.log(20), abs=0.3)
    assert (modes.theta[:, 0] > 0).mean() == pytest.approx(0.3, abs=0.15)

    def cut(theta):
        return np.where(theta[:, 0] > 0.5, -3.5, -np.inf)

    annealed = [ef.anneal(in_a_box(cut, 2, 1.0), 100, seed=seed) for seed in range(4)]
    off = np.array([p.log_evidence for p in annealed]) + 3.5 - np.log(0.25)
    assert np.abs(off).max() < 4 * np.sqrt(0.75 / (0.25 * 400))
    claimed = np.median([p.log_evidence_error for p in annealed])
    assert_allclose(claimed, np.sqrt(0.75 / (0.25 * 400)), rtol=0.3)


@pytest.mark.parametrize(("off", "problems"), [(0.05, 0), (0.5, 1), (-0.5, 1)])
def test_two_evidences_that_differ_by_many_of_their_errors_are_a_problem(off, problems):
    """That along the powers, and that of 1,000 weights whose mean is one."""
    weights = np.random.default_rng(1).normal(-0.02, 0.2, size=1_000)
    assert len(_find_problems([weights], off, error=0.05)) == problems


@pytest.mark.slow
def test_a_posterior_of_a_ten_thousandth_of_the_prior_is_found():
    """The law of the powers: none is left out on the long way to a sharp peak."""
    sd, centre = 1e-4, np.array([0.3, -0.2, 0.7])

    def sharp(theta):
        x = (theta - centre) / sd
        return -0.5 * (x**2).sum(axis=1) - 3 * np.log(sd * np.sqrt(2 * np.pi))

    annealed = ef.anneal(in_a_box(sharp, 3, 1.0), 200, seed=1)
    off = annealed.log_evidence + 3 * np.log(2.0)
    assert abs(off) < LIMIT * annealed.log_evidence_error < 4
    assert np.abs((annealed.theta.mean(axis=0) - centre) / sd).max() < 0.3


@pytest.mark.slow
def test_the_effective_size_counts_descendants_of_one_draw_as_one():
    """Of 81 needles each stays where the ancestors of its members were."""
    centres = np.linspace(-8.0, 8.0, 9)

    def needles(x):
        parts = [-0.5 * ((x - centre) / 0.02) ** 2 for centre in centres]
        return np.logaddexp.reduce(parts).sum(axis=1)

    posterior = in_a_box(needles, 2, 10.0)
    annealed = [ef.anneal(posterior, 80, seed=seed) for seed in range(8)]
    means = np.array([p.theta.mean(axis=0) for p in annealed])
    size = np.mean(centres**2) / np.mean(means**2)
    assert size < 30
    assert 1 / 3 < np.mean([p.effective_size for p in annealed]) / size < 3


def test_members_that_steps_renewed_have_forgotten_half_of_where_they_were():
    """Of independence proposals, which are far off here, none is accepted."""
    n, d = 400, 16
    random = np.random.RandomState(1)
    far = IndependenceMove([1.0], np.full((1, d), 9.0), np.eye(d)[None])

    def rows(theta):
        return np.column_stack([-0.5 * (theta**2).sum(axis=1), np.zeros(len(theta))])

    theta, halves = random.standard_normal((n, d)), np.split(np.arange(n), 2)
    moved = _renew(
        rows, theta, rows(theta), halves, 1.0, random, [far, far], False, 200
    )
    assert len(moved.accepted) < 200
    assert np.mean(theta * moved.theta) < 0.5  # a correlation, within 0.01


@forks
def test_workers_change_nothing_and_all_solves_are_counted():
    solved = []

    def counted(parameters):
        solved.append(len(parameters["a"]))
        return LAW.solve(parameters)

    target = ef.LogPosterior(counted, LAW.posterior.terms, LAW.posterior.prior)
    serial = ef.anneal(target, 80, seed=1)
    assert serial.solves == sum(solved)
    assert_allclose(LAW.posterior(serial.theta), serial.rows, rtol=1e-11)
    one, two = (ef.anneal(LAW.posterior, 80, seed=1, workers=n) for n in (1, 2))
    assert one.theta.tobytes() == two.theta.tobytes()
    assert one.log_evidence == two.log_evidence and one.solves == two.solves
    assert ef.anneal(LAW.posterior, 80, seed=2).log_evidence != one.log_evidence
