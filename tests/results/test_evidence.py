"""log_evidence against closed forms, and the honesty of its standard errors."""

from types import SimpleNamespace

import emcee
import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.examples import load
from support.tempered_laws import BoundedLaw, GaussianLaw

import emcee_femu as ef
from emcee_femu import DEMCMove, TemperedMove, log_evidence
from emcee_femu.results.arviz_objects import load_arviz
from emcee_femu.results.evidence import Evidence
from emcee_femu.results.evidence_ladder import space_betas
from emcee_femu.sampling.run_file import RunFile

LAWS = {"gaussian": GaussianLaw(), "bounded": BoundedLaw()}
BETAS = np.linspace(1, 0, 8) ** 3


def tempered(law, block, nsteps, seed=1, betas=BETAS, **options):
    move, nwalkers = TemperedMove(DEMCMove(), betas), block * len(betas)
    return ef.run(law.posterior, move, nwalkers, nsteps, seed=seed, **options)


@pytest.mark.parametrize("law", LAWS)
def test_the_evidence_is_the_exact_one(law):
    found = log_evidence(tempered(LAWS[law], block=100, nsteps=800), discard=100)
    exact = LAWS[law].log_evidence
    assert found.log_evidence_error < 0.02
    assert abs(found.log_evidence - exact) < 3 * found.log_evidence_error


@pytest.mark.slow
def test_the_standard_error_is_the_spread_of_independent_runs():
    repeated = tempered(LAWS["gaussian"], block=20, nsteps=500, ensembles=10, seed=2)
    found = [log_evidence(run, discard=60) for run in repeated]
    values = [one.log_evidence for one in found]
    claimed = np.sqrt(np.mean([one.log_evidence_error**2 for one in found]))
    assert 0.5 < np.std(values, ddof=1) / claimed < 2
    together = log_evidence(repeated, discard=60)
    assert_allclose(np.mean(values), together.log_evidence, atol=claimed)
    error = together.log_evidence_error
    assert 0.5 < error / (claimed / np.sqrt(len(found))) < 2
    assert abs(together.log_evidence - LAWS["gaussian"].log_evidence) < 4 * error


class Backend(emcee.backends.Backend):
    """A stored chain with the moves of its sampler, as log_evidence sees one."""

    def __init__(self, log_likelihood, betas=(1.0, 0.5, 0.0), log_prior=-2.0):
        super().__init__()
        steps, self.nwalkers = log_likelihood.shape
        self._moves = [TemperedMove(DEMCMove(), betas)]
        self.reset(self.nwalkers, 1)
        blobs = np.full((self.nwalkers, 2), log_prior)
        self.grow(steps, blobs)
        for likelihood in log_likelihood:
            state = emcee.State(
                np.zeros((self.nwalkers, 1)), likelihood + log_prior, blobs
            )
            self.save_step(state, np.ones(self.nwalkers, bool))


def independent(steps=1_000, shift=0.0):
    """Return log-likelihoods of three rungs, whose laws are those of one Gaussian.

    With N(-2, 2) at beta = 0 they are N(-2 + 2 beta, 2): the evidence is exp(-1).
    """
    values = np.random.default_rng(1).normal(size=(steps, 3, 5)) * np.sqrt(2)
    return (values + np.array([0.0, -1.0, -2.0])[:, None] + shift).reshape(steps, -1)


def test_independent_draws_of_a_known_ladder_give_its_evidence():
    errors = []
    for steps in (1_000, 16_000):
        found = log_evidence(Backend(independent(steps)))
        assert abs(found.log_evidence + 1) < 3 * found.log_evidence_error
        errors.append(found.log_evidence_error)
    assert_allclose(errors[0] / errors[1], 4, rtol=0.15)
    # Both laws are d = 1 / sqrt(2) standard deviations apart: E sech^2 by quadrature.
    x, d = np.linspace(-9, 9, 10_001), np.sqrt(0.5)
    density = np.exp(-0.5 * (x - d / 2) ** 2) / np.sqrt(2 * np.pi)
    overlap = np.trapezoid(density / np.cosh(d * x / 2) ** 2, x)
    assert_allclose(found.overlaps, overlap, rtol=0.02)
    # Meng and Wong's error of each bridge; rung 1 has a part in both.
    alone = np.sqrt(2 * (1 / overlap - 1) * 2 / (16_000 * 5))
    assert 0.8 < errors[1] / alone < 1.6


