"""What "auto" finds, weighs and samples, on posteriors of known answer."""

import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from scipy.special import logsumexp
from support.free_posterior import FreeModel, box, free_posterior
from support.runs import failures

import emcee_femu as ef
from emcee_femu.evaluation.evaluator import Evaluation
from emcee_femu.sampling.auto import _choose_draws
from emcee_femu.sampling.search import Search

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


def gaussian(mean, sd, low=0.0, high=1.0, **options):
    mean = np.atleast_1d(mean)
    prior = box(low, high, len(mean))
    return free_posterior(
        lambda x: -0.5 * (((x - mean) / sd) ** 2).sum(axis=1), prior, **options
    )


def largest_z(samplers, mean, sd, discard=0):
    """Return how far the means are off, in standard errors."""
    x = np.concatenate([s.get_chain(flat=True, discard=discard) for s in samplers])
    tau = max(s.get_autocorr_time(quiet=True, tol=0).max() for s in samplers)
    return np.abs(x.mean(axis=0) - mean).max() / (np.min(sd) * np.sqrt(tau / len(x)))


# --- several modes ----------------------------------------------------------------


def test_weights_of_modes_are_exact_and_so_are_their_errors():
    posterior = two_modes(0.15, 2)
    estimates = []
    for seed in range(8):
        samplers = ef.run(posterior, "auto", 20, 50, ensembles=2, seed=seed)
        result = samplers.search
        assert len(result.weights) == 2 and np.sum(result.found_by, axis=0).all()
        weight, error = min(zip(result.weights, result.errors, strict=True))
        inside = [(s.get_chain()[..., 0] > 4.3).mean() for s in samplers]
        estimates.append([weight, error, np.mean(inside)])
    weights, errors, inside = np.array(estimates).T
    z = (weights - SHARE) / errors
    assert np.abs(z).max() < LIMIT and 0.4 < np.sqrt(np.mean(z**2)) < 2.0
    assert errors.max() < 0.03
    assert abs(inside.mean() - SHARE) < LIMIT * inside.std() / np.sqrt(8)
    assert inside.std() < 0.05


def search_of(posterior, seed, starts=None):
    streams = np.random.default_rng(seed).spawn(2 if starts is None else len(starts))
    with Evaluation.open(posterior) as evaluator:
        search = Search(evaluator, streams)
        search.run(1_000, starts, 20_000)
    return search


def test_the_first_proposal_is_the_gaussians_of_the_modes_by_their_evidence():
    mixture = search_of(two_modes(0.15, 2), 1).mixture()
    order = np.argsort(mixture.means[:, 0])
    assert_allclose(mixture.weights[order], [1 - SHARE, SHARE], atol=0.01)
    variances = np.array([1.0, 0.15**2])[:, None, None] * np.eye(2)
    assert_allclose(mixture.matrices[order], variances, rtol=0.05, atol=1e-3)


