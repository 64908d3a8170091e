"""What "auto" searches, finds and records, on posteriors of known answer."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from support.free_posterior import FreeModel, box, density_term, free_posterior

import emcee_femu as ef
from emcee_femu.moves.mixture_em import Mixture
from emcee_femu.sampling import auto
from emcee_femu.sampling.auto import choose_starts, is_better
from emcee_femu.sampling.evaluation import Evaluation
from emcee_femu.sampling.groups import label
from emcee_femu.sampling.recipe import describe
from emcee_femu.sampling.search import Search
from emcee_femu.sampling.trial import Trial, try_out

LIMIT = 5.0  # |z|
WIDE, NARROW = np.zeros(3), np.array([5.0, 0.0, 0.0])
SHARE = 0.3  # of the posterior in the narrow mode


@pytest.fixture(autouse=True)
def short_search(monkeypatch):
    monkeypatch.setattr(auto, "FEWEST", 400)
    monkeypatch.setattr(auto, "ROUND", 300)


def two_modes(sd, d=3):
    """Return the posterior of a wide and a narrow mode."""
    laws = [
        (1 - SHARE, stats.multivariate_normal(WIDE[:d], np.eye(d))),
        (SHARE, stats.multivariate_normal(NARROW[:d], sd**2 * np.eye(d))),
    ]

    def log_density(x):
        parts = [np.log(w) + law.logpdf(x).reshape(-1) for w, law in laws]
        return np.logaddexp(*parts)

    return free_posterior(log_density, box(-10, 10, d))


def gaussian(mean, sd, low=0.0, high=1.0, **options):
    mean = np.atleast_1d(mean)
    prior = box(low, high, len(mean))
    return free_posterior(
        lambda x: -0.5 * (((x - mean) / sd) ** 2).sum(axis=1), prior, **options
    )


def largest_z(samplers, mean, sd):
    """Return how far the means are off; the draws lose little to autocorrelation."""
    x = np.concatenate([s.get_chain(flat=True) for s in samplers])
    tau = max(s.get_autocorr_time(quiet=True, tol=0).max() for s in samplers)
    return np.abs(x.mean(axis=0) - mean).max() / (sd * np.sqrt(tau / len(x)))


@pytest.mark.parametrize("d", [2, 3])
def test_a_narrow_mode_beside_a_wide_one_is_found_by_each_ensemble(d):
    posterior = two_modes(0.15, d)
    evaluation = Evaluation.of(posterior, None, "raise", 0.1)
    streams = [np.random.default_rng(seed) for seed in (1, 2)]
    search = Search(evaluation, posterior.prior, streams)
    search.run(8_000, None)
    law = search.law()
    order = np.argsort(law.means[:, 0])
    np.testing.assert_allclose(
        law.means[order][[0, -1]], [WIDE[:d], NARROW[:d]], atol=0.1
    )
    assert law.weights[order][-1] == pytest.approx(SHARE, abs=0.05)
    assert np.shape(search.found_by) == (len(search.maxima), 2)
    assert (np.sum(search.found_by, axis=0) > 0).all()
    # Every point is kept with the ensemble whose stream drew it.
    assert not np.isin(search.own[0][0], search.own[1][0]).any()
    assert len(search.own[0][0]) == len(search.own[1][0])


def test_scans_about_the_wide_mode_hit_a_needle_that_the_prior_does_not():
    posterior = two_modes(0.015, 2)
    evaluation = Evaluation.of(posterior, None, "raise", 0.1)
    streams = [np.random.default_rng(seed) for seed in (0, 9)]
    search = Search(evaluation, posterior.prior, streams)
    search.run(8_000, None)
    tops = np.array([maximum.theta for maximum in search.maxima])
    needle = int(np.argmin(np.linalg.norm(tops - NARROW[:2], axis=1)))
    np.testing.assert_allclose(tops[needle], NARROW[:2], atol=0.01)
    assert search.found_by[needle] == [1, 0]  # the other one knew it by then


def test_one_parameter_is_climbed_to():
    samplers = ef.run(gaussian(0.3, 0.01), "auto", nsteps=20, ensembles=1, seed=1)
    assert samplers[0].recipe.record["efficiency"] > 0.8


def test_what_one_ensemble_was_given_it_alone_starts_from():
    """A needle that no scan can hit is in the proposal of all, and weighed exactly."""
    posterior = two_modes(1e-3, 2)
    initial = np.random.default_rng(1).normal(WIDE[:2], 1.0, (3, 20, 2))
    initial[1, 7] = NARROW[:2] + 1e-4
    samplers = ef.run(posterior, "auto", 20, 100, ensembles=3, seed=1, initial=initial)
    record = samplers[0].recipe.record
    needle = int(np.argmin(record["weights"]))
    assert record["found_by"][1][needle] > 0
    assert [by[needle] for by in record["found_by"]][::2] == [0, 0]
    assert record["start"][1][needle] > 0
    assert [start[needle] for start in record["start"]][::2] == [0, 0]
    weight, error = record["weights"][needle], record["errors"][needle]
    assert abs(weight - SHARE) < LIMIT * error < 0.2
    x = np.stack([s.get_chain()[20:] for s in samplers])
    inside = (x[..., 0] > 4.9).mean(axis=(1, 2))
    np.testing.assert_allclose(inside, SHARE, atol=0.1)  # jumps reach all ensembles


def trial_of(log_weights, theta):
    law = Mixture(
        np.array([0.45, 0.45, 0.05, 0.05]),
        np.array([[0.0], [20.0], [10.0], [10.0]]),
        np.array([1.0, 1.0, 99.0, 99.0])[:, None, None],
        8.0,
    )
    rows = np.column_stack([log_weights, log_weights])
    return Trial(law, theta, rows, log_weights, 0.1, 0.5, 10.0)


GROUPS = np.array([0, 1, -1, -1])


def test_starts_are_an_ensembles_own_draws_by_weight():
    rng = np.random.default_rng(3)
    theta = np.where(np.arange(400) % 2, 20.0, 0.0)[:, None] + rng.normal(size=(400, 1))
    log_weights = rng.normal(size=400)
    trial = trial_of(log_weights, theta)
    for number in (0, 1):
        own = np.arange(400).reshape(2, 200)[number]
        counts = np.zeros(400)
        for _ in range(200):
            chosen = choose_starts(
                rng, trial, number, 2, GROUPS, np.array([1, 1]) > 0, 25
            )
            counts += np.bincount(chosen, minlength=400)
        expected = np.where(np.isin(np.arange(400), own), np.exp(log_weights), 0.0)
        expected *= 200 * 25 / expected.sum()
        assert (counts[expected == 0] == 0).all()
        # Each draw is chosen with no more than a Poisson law's scatter.
        z = (counts - expected)[own] / np.sqrt(expected[own])
        assert np.abs(z).max() < LIMIT and np.mean(z**2) < 1.2
        only = choose_starts(rng, trial, number, 2, GROUPS, np.array([0, 1]) > 0, 25)
        assert (label(theta[only], trial.law, GROUPS) == 1).all()


def test_starts_where_an_ensembles_own_draws_have_no_weight():
    rng = np.random.default_rng(4)
    theta = np.zeros((40, 1))
    log_weights = np.where(np.arange(40) < 20, -np.inf, 0.0)
    trial, found = trial_of(log_weights, theta), np.array([False, True])
    # What it found has no draw: then from its own by weight, or from all.
    assert (choose_starts(rng, trial, 1, 2, GROUPS, found, 9) >= 20).all()
    assert (choose_starts(rng, trial, 0, 2, GROUPS, found, 9) >= 20).all()


def test_ensembles_start_from_draws_of_their_own():
    samplers = ef.run(gaussian([0.4, 0.6], 0.05), "auto", nsteps=1, ensembles=4, seed=1)
    states = samplers[0].recipe.states
    starts = np.array([state.coords for state in states])
    between = starts[:, None, :, None] == starts[None, :, None, :]
    assert not between.any(axis=(2, 3, 4))[~np.eye(4, dtype=bool)].any()
    # Draws of the posterior, whose means are therefore right, each ensemble's.
    z = (starts.mean(axis=1) - [0.4, 0.6]) / (0.05 / starts.shape[1] ** 0.5)
    assert np.abs(z).max() < LIMIT and z.std() > 0.3


def test_a_failing_part_of_the_prior_is_rejected(caplog):
    caplog.set_level("ERROR", "emcee_femu")  # thousands of solves fail

    class Failing(FreeModel):
        def __call__(self, parameters):
            if (parameters["x1"] > 0.5).any():
                raise RuntimeError("no solution")
            return super().__call__(parameters)

    posterior = gaussian([0.5, 0.5], 0.1, model=Failing())  # of which half fails
    options = {"on_failure": "reject", "max_failures": 0.9}
    samplers = ef.run(posterior, "auto", 16, 100, ensembles=1, seed=3, **options)
    half = 0.1 * np.sqrt(2 / np.pi)
    x = np.concatenate([s.get_chain(flat=True) for s in samplers])
    assert x[:, 0].max() <= 0.5 and samplers[0].failures.causes["exception"]
    assert largest_z(samplers, [0.5 - half, 0.5], 0.1) < LIMIT
    evidence = ef.log_evidence(samplers)  # of a Gaussian of peak one, half of it cut
    exact = np.log(0.5 * 2 * np.pi * 0.1**2)
    assert abs(evidence.log_evidence - exact) < LIMIT * evidence.log_evidence_error


def test_a_joint_posterior_in_one_dimension():
    prior = box(0, 3, 1)
    tests = {
        name: (
            FreeModel(),
            density_term(
                lambda x, y=y, sd=sd: -0.5 * ((x[:, 0] - y) / sd) ** 2, prior.names
            ),
        )
        for name, y, sd in (("one", 1.0, 0.2), ("other", 2.0, 0.1))
    }
    posterior = ef.LogPosterior.joint(tests, prior)
    samplers = ef.run(posterior, "auto", 16, 300, ensembles=2, seed=1)
    assert largest_z(samplers, 1.8, 125**-0.5) < LIMIT
    x = np.concatenate([s.get_chain(flat=True) for s in samplers])
    assert x.std() == pytest.approx(125**-0.5, rel=0.1)


@pytest.mark.parametrize("height", [-1e4, 0.0])
def test_the_record_is_json(height):
    posterior = free_posterior(
        lambda x: height - 50 * np.abs(x - 0.3).sum(axis=1), box(0, 1, 2)
    )
    recipe = ef.run(posterior, "auto", nsteps=2, ensembles=2, seed=1)[0].recipe
    text = json.dumps(recipe.record, allow_nan=False)
    assert json.loads(text) == recipe.record
    assert recipe.record["efficiency"] > 0.5
    assert str(recipe).startswith("a search by")


@pytest.mark.parametrize("found", [0, 10])
def test_the_record_of_a_proposal_that_hardly_meets_the_posterior_is_json(found):
    log_weights = np.where(np.arange(1_000) < found, 1.0 * np.arange(1_000), -np.inf)
    theta = np.zeros((1_000, 1))
    law = trial_of(log_weights, theta).law
    rows = np.column_stack([log_weights, log_weights])
    trial = try_out(law, 1_000, lambda law, n: (theta, rows))
    assert trial.narrow and trial.k == np.inf and 0 <= trial.acceptance <= 1
    maximum = SimpleNamespace(theta=np.zeros(1))
    search = SimpleNamespace(
        streams=[0, 0],
        maxima=[maximum],
        found_by=[[1, 2]],
        own=[(theta, rows)],
        climbs=3,
    )
    record = describe(search, trial)
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["found_by"] == [[1, 0], [2, 0]]
    assert record["pareto_k"] > 0.7
    assert (record["weights"][0] is None) == (found == 0)
    good = trial_of(np.zeros(1_000), theta)
    assert is_better(good, trial) and not is_better(trial, good)
    assert not is_better(trial, trial)
