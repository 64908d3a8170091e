"""The numbers of a diagnosis, by their definitions and by exact laws."""

from dataclasses import replace

import arviz as az
import emcee
import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_equal
from scipy import stats
from support.chains import ar1, as_arviz, backend

import emcee_femu as ef
from emcee_femu.verdict.statistics import MaximaWeights

PHI = np.array([0.0, 0.5, 0.8])
TAU = (1 + PHI) / (1 - PHI)  # 1, 3, 9
STEPS, WALKERS = 4000, 12


@pytest.fixture(scope="module")
def same_law():
    scale = {"mean": 1e-4, "sd": 1e-8}  # as small as second moments of area
    return [backend(ar1(PHI, STEPS, WALKERS, seed, **scale)) for seed in (1, 2)]


def test_tau_and_ess_are_those_of_an_autoregressive_chain(same_law):
    found = ef.diagnose(same_law)
    # Sokal's window is 5 tau wide; the estimator is low by about (2 M + 1) / steps.
    window = 2 * 5 * TAU + 1
    error = 4 * np.sqrt(2 * window / (STEPS * WALKERS)) + window / STEPS
    assert (np.abs(found.tau / TAU - 1) < error).all() and (error < 0.3).all()
    assert_allclose(found.steps_per_tau, STEPS / found.tau.max(axis=0), rtol=1e-12)
    samples = 2 * WALKERS * STEPS
    assert_allclose(found.ess_bulk, samples / TAU, rtol=0.08)
    assert (found.ess_tail > samples / TAU * 0.9).all()
    assert found.converged and found.stuck == ()
    alone = ef.diagnose(same_law[0])  # which cannot show that it converged
    assert not alone.converged and np.isnan(alone.rhat_between).all()
    assert alone.chains.short == "one ensemble"


def test_discard_shortens_and_stuck_walkers_are_left_out_of_tau():
    chains = [ar1([0.5, 0.9], 1000, 8, seed) for seed in (1, 2)]
    chains[0][100:, 3, 1] = chains[0][100, 3, 1]  # one of its parameters
    chains[1][:, 6] = chains[1][0, 6]
    runs = [backend(chain) for chain in chains]
    assert ef.diagnose(runs).stuck == ((1, 6),)
    found = ef.diagnose(runs, discard=100)
    assert found.stuck == ((0, 3), (1, 6)) and found.steps == 900
    assert "stuck" in found.chains.short and not found.converged
    assert "[(0, 3), (1, 6)]" in found.chains.sentence
    assert "solves" not in found.chains.sentence  # emcee's own samplers have none
    for row, chain, gone in zip(found.tau, chains, (3, 6), strict=True):
        kept = np.delete(chain, gone, axis=1)[100:]
        assert_allclose(row, emcee.autocorr.integrated_time(kept, tol=0))


def by_arviz(function, chains, **options):
    data = {"x": (("chain", "draw"), chains)}
    table = xarray.Dataset(data, attrs={"sample_dims": ["chain", "draw"]})
    return float(function(table, **options)["x"])


def test_rhat_and_effective_sizes_equal_their_definitions():
    """Of the walkers of each ensemble, of pooled ensembles, and of all walkers."""
    ensembles = [ar1([0.8, 0.2], 60, 4, seed) for seed in (3, 4)]
    ensembles[0] *= np.linspace(1, 3, 4)[:, None]  # folded ranks see it
    found = ef.diagnose([backend(chain) for chain in ensembles])
    by_walker = [chain.swapaxes(0, 1) for chain in ensembles]
    for k, x in enumerate(np.moveaxis(np.concatenate(by_walker), -1, 0)):
        within = [by_arviz(az.rhat, w[..., k], method="rank") for w in by_walker]
        assert_allclose(found.rhat_within[k], max(within), rtol=1e-12)
        pooled = np.stack([walkers[..., k].ravel() for walkers in by_walker])
        between = by_arviz(az.rhat, pooled, method="rank")
        assert_allclose(found.rhat_between[k], between, rtol=1e-12)
        assert_allclose(found.ess_bulk[k], by_arviz(az.ess, x, method="bulk"), 1e-9)
        ends = [by_arviz(az.ess, x, method="quantile", prob=p) for p in (0.05, 0.95)]
        assert_allclose(found.ess_tail[k], min(ends), rtol=1e-9)