def test_every_ensemble_climbs_from_more_than_its_highest_point():
    """Needles that no scan can hit; each of four ensembles was given points at two."""
    angles = 2 * np.pi * np.arange(8) / 8
    needles = 6 * np.column_stack([np.cos(angles), np.sin(angles)])

    def log_density(x):
        squares = ((x[:, None] - needles) ** 2).sum(axis=2)
        return logsumexp(np.c_[13 - squares / 2e-6, -0.5 * (x**2).sum(axis=1)], axis=1)

    starts = np.random.default_rng(1).normal(size=(4, 8, 2))
    starts[:, :2] = needles.reshape(4, 2, 2) + 1e-4
    search = search_of(free_posterior(log_density, box(-10, 10, 2)), 1, starts)
    places = [tuple(np.round(maximum.theta, 2)) for maximum in search.maxima]
    found_by = dict(zip(places, search.found_by, strict=True))
    for number, needle in enumerate(needles):
        assert found_by[tuple(np.round(needle, 2))][number // 2], needle


def ridges(x):
    """Return two bent ridges, one of some percent, and a ball beside them."""
    along = -50 * (x[:, 0] * x[:, 1] - 1) ** 2
    across = -0.5 * ((x[:, 0] - 2) ** 2 + x[:, 2] ** 2 + x[:, 3] ** 2)
    ball = -0.5 * ((x + 3) ** 2).sum(axis=1) / 0.3**2 - 4 * np.log(0.3)
    return np.logaddexp(np.log(0.6) + along + across, np.log(0.4) + ball)


@pytest.mark.slow
def test_what_the_modes_explain_least_is_climbed_from_though_it_is_low():
    """The highest points alone are those of the tails of the first ridge."""
    prior = ef.GaussianPrior(
        ["x1", "x2", "x3", "x4"], np.zeros(4), 3.0, [(-40, 40)] * 4
    )
    posterior = free_posterior(ridges, prior)
    found = [len(search_of(posterior, seed).maxima) for seed in range(6)]
    assert np.mean(found) >= 2.8


@pytest.mark.slow
def test_scans_about_the_wide_mode_hit_a_needle():
    """Which draws of the prior hardly ever do."""
    samplers = ef.run(two_modes(0.05, 2), "auto", 20, 1_000, ensembles=2, seed=0)
    assert min(samplers.search.weights) == pytest.approx(SHARE, abs=0.05)
    for sampler in samplers:  # jumps reach both ensembles, and every walker
        inside = sampler.get_chain()[..., 0] > 5 - 5 * 0.05
        assert inside.mean() == pytest.approx(SHARE, abs=0.05)
        assert inside.any(axis=0).all() and (~inside).any(axis=0).all()


def test_a_valley_tells_a_mode_from_the_tail_that_it_stands_in():
    """Most of what is unexplained is tail, from where climbs lead to the known mode."""

    def log_density(x):
        tail = -2.0 * np.log1p((x**2).sum(axis=1) / 2.0)
        apart = ((x - [15.0, 0.0]) ** 2).sum(axis=1)
        return np.logaddexp(tail, np.log(0.02) - 0.5 * apart / 1.5**2)

    posterior = free_posterior(log_density, box(-40, 40, 2))
    for seed in range(6):
        found = ef.run(posterior, "auto", 16, 2, ensembles=2, seed=seed).search
        assert len(found.weights) == 2 and found.found_by.sum(axis=0).all()


def test_what_one_ensemble_was_given_it_alone_starts_from():
    """A needle that no scan can hit is in the proposal of all, and weighed exactly."""
    starts = np.random.default_rng(1).normal(0.0, 1.0, (3, 20, 2))
    starts[1, 7] = [5.0 + 1e-4, 1e-4]
    posterior = two_modes(1e-3, 2)
    samplers = ef.run(posterior, "auto", 20, 100, ensembles=3, seed=1, starts=starts)
    result = samplers.search
    needle = int(np.argmin(result.weights))
    found_by = [by[needle] for by in result.found_by]
    assert found_by[1] > 0 and found_by[::2] == [0, 0]
    weight, error = result.weights[needle], result.errors[needle]
    assert abs(weight - SHARE) < LIMIT * error < 0.2
    x = np.stack([s.get_chain()[..., 0] for s in samplers])
    starts = np.array(result.starts)[:, needle]
    assert starts[1] > 0 and (starts[::2] == 0).all()
    inside = (x[:, 20:] > 4.9).mean(axis=(1, 2))
    assert_allclose(inside, SHARE, atol=0.1)  # jumps reach all ensembles


def test_draws_that_a_posterior_brings_are_searched_too():
    posterior = two_modes(1e-3, 2)
    posterior.draws = np.array([[0.0, 0.0]] * 5 + [[5.0 + 1e-4, 1e-4]])
    found = ef.run(posterior, "auto", 20, 2, ensembles=2, seed=1).search
    assert found.found_by.sum(axis=1).all() and len(found.weights) == 2


# --- one mode ---------------------------------------------------------------------

CORRELATED = np.array([[1.0, 0.9, 0], [0.9, 1, 0], [0, 0, 0.1]])
MIXTURE = [(0.3, [0, 0, 0], CORRELATED), (0.7, [3, 0, 1], np.diag([0.2, 2.0, 1.0]))]


def mixture(x):
    laws = [stats.multivariate_normal(mean, cov) for _, mean, cov in MIXTURE]
    parts = [np.log(MIXTURE[i][0]) + law.logpdf(x) for i, law in enumerate(laws)]
    return np.logaddexp(*np.reshape(parts, (2, -1)))


DENSITIES = {  # and the effective share of the proposal
    "one parameter": (1, 0.8, lambda x: -0.5 * ((x[:, 0] - 0.3) / 0.01) ** 2),
    "a kink": (2, 0.5, lambda x: -50 * np.abs(x - 0.3).sum(axis=1)),
    "a mixture": (3, 0.7, mixture),
}


@pytest.mark.parametrize("height", [-1e5, 1e5])
@pytest.mark.parametrize("name", DENSITIES)
def test_the_proposal_is_good_whatever_the_constant(name, height):
    d, share, density = DENSITIES[name]
    posterior = free_posterior(lambda x: height + density(x), box(-10, 10, d))
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


@pytest.mark.parametrize("height", [-1e5, 1e5])
def test_all_of_ten_modes_are_found_whatever_the_constant(height):
    posterior = free_posterior(lambda x: height + ten_modes(x), box(-20, 20, 2))
    for seed in range(4):
        run = ef.run(posterior, "auto", 16, 2, ensembles=2, seed=seed)
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


def test_walkers_start_by_importance_weights_in_modes_of_their_ensemble():
    log_weights = np.log([1.0, 2.0, 3.0, 4.0, 5.0, 0.0 + 1e-300])
    own, part = np.array([True, True, True, True, False, True]), np.arange(6)
    rng = np.random.default_rng(1)
    chosen = _choose_draws(rng, log_weights, part, own, 1_000)
    counts = np.bincount(chosen, minlength=6)
    assert_allclose(counts, [100, 200, 300, 400, 0, 0], atol=1)  # stratified


def test_all_climbs_to_the_parts_of_a_mode_are_counted():
    def log_density(x):
        apart = [((x - [at, 0.0]) ** 2).sum(axis=1) for at in (-1.75, 1.75)]
        return np.logaddexp(*(-0.5 * np.array(apart)))

    posterior = free_posterior(log_density, box(-10, 10, 2))
    for seed in range(4):
        search = ef.run(posterior, "auto", 16, 2, ensembles=4, seed=seed).search
        assert len(search.weights) == 1
        assert search.found_by.sum() == search.climbs


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
    x = samplers[0].get_chain(flat=True)
    assert x[:, 0].max() <= 0.5 and failures(samplers)[1]["exception"]
    assert largest_z(samplers, [0.5 - half, 0.5], 0.1) < LIMIT
    evidence = ef.log_evidence(samplers)  # of a Gaussian of peak one, half of it cut
    exact = np.log(0.5 * 2 * np.pi * 0.1**2)
    assert abs(evidence.log_evidence - exact) < LIMIT * evidence.log_evidence_error


# --- what it may cost -------------------------------------------------------------

PRESSED = 14  # parameters, most of them to their bounds


def pressed(x):
    """Return the fit of a product model, whose truth is mostly out of its bounds."""
    rng = np.random.default_rng(PRESSED)
    mixed = rng.normal(size=(PRESSED + 4, PRESSED)) / PRESSED**0.5
    truth = np.where(rng.random(PRESSED) < 0.9, rng.choice([-0.4, 1.4], PRESSED), 0.5)
    return -0.5 * (((np.exp(0.5 * (x - truth) @ mixed.T) - 1) / 0.02) ** 2).sum(axis=1)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 2))]
)
def test_the_search_keeps_to_its_budget_whatever_lies_at_bounds(
    monkeypatch, caplog, capsys, seed
):
    """Fault 23: 94,802 to 157,164 evaluations for chains of 8,000 to 13,000."""
    caplog.set_level("INFO", "emcee_femu")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    posterior = free_posterior(pressed, box(0, 1, PRESSED))
    run = ef.run(posterior, "auto", steps=50, seed=seed, progress=True)
    (said,) = caplog.messages
    assert said.startswith("search, at most 30,000 evaluations, ")
    shown = capsys.readouterr().err  # the bar; the first solve was before it
    assert f"{said}:   0%" in shown and f"{run.search.solves - 1}/30000" in shown
    assert 10_000 < run.search.solves <= 30_000  # else the case tells nothing
    for sampler in run:
        assert len(np.unique(sampler.get_chain()[0], axis=0)) > 20  # not one draw alone
        assert (sampler.acceptance_fraction > 0).mean() > 0.9


