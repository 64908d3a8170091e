"""log_evidence against closed forms, and the honesty of its standard errors."""

import emcee
import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.tempered_laws import BoundedLaw, GaussianLaw

import emcee_femu as ef
from emcee_femu import DEMCMove, TemperedMove, log_evidence
from emcee_femu.results.evidence import Evidence

LAWS = {"gaussian": GaussianLaw(), "bounded": BoundedLaw()}
BETAS = np.linspace(1, 0, 8) ** 3


def tempered(law, block, nsteps, ensembles=1, seed=1, betas=BETAS):
    move = TemperedMove(DEMCMove(), betas)
    return ef.run(
        law.posterior,
        move,
        block * len(betas),
        nsteps,
        ensembles=ensembles,
        seed=seed,
    )


@pytest.mark.parametrize("law", LAWS)
def test_the_evidence_is_the_exact_one(law):
    found = log_evidence(tempered(LAWS[law], block=150, nsteps=1_200), discard=100)
    exact = LAWS[law].log_evidence
    for value, error in (
        (found.stepping_stones, found.stepping_stones_error),
        (found.thermodynamic, found.thermodynamic_error),
    ):
        assert error < 0.01
        assert abs(value - exact) < 3 * error
        assert abs(value / exact - 1) < 0.01


@pytest.fixture(scope="module")
def repeated():
    return tempered(LAWS["gaussian"], block=20, nsteps=300, ensembles=12, seed=2)


@pytest.mark.parametrize("which", ["stepping_stones", "thermodynamic"])
def test_the_standard_error_is_the_spread_of_independent_runs(repeated, which):
    found = [log_evidence(run, discard=60) for run in repeated]
    values = [getattr(one, which) for one in found]
    claimed = np.sqrt(np.mean([getattr(one, which + "_error") ** 2 for one in found]))
    assert 0.5 < np.std(values, ddof=1) / claimed < 2
    together = log_evidence(repeated, discard=60)
    assert_allclose(np.mean(values), getattr(together, which), atol=claimed)
    error = getattr(together, which + "_error")
    assert 0.5 < error / (claimed / np.sqrt(len(found))) < 2
    assert abs(getattr(together, which) - LAWS["gaussian"].log_evidence) < 4 * error


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_the_standard_error_is_honest_in_longer_runs(law):
    runs = tempered(LAWS[law], block=40, nsteps=1_000, ensembles=12, seed=3)
    found = [log_evidence(run, discard=100) for run in runs]
    z = [
        (one.stepping_stones - LAWS[law].log_evidence) / one.stepping_stones_error
        for one in found
    ]
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.6
    assert abs(np.mean(z)) < 4 / np.sqrt(len(z))


class Backend(emcee.backends.Backend):
    """A stored chain with the moves of its sampler, as log_evidence sees one."""

    def __init__(self, log_likelihood, betas=(1.0, 0.5, 0.0), log_prior=-2.0):
        super().__init__()
        steps, self.nwalkers = log_likelihood.shape
        self._moves = [TemperedMove(DEMCMove(), betas)]
        self.reset(self.nwalkers, 1)
        for likelihood in log_likelihood:
            blobs = np.full((self.nwalkers, 2), log_prior)
            state = emcee.State(
                np.zeros((self.nwalkers, 1)), likelihood + log_prior, blobs
            )
            self.grow(1, blobs)
            self.save_step(state, np.ones(self.nwalkers, bool))


def test_both_estimates_are_their_formulas():
    # Independent log-likelihoods: the formulas by hand, and plain standard errors.
    steps, block = 4_000, 5
    rng = np.random.default_rng(1)
    means, sds = np.array([-1.0, -2.0, -4.0]), np.array([0.3, 0.5, 0.8])
    values = means[:, None] + sds[:, None] * rng.normal(size=(steps, 3, block))
    found = log_evidence(Backend(values.reshape(steps, -1)))
    ratios = [np.exp(0.5 * values[:, t]).ravel() for t in (1, 2)]
    stones = sum(np.log(ratio.mean()) for ratio in ratios)
    assert_allclose(found.stepping_stones, stones, rtol=1e-12)
    average = values.mean(axis=(0, 2))
    assert_allclose(found.mean_log_likelihood, average, rtol=1e-12)
    variance = values.var(axis=(0, 2))
    area = np.trapezoid(average[::-1], dx=0.5) - 0.25 / 12 * (variance[0] - variance[2])
    assert_allclose(found.thermodynamic, area, rtol=1e-12)
    n = steps * block
    error = np.sqrt(sum(r.var() / r.mean() ** 2 / n for r in ratios))
    assert_allclose(found.stepping_stones_error, error, rtol=0.2)
    weights = np.array([0.25, 0.5, 0.25])
    error = np.sqrt((weights**2 * variance / n).sum())
    assert_allclose(found.thermodynamic_error, error, rtol=0.2)


def test_the_error_grows_with_what_walkers_and_ensembles_share():
    rng = np.random.default_rng(2)
    shared = rng.normal(size=(1_000, 1, 1)) * np.ones((1, 3, 5))
    alone = rng.normal(size=(1_000, 3, 5))
    errors = [
        log_evidence(Backend(values.reshape(1_000, -1))).thermodynamic_error
        for values in (alone, shared)
    ]
    assert errors[1] > 2.5 * errors[0]
    two = [Backend(alone.reshape(1_000, -1) + shift) for shift in (0.0, 3.0)]
    # Each is sure of itself; that they are 3 apart is the larger error.
    assert_allclose(log_evidence(two).thermodynamic_error, 1.5, rtol=0.1)


def test_huge_log_likelihoods_neither_overflow_nor_vanish():
    values = np.random.default_rng(3).normal(size=(100, 15))
    found, moved = (log_evidence(Backend(values + shift)) for shift in (0.0, -1e6))
    assert_allclose(moved.stepping_stones, found.stepping_stones - 1e6, rtol=1e-12)
    assert_allclose(moved.stepping_stones_error, found.stepping_stones_error, rtol=1e-6)


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
    assert found.stepping_stones_error < 0.1
    assert abs(found.stepping_stones - inside) < 4 * found.stepping_stones_error
    assert found.failed_solves == runs[0].failures.causes.total() > 0
    assert f"{found.failed_solves} solves failed" in str(found)


def test_it_prints_both_and_says_when_they_disagree():
    agree = Evidence(-5.0, 0.01, -5.01, 0.01, BETAS, BETAS)
    assert str(agree).splitlines()[1:] == [
        "stepping stones            -5.0000 +- 0.0100",
        "thermodynamic integration  -5.0100 +- 0.0100",
    ]
    disagree = Evidence(-5.0, 0.01, -4.0, 0.01, BETAS, BETAS)
    assert "more betas" in str(disagree).splitlines()[-1]


def untempered():
    return ef.run(LAWS["bounded"].posterior, nwalkers=16, nsteps=10, seed=1)


NORMAL = np.random.default_rng(4).normal(size=(10, 6))
BROKEN = {
    "untempered": (untempered, "not tempered"),
    "a backend": (lambda: untempered()[0].backend, "not tempered"),
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