@pytest.mark.parametrize(
    ("short", "phi", "steps", "walkers_apart", "ensembles_apart", "number", "low_high"),
    [  # each just inside and just outside of its bound
        ("too short", 0.8, 140, 0, 0, "steps_per_tau", (15, 24.9)),
        ("converged", 0.8, 330, 0, 0, "steps_per_tau", (25.1, 45)),
        ("ensembles disagree", 0.5, 2000, 0, 0.27, "rhat_between", (1.011, 1.019)),
        ("converged", 0.5, 2000, 0, 0.19, "rhat_between", (1.004, 1.0099)),
        ("walkers stay apart", 0.5, 2000, 1.28, 0, "rhat_within", (1.06, 1.39)),
        ("converged", 0.5, 2000, 0.4, 0, "rhat_within", (1.015, 1.049)),
        ("walkers stay apart", 0.8, 260, 0.5, 0, "rhat_within", (1.07, 1.09)),
        ("converged", 0.8, 260, 0.3, 0, "rhat_within", (1.051, 1.06)),
        ("ensembles disagree", 0.5, 2000, 0, 6.0, "rhat_between", (1.5, 9.0)),
    ],
)
def test_the_bounds_of_the_verdict(
    short, phi, steps, walkers_apart, ensembles_apart, number, low_high
):
    every_second = walkers_apart * (np.arange(8) % 2)[:, None]
    chains = [ar1([phi], steps, 8, seed) + every_second for seed in (1, 2)]
    chains[1] += ensembles_apart
    found = ef.diagnose([backend(chain) for chain in chains])
    low, high = low_high
    assert low < getattr(found, number)[0] < high
    assert found.chains.short == short
    # Length does not bring ensembles in different modes together.
    mended = short != "converged" and ensembles_apart < 1
    assert (" steps in all." in found.chains.sentence) == mended


@pytest.mark.slow
@pytest.mark.parametrize(
    ("d", "taus", "each", "largest"),
    [(1, 25, 0.7, 0.84), (5, 25, 0.71, 0.96), (5, 50, 0.83, 1.1)],
)
def test_tau_of_a_short_chain_is_too_small_and_the_largest_is_less_so(
    d, taus, each, largest
):
    """The page on the verdict has these numbers. Healthy walkers are not apart."""
    phi, tau, runs = 0.6, 4, []
    for seed in range(0, 48, 4):
        chains = [ar1([phi] * d, taus * tau, 10, seed + k) for k in range(4)]
        found = ef.diagnose([*map(backend, chains)])
        assert "walkers stay apart" not in found.chains.reasons
        runs.append(found.tau / tau)
    assert np.mean(runs) == pytest.approx(each, abs=0.05)
    assert np.max(runs, axis=(1, 2)).mean() == pytest.approx(largest, abs=0.08)


POSTERIOR = ef.LogPosterior(
    lambda p: ef.ModalSolution(np.stack([10 * p["stiff"] ** 2, 20 * p["alpha"]], 1)),
    ef.FrequencyTerm([10.0, 25.0], beta=1e3),
    ef.GaussianPrior(["stiff", "alpha"], [1.0, 1.2], 0.1, [(0.1, 9.0)] * 2),
)


@pytest.mark.slow
def test_agreement_of_given_starts_is_not_called_converged():
    start = POSTERIOR.prior.sample(np.random.default_rng(1), 16).reshape(2, 8, 2)
    move = ef.MetropolisMove(sd=0.1)
    run = ef.run(POSTERIOR, move, 8, 1200, ensembles=2, seed=1, starts=start)
    for source in (run, ef.to_inference_data(run)):
        found = ef.diagnose(source, 100)
        assert not found.converged and found.chains.short == "starts given"
    assert ef.diagnose(list(run), 100).converged  # samplers do not know


@pytest.mark.slow
def test_starts_from_which_auto_only_searches_are_not_held_against_its_chain(tmp_path):
    options = {"nwalkers": 8, "ensembles": 2, "seed": 1, "backend": tmp_path / "run"}
    starts = POSTERIOR.start(16, seed=1).reshape(2, 8, 2)
    run = ef.run(POSTERIOR, starts=starts, ess=1.0, **options)
    for source in (run, options["backend"]):
        assert ef.diagnose(source).converged


@pytest.mark.parametrize("discard", [0, 5])
def test_an_arviz_object_is_judged_as_its_samplers(discard):
    runs = ef.run(POSTERIOR, ef.MetropolisMove(sd=0.05), 4, 40, ensembles=3, seed=1)
    idata = ef.to_inference_data(runs, POSTERIOR, discard=10)
    found, expected = ef.diagnose(idata, discard), ef.diagnose(runs, 10 + discard)
    for name, value in vars(expected).items():
        # It has dropped steps that the object does not know; and what the samples say
        # of the data is that of all that were converted.
        if name not in ("chains", "data"):
            same = assert_allclose if np.asarray(value).dtype == float else assert_equal
            same(getattr(found, name), value, err_msg=name)
    # By their text, since NaN equals nothing.
    assert (str(found.data) == str(expected.data)) == (discard == 0)
    assert found.short == expected.short and found.names == ("stiff", "alpha")
    assert_equal(found.acceptance, [run.acceptance_fraction for run in runs])
    with pytest.raises(ValueError, match=r"^source: .*\[3, 4, 4\]"):
        ef.diagnose(idata.isel(chain=slice(1, None)), discard)
    unknown = ef.diagnose(idata.isel(chain=slice(4, None)), discard)
    assert np.isnan(unknown.acceptance).all() and "Acceptance" not in str(unknown)


