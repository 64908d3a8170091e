"""The moves keep their target: exact-start tests, and mutants that must fail them."""

import emcee
import numpy as np
import pytest
from support.checks import LIMIT, BoundedTriangle, Gaussian, exact_start

from emcee_femu.moves import (
    CrossoverMove,
    DEMCMove,
    IndependenceMove,
    MetropolisMove,
    SnookerMove,
)
from emcee_femu.moves.acceptance import ProposingMove
from emcee_femu.moves.component_walk import ComponentWalk

TARGETS = {"gaussian": Gaussian, "bounded": BoundedTriangle}
UNIT, FAR = (1.0, 1.0, 1.0), (1e-8, 1.0, 1e8)  # areas beside stiffnesses
BOLD = {"live_dangerously": True}


def metropolis(law):
    return MetropolisMove(sd=0.6 * law.scale)


def correlated(law):
    sd = 0.6 * law.scale
    return MetropolisMove(cov=np.outer(sd, sd) * (0.5 + 0.5 * np.eye(law.ndim)))


def tuned(law):
    return MetropolisMove.tuned(law.sample(np.random.default_rng(5), (500,)))


def badly_fitted(components):
    """Return the fit to shifted draws: it must only be slower, never wrong."""

    def make(law):
        draws = law.sample(np.random.default_rng(1), (2_000,)) + 0.3 * law.scale
        return IndependenceMove.fit(draws, components)

    return make


def walk(law, kind=ComponentWalk):
    """Return a walk by a narrow and a wide component, beside each other."""
    draws = law.sample(np.random.default_rng(1), (2_000,))
    near = np.diag((0.25 * law.scale) ** 2)
    means = draws.mean(axis=0) + np.outer([0.8, -0.8], law.scale)
    mixture = IndependenceMove([0.5, 0.5], means, [near, 9.0 * near])
    return kind(mixture, scale=0.8)


CASES = [  # move, or what makes it for a target; walkers; dimension; scale
    *[(DEMCMove(**BOLD), n, 3, UNIT) for n in (4, 6, 32)],
    (DEMCMove(**BOLD), 10, 3, FAR),
    (DEMCMove(0.05, **BOLD), 6, 3, UNIT),
    (DEMCMove([0.0, 0.02, 0.3], **BOLD), 6, 3, UNIT),
    (DEMCMove(0.0, **BOLD), 6, 3, UNIT),
    (DEMCMove(gamma0=0.4, **BOLD), 6, 3, UNIT),
    (DEMCMove(mode_jump=0.5, **BOLD), 6, 3, UNIT),
    (DEMCMove(nsplits=4, **BOLD), 6, 3, UNIT),
    (DEMCMove(nsplits=6, **BOLD), 6, 3, UNIT),
    (DEMCMove(randomize_split=False, **BOLD), 6, 3, UNIT),
    *[
        (make, n, 3, scale)
        for make in (
            metropolis,
            correlated,
            tuned,
            badly_fitted(1),
            badly_fitted(3),
            walk,
        )
        for n, scale in ((1, UNIT), (6, FAR))
    ],
    # The fewest legal walkers: in two splits, one after another; then many.
    *[(SnookerMove(**BOLD), 6, ndim, UNIT) for ndim in (3, 5)],
    *[(SnookerMove(nsplits=4, **BOLD), 4, ndim, UNIT) for ndim in (3, 5)],
    *[(SnookerMove(**BOLD), 32, 5, FAR)],
    (SnookerMove((0.1, 3.0), **BOLD), 12, 3, UNIT),
    (SnookerMove((1.7, 1.7), nsplits=3, randomize_split=False), 12, 3, FAR),
    *[(CrossoverMove(**BOLD), 12, ndim, UNIT) for ndim in (3, 5)],
    *[(CrossoverMove(nsplits=7, **BOLD), 7, ndim, UNIT) for ndim in (3, 5)],
    *[(CrossoverMove(), 32, 5, FAR)],
    (CrossoverMove(1), 12, 3, UNIT),
    (CrossoverMove(2, [0.1], 0.0), 12, 3, FAR),
    (CrossoverMove(3, [1.0], 0.1, nsplits=6), 12, 3, UNIT),
    (CrossoverMove(3, [0.5, 0.9], nsplits=4, randomize_split=False), 12, 3, UNIT),
    # In one dimension, where constants and exponents have values of their own.
    *[(move, 6, 1, UNIT) for move in (DEMCMove(), SnookerMove(), CrossoverMove(1))],
    *[(make, 3, 1, UNIT) for make in (tuned, badly_fitted(1), badly_fitted(3))],
]