def test_climbs_leave_the_budget_of_what_follows(monkeypatch):
    monkeypatch.setattr("emcee_femu.sampling.auto.LEAST_BUDGET", 4_500)
    posterior = free_posterior(ten_modes, box(-20, 20, 2))
    search = ef.run(posterior, "auto", 16, 2, seed=1).search
    assert search.solves < 4_500 and search.climbs == 4  # one of each, of ten modes


# --- gradients --------------------------------------------------------------------

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


@pytest.mark.slow
def test_skew_parameters_are_moved_by_gradients_where_there_are_any():
    def term(parameters, response):
        return -0.5 * (((response["y"] - 1) / 0.5) ** 2).sum(axis=1)

    prior = ef.GaussianPrior(Exponential.names, np.zeros(12), 1.0, [(-6.0, 3.0)] * 12)
    posterior = ef.LogPosterior(Exponential(), term, prior)
    samplers = ef.run(posterior, "auto", 24, 80, ensembles=2, seed=1)
    assert "Hamiltonian" in samplers.search.sentence
    assert largest_z(samplers, MEAN, SPREAD, discard=20) < LIMIT
    x = np.concatenate([s.get_chain(flat=True, discard=20) for s in samplers])
    assert_allclose(x.std(axis=0) / SPREAD, 1.0, atol=0.15)