LOW = stats.norm.ppf(0.05)


def test_walkers_that_exchange_places_are_judged_by_their_mean():
    """Shuffled walkers forget at once, but their ensemble has the tau of before."""
    steps, walkers, phi = 4000, 6, 0.9
    rng, plain = np.random.default_rng(3), []
    for seed in range(4):
        chain = np.repeat(ar1([phi], steps, walkers, seed), 3, axis=2)
        noise = rng.normal(size=(2, steps, walkers))
        chain[..., 1] = 5 * np.sign(chain[..., 0]) + noise[0]
        chain[..., 2] = noise[1] - 20 * (chain[..., 0] < LOW)  # a slow tail
        plain.append(backend(rng.permuted(chain, axis=1)))
    # Of signs the autocorrelation is 2 / pi arcsin(phi^k): two modes, mixed slowly.
    signs = 2 / np.pi * np.arcsin(phi ** np.arange(1, 200))
    joint = [
        stats.multivariate_normal([0, 0], [[1, r], [r, 1]]).cdf([LOW, LOW])
        for r in phi ** np.arange(1, 60)
    ]
    tails = (np.array(joint) - 0.05**2) / (0.05 - 0.05**2)
    sums = signs.sum(), tails.sum()
    tau = np.array([(1 + phi) / (1 - phi), *(1 + 2 * np.array(sums))])
    found = ef.diagnose(as_arviz(plain, betas=[1.0, 0.5]))
    assert_allclose(found.tau[:, 0].mean(), tau[0], rtol=0.15)
    assert_allclose(found.ess_bulk, 4 * walkers * steps / tau, rtol=0.2)
    assert (found.ess_tail > 0.8 * found.ess_bulk).all()
    assert_allclose(found.ess_tail[2], 4 * walkers * steps / tau[2], rtol=0.2)
    of_sd = np.sqrt((1 + phi**2) / (1 - phi**2) / (2 * 4 * walkers * steps))
    assert_allclose(found.sd_error[0], of_sd, rtol=0.2)  # squares forget by phi^2


def test_objects_of_arviz_from_emcee_are_judged_and_tabulated():
    """Fault 17: they have none of our groups, and perhaps vectors."""
    sampler = emcee.EnsembleSampler(8, 3, lambda x: -0.5 * float(x @ x))
    sampler.run_mcmc(np.random.default_rng(1).normal(size=(8, 3)), 40)
    expected = ef.diagnose(sampler)
    for names, slices, columns in (
        (["a", "b", "c"], None, ("a", "b", "c")),
        (["x"], [slice(None)], ("x[0]", "x[1]", "x[2]")),
    ):
        idata = az.from_emcee(sampler, var_names=names, slices=slices)
        found = ef.diagnose(idata)
        assert found.names == columns and found.chains.short == expected.chains.short
        assert_allclose(found.tau, expected.tau)
        table = ef.parameter_table(idata, {columns[0]: 1.0})
        mean = sampler.get_chain(flat=True).mean(axis=0)
        assert_allclose(table.column("mean"), mean, rtol=1e-12)
        assert ef.figures.plot_correlation(idata).axes
        with pytest.raises(ValueError, match="'response'"):
            ef.predictive_table(idata)


@pytest.mark.parametrize(("steps", "stuck_first"), [(13, False), (200, True)])
def test_a_walker_that_chance_has_not_moved_yet_is_not_the_first_complaint(
    steps, stuck_first
):
    rng = np.random.default_rng(1)
    moved = rng.random((steps, 20)) < 0.15
    moved[:, 3] = False
    last = np.maximum.accumulate(np.where(moved, np.arange(steps)[:, None], 0))
    chain = rng.normal(size=(steps, 20, 2))[last, np.arange(20)]
    found = ef.diagnose([backend(chain, moved)])
    assert (0, 3) in found.stuck
    named = ["stuck" in reason for reason in found.chains.reasons]
    assert len(named) > 1 and sum(named) == 1 and named[0] == stuck_first


def test_maxima_without_weight_hold_no_samples():
    """By the chain and by importance sampling, where that is known."""
    maxima = MaximaWeights(
        weights=np.array([[0.6, 0.4, 0.0, 0.0], [0.7, 0.3, 0.0, 0.0]]),
        errors=np.zeros(4),
        importance=np.array([0.65, 0.35, 1e-5, np.nan]),
        importance_errors=np.zeros(4),
        acceptance=np.ones(4),
        mean_error=np.zeros(2),
        sd_error=np.zeros(2),
        reached=np.ones(4, dtype=bool),
        pareto_k=0.1,
        chain_k=0.1,
        efficiency=0.9,
        share=0.9,
    )
    assert maxima.held == 2
    assert replace(maxima, importance=np.array([0.6, 0.3, 0.1, np.nan])).held == 3