def test_the_error_grows_with_what_walkers_and_ensembles_share():
    rng, means = np.random.default_rng(2), np.array([0.0, -1.0, -2.0])[:, None]
    shared = means + rng.normal(size=(1_000, 1, 1)) * np.ones((1, 3, 5))
    alone = means + rng.normal(size=(1_000, 3, 5))
    errors = [
        log_evidence(Backend(values.reshape(1_000, -1))).log_evidence_error
        for values in (alone, shared)
    ]
    assert errors[1] > 2.5 * errors[0]
    two = [Backend(alone.reshape(1_000, -1) + shift) for shift in (0.0, 1.0)]
    # Each is sure of itself; that they are 1 apart is the larger error.
    assert_allclose(log_evidence(two).log_evidence_error, 0.5, rtol=0.2)


def test_huge_log_likelihoods_neither_overflow_nor_vanish():
    found, moved = (log_evidence(Backend(independent(100, s))) for s in (0.0, -1e6))
    assert_allclose(moved.log_evidence, found.log_evidence - 1e6, rtol=1e-9)
    assert_allclose(moved.log_evidence_error, found.log_evidence_error, rtol=1e-4)


def test_rungs_that_do_not_overlap_claim_no_error_and_name_better_betas():
    apart = independent().reshape(-1, 3, 5) + 20 * np.array([2.0, 1.0, 0.0])[:, None]
    found = log_evidence(Backend(apart.reshape(1_000, -1)))
    assert found.log_evidence_error == np.inf
    text = str(found).splitlines()
    assert "no standard error can be claimed" in text[0]
    assert text[1].startswith("Betas ") and "hardly overlap" in text[1]


def test_better_betas_are_equally_far_apart():
    """For a Gaussian likelihood in d dimensions under a wide Gaussian prior."""
    d, wide = 8, 1e4
    betas = np.array([1.0, 0.1, 1e-3, 0.0])

    def variance(beta):
        return d / 2 / (beta + 1 / wide) ** 2

    better = space_betas(betas, variance(betas))
    assert better[0] == 1 and better[-1] == 0 and (np.diff(better) < 0).all()
    apart = np.sqrt(d / 2) * -np.diff(np.log(better + 1 / wide))
    assert_allclose(apart, apart[0], rtol=1e-2)
    assert 1.1 < apart[0] <= 1.2 * (1 + 1e-3)