FEWEST = [  # of each kind that guides walkers by walkers
    *[(DEMCMove(**BOLD), n, 3, UNIT) for n in (4, 6)],
    (SnookerMove(**BOLD), 6, 3, UNIT),
    (CrossoverMove(nsplits=7, **BOLD), 7, 3, UNIT),
]


def z_of(case, target, **effort):
    make, nwalkers, ndim, scale = case
    law = TARGETS[target](scale, ndim)
    move = make if isinstance(make, ProposingMove) else make(law)
    return exact_start(move, law, nwalkers, **effort)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("case", CASES)
def test_the_move_keeps_the_target(case, target):
    assert z_of(case, target) < LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("case", FEWEST)
def test_the_move_keeps_the_target_at_high_power(case, target):
    # Ten times the power, before which a bias of the synchronous kind cannot hide.
    assert z_of(case, target, ensembles=2_000, steps=30) < LIMIT


@pytest.mark.parametrize("move", [DEMCMove(), SnookerMove(), CrossoverMove()], ids=str)
def test_scaled_axes_give_the_same_chain_as_unit_axes(move):
    # Noise and angles follow the walkers, so a change of units changes nothing.
    def chain(scale):
        target = Gaussian(scale)
        start = target.sample(np.random.default_rng(1), (12,))
        sampler = emcee.EnsembleSampler(12, 3, target, moves=move, vectorize=True)
        stream = np.random.RandomState(1).get_state()
        sampler.run_mcmc(emcee.State(start, random_state=stream), 200)
        return sampler.get_chain() / target.scale

    scale = 2.0 ** np.array([-27.0, 0.0, 27.0])  # exact in floating point
    np.testing.assert_allclose(chain(scale), chain((1, 1, 1)), rtol=1e-9)


# Mutants: each breaks a move in one way, and the exact start must see it.


class Synchronous(DEMCMove):
    """Moves all walkers from one generation."""

    def batches(self, coords, random):
        others = [[np.delete(coords, i, axis=0)] for i in range(len(coords))]
        pairs = zip(coords[:, None], others, strict=True)
        proposed = [self.get_proposal(one, c, random)[0] for one, c in pairs]
        yield np.arange(len(coords)), np.vstack(proposed), None


class GuidedByItself:
    """May take the walker that it moves for one of a pair."""

    def get_proposal(self, s, c, random):
        propose = super().get_proposal
        proposed = [propose(one[None], [np.vstack([*c, one])], random) for one in s]
        return np.vstack([q for q, _ in proposed]), None


class SelfishDEMC(GuidedByItself, DEMCMove):
    pass


class SelfishCrossover(GuidedByItself, CrossoverMove):
    pass


class OneSign(DEMCMove):
    """Takes differences of one sign only along the first axis."""

    def get_proposal(self, s, c, random):
        proposed, _ = super().get_proposal(s, c, random)
        step = proposed - s
        return s + np.where(step[:, :1] < 0, -step, step), None


class AcceptsWithoutLimit(DEMCMove):
    """Accepts what ``wrong`` says, whatever the Metropolis ratio."""

    def __init__(self, wrong, **settings):
        super().__init__(**settings)
        self.wrong = wrong

    def propose(self, model, state):
        def generous(q):
            log_prob, blobs = model.compute_log_prob_fn(q)
            return np.where(self.wrong(log_prob).astype(bool), 1e300, log_prob), blobs

        state, accepted = super().propose(
            model._replace(compute_log_prob_fn=generous), state
        )
        found = model.compute_log_prob_fn(state.coords)[0]
        state.log_prob[:] = np.maximum(found, -1e300)  # all at -inf would be refused
        return state, accepted


