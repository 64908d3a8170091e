"""log_evidence against closed forms, and the honesty of its standard errors."""

import emcee
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal, stats
from support.chains import as_arviz, backend, stored_and_read
from support.tempered_laws import BoundedLaw, GaussianLaw

import emcee_femu as ef
from emcee_femu.results.evidence import standard_error

LAWS = {"gaussian": GaussianLaw(), "bounded": BoundedLaw()}


def tempered(posterior, block, steps, betas=8, **options):
    betas = np.linspace(1, 0, betas) ** 3
    move = ef.moves.TemperedMove(ef.DEMCMove(), betas)
    options = {"ensembles": 1, "seed": 1} | options
    return ef.run(posterior, move, block * len(betas), steps, **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "seed", "steps"), [("gaussian", 2, 500), ("bounded", 1, 1_200)]
)
def test_the_evidence_is_the_exact_one_and_its_error_the_spread(law, seed, steps):
    """Of chains that are all long enough to claim an error."""
    law = LAWS[law]
    runs = tempered(law.posterior, block=20, steps=steps, ensembles=10, seed=seed)
    found = [ef.log_evidence(run, discard=60) for run in runs]
    claimed = np.sqrt(np.mean([one.log_evidence_error**2 for one in found]))
    spread = np.std([one.log_evidence for one in found], ddof=1)
    assert 0.5 < spread / claimed < 2
    together = ef.log_evidence(runs, discard=60)
    error = together.log_evidence_error
    assert 0.5 < error / (claimed / np.sqrt(len(found))) < 2
    assert abs(together.log_evidence - law.log_evidence) < 4 * error


def ladder(log_likelihood, betas=(1.0, 0.5, 0.0), log_prior=-2.0, seed=0):
    """Return a sampler that stored these log-likelihoods ``(steps, walkers)``."""
    steps, walkers = log_likelihood.shape
    # What the chains themselves are judged by.
    chain = np.random.default_rng([steps, seed]).normal(size=(steps, walkers, 1))
    blobs = np.full((steps, walkers, 2), log_prior)
    move = ef.moves.TemperedMove(ef.DEMCMove(), betas)
    sampler = emcee.EnsembleSampler(walkers, 1, len, moves=move)
    sampler.backend = backend(chain, None, log_likelihood + log_prior, blobs)
    return sampler


def independent(steps=1_000, seed=1, apart=0.0):
    """Return log-likelihoods N(-2 + 2 beta, 2) of three rungs, of evidence exp(-1)."""
    values = np.random.default_rng(seed).normal(size=(steps, 3, 5)) * np.sqrt(2)
    centres = np.array([0.0, -1.0, -2.0]) + apart * np.array([2.0, 1.0, 0.0])
    return (values + centres[:, None]).reshape(steps, -1)


def test_independent_draws_of_a_known_ladder_give_its_evidence():
    errors = []
    for steps in (1_000, 16_000):
        found = ef.log_evidence(ladder(independent(steps)))
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


@pytest.mark.slow
def test_the_error_is_the_spread_also_of_few_ensembles():
    """The larger of two errors would be 1.25 times too large with two ensembles."""
    found = [
        ef.log_evidence([ladder(independent(120, (k, e)), seed=e) for e in range(2)])
        for k in range(60)
    ]
    claimed = np.sqrt(np.mean([one.log_evidence_error**2 for one in found]))
    spread = np.std([one.log_evidence for one in found], ddof=1)
    assert 0.82 < claimed / spread < 1.24


def test_the_error_of_a_short_chain_has_what_its_own_mean_hides():
    """Forty autocorrelation times of an autoregression, whose tau is 19 steps."""
    noise = np.random.default_rng(5).normal(size=(1_100, 1_000))
    series = signal.lfilter([1.0], [1.0, -0.9], noise, axis=0)[300:]
    found = [standard_error(one[:, None]) for one in series.T]
    claimed = np.array([error for error, problems in found if not problems])
    assert len(claimed) > 950
    spread = series.mean(axis=0).std()
    assert np.sqrt(np.mean(claimed**2)) == pytest.approx(spread, rel=0.05)


def test_ensembles_that_disagree_widen_the_error():
    shifts = np.array([0.0, 0.0, 0.0, 0.8])  # as of one that lacks a mode
    hot = np.repeat([0.0, 0.0, 1.0], 5)
    values = [independent(seed=e) + shifts[e] * hot for e in range(4)]
    several = [ladder(series, seed=e) for e, series in enumerate(values)]
    found = ef.log_evidence(several)
    apart = np.std([ef.log_evidence(ladder(v)).log_evidence for v in values], ddof=1)
    assert_allclose(found.log_evidence_error, apart / 2, rtol=0.1)


