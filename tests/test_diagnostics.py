import arviz as az
import emcee
import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

import emcee_femu as ef
from emcee_femu.diagnostics import (
    autocorrelation_time,
    measured_frequencies,
    running_tae,
    total_average_error,
)
from emcee_femu.inference_data import effective_sizes, rhat, wrapped
from emcee_femu.moves import MetropolisMove

SAMPLE_DIMS = {"sample_dims": ["chain", "draw"]}


def backend(chain, accepted=None):
    """Return an emcee backend that holds ``chain (steps, walkers, d)``."""
    steps, walkers, d = chain.shape
    accepted = np.ones((steps, walkers), bool) if accepted is None else accepted
    filled = emcee.backends.Backend()
    filled.reset(walkers, d)
    filled.grow(steps, None)
    for coords, moved in zip(chain, accepted, strict=True):
        filled.save_step(emcee.State(coords, log_prob=np.zeros(walkers)), moved)
    return filled


def ar1(phis, steps, walkers, seed, mean=0.0, sd=1.0):
    """Return stationary AR(1) chains ``(steps, walkers, d)``, one phi a parameter."""
    rng, phi = np.random.default_rng(seed), np.array(phis)
    chain = rng.normal(size=(steps, walkers, len(phi)))
    for i in range(1, steps):
        chain[i] = phi * chain[i - 1] + np.sqrt(1 - phi**2) * chain[i]
    return mean + sd * chain


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
    assert (error < 0.22).all()
    assert found.tau.shape == (2, 3)
    assert (np.abs(found.tau / TAU - 1) < error).all()
    assert_allclose(found.steps_per_tau, STEPS / found.tau.max(axis=0), rtol=1e-15)
    samples = 2 * WALKERS * STEPS
    assert_allclose(found.ess_bulk, samples / TAU, rtol=0.08)
    assert (found.ess_tail > samples / TAU * 0.9).all()
    assert found.steps == STEPS
    assert found.names == ("theta1", "theta2", "theta3")


def test_tau_is_that_of_one_ensemble_and_discard_shortens_it(same_law):
    slow = backend(ar1([0.9, 0.5, 0.0], STEPS, WALKERS, 3))
    found = ef.diagnose([same_law[0], slow], discard=2000)
    assert found.steps == 2000
    for row, run in zip(found.tau, (same_law[0], slow), strict=True):
        assert_array_equal(row, autocorrelation_time(run.get_chain()[2000:]))
    assert found.tau[1, 0] > 10 > found.tau[0, 0]
    assert_allclose(found.steps_per_tau[0], 2000 / found.tau[1, 0], rtol=1e-15)


def test_two_ensembles_of_one_law_converge(same_law):
    found = ef.diagnose(same_law)
    assert found.converged
    assert found.verdict.startswith("Converged by every check: 2 ensembles agree")
    assert (found.rhat_between < 1.01).all() and (found.rhat_within < 1.02).all()
    assert found.stuck == ()


def test_rhat_is_over_walkers_within_and_over_ensembles_between(same_law):
    other = backend(ar1(PHI, STEPS, WALKERS, 5, mean=1e-4 + 5e-9, sd=1e-8))
    found = ef.diagnose([same_law[0], other])
    walkers = [run.get_chain().swapaxes(0, 1) for run in (same_law[0], other)]
    assert_allclose(found.rhat_within, np.maximum(*map(rhat, walkers)), rtol=1e-12)
    pooled = np.stack([chain.reshape(-1, 3) for chain in walkers])
    assert_allclose(found.rhat_between, rhat(pooled), rtol=1e-12)
    assert (found.rhat_between > 1.02).all()


def test_one_ensemble_cannot_show_a_missed_mode(same_law):
    found = ef.diagnose(same_law[0])
    assert not found.converged
    assert "one ensemble cannot show a missed mode" in found.verdict
    assert np.isnan(found.rhat_between).all()


def test_two_ensembles_in_different_modes_are_not_converged(same_law):
    away = backend(ar1(PHI, STEPS, WALKERS, 4, mean=1e-4 + 6e-8, sd=1e-8))
    found = ef.diagnose([same_law[0], away])
    assert (found.rhat_between > 1.1).all() and (found.rhat_within < 1.05).all()
    assert not found.converged
    assert found.verdict.startswith("Not converged: the ensembles disagree about theta")


def test_walkers_that_stay_apart_within_one_ensemble_are_flagged():
    chain = ar1([0.5, 0.5], 1000, 8, 6)
    chain[:, 4:, 1] += 6
    found = ef.diagnose([backend(chain), backend(chain[::-1])])
    assert found.rhat_within[1] > 1.5 and found.rhat_within[0] < 1.02
    assert (found.steps_per_tau > 50).all()  # tau cannot see it
    assert not found.converged
    assert "the walkers of one ensemble stay apart in theta2" in found.verdict


def test_a_chain_of_too_few_autocorrelation_times_is_not_converged():
    chains = [ar1([0.9, 0.2], 400, 8, seed) for seed in (1, 2)]  # about 21 and 267 tau
    found = ef.diagnose([backend(chain) for chain in chains])
    assert 10 < found.steps_per_tau[0] < 50 < found.steps_per_tau[1]
    assert not found.converged
    length = f"{found.steps_per_tau[0]:.0f} autocorrelation times long for theta1"
    assert found.verdict.startswith(f"Not converged: the chain is {length}")


