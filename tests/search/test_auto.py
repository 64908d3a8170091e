"""What "auto" finds, weighs and samples, on posteriors of known answer."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.campaigns import by_hand
from support.free_posterior import box, free_posterior
from support.gradients import LinearDerived, LinearTerm

import emcee_femu as ef
from emcee_femu.search import auto

LIMIT = 5.0  # |z|
SHARE = 0.3  # of the posterior in the narrow mode


def two_modes(sd, d):
    """Return the posterior of a wide mode and a narrow one, five away."""
    narrow = np.eye(d)[0] * 5.0
    laws = [
        (1 - SHARE, stats.multivariate_normal(np.zeros(d), np.eye(d))),
        (SHARE, stats.multivariate_normal(narrow, sd**2 * np.eye(d))),
    ]

    def log_density(x):
        parts = [np.log(w) + law.logpdf(x).reshape(-1) for w, law in laws]
        return np.logaddexp(*parts)

    return free_posterior(log_density, box(-10, 10, d))


def test_weights_of_modes_are_exact_and_so_are_their_errors():
    posterior = two_modes(0.15, 2)
    estimates = []
    for seed in range(5):
        samplers = ef.run(posterior, "auto", 20, 30, ensembles=2, seed=seed)
        result = samplers.search
        assert len(result.weights) == 2 and np.sum(result.found_by, axis=0).all()
        weight, error = min(zip(result.weights, result.errors, strict=True))
        inside = [(s.get_chain()[..., 0] > 4.3).mean() for s in samplers]
        estimates.append([weight, error, np.mean(inside)])
    weights, errors, inside = np.array(estimates).T
    z = (weights - SHARE) / errors
    assert np.abs(z).max() < LIMIT and 0.3 < np.sqrt(np.mean(z**2)) < 2.5
    assert errors.max() < 0.03
    assert abs(inside.mean() - SHARE) < LIMIT * inside.std() / np.sqrt(5)


@pytest.mark.parametrize("given", ["starts", "draws"])
def test_a_needle_that_no_scan_can_hit_is_found_where_it_was_given(given):
    """One ensemble starts there, or the posterior brings draws; exactly weighed."""
    posterior, options = two_modes(1e-3, 2), {"ensembles": 3, "seed": 1}
    point = [5.0 + 1e-4, 1e-4]
    if given == "draws":
        posterior.draws = np.array([[0.0, 0.0]] * 5 + [point])
    else:
        options["starts"] = np.random.default_rng(1).normal(0.0, 1.0, (3, 20, 2))
        options["starts"][1, 7] = point
    samplers = ef.run(posterior, "auto", 20, 60, **options)
    result = samplers.search
    needle = int(np.argmin(result.weights))
    assert len(result.weights) == 2 and np.sum(result.found_by, axis=0).all()
    weight, error = result.weights[needle], result.errors[needle]
    assert abs(weight - SHARE) < LIMIT * error < 0.2
    x = np.stack([s.get_chain()[..., 0] for s in samplers])
    inside = (x[:, 20:] > 4.9).mean(axis=(1, 2))
    assert_allclose(inside, SHARE, atol=0.15)  # jumps reach all ensembles
    if given == "starts":  # and it alone starts there
        assert [by[needle] > 0 for by in result.found_by] == [False, True, False]
        assert [n[needle] > 0 for n in result.starts] == [False, True, False]


CORRELATED = np.array([[1.0, 0.9, 0], [0.9, 1, 0], [0, 0, 0.1]])
MIXTURE = [(0.3, [0, 0, 0], CORRELATED), (0.7, [3, 0, 1], np.diag([0.2, 2.0, 1.0]))]


def mixture(x):
    laws = [stats.multivariate_normal(mean, cov) for _, mean, cov in MIXTURE]
    parts = [np.log(MIXTURE[i][0]) + law.logpdf(x) for i, law in enumerate(laws)]
    return np.logaddexp(*np.reshape(parts, (2, -1)))


DENSITIES = {  # and the effective share of the proposal
    "one parameter": (1, 0.8, lambda x: -0.5 * ((x[:, 0] - 0.3) / 0.01) ** 2),
    "a kink": (2, 0.35, lambda x: -50 * np.abs(x - 0.3).sum(axis=1)),
    "a mixture": (3, 0.7, mixture),
}


@pytest.mark.parametrize("name", DENSITIES)
def test_the_proposal_is_good_whatever_the_constant(name):
    d, share, density = DENSITIES[name]
    posterior = free_posterior(lambda x: 1e5 + density(x), box(-10, 10, d))
    samplers = ef.run(posterior, "auto", steps=2, ensembles=2, seed=1)
    assert samplers.search.efficiency > share


def ten_modes(x):
    """Return ten Gaussians of unequal weights and widths in the plane."""
    rng = np.random.default_rng(10)
    sds, weights = rng.uniform(0.3, 1, 10), np.linspace(0.04, 0.16, 10)
    means = [[i, j] + rng.normal(size=2) for i in range(-10, 15, 5) for j in (-5, 5)]
    distances = np.linalg.norm(x[:, None] - np.array(means), axis=2) / sds
    parts = np.log(weights / sds**2) - 0.5 * distances**2
    return np.logaddexp.reduce(parts, axis=1)


def test_all_of_ten_modes_are_found_whatever_the_constant():
    posterior = free_posterior(lambda x: ten_modes(x) - 1e5, box(-20, 20, 2))
    run = ef.run(posterior, "auto", 16, 2, ensembles=2, seed=0)
    assert len(run.search.weights) == 10


def test_ensembles_start_from_draws_of_the_posterior_of_their_own():
    def bent(x):  # so that half of the walkers stay in the first step
        return -0.5 * (x[:, 0] ** 2 + 9 * (x[:, 1] - x[:, 0] ** 2) ** 2)

    posterior = free_posterior(bent, box(-15, 15, 2))
    samplers = ef.run(posterior, "auto", 100, 1, ensembles=4, seed=1)
    starts = np.array([sampler.get_chain()[0] for sampler in samplers])
    same = starts[:, None, :, None] == starts[None, :, None, :]
    assert not same.any(axis=(2, 3, 4))[~np.eye(4, dtype=bool)].any()
    z = starts.mean(axis=1)[:, 0] * np.sqrt(100)
    assert np.abs(z).max() < LIMIT and z.std() > 0.2


PRESSED = 14  # parameters, most of them to their bounds


def pressed(x):
    """Return the fit of a product model, whose truth is mostly out of its bounds."""
    rng = np.random.default_rng(PRESSED)
    mixed = rng.normal(size=(PRESSED + 4, PRESSED)) / PRESSED**0.5
    truth = np.where(rng.random(PRESSED) < 0.9, rng.choice([-0.4, 1.4], PRESSED), 0.5)
    return -0.5 * (((np.exp(0.5 * (x - truth) @ mixed.T) - 1) / 0.02) ** 2).sum(axis=1)


@pytest.mark.slow
def test_the_search_keeps_to_its_budget_whatever_lies_at_bounds(caplog):
    """Fault 23: 94,802 to 157,164 evaluations for chains of 8,000 to 13,000."""
    caplog.set_level("INFO", "emcee_femu")
    posterior = free_posterior(pressed, box(0, 1, PRESSED))
    run = ef.run(posterior, "auto", steps=20, ensembles=2, seed=0)
    (said,) = caplog.messages
    (most,) = re.findall(r"about ([\d,]+)", said)
    assert 0.3 < run.search.solves / int(most.replace(",", "")) <= 1
    for sampler in run:
        assert len(np.unique(sampler.get_chain()[0], axis=0)) > 1  # not one draw alone
        assert (sampler.acceptance_fraction > 0).mean() > 0.6


def narrow(x):
    """Return a Gaussian of a narrow sd, far from the middle of the prior."""
    return -4e5 * ((x - np.linspace(0.2, 0.8, 7)) ** 2).sum(axis=1)


@pytest.mark.parametrize(
    ("density", "d"),
    [(narrow, 7), pytest.param(pressed, PRESSED, marks=pytest.mark.slow)],
)
def test_a_search_leaves_half_of_few_solves_to_the_chain(density, d):
    run = ef.run(free_posterior(density, box(0, 1, d)), solves=10_000, seed=3)
    assert run.search.solves <= 5_000
    found = ef.diagnose(run)
    assert found.converged == (density is narrow)


GRID = np.linspace(-6.0, 3.0, 20_001)
SKEW = np.exp(-0.5 * GRID**2 - 2 * (np.exp(1.5 * GRID) - 1) ** 2)
MEAN = np.average(GRID, weights=SKEW)
SPREAD = np.average((GRID - MEAN) ** 2, weights=SKEW) ** 0.5


class Exponential:
    """A response y_i = exp(1.5 x_i), by which each parameter is skew."""

    names = tuple(f"x{i}" for i in range(12))
    variables = {"y": ef.Variable({"i": range(12)})}

    def __call__(self, parameters):
        return {"y": np.exp(1.5 * np.stack([*parameters.values()], axis=1))}

    def jacobian(self, parameters):
        response = self(parameters)
        slopes = zip(self.names, 1.5 * np.eye(12), strict=True)
        return response, {"y": {name: response["y"] * unit for name, unit in slopes}}


def skew_posterior():
    """Return the posterior of that response, whose gradient takes one solve."""

    def term(parameters, response):
        return -0.5 * (((response["y"] - 1) / 0.5) ** 2).sum(axis=1)

    prior = ef.GaussianPrior(Exponential.names, np.zeros(12), 1.0, [(-6.0, 3.0)] * 12)
    return ef.LogPosterior(Exponential(), term, prior)


@pytest.mark.slow
def test_climbs_and_chains_by_gradients_keep_to_few_solves():
    """A tuned trajectory alone would take more; climbs get where they go."""
    run = ef.run(skew_posterior(), solves=10_000, seed=3)
    assert run.search.solves < 7_000 and run.solves <= 10_000
    assert run[0].iteration > 8 and run.search.from_prior


def test_climbs_from_the_prior_have_their_share_of_a_search_and_no_more():
    """Of a linear model each takes two solves; they share half the points."""
    model = LinearDerived()
    prior = ef.GaussianPrior(model.names, np.zeros(3), 1.0)
    posterior = ef.LogPosterior(model, LinearTerm(), prior)
    search = ef.run(posterior, "auto", 24, 2, ensembles=2, seed=1).search
    assert 0.5 <= 2 * search.from_prior / search.points < 0.6  # and a batch of climbs


@pytest.mark.slow
def test_a_chain_of_trajectories_keeps_to_its_solves():
    """A proposal of them takes 40."""
    move = ef.moves.HamiltonianMove(steps=40, step_size=0.1)
    run = ef.run(skew_posterior(), move, 24, solves=12_000, seed=3)
    assert 10_800 < run.solves <= 12_000
    move = ef.moves.HamiltonianMove(steps=20, step_size=0.1)
    mixed = [(move, 0.5), (ef.DEMCMove(), 0.5)]  # each ensemble draws its own
    run = ef.run(skew_posterior(), mixed, 24, solves=12_000, seed=4)
    assert 10_800 < run.solves <= 12_000 + 20 * 4 * 24  # at most a step too many


@pytest.mark.slow
def test_skew_parameters_are_moved_by_gradients_where_there_are_any(monkeypatch):
    """The law of gradients in "auto": twelve skew marginals, by quadrature.

    With components for all twelve tails, the proposal may be good enough by itself.
    """
    monkeypatch.setattr("emcee_femu.search.tails.TAIL_SOLVES", 0)
    samplers = ef.run(skew_posterior(), "auto", 24, 80, ensembles=2, seed=1)
    assert "Hamiltonian" in samplers.search.sentence
    x = np.concatenate([s.get_chain(flat=True, discard=20) for s in samplers])
    tau = max(s.get_autocorr_time(quiet=True, tol=0).max() for s in samplers)
    z = (x.mean(axis=0) - MEAN) / (SPREAD * np.sqrt(tau / len(x)))
    assert np.abs(z).max() < LIMIT
    assert_allclose(x.std(axis=0) / SPREAD, 1.0, atol=0.15)


def test_the_search_of_a_long_run_is_a_small_part_of_it():
    """A fifth of its evaluations would be 20,000 points."""
    run = ef.run(two_modes(0.15, 2), nwalkers=250, steps=100, seed=1)
    assert 9_000 < run.search.points < 11_000
    assert run.search.solves < 0.2 * run.solves


def test_a_density_without_residuals_or_gradients_is_searched_with_more_points():
    """Climbs, which find what points missed, are dear there."""
    points = []
    for differentiable, observed in ((0, {}), (0, {"y": 1}), (1, {}), (1, {"y": 1})):
        term = SimpleNamespace(observed=observed)
        posterior = SimpleNamespace(
            ndim=2, terms=[term], differentiable=bool(differentiable), normal=False
        )
        evaluator = SimpleNamespace(posterior=posterior, solves=0)
        points.append(auto._plan(evaluator, 24, 4_000, 10_000)[1].points)
    assert points[0] >= 2 * points[1] and len(set(points[1:])) == 1


@pytest.mark.slow
def test_auto_beats_plain_demc():
    """The law of "auto" where there is one mode: effective draws per evaluation."""
    posterior = ef.paper.mass_spring().posterior
    run = ef.run(posterior, "auto", 20, 600, ensembles=2, seed=3)
    diagnosis = ef.diagnose(run)
    assert diagnosis.converged, diagnosis.verdict
    drawn = 2 * 20 * 600
    assert diagnosis.ess_bulk.min() / drawn > 0.15  # plain DE-MC: 0.04
    drawn += run.evaluations  # of the search
    assert diagnosis.ess_bulk.min() / drawn > 0.08


@pytest.mark.parametrize(
    ("mixture", "reliable", "taken"),
    [(0.4, True, True), (0.4, False, False), (0.1, False, True), (0.6, True, False)],
)
def test_polynomials_replace_a_fair_mixture_only_by_reliable_weights(
    mixture, reliable, taken, monkeypatch
):
    """Both seem to accept .5 of their proposals; a poor mixture is no loss."""
    law = SimpleNamespace(law=None)
    first = SimpleNamespace(acceptance=mixture, proposal=law)
    nothing = np.zeros(1)
    found = SimpleNamespace(
        reliable=reliable,
        theta=nothing,
        log_p=nothing,
        log_q=nothing,
        is_better=lambda other: False,
    )
    campaign = SimpleNamespace(
        bent=True,
        settings=auto.SETTINGS,
        best=first,
        surface=None,
        streams=[None],
        evaluator=SimpleNamespace(solves=0),
        ledger=SimpleNamespace(end=lambda *stages: np.inf),
    )
    surface = np.zeros_like
    monkeypatch.setattr(auto, "learn_surface", lambda *args: (surface, law))
    monkeypatch.setattr(auto, "judge", lambda c: setattr(c, "best", found))
    monkeypatch.setattr(auto, "find_acceptance", lambda *args: 0.5)
    auto.bend(campaign)
    assert (campaign.surface is surface) == taken
    assert (campaign.best is found) == taken


@pytest.mark.parametrize(
    ("acceptance", "efficiency", "total", "populations"),
    [
        (0.01, 0.01, 30_000, 2),  # hardly meets the posterior
        (0.40, 0.01, 30_000, 0),  # meets it well enough for a chain
        (0.01, 0.01, 7_000, 0),  # no solve is left for a population
        (0.01, 0.00, 30_000, 2),  # no draw is possible
    ],
)
def test_starts_are_annealed_where_the_proposal_is_poor_and_solves_are_left(
    acceptance, efficiency, total, populations
):
    posterior = free_posterior(lambda x: -0.5 * (x**2).sum(axis=1), box(-9, 9, 2))
    campaign = by_hand(posterior, ensembles=2, total=total)
    campaign.best = SimpleNamespace(
        reliable=False, acceptance=acceptance, efficiency=efficiency
    )
    auto.anneal_starts(campaign)
    assert len(campaign.populations) == populations