def test_what_no_error_can_be_claimed_of():
    """Rungs that do not overlap, chains too short, and chains that drift."""
    for gap in (13.0, 20.0):  # overlaps of 0.07, 0.01
        found = ef.log_evidence(ladder(independent(apart=gap)))
        assert found.log_evidence_error == np.inf and found.overlaps.max() < 0.1
        assert any("overlap" in problem for problem in found.problems)
    steps = 400
    slow = np.cumsum(np.random.default_rng(3).normal(size=(steps, 1)), axis=0)
    drift = independent(steps)
    drift[: steps // 2] += 1.0
    for values in (0.1 * independent(steps) + 0.1 * slow, drift):
        found = ef.log_evidence(ladder(values))
        assert found.log_evidence_error == np.inf and found.problems
    assert np.isfinite(ef.log_evidence(ladder(drift), steps // 2).log_evidence_error)


@pytest.mark.slow
def test_the_evidence_is_that_of_the_prior_where_it_can_be_solved():
    """The law where half of the prior fails: a closed form."""
    law = LAWS["bounded"]
    model = ef.FunctionModel(lambda p: [1.0 if p["a"] < 0.5 else np.nan], n_modes=1)
    posterior = ef.LogPosterior(model, law.term, law.posterior.prior)
    reject = {"on_failure": "reject", "max_failures": 0.9}
    runs = tempered(posterior, 16, 1_000, 5, **reject)
    found = ef.log_evidence(runs, discard=50)
    inside = np.log(0.5**2 / 2 / 0.5) + law.log_evidence - np.log(1 / 2)
    assert found.log_evidence_error < 0.1
    assert abs(found.log_evidence - inside) < 4 * found.log_evidence_error
    assert found.failed_solves == runs.failures.causes.total() > 0


def test_what_anneal_returns_and_the_name_of_a_file_are_taken(tmp_path):
    annealed = ef.anneal(LAWS["gaussian"].posterior, 100, seed=1)
    found = ef.log_evidence(annealed)
    assert found.log_evidence == annealed.log_evidence
    assert found.log_evidence_error == annealed.log_evidence_error
    file = tmp_path / "run.chain"
    run = tempered(LAWS["bounded"].posterior, 10, 20, 3, backend=file)
    assert ef.log_evidence(file).log_evidence == ef.log_evidence(run).log_evidence


NORMAL = np.random.default_rng(4).normal(size=(10, 6))
BROKEN = {
    "untempered": (lambda: backend(NORMAL[..., None]), "auto"),
    "not to the prior": (lambda: ladder(NORMAL, [1.0, 0.1]), "end at 0"),
    "not finite": (lambda: ladder(np.where(NORMAL > 1, -np.inf, NORMAL)), "finite"),
    "constant": (lambda: ladder(np.zeros((10, 6))), "never changed"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_has_no_evidence_is_refused(case):
    make, match = BROKEN[case]
    with pytest.raises(ValueError, match=match):
        ef.log_evidence(make())


@pytest.mark.slow
def test_the_arviz_object_of_auto_has_the_same_evidence(tmp_path):
    law = GaussianLaw()
    run = ef.run(law.posterior, "auto", 16, 200, ensembles=2, seed=1)
    idata = ef.to_inference_data(run, discard=20)
    idata = stored_and_read(idata, tmp_path / "run.nc")
    for discard in (0, 30):
        direct = ef.log_evidence(run, 20 + discard)
        found = ef.log_evidence(idata, discard)
        # Arrays in another order are summed in another order.
        for own in ("log_evidence", "log_evidence_error"):
            assert getattr(found, own) == pytest.approx(getattr(direct, own), rel=1e-9)
    error = 4 * found.log_evidence_error + 1e-6
    assert abs(found.log_evidence - law.log_evidence) < error


# The bridge from a frozen proposal: q is a t, p a Gaussian of known evidence.
D, LOG_Z, KEPT = 4, -7.0, 0.8  # KEPT: a step's correlation with the one before
Q = stats.multivariate_t(np.full(D, 0.2), 1.3 * np.eye(D), df=5.0)


def log_p(x):
    return LOG_Z + stats.norm.logpdf(x).sum(axis=-1)


def of_auto(seed, steps=1_000, ensembles=2, walkers=4, n=500, shift=0.0):
    """Return an ArviZ object of correlated draws of p, and what "auto" knows of q."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(steps, ensembles, walkers, D))
    for t in range(1, steps):
        x[t] = KEPT * x[t - 1] + np.sqrt(1 - KEPT**2) * x[t]
    y = Q.rvs(n, random_state=rng)
    mixture = [[1.0], [Q.loc.tolist()], [Q.shape.tolist()], Q.df]
    search = {"mixture": mixture, "mode_of": [0], "trajectories": None}
    search |= {"log_weights": (log_p(y) - Q.logpdf(y) - shift).tolist()}
    search |= {"weights": [1.0], "errors": [0.0], "efficiency": 1.0, "pareto_k": 0.0}
    search |= dict.fromkeys(["found_by", "starts"], [[1]] * ensembles)
    search |= dict.fromkeys("points climbs annealed solves share".split(), 0)
    chains = [
        backend(x[:, e], log_prob=log_p(x[:, e]) + shift) for e in range(ensembles)
    ]
    return as_arviz(chains, search=search)


def test_the_bridge_from_a_frozen_proposal_is_exact_and_its_error_the_spread():
    found = [ef.log_evidence(of_auto(seed)) for seed in range(14)]
    values = np.array([one.log_evidence for one in found])
    errors = np.array([one.log_evidence_error for one in found])
    z = (values - LOG_Z) / errors
    assert (np.abs(z) < 3).mean() >= 0.95
    assert abs(z.mean()) < 4 / np.sqrt(len(z))
    assert 1 / 1.6 < values.std(ddof=1) / np.sqrt((errors**2).mean()) < 1.6


def test_chains_that_diagnose_does_not_call_converged_claim_no_error():
    """Fault 18: the estimate was five errors off, and nothing was said."""
    whole = of_auto(1)
    few = whole.isel(draw=slice(0, 150))
    assert ef.diagnose(few).chains.reasons[0] == "too short"
    good, bad = ef.log_evidence(whole), ef.log_evidence(few)
    assert good.problems == () and np.isfinite(good.log_evidence_error)
    assert bad.log_evidence_error == np.inf
    assert any("too short" in problem for problem in bad.problems)
    assert ef.compare_models({"whole": good, "few": few}).winner is None


@pytest.mark.parametrize("shift", [15.0, 300.0])
def test_no_overlap_with_the_frozen_proposal_claims_no_error(shift):
    found = ef.log_evidence(of_auto(1, shift=shift))
    assert any("overlap" in problem for problem in found.problems)
    assert found.log_evidence_error == np.inf