class AsymmetricMetropolis(MetropolisMove):
    """Steps by a scale that depends on where the walker is."""

    def batches(self, coords, random):
        scaled = MetropolisMove(sd=0.1 + 0.5 * np.abs(coords[0, 0] - 3))
        return scaled.batches(coords, random)


class Textbook(SnookerMove):
    """The snooker update walker by walker, with two exponents to break it by."""

    def __init__(self, length=1.0, jacobian=1.0, **settings):
        super().__init__(**settings)
        self.length, self.jacobian = length, jacobian

    def get_proposal(self, s, c, random):
        guides, sd = np.concatenate(c), np.concatenate(c).std(axis=0)
        proposed, factors = np.empty_like(s), np.empty(len(s))
        for i, theta in enumerate(s / sd):
            z, z1, z2 = guides[random.choice(len(guides), 3, replace=False)] / sd
            norm = np.linalg.norm(theta - z)
            u = (theta - z) / norm**self.length
            new = theta + random.uniform(*self.gamma) * u * (u @ z1 - u @ z2)
            proposed[i] = new * sd
            factors[i] = np.log(np.linalg.norm(new - z) / norm)
        return proposed, self.jacobian * (s.shape[1] - 1) * factors


class NoHastingsFactor(IndependenceMove):
    def log_density(self, theta):
        return np.zeros(len(theta))


class OneTailForAll(IndependenceMove):
    """Evaluates the density with another df than it draws with."""

    def log_density(self, theta):
        other = IndependenceMove(self.weights, self.means, self.scale_matrices, 50.0)
        return other.log_density(theta)


class WalkWithoutFactor(ComponentWalk):
    """Takes the step there for as likely as the step back."""

    def batches(self, coords, random):
        for walkers, proposed, _ in super().batches(coords, random):
            yield walkers, proposed, None


SHIFTED = Gaussian().sample(np.random.default_rng(1), (2_000,)) + 0.3
MUTANTS = {  # move, target, walkers, dimension, ensembles
    # The bias of the first is the smallest, 13 % of a variance.
    "all from one generation": (Synchronous(**BOLD), "gaussian", 4, 3, 2_500),
    "DE-MC guided by itself": (SelfishDEMC(**BOLD), "gaussian", 4, 3, 100),
    "crossover guided by itself": (SelfishCrossover(1, **BOLD), "gaussian", 4, 3, 200),
    "differences of one sign": (OneSign(), "gaussian", 6, 3, 50),
    "-inf accepted": (AcceptsWithoutLimit(np.isneginf), "bounded", 6, 3, 50),
    "all accepted": (AcceptsWithoutLimit(np.ones_like), "gaussian", 6, 3, 50),
    "asymmetric steps": (AsymmetricMetropolis(sd=0.5), "gaussian", 1, 3, 1_500),
    "snooker without Jacobian": (Textbook(jacobian=0.0), "gaussian", 10, 5, 50),
    "snooker, exponent halved": (Textbook(jacobian=0.5), "gaussian", 10, 5, 50),
    "snooker, emcee's direction": (Textbook(length=0.5), "gaussian", 10, 5, 300),
    "snooker of emcee 3.1.6": (Textbook(0.5, 0.5), "gaussian", 10, 5, 150),
    "no density": (NoHastingsFactor.fit(SHIFTED, df=3.0), "gaussian", 6, 3, 50),
    "another tail": (OneTailForAll.fit(SHIFTED, df=3.0), "gaussian", 6, 3, 50),
    "no factor": (walk(Gaussian(), WalkWithoutFactor), "gaussian", 99, 3, 100),
}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_the_check_catches_a_broken_move(mutant):
    move, target, nwalkers, ndim, ensembles = MUTANTS[mutant]
    case = move, nwalkers, ndim, UNIT
    assert z_of(case, target, ensembles=ensembles) > LIMIT


def test_the_textbook_form_of_the_snooker_update_passes_the_check():
    assert z_of((Textbook(**BOLD), 6, 3, UNIT), "gaussian") < LIMIT