def test_stuck_walkers_are_reported_and_left_out_of_tau():
    chains = [ar1([0.5, 0.5], 1000, 8, seed) for seed in (1, 2)]
    chains[0][100:, 3] = chains[0][100, 3]
    chains[1][:, 6] = chains[1][0, 6]
    runs = [backend(chain) for chain in chains]
    assert ef.diagnose(runs).stuck == ((1, 6),)
    found = ef.diagnose(runs, discard=100)
    assert found.stuck == ((0, 3), (1, 6))
    assert not found.converged
    assert found.verdict.startswith("Not converged: 2 walkers never moved")
    assert "[(0, 3), (1, 6)]" in found.verdict
    for row, chain, gone in zip(found.tau, chains, (3, 6), strict=True):
        kept = np.delete(chain, gone, axis=1)[100:]
        assert_array_equal(row, autocorrelation_time(kept))


def test_tau_is_nan_when_no_walker_of_the_ensemble_moved():
    frozen = np.repeat(ar1([0, 0], 1, 8, 1), 300, axis=0)
    found = ef.diagnose([backend(ar1([0, 0], 300, 8, 2)), backend(frozen)])
    assert_array_equal(np.isnan(found.tau), [[False] * 2, [True] * 2])
    assert found.stuck == tuple((1, walker) for walker in range(8))
    assert "8 walkers never moved" in found.verdict and not found.converged


def test_acceptance_is_the_fraction_of_every_walker():
    chain = ar1([0.5], 200, 4, 1)
    shares = np.array([[0.1, 0.25, 0.5, 1.0], [0.2, 0.4, 0.6, 0.8]])
    step = np.arange(200)[:, None]
    runs = [backend(chain, step < 200 * share) for share in shares]
    assert_allclose(ef.diagnose(runs, discard=20).acceptance, shares, rtol=1e-15)


@pytest.mark.parametrize("steps, discard", [(7, 0), (20, 13)])
def test_fewer_than_eight_steps_are_an_error(steps, discard):
    with pytest.raises(ValueError, match="at least 8 steps to judge, left 7"):
        ef.diagnose(backend(ar1([0.5], steps, 4, 1)), discard)


def test_discard_must_be_a_whole_number():
    with pytest.raises(TypeError, match="discard: expected a whole number"):
        ef.diagnose(backend(ar1([0.5], 20, 4, 1)), 2.0)


class Square:
    n_modes = 2

    def __call__(self, p):
        rows = np.stack([10 * p["stiff"] ** 2, 20 * p["alpha"]], axis=1)
        return ef.ModalSolution(rows)


POSTERIOR = ef.LogPosterior(
    Square(),
    ef.FrequencyTerm([10.0, 25.0], beta=1e3),
    ef.GaussianPrior(["stiff", "alpha"], [1.0, 1.2], 0.1, [(0.1, 9.0)] * 2),
)


@pytest.mark.parametrize("vectorize", [True, False])
def test_names_are_those_of_the_posterior_and_text_shows_them(vectorize):
    move = MetropolisMove(0.05)
    runs = ef.run(POSTERIOR, move, 4, 30, ensembles=2, seed=1, vectorize=vectorize)
    found = ef.diagnose(runs)
    assert found.names == ("stiff", "alpha")
    text = str(found).splitlines()
    for i, name in enumerate(found.names):
        cells = text[1 + i].split()
        expected = [found.tau[:, i].max(), found.steps_per_tau[i], found.ess_bulk[i]]
        expected += [found.ess_tail[i], found.rhat_within[i], found.rhat_between[i]]
        assert cells[0] == name
        assert_allclose([float(x) for x in cells[1:]], expected, rtol=0, atol=0.5)
        assert cells[5:] == [f"{x:.3f}" for x in expected[4:]]
    assert text[-1] == found.verdict
    assert_array_equal(found.acceptance, [run.acceptance_fraction for run in runs])


def tiny():
    """Return 2 chains of 3 draws whose running means are whole tenths."""
    stiff = np.array([[1.0, 1.2, 0.8], [1.2, 1.4, 0.4]])  # means 1.1, 1.2, 1.0
    alpha = np.array([[1.0, 1.3, 1.5], [1.2, 1.5, 1.3]])  # means 1.1, 1.25, 1.3
    data = {"stiff": (("chain", "draw"), stiff), "alpha": (("chain", "draw"), alpha)}
    observed = {"frequency": ("mode", [10.0, 25.0]), "later": ("mode", [1.0, 2.0])}
    return {
        "posterior": xarray.Dataset(data, attrs=SAMPLE_DIMS),
        "observed_data": xarray.Dataset(observed),
    }


def test_running_tae_equals_a_computation_by_hand():
    generations, tae = running_tae(wrapped(tiny()), POSTERIOR)
    assert_array_equal(generations, [1, 2, 3])
    # 10 * mean**2 against 10 and 20 * mean against 25, in percent
    assert_allclose(tae, [(21 + 12) / 2, (44 + 0) / 2, (0 + 4) / 2], rtol=1e-13)


@pytest.mark.parametrize("points", [2, 10, 200])
def test_running_tae_ends_with_the_error_at_the_overall_mean(points):
    runs = ef.run(POSTERIOR, None, 8, 60, ensembles=2, seed=1)
    idata = ef.to_inference_data(runs, POSTERIOR, discard=10)
    generations, tae = running_tae(idata, POSTERIOR, points)
    chains = np.stack([run.get_chain(discard=10) for run in runs], axis=1)
    for generation, error in zip(generations, tae, strict=True):
        stiff, alpha = chains[: int(generation)].mean(axis=(0, 1, 2))
        errors = np.abs([10 * stiff**2 / 10 - 1, 20 * alpha / 25 - 1])
        assert_allclose(error, 100 * errors.mean(), rtol=1e-9)
    assert (generations[0], generations[-1]) == (1, 50)
    assert 2 <= len(generations) <= points
    assert_allclose(
        tae[-1],
        total_average_error([10, 25], POSTERIOR(chains.mean(axis=(0, 1, 2)))[3:]),
        rtol=1e-9,
    )