class Square:
    """A response of which the sign of a parameter is not known."""

    names, variables = ("a", "b"), {"y": ef.Variable({"i": range(2)})}

    def __call__(self, p):
        return {"y": np.column_stack([p["a"] ** 2, p["b"]])}

    def jacobian(self, p):
        slopes = {"a": 2 * p["a"][:, None] * [1, 0], "b": np.ones_like(p["b"])[:, None]}
        return self(p), {"y": slopes | {"b": slopes["b"] * [0, 1]}}


def test_beside_gradients_there_are_jumps_between_modes(monkeypatch):
    monkeypatch.setattr(
        "emcee_femu.sampling.auto.POOR_ACCEPTANCE", 2.0
    )  # gradients do better

    def term(parameters, response):
        return -50 * ((response["y"] - 1) ** 2).sum(axis=1)

    prior = ef.GaussianPrior(["a", "b"], [0.0, 0.0], 1.0)
    posterior = ef.LogPosterior(Square(), term, prior)
    run = ef.run(posterior, "auto", 16, 10, ensembles=2, seed=1)
    assert len(run.search.weights) == 2
    shares = {type(move).__name__: share for move, share in run.moves}
    assert shares["HamiltonianMove"] > shares["IndependenceMove"] > 0


# --- what it says and gains -------------------------------------------------------


def test_auto_says_what_it_did_and_beats_plain_demc():
    posterior = ef.paper.mass_spring().posterior
    run = ef.run(posterior, "auto", 20, 600, ensembles=2, seed=3)
    diagnosis = ef.diagnose(run)
    assert diagnosis.converged, diagnosis.verdict
    per_evaluation = diagnosis.ess_bulk.min() / (2 * 20 * 600)
    assert per_evaluation > 0.15  # plain DE-MC: 0.04
    sentence = run.search.sentence
    assert "Student-t" in sentence and "DEMC" in sentence
    assert 1_000 < run.evaluations < 10_000
    assert [type(move).__name__ for move, _ in run.moves] == [
        "IndependenceMove",
        "DEMCMove",
    ]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # scipy's, of the overflow
def test_a_prior_whose_draws_overflow_is_named_as_the_cause():
    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
    term = ef.FrequencyTerm([200.0], relative_sd=0.02)
    prior = ef.IndependentPrior({"k": stats.lognorm(40e3, 0.2)})
    with pytest.raises(
        ValueError, match=r"are infinite; scipy.stats.lognorm takes \(s"
    ):
        ef.run(ef.LogPosterior(model, term, prior), steps=10, seed=1)
