"""TemperedMove keeps every tempered law, crosses between modes, and hides nothing."""

from concurrent.futures import ProcessPoolExecutor
from itertools import permutations
from pathlib import Path

import emcee
import numpy as np
import pytest
from emcee.model import Model
from numpy.testing import assert_array_equal
from scipy import stats
from support.checks import LIMIT, exact_start
from support.tempered_laws import BoundedLaw, GaussianLaw

import emcee_femu as ef
from emcee_femu import (
    DelayedAcceptanceMove,
    DEMCMove,
    MetropolisMove,
    SnookerMove,
    TemperedMove,
)
from emcee_femu.moves import acceptance, tempering
from emcee_femu.results.arviz_objects import samples

BETAS = [1.0, 0.3, 0.0]


def shifted(theta):
    return -0.2 * ((theta - 0.4) ** 2).sum(axis=1)


LAWS = {"gaussian": GaussianLaw(), "bounded": BoundedLaw()}
INNER = {  # each with the walkers of a block; those of the package move together
    "DE-MC, few walkers": (DEMCMove(live_dangerously=True), 4),
    "DE-MC with mode jumps": (DEMCMove(mode_jump=0.3), 8),
    "Metropolis": (MetropolisMove(sd=0.3), 1),
    "snooker, one after another": (SnookerMove(nsplits=6), 6),
    "delayed": (DelayedAcceptanceMove(MetropolisMove(sd=0.3), shifted), 3),
    "stock stretch": (emcee.moves.StretchMove(), 8),
    "stock Gaussian": (emcee.moves.GaussianMove(0.1), 2),
}


