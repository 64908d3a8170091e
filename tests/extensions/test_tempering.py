"""TemperedMove keeps every tempered target, crosses between modes, hides nothing."""

import emcee
import numpy as np
import pytest
from emcee.model import Model
from scipy import stats
from support.checks import LIMIT, exact_start
from support.examples import load
from support.tempered_laws import BoundedLaw, GaussianLaw

import emcee_femu as ef
from emcee_femu import DEMCMove, MetropolisMove

BETAS = [1.0, 0.3, 0.0]


def shifted(theta):
    return -0.2 * ((theta - 0.4) ** 2).sum(axis=1)


TARGETS = {"gaussian": GaussianLaw(), "bounded": BoundedLaw()}
INNER = {  # each with the walkers of a block; those of the package move together
    "DE-MC, few walkers": (DEMCMove(live_dangerously=True), 4),
    "DE-MC, in three parts": (DEMCMove(nsplits=3, mode_jump=0.3), 6),
    "Metropolis": (MetropolisMove(sd=0.3), 1),
    "delayed": (ef.moves.DelayedAcceptanceMove(MetropolisMove(sd=0.3), shifted), 3),
}


class Blocks:
    """The tempered targets of all blocks as one."""

    def __init__(self, target):
        self.target = target

    def sample(self, rng, size):
        ensembles, nwalkers = size
        n = ensembles * nwalkers // len(BETAS)
        blocks = [self.target.sample(rng, n, beta) for beta in BETAS]
        return np.concatenate([b.reshape(ensembles, -1, 3) for b in blocks], axis=1)

    def __call__(self, theta):
        return self.target.posterior(theta)

    def statistics(self, theta):
        n, walkers, _ = theta.shape
        blocks = zip(np.split(theta, len(BETAS), axis=1), BETAS, strict=True)
        values = [self.target.statistics(x.reshape(-1, 3), beta) for x, beta in blocks]
        return np.column_stack(values).reshape(n, walkers // len(BETAS), -1)


# Of a bounded law each inner move is slow but one: bounds are the posterior's matter.
@pytest.mark.parametrize(
    ("inner", "target"),
    [
        pytest.param(
            inner,
            target,
            marks=[pytest.mark.slow] * (target == "bounded" and inner != "Metropolis"),
        )
        for inner in INNER
        for target in TARGETS
    ],
)
def test_every_block_keeps_its_tempered_target(inner, target):
    move, block = INNER[inner]
    blocks, n = Blocks(TARGETS[target]), block * len(BETAS)
    assert exact_start(ef.moves.TemperedMove(move, BETAS), blocks, n, 50, 6) < LIMIT


def test_each_block_accepts_by_its_own_power_of_the_likelihood():
    """The prior falls by half with every step, and so does the likelihood."""
    betas, block = [1.0, 0.3, 0.0], 20_000
    start, blobs = np.zeros((3 * block, 1)), np.tile([-3.0, 0.0], (3 * block, 1))
    state = emcee.State(start, np.full(len(start), -5.0), blobs)

    def fall(theta):
        return np.full(len(theta), -6.0), np.tile([-3.5, 0.0], (len(theta), 1))

    model = Model(None, fall, map, np.random.RandomState(0))
    move = ef.moves.TemperedMove(MetropolisMove(sd=1.0), betas)
    _, accepted = move.propose(model, state)
    for beta, moved in zip(betas, np.split(accepted, 3), strict=True):
        p = np.exp(-0.5 - 0.5 * beta)
        assert stats.binomtest(int(moved.sum()), block, p).pvalue > 1e-4


def nowhere(theta):
    return np.full(len(theta), -np.inf), np.zeros((len(theta), 2))


@pytest.mark.parametrize("betas", [[1.0, 0.3], [1.0, 0.6, 0.2, 0.0]])
def test_every_pair_of_blocks_exchanges_by_the_ratio_of_its_likelihoods(betas):
    """Only one pair may exchange, with one ratio, whose power is accepted."""
    block = 1_000
    for t, gap in enumerate(-np.diff(betas)):
        for rise in (-0.7, 0.7):
            likelihood = np.full((len(betas), block), -np.inf)
            likelihood[t], likelihood[t + 1] = 5.0, 5.0 + rise / gap
            labels = np.repeat(np.arange(len(betas)), block)[:, None].astype(float)
            blobs = np.full((labels.size, 2), -3.0)
            state = emcee.State(labels.copy(), likelihood.ravel() - 3.0, blobs)
            model = Model(None, nowhere, map, np.random.RandomState(t))
            move = ef.moves.TemperedMove(MetropolisMove(sd=1.0), betas)
            state, _ = move.propose(model, state)
            swapped = int((state.coords[labels[:, 0] == t] == t + 1).sum())
            p = min(1.0, np.exp(rise))
            assert stats.binomtest(swapped, block, p).pvalue > 1e-4


POSTERIOR = ef.paper.mass_spring().posterior
MOVE = ef.moves.TemperedMove(DEMCMove(), [1.0, 0.2, 0.0])
OTHER = ef.moves.TemperedMove(DEMCMove(mode_jump=1.0), [1, 0.3, 0])


@pytest.mark.parametrize(
    ("options", "error", "named"),
    [
        ({"moves": [MOVE, DEMCMove()]}, ValueError, "betas"),
        ({"moves": [(MOVE, 0.5), (OTHER, 0.5)]}, ValueError, "betas"),
        ({"nwalkers": 35}, ValueError, "nwalkers: .* 3"),
        ({"nwalkers": 24}, RuntimeError, "24, .* 8 for each of 3"),
    ],
)
def test_what_does_not_fit_the_temperatures_is_refused(options, error, named):
    given = {"moves": MOVE, "nwalkers": 36, "steps": 2, "seed": 1, "ensembles": 1}
    with pytest.raises(error, match=named):
        ef.run(POSTERIOR, **given | options)
    sampler = emcee.EnsembleSampler(36, 2, lambda x: -0.5 * x @ x, moves=MOVE)
    with pytest.raises(ValueError, match="blobs"):  # they have the log-prior
        sampler.run_mcmc(np.random.default_rng(1).normal(size=(36, 2)), 1)


def test_zero_likelihood_stays_forbidden_at_beta_zero():
    model = ef.FunctionModel(lambda p: [1.0], n_modes=1)
    prior = ef.IndependentPrior({"a": stats.uniform(0, 1)})
    posterior = ef.LogPosterior(
        model, lambda p, modes: np.where(p["a"] > 0.5, 0.0, -np.inf), prior
    )
    start = np.random.default_rng(1).random((20, 1)) / 2 + 0.5
    start[[0, 12]] = 0.2  # plain emcee lets walkers start where they may not be
    move = ef.moves.TemperedMove(DEMCMove(), [1.0, 0.0])
    sampler = emcee.EnsembleSampler(20, 1, posterior, moves=move, vectorize=True)
    sampler.run_mcmc(start, 60)
    assert (sampler.get_chain()[-1] > 0.5).all()
    assert (np.delete(sampler.get_chain(), [0, 12], axis=1) > 0.5).all()


@pytest.mark.slow
def test_tempered_walkers_cross_to_the_mode_they_did_not_start_in():
    """The law of tempering: weight, mean and evidence of Beck and Au by quadrature."""
    posterior, betas = load("evidence").beck_au().posterior, np.linspace(1, 0, 7) ** 4
    move, nwalkers = ef.moves.TemperedMove(DEMCMove(), betas), 250 * len(betas)
    noise = np.random.default_rng(3).normal(size=(nwalkers, 2))
    one_mode = np.array([1.8132, 0.2470]) + np.array([0.1, 0.015]) * noise
    options = {"seed": 1, "ensembles": 1, "starts": one_mode}
    (run,) = ef.run(posterior, move, nwalkers, 1_500, **options)
    x1 = run.get_chain(discard=150)[:, move.cold(nwalkers), 0]
    assert abs((x1 < 1).mean() - 0.53079) < 0.02
    generations = x1.mean(axis=1)
    (tau,) = emcee.autocorr.integrated_time(generations[:, None], tol=0)
    error = generations.std() * np.sqrt(tau / len(generations))
    assert error < 0.01
    assert abs(x1.mean() - 1.11700) < 3 * error
    evidence = ef.log_evidence(run, discard=150)
    difference = abs(evidence.log_evidence - np.log(1.50950e-3))
    assert difference < min(3 * evidence.log_evidence_error, 0.03)