def test_short_and_drifting_chains_claim_no_error():
    steps = 400
    slow = np.cumsum(np.random.default_rng(3).normal(size=(steps, 1, 1)), axis=0)
    walk = independent(steps).reshape(steps, 3, 5) * 0.1 + 0.1 * slow
    short = log_evidence(Backend(walk.reshape(steps, -1)))
    assert short.log_evidence_error == np.inf
    assert "autocorrelation times of the evidence long" in str(short)
    drift = independent(steps)
    drift[: steps // 2] += 1.0
    found = log_evidence(Backend(drift))
    assert found.log_evidence_error == np.inf
    assert np.isfinite(log_evidence(Backend(drift), steps // 2).log_evidence_error)


def half_solvable(parameters):
    """Return a frequency in one half of the unit box, none in the other."""
    return [1.0 if parameters["a"] < 0.5 else np.nan]


def test_the_evidence_is_that_of_the_prior_where_it_can_be_solved():
    law = LAWS["bounded"]
    posterior = ef.LogPosterior(
        ef.FunctionModel(half_solvable, n_modes=1), law.term, law.posterior.prior
    )
    betas = np.linspace(1, 0, 5) ** 2
    runs = ef.run(
        posterior,
        TemperedMove(DEMCMove(), betas),
        nwalkers=16 * len(betas),
        nsteps=300,
        seed=1,
        on_failure="reject",
        max_failures=0.9,
    )
    found = log_evidence(runs, discard=50)
    inside = np.log(0.5**2 / 2 / 0.5) + law.log_evidence - np.log(1 / 2)
    assert found.log_evidence_error < 0.1
    assert abs(found.log_evidence - inside) < 4 * found.log_evidence_error
    assert found.failed_solves == runs[0].failures.causes.total() > 0
    assert f"{found.failed_solves} solves failed" in str(found)


def test_it_prints_the_estimate_or_why_there_is_no_error():
    found = Evidence(-5.0, 0.01, "by bridges between 8 betas")
    assert str(found) == (
        "log evidence (natural) -5.0000 +- 0.0100, by bridges between 8 betas"
    )
    drifting = Evidence(-5.0, np.inf, "known", problems=("its halves disagree",))
    assert str(drifting).splitlines() == [
        "log evidence (natural) -5.0000 (no standard error can be claimed), known",
        "Its halves disagree.",
    ]


def test_what_anneal_returns_and_a_run_file_are_taken(tmp_path):
    annealed = SimpleNamespace(log_evidence=-3.0, log_evidence_error=0.1)
    assert str(log_evidence(annealed)).startswith("log evidence (natural) -3.0000 +- ")
    file = tmp_path / "run.chain"
    (run,) = tempered(LAWS["bounded"], 10, 20, betas=[1.0, 0.3, 0.0], backend=file)
    stored = log_evidence(RunFile(file))
    assert stored.log_evidence == log_evidence(run).log_evidence


def untempered():
    return ef.run(LAWS["bounded"].posterior, nwalkers=16, nsteps=10, seed=1)


NORMAL = np.random.default_rng(4).normal(size=(10, 6))
BROKEN = {
    "untempered": (untempered, "or of .auto."),
    "a backend": (lambda: untempered()[0].backend, "or of .auto."),
    "not to the prior": (lambda: Backend(NORMAL, [1.0, 0.1]), "end at 0"),
    "different betas": (
        lambda: [Backend(NORMAL), Backend(NORMAL, [1.0, 0.1, 0.0])],
        "same betas",
    ),
    "NaN": (
        lambda: Backend(np.where(NORMAL == NORMAL[3, 2], np.nan, NORMAL)),
        "walker 2 of ensemble 0 is nan at step 3",
    ),
    "zero likelihood": (
        lambda: Backend(np.where(NORMAL == NORMAL[3, 2], -np.inf, NORMAL)),
        "is -inf at step 3",
    ),
    "constant": (lambda: Backend(np.zeros((10, 6))), "never changed"),
    "too short": (lambda: Backend(NORMAL[:5]), "at least 8 steps"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_has_no_evidence_is_refused(case):
    make, match = BROKEN[case]
    with pytest.raises(ValueError, match=match):
        log_evidence(make())


BENCHMARK = load("evidence")
# Left out for their time: the other problems by "auto" and anneal, which meet the bar,
# and the other tempered ones. Left out because it fails: the funnel by anneal, which
# misses the neck and claims no error; tests/sampling/test_annealing.py holds it to
# that. docs/explanation/moves_measured.md has the figures.
HELD = [
    ("Gaussian, d=2", "auto"),
    ("two modes", "auto"),
    ("Beck and Au", "auto"),
    ("funnel, d=5", "auto"),
    ("Gaussian, d=2", "anneal"),
    ("two modes", "anneal"),
    ("Beck and Au", "anneal"),
    ("Gaussian, d=2", "tempered"),
    ("two modes", "tempered"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("problem", "method"), HELD)
def test_twenty_seeds_meet_the_bar(problem, method):
    found = BENCHMARK.measure(problem, method, 20)
    assert found["|z| > 3"] <= 1
    assert found["no claim"] <= 5
    assert 1 / 1.5 < found["claimed"] / found["spread"] < 1.5


@pytest.mark.parametrize("kept", ["in memory", "netCDF"])
def test_the_arviz_object_of_auto_has_the_same_evidence(kept, tmp_path):
    law = GaussianLaw()
    runs = ef.run(law.posterior, "auto", 16, 200, ensembles=2, seed=1)
    idata = ef.to_inference_data(runs, law.posterior, discard=20)
    if kept == "netCDF":
        idata.to_netcdf(tmp_path / "run.nc")
        idata = load_arviz().from_netcdf(tmp_path / "run.nc")
    found, direct = log_evidence(idata), log_evidence(runs, 20)
    assert found.log_evidence == direct.log_evidence
    assert found.log_evidence_error == direct.log_evidence_error
    assert log_evidence(idata, 30).log_evidence == log_evidence(runs, 50).log_evidence
    error = 4 * found.log_evidence_error + 1e-6
    assert abs(found.log_evidence - law.log_evidence) < error
    assert ef.compare_models({"a": idata, "b": runs}).winner is None


def test_an_arviz_object_without_what_is_needed_is_refused_by_name():
    law = GaussianLaw()
    for samplers, expected in (
        (tempered(law, 20, 10), "cold walkers of a tempered run, .* its samplers or"),
        (ef.run(law.posterior, nsteps=10, seed=1), "other moves than 'auto'"),
        (ef.anneal(law.posterior, 80, seed=1), "population, .* the population itself"),
    ):
        with pytest.raises(ValueError, match=f"samplers: .*{expected}"):
            log_evidence(ef.to_inference_data(samplers, law.posterior))
