"""TemperedMove keeps every tempered law, crosses between modes, and hides nothing."""

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import emcee
import numpy as np
import pytest
from emcee.model import Model
from numpy.testing import assert_array_equal
from scipy import stats
from support.checks import LIMIT
from support.tempered_laws import BoundedLaw, GaussianLaw

import emcee_femu as ef
from emcee_femu import DEMCMove, MetropolisMove, TemperedMove
from emcee_femu.moves import tempering
from emcee_femu.results.inference_data import samples

BETAS = [1.0, 0.3, 0.0]
BLOCK = 8
LAWS = {"gaussian": GaussianLaw(), "bounded": BoundedLaw()}
INNER = {
    "DE-MC": DEMCMove(),
    "DE-MC with mode jumps": DEMCMove(mode_jump=0.3),
    "Metropolis": MetropolisMove(0.3),
    "stock stretch": emcee.moves.StretchMove(),
    "stock DE": emcee.moves.DEMove(),
    "stock Gaussian": emcee.moves.GaussianMove(0.1),
}


def exact_start(move, law, ensembles=400, steps=4, seed=0, check_rows=True):
    """Return the largest |z| over all blocks after a few steps from the exact laws.

    It is infinite if the state's log_prob or blobs are not those of its coordinates.
    """
    rng = np.random.default_rng(seed)
    random = np.random.RandomState(seed + 1)

    def solve(theta):
        rows = law.posterior(theta)
        return rows[:, 0], rows[:, 1:]

    model = Model(None, solve, map, random)
    betas = move.betas
    averages = []
    for _ in range(ensembles):
        start = np.concatenate([law.sample(rng, BLOCK, beta) for beta in betas])
        state = emcee.State(start, *solve(start))
        for _ in range(steps):
            state, _ = move.propose(model, state)
        kept = np.column_stack([state.log_prob, state.blobs])
        if check_rows and not np.array_equal(kept, law.posterior(state.coords)):
            return np.inf
        blocks = state.coords.reshape(len(betas), BLOCK, -1)
        averages.append(
            [
                law.statistics(theta, beta).mean(axis=0)
                for theta, beta in zip(blocks, betas, strict=True)
            ]
        )
    averages = np.array(averages)  # (ensembles, betas, statistics)
    return np.abs(
        averages.mean(axis=0) / averages.std(axis=0) * np.sqrt(ensembles)
    ).max()


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("inner", INNER)
def test_every_block_keeps_its_tempered_law(law, inner):
    assert exact_start(TemperedMove(INNER[inner], BETAS), LAWS[law]) < LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("betas", [BETAS, [1.0, 0.3], np.linspace(1, 0, 6) ** 2])
def test_every_block_keeps_its_tempered_law_at_high_power(law, betas):
    move = TemperedMove(DEMCMove(mode_jump=0.1), betas)
    assert exact_start(move, LAWS[law], ensembles=2_000, steps=8) < LIMIT


# Mutants: the module with one thing broken, which the exact start must see.
MUTANTS = {
    "wrong sign": (
        "log_likelihood[hot] - log_likelihood[cold]",
        "log_likelihood[cold] - log_likelihood[hot]",
    ),
    "always exchanged": ("possible & (log_ratio > threshold)", "possible"),
    "prior tempered too": (
        "log_prob - (1 - beta) * log_likelihoods(log_prob, blobs[:, 0])",
        "beta * np.maximum(log_prob, -1e300)",
    ),
    "tempered log-probability stored": ("= moved.blobs[:, -1]", "= moved.log_prob"),
    "log-probability not exchanged": (
        "(state.coords, state.log_prob, state.blobs)",
        "(state.coords, state.blobs)",
    ),
    "blobs not exchanged": (
        "(state.coords, state.log_prob, state.blobs)",
        "(state.coords, state.log_prob)",
    ),
}


def mutated(original, wrong):
    source = Path(tempering.__file__).read_text(encoding="utf-8")
    assert source.count(original) == 1
    names = {"__name__": "mutant", "__package__": "emcee_femu.moves"}
    exec(source.replace(original, wrong), names)
    return names["TemperedMove"]


@pytest.mark.parametrize("mutant", MUTANTS)
def test_the_check_catches_a_broken_move(mutant):
    move = mutated(*MUTANTS[mutant])(DEMCMove(), BETAS)
    assert exact_start(move, LAWS["gaussian"], check_rows=False) > LIMIT


PROBLEM = ef.paper.mass_spring()
MOVE = TemperedMove(DEMCMove(), [1.0, 0.2, 0.0])


def sampled(nsteps=12, **options):
    options = {"moves": MOVE, "nwalkers": 36, "seed": 1, **options}
    return ef.run(PROBLEM.posterior, nsteps=nsteps, **options)


def everything(sampler):
    parts = sampler.get_chain(), sampler.get_log_prob()[..., None], sampler.get_blobs()
    return np.concatenate(parts, axis=2)


def test_stored_rows_are_the_posteriors_own_for_every_walker():
    stored = everything(sampled()[0]).reshape(12 * 36, -1)
    assert_array_equal(stored[:, 5:], PROBLEM.posterior(stored[:, :5]))