class Blocks:
    """The tempered laws of all blocks as one target."""

    def __init__(self, law, betas):
        self.law, self.betas = law, betas

    def sample(self, rng, size):
        ensembles, nwalkers = size
        n = ensembles * nwalkers // len(self.betas)
        blocks = [self.law.sample(rng, n, beta) for beta in self.betas]
        return np.concatenate([b.reshape(ensembles, -1, 3) for b in blocks], axis=1)

    def __call__(self, theta):
        return self.law.posterior(theta)

    def statistics(self, theta):
        n, walkers, _ = theta.shape
        blocks = zip(np.split(theta, len(self.betas), axis=1), self.betas, strict=True)
        found = [self.law.statistics(own.reshape(-1, 3), beta) for own, beta in blocks]
        return np.column_stack(found).reshape(n, walkers // len(self.betas), -1)


def largest_z(move, law, block=8, ensembles=100, steps=8, rows=True):
    target, n = Blocks(law, move.betas), block * len(move.betas)
    return exact_start(move, target, n, ensembles, steps, rows=rows)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("inner", INNER)
def test_every_block_keeps_its_tempered_law(law, inner):
    move, block = INNER[inner]
    assert largest_z(TemperedMove(move, BETAS), LAWS[law], block) < LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("betas", [BETAS, [1.0, 0.3], np.linspace(1, 0, 6) ** 2])
def test_every_block_keeps_its_tempered_law_at_high_power(law, betas):
    move = TemperedMove(DEMCMove(mode_jump=0.1), betas)
    assert largest_z(move, LAWS[law], ensembles=800, steps=13) < LIMIT


class Still(acceptance.ProposingMove):
    """Leaves all walkers where they are."""

    def batches(self, coords, random):
        return iter(())


def exchange_p_values(kind, betas=(1.0, 0.6, 0.2, 0.0), block=1_000):
    """Return p-values of the share of exchanges, per pair of blocks and sign.

    Only one pair may exchange, with one likelihood ratio, whose power is accepted.
    """
    found = []
    for t, gap in enumerate(-np.diff(betas)):
        for rise in (-0.7, 0.7):
            likelihood = np.full((len(betas), block), -np.inf)
            likelihood[t], likelihood[t + 1] = 5.0, 5.0 + rise / gap
            labels = np.repeat(np.arange(len(betas)), block)[:, None].astype(float)
            blobs = np.full((labels.size, 2), -3.0)
            state = emcee.State(labels.copy(), likelihood.ravel() - 3.0, blobs)
            model = Model(None, None, map, np.random.RandomState(t))
            state, _ = kind(Still(), betas).propose(model, state)
            swapped = int((state.coords[labels[:, 0] == t] == t + 1).sum())
            p = min(1, np.exp(rise))
            found.append(stats.binomtest(swapped, block, p).pvalue)
    return found


@pytest.mark.parametrize("betas", [[1.0, 0.3], [1.0, 0.3, 0.0], [1.0, 0.6, 0.2, 0.0]])
def test_every_pair_of_blocks_exchanges_by_the_ratio_of_its_likelihoods(betas):
    assert min(exchange_p_values(TemperedMove, betas)) > 1e-4


def blocks_guided_by_others(kind, betas=(1.0, 0.5, 0.0), block=4):
    """Return how many blocks moved by other guides than their own ones at rest.

    Each proposal is x_i + (x_a - x_b) / 2, and these three can be told.
    """
    wrong, calls = 0, 0
    state = emcee.State(
        np.random.default_rng(0).normal(size=(len(betas) * block, 3)),
        log_prob=np.zeros(len(betas) * block),
        blobs=np.zeros((len(betas) * block, 2)),
    )

    def flat(proposed):
        nonlocal wrong, calls
        calls += 1
        for t, own in enumerate(np.split(proposed, len(betas))):
            walkers = state.coords[t * block : (t + 1) * block]
            chosen = [
                (i, a, b)
                for q in own
                for i, a, b in permutations(range(block), 3)
                if np.allclose(walkers[i] + 0.5 * (walkers[a] - walkers[b]), q)
            ]
            moving = {i for i, _, _ in chosen}
            wrong += len(chosen) < len(own) or any(
                {a, b} & moving for _, a, b in chosen
            )
        return np.zeros(len(proposed)), np.zeros((len(proposed), 2))

    inner = DEMCMove(sigma=0.0, gamma0=0.5, live_dangerously=True)
    model = Model(None, flat, map, np.random.RandomState(0))
    kind(inner, betas).propose(model, state)
    assert calls == 2  # one for each half, of all blocks together
    return wrong


def test_every_block_is_guided_by_its_own_walkers_at_rest_in_one_call_for_all():
    assert blocks_guided_by_others(TemperedMove) == 0


def crossed(blocks, own, random):
    """Return proposals guided by the walkers that the next block moves meanwhile."""
    moving = [coords[i] for coords, i in zip(blocks, own, strict=True)]
    move = DEMCMove(sigma=0.0, gamma0=0.5)
    pairs = zip(moving, moving[1:] + moving[:1], strict=True)
    return [move.get_proposal(s, [c], random)[0] for s, c in pairs]


def mutated(original, wrong):
    """Return TemperedMove with one thing broken."""
    source = Path(tempering.__file__).read_text(encoding="utf-8")
    assert source.count(original) == 1
    names = {
        "__name__": "mutant",
        "__package__": "emcee_femu.moves",
        "crossed": crossed,
    }
    exec(source.replace(original, wrong), names)
    return names["TemperedMove"]


RATIO = "gaps * (log_likelihood[hot] - log_likelihood[cold])"
UNPACKED = "own, proposed, factors = zip(*batches, strict=True)"
EXCHANGE_MUTANTS = {
    "wrong sign": (RATIO, "-" + RATIO),
    "wrong sign of the coldest pair": (RATIO, f"{RATIO} * np.sign(cold - block + 0.5)"),
    "wrong sign of the hottest pair": (
        RATIO,
        f"{RATIO} * np.sign(len(state.coords) - hot - block - 0.5)",
    ),
    "always": ("possible & (log_ratio > threshold)", "possible"),
}
GUIDE_MUTANTS = {
    "guides of the next block": (
        UNPACKED,
        f"{UNPACKED}; proposed = crossed(blocks, own, model.random)",
    ),
    "guides before they moved": (
        "[state.coords[start : start + block] for",
        "[state.coords[start : start + block].copy() for",
    ),
}


@pytest.mark.parametrize("mutant", EXCHANGE_MUTANTS)
def test_the_share_of_exchanges_catches_a_broken_ratio(mutant):
    assert min(exchange_p_values(mutated(*EXCHANGE_MUTANTS[mutant]))) < 1e-9


@pytest.mark.parametrize("mutant", GUIDE_MUTANTS)
def test_wrong_guides_are_seen_in_the_proposals(mutant):
    assert blocks_guided_by_others(mutated(*GUIDE_MUTANTS[mutant])) > 0


def test_the_exact_start_catches_a_tempered_prior(monkeypatch):
    def prior_too(log_prob, log_prior):
        return np.maximum(log_prob, -1e300)

    monkeypatch.setattr(acceptance, "subtract_log_prior", prior_too)
    assert largest_z(TemperedMove(DEMCMove(), BETAS), LAWS["gaussian"]) > LIMIT


@pytest.mark.parametrize("kept", ["(state.coords, state.blobs)", "(state.coords,)"])
def test_the_exact_start_catches_what_is_not_exchanged(kept):
    broken = mutated("(state.coords, state.log_prob, state.blobs)", kept)
    move, law = broken(DEMCMove(), BETAS), LAWS["gaussian"]
    assert largest_z(move, law, ensembles=1) == np.inf
    assert largest_z(move, law, rows=False) > LIMIT


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
    file = tmp_path / "run.chain"
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
        ({"nwalkers": 24}, RuntimeError, "than 24, .* 8 for each of 3 .* 60 would"),
        ({"nwalkers": 3}, ValueError, "than 3, .* 1 for each of 3 .* 60 would"),
        ({"nwalkers": 2}, ValueError, "a multiple of 3, .* got 2; 60 would"),
        ({"moves": TemperedMove(MetropolisMove(sd=[1.0]), [1, 0])}, ValueError, "sd"),
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


class Synchronous(DEMCMove):
    """Accepts in a way of its own, which TemperedMove would leave out."""

    def propose(self, model, state):
        raise NotImplementedError


@pytest.mark.parametrize(
    "inner", [DEMCMove, MOVE, [DEMCMove()], None, Synchronous(), emcee.moves.Move()]
)
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


def test_the_default_walkers_suffice_for_every_temperature():
    for ndim in (1, 5, 20):
        n = MOVE.default_walkers(ndim)
        assert n == 3 * max(16, 4 * ndim)
        MOVE.check(n, ndim)
    TemperedMove(emcee.moves.StretchMove(), BETAS).check(6, ndim=1)  # 2 * ndim each


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