def test_serial_vectorised_and_pooled_chains_are_the_same_to_the_bit():
    reference = everything(sampled()[0])
    assert_array_equal(everything(sampled(vectorize=False)[0]), reference)
    with ProcessPoolExecutor(2) as pool:
        assert_array_equal(everything(sampled(pool=pool)[0]), reference)


def test_a_run_resumed_from_a_file_goes_on_to_the_bit(tmp_path):
    file = tmp_path / "run.h5"
    sampled(nsteps=5, backend=file)
    (resumed,) = sampled(backend=file, resume=True)
    assert_array_equal(everything(resumed), everything(sampled()[0]))


def test_conversion_tables_and_diagnosis_use_the_cold_walkers_alone():
    runs = sampled(nsteps=40, ensembles=2)
    idata = ef.to_inference_data(runs, PROBLEM.posterior, discard=8)
    _, chains = samples(idata)
    cold = np.stack([run.get_chain(discard=8)[:, :12] for run in runs])
    assert_array_equal(chains, cold.transpose(0, 2, 1, 3).reshape(24, 32, 5))
    assert "k1" in str(ef.parameter_table(idata))
    found = ef.diagnose(runs, discard=8)
    assert_array_equal(found.acceptance, [r.acceptance_fraction[:12] for r in runs])
    assert_array_equal(
        found.tau[1], ef.results.diagnostics.autocorrelation_time(cold[1])
    )
    assert all(walker < 12 for _, walker in found.stuck)


@pytest.mark.parametrize(
    "moves",
    [[MOVE, DEMCMove()], [(MOVE, 0.5), (TemperedMove(DEMCMove(), [1, 0.3, 0]), 0.5)]],
)
def test_walkers_without_one_temperature_are_refused(moves):
    with pytest.raises(ValueError, match="every move .* same betas"):
        sampled(moves=moves)
    plain = emcee.EnsembleSampler(36, 5, PROBLEM.posterior, moves=moves, vectorize=True)
    plain.run_mcmc(PROBLEM.posterior.start(36, seed=1), 10)
    for judge in (lambda s: ef.to_inference_data(s, PROBLEM.posterior), ef.diagnose):
        with pytest.raises(ValueError, match="every move .* same betas"):
            judge(plain)


def test_tempered_moves_of_the_same_betas_may_be_mixed():
    other = TemperedMove(DEMCMove(mode_jump=1.0), MOVE.betas)
    chain = sampled(moves=[(MOVE, 0.9), (other, 0.1)], ensembles=2)
    assert len(ef.diagnose(chain).acceptance[0]) == 12


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"nwalkers": 35}, ValueError, "nwalkers: expected a multiple of 3"),
        ({"nwalkers": 24}, RuntimeError, "2 \\* ndim"),
        ({"moves": TemperedMove(MetropolisMove([1.0]), [1, 0])}, ValueError, "cov"),
    ],
)
def test_ensembles_that_do_not_fit_are_refused(options, error, match):
    with pytest.raises(error, match=match):
        sampled(**options)


@pytest.mark.parametrize(
    "betas", [[1.0], [0.5, 0.0], [1.0, 0.5, 0.5], [0.0, 1.0], [1.0, -0.1], [1, np.nan]]
)
def test_wrong_betas_are_refused(betas):
    with pytest.raises(ValueError, match="betas"):
        TemperedMove(DEMCMove(), betas)


@pytest.mark.parametrize("inner", [DEMCMove, MOVE, [DEMCMove()], None])
def test_what_is_no_untempered_move_is_refused(inner):
    with pytest.raises(TypeError, match="inner"):
        TemperedMove(inner, [1.0, 0.0])


def test_a_log_probability_without_blobs_is_refused():
    sampler = emcee.EnsembleSampler(36, 2, lambda x: -0.5 * x @ x, moves=MOVE)
    start = np.random.default_rng(1).normal(size=(36, 2))
    with pytest.raises(ValueError, match="log-prior .* got no blobs"):
        sampler.run_mcmc(start, 1)


def test_the_move_prints_as_the_call_that_makes_it():
    again = eval(repr(MOVE))
    assert repr(again) == repr(MOVE)
    assert again.cold(36) == slice(0, 12)


def cut(parameters, modes):
    return np.where(parameters["a"] > 0.5, 0.0, -np.inf)


def test_zero_likelihood_stays_forbidden_at_beta_zero():
    model = ef.FunctionModel(lambda p: [1.0], n_modes=1)
    prior = ef.IndependentPrior({"a": stats.uniform(0, 1)})
    posterior = ef.LogPosterior(model, cut, prior)
    start = np.random.default_rng(1).random((20, 1)) / 2 + 0.5
    start[[0, 12]] = 0.2  # plain emcee lets walkers start where they may not be
    move = TemperedMove(DEMCMove(), [1.0, 0.0])
    sampler = emcee.EnsembleSampler(20, 1, posterior, moves=move, vectorize=True)
    sampler.run_mcmc(start, 60)
    assert (sampler.get_chain()[-1] > 0.5).all()
    assert (np.delete(sampler.get_chain(), [0, 12], axis=1) > 0.5).all()
